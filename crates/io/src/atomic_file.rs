//! Files that appear whole or not at all, and files read whole.
//!
//! Owns the way by a temporary neighbour: a reader, or a run that is killed, never meets half a file. What is there and
//! is no regular file (`/dev/null`, a pipe) is written and never replaced.

use std::fs;
use std::io::{self, Read};
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, MetadataExt as _, chown};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use parking_lot::Mutex;
use serde::Serialize;

/// Every [`Part`] of this program that is not finished, and the folder of [`pass_on`].
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

/// Removes the files of this program that are not finished: it is about to end without dropping their [`Part`]s.
pub fn remove_unfinished() {
    UNFINISHED.lock().drain(..).for_each(remove);
}

/// Removes a file, or a folder with what is in it.
fn remove(part: PathBuf) {
    if fs::remove_file(&part).is_err() {
        fs::remove_dir_all(part).ok();
    }
}

/// Lets `fill` create and fill a file beside `path`, which then takes the name `path`; returns the result of `fill`. A
/// link is followed. Into a device or pipe the bytes of the file are copied.
///
/// # Errors
/// `path` exists and `is_replaced` is false, or its folder cannot be written; the error of `fill`.
/// `path` is as it was then, and nothing is left beside it.
pub fn write<T>(
    path: &Path,
    is_replaced: bool,
    fill: impl FnOnce(&Path) -> Result<T>,
) -> Result<T> {
    let takes_bytes = takes_bytes(path)?;
    if !is_replaced {
        refuse_existing(path)?;
    }
    if takes_bytes {
        return pass_on(path, fill).with_context(|| format!("cannot write {}", path.display()));
    }
    let part = Part::of(path)?;
    let filled = fill(part.path()).with_context(|| format!("cannot write {}", path.display()))?;
    if is_replaced {
        part.finish()?;
    } else {
        part.finish_new()?;
    }
    Ok(filled)
}

/// Writes `contents`, whole or not at all.
///
/// # Errors
/// As [`write()`].
pub fn write_contents(path: &Path, is_replaced: bool, contents: impl AsRef<[u8]>) -> Result<()> {
    write(path, is_replaced, |part| Ok(fs::write(part, contents)?))
}

/// The file beside another one that takes its name when it is finished, and is removed if it is not.
#[derive(Debug)]
pub struct Part {
    /// `None` when it has its name.
    part: Option<PathBuf>,
    path: PathBuf,
}

impl Part {
    /// Of a file at `path` that is there or not; of a link, beside what it points to.
    ///
    /// # Errors
    /// `path` is no file name.
    pub fn of(path: &Path) -> Result<Self> {
        let path = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let part = part_of(&path)?;
        UNFINISHED.lock().push(part.clone());
        Ok(Self { part: Some(part), path })
    }

    /// Where to create it.
    pub fn path(&self) -> &Path {
        self.part.as_deref().unwrap_or(&self.path)
    }

    /// Gives it its name, in place of what has it: with its bytes on the disk, so that a power cut leaves the one or
    /// the other.
    ///
    /// # Errors
    /// The file system refuses.
    pub fn finish(mut self) -> Result<()> {
        self.sync()?;
        if let Ok(there) = fs::metadata(&self.path) {
            // Its group may write it as before; some systems have no owners.
            chown(self.path(), None, Some(there.gid())).ok();
            fs::set_permissions(self.path(), there.permissions()).ok();
        }
        fs::rename(self.path(), &self.path).with_context(|| {
            format!("cannot write {}: it cannot be renamed", self.path.display())
        })?;
        if let Some(part) = self.part.take() {
            forget(&part);
        }
        Ok(())
    }

    /// The same, but nothing is replaced: neither what another process has written there meanwhile.
    fn finish_new(self) -> Result<()> {
        self.sync()?;
        match fs::hard_link(self.path(), &self.path) {
            Ok(()) => Ok(()),
            Err(_) if is_there(&self.path) => {
                bail!(
                    "{} exists already: another process has written it meanwhile",
                    self.path.display()
                )
            }
            // A file system may have no hard links.
            Err(_) => self.finish(),
        }
    }

    fn sync(&self) -> Result<()> {
        fs::File::open(self.path())
            .and_then(|part| part.sync_all())
            .with_context(|| format!("cannot write {}", self.path.display()))
    }
}

impl Drop for Part {
    fn drop(&mut self) {
        if let Some(part) = &self.part {
            // What could not be created is not there, and what could not be written stays unfinished.
            fs::remove_file(part).ok();
            forget(part);
        }
    }
}

/// The file is not unfinished any more.
fn forget(part: &Path) {
    UNFINISHED.lock().retain(|unfinished| unfinished != part);
}

/// Refuses a file that is there.
fn refuse_existing(path: &Path) -> Result<()> {
    if is_there(path) {
        bail!("{} exists already: choose another name, or replace it with --force", path.display());
    }
    Ok(())
}

/// Whether `path` names a file, or a link to one that may be missing.
pub fn is_there(path: &Path) -> bool {
    fs::symlink_metadata(path).is_ok()
}

/// Checks what [`write()`] would refuse of `path`, before the work whose result it shall take. Leaves nothing behind.
///
/// # Errors
/// `path` exists and `is_replaced` is false, and as [`probe`].
pub fn prepare(path: &Path, is_replaced: bool) -> Result<()> {
    probe(path)?;
    if is_replaced { Ok(()) } else { refuse_existing(path) }
}

/// Refuses a result `to` that would replace its own source `from`.
///
/// # Errors
/// Both are one file.
pub fn keep_apart(from: &Path, to: &Path) -> Result<()> {
    let is_one = to.canonicalize().is_ok_and(|to| from.canonicalize().is_ok_and(|from| from == to));
    ensure!(!is_one, "{} would replace itself: choose another name with -o", from.display());
    Ok(())
}

/// Tries whether [`write()`] could create its file, before the work whose result `path` shall take. Leaves nothing
/// behind.
///
/// # Errors
/// `path` is a folder, a socket or a disk, is read-only, a link to nothing, or names no file, or its folder is missing
/// or cannot be written.
pub fn probe(path: &Path) -> Result<()> {
    if takes_bytes(path)? {
        return Ok(());
    }
    let part = part_of(&fs::canonicalize(path).unwrap_or_else(|_| path.to_owned()))?;
    fs::write(&part, "")
        .and_then(|()| fs::remove_file(&part))
        .with_context(|| format!("cannot write {}", path.display()))
}

/// Whether `path` is a device or pipe: a file that is renamed to it would take its place.
///
/// # Errors
/// It is something else that is no file, is read-only, or a link that leads to no file.
fn takes_bytes(path: &Path) -> Result<bool> {
    let Ok(there) = fs::metadata(path) else {
        ensure!(!is_there(path), "cannot write {}: it is a link to nothing", path.display());
        return Ok(false);
    };
    let kind = there.file_type();
    if kind.is_dir() {
        bail!("cannot write {}: it is a folder", path.display());
    }
    ensure!(!there.permissions().readonly(), "cannot write {}: it is read-only", path.display());
    let takes_bytes = kind.is_char_device() || kind.is_fifo();
    if !(takes_bytes || kind.is_file()) {
        bail!("cannot write {}: it is no file, no pipe and no character device", path.display());
    }
    Ok(takes_bytes)
}

/// Lets `fill` fill a file in a folder that nobody else can write, and copies its bytes into `path`.
fn pass_on<T>(path: &Path, fill: impl FnOnce(&Path) -> Result<T>) -> Result<T> {
    let folder = std::env::temp_dir().join(format!("tello-ctl-{}.part", std::process::id()));
    fs::DirBuilder::new()
        .mode(0o700)
        .create(&folder)
        .with_context(|| format!("cannot make {}", folder.display()))?;
    UNFINISHED.lock().push(folder.clone());
    let part = folder.join("part");
    let written = fill(&part).and_then(|filled| {
        let mut into = fs::OpenOptions::new().write(true).open(path)?;
        io::copy(&mut fs::File::open(&part)?, &mut into)?;
        Ok(filled)
    });
    fs::remove_dir_all(&folder).ok();
    forget(&folder);
    written
}

/// The neighbour of `path` that is filled.
fn part_of(path: &Path) -> Result<PathBuf> {
    let Some(name) = path.file_name() else { bail!("{} is no file name", path.display()) };
    let part = format!(".{}.{}.part", name.to_string_lossy(), std::process::id());
    Ok(path.with_file_name(part))
}

/// Longest recording that is read whole. bytes
pub const RECORDING_BYTES_MAX: u64 = 2 << 30;

/// The bytes of `path`, which may be no ordinary file: what never ends must not fill the memory.
///
/// # Errors
/// Those of the file system; more than `bytes_max`.
pub fn read(path: &Path, bytes_max: u64) -> io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(bytes_max.saturating_add(1)).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > bytes_max {
        return Err(io::Error::other(format!("it has more than {bytes_max} bytes")));
    }
    Ok(bytes)
}

/// Writes `value` as JSON for people, whole or not at all.
///
/// # Errors
/// As [`write()`]; a value that has no JSON form.
pub fn write_json(path: &Path, is_replaced: bool, value: &impl Serialize) -> Result<()> {
    let json = serde_json::to_string_pretty(value)? + "\n";
    write_contents(path, is_replaced, json)
}

#[cfg(test)]
mod tests;
