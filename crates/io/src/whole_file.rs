//! Files that appear whole or not at all.
//!
//! Owns the way by a temporary neighbour: a reader, or a run that is killed, never meets half a file.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result, bail};
use serde::Serialize;

/// Lets `fill` create and fill a file beside `path`, which then takes the name `path`.
///
/// # Errors
/// `path` exists and `is_replaced` is false, or its folder cannot be written; the error of `fill`.
/// `path` is as it was then, and nothing is left beside it.
pub fn write(path: &Path, is_replaced: bool, fill: impl FnOnce(&Path) -> Result<()>) -> Result<()> {
    if !is_replaced && path.exists() {
        bail!("{} exists already: choose another name, or replace it with --force", path.display());
    }
    let Some(name) = path.file_name() else { bail!("{} is no file name", path.display()) };
    let part = format!(".{}.{}.part", name.to_string_lossy(), std::process::id());
    let part = path.with_file_name(part);
    let written = fill(&part)
        .and_then(|()| fs::rename(&part, path).context("it cannot be renamed"))
        .with_context(|| format!("cannot write {}", path.display()));
    if written.is_err() {
        // What could not be created is not there, and what could not be written stays unfinished.
        fs::remove_file(&part).ok();
    }
    written
}

/// Writes `value` as JSON for people, in place of what was there.
///
/// # Errors
/// As [`write()`]; a value that has no JSON form.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let json = serde_json::to_string_pretty(value)? + "\n";
    write(path, true, |part| Ok(fs::write(part, json)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    fn folder(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("tello-ctl-{}-{name}", std::process::id()));
        fs::create_dir_all(&folder).unwrap();
        folder
    }

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn a_file_is_kept_unless_it_may_be_replaced() {
        let folder = folder("kept");
        let path = folder.join("a.txt");
        let fill = |text: &'static str| move |part: &Path| Ok(fs::write(part, text)?);
        write(&path, false, fill("first")).unwrap();
        let error = write(&path, false, fill("second")).unwrap_err();
        assert!(error.to_string().contains("--force"), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "first");
        write(&path, true, fill("third")).unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "third");
        assert_eq!(names(&folder), ["a.txt"]);
        fs::remove_dir_all(folder).unwrap();
    }

    #[test]
    fn a_failure_leaves_nothing_and_spoils_nothing() {
        let folder = folder("failure");
        let path = folder.join("a.txt");
        fs::write(&path, "before").unwrap();
        let half = |part: &Path| {
            fs::write(part, "half")?;
            bail!("the disk is full")
        };
        let error = write(&path, true, half).unwrap_err();
        assert_eq!(
            format!("{error:#}"),
            format!("cannot write {}: the disk is full", path.display())
        );
        assert_eq!(fs::read_to_string(&path).unwrap(), "before");
        assert_eq!(names(&folder), ["a.txt"]);
        assert!(write(&folder.join("no/a.txt"), true, |part| Ok(fs::write(part, "")?)).is_err());
        fs::remove_dir_all(folder).unwrap();
    }
}
