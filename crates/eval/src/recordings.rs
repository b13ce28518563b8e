//! Recorded flights from files and folders, as identification wants them.
//!
//! Owns which files are meant, what of a file counts as an observation, and the reasons for what does
//! not. A file that cannot be used never stops the others. Where a recording is cut into pieces is
//! decided by the caller.

pub(crate) mod from_rows;
pub(crate) mod known_flights;
pub mod rows;
pub mod ticks;

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, Sticks, pose, stick};
use horizon_model::setting::SettingError;
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use sha2::{Digest, Sha256};
use tello_flight::FilterSettings;
use tello_io::log::{LogReader, csv};

use tello_io::atomic_file::{self, RECORDING_BYTES_MAX};
use tello_io::config;

use self::known_flights::Motions;
use crate::flight_log;

/// Period of every recording. s
pub const PERIOD_S: f64 = 0.02;

/// First bytes of every MCAP file.
const MCAP_MAGIC: &[u8] = b"\x89MCAP";

/// Names of the files of a folder that are recordings.
const EXTENSIONS: [&str; 3] = ["log", "csv", "mcap"];

/// Longest gap in a recording that is bridged with missing observations: one second. steps
pub(crate) const GAP_STEPS_MAX: u64 = 50;

/// No room is so large. m and rad
const POSE_MAX: f64 = 1000.0;

/// A recording that can be used.
#[derive(Debug, Clone, PartialEq)]
pub struct Loaded {
    /// Where it was read.
    pub path: PathBuf,
    /// SHA-256 of the file's bytes, hexadecimal.
    pub sha256: String,
    /// Whether it is marked as one of a simulated vehicle.
    pub is_simulated: bool,
    /// Every step of [`PERIOD_S`], the missing ones included. What is not accepted is not observed.
    pub recording: Recording<{ stick::COUNT }, { pose::COUNT }>,
    /// Parts that were left out, and why.
    pub skipped: Vec<String>,
    /// Hashes of its runs of positions, by which a copy is known.
    pub motions: BTreeSet<u64>,
}

/// A log that was not used.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct FileSkipped {
    /// Where it was looked for.
    pub path: PathBuf,
    /// Why it was not used.
    pub why: String,
}

/// The recordings in `paths`, files and folders, in the order of [`find`]; and the files that cannot
/// be used, with the reason. Of the copies of a flight one is used.
///
/// | kind of file | an observation is | an input is |
/// |---|---|---|
/// | CSV | a `pos` line. In a raw recording (an object at the origin, or headings that wrap) what the flight's filter accepts of it; a repeated pose is a stall, unless the file rounds to a centimetre | an `input` line |
/// | log of a flight | a filtered pose that the filter accepted, while flying | the sticks sent |
/// | converted CSV | as in the CSV | as in the CSV |
///
/// An input is held until the next one. Up to a second without any line is bridged; of a recording with
/// a longer gap the longest part is used. A recording without pose or with constant sticks is not usable.
///
/// # Errors
/// As [`find`].
pub fn load(paths: &[PathBuf]) -> Result<(Vec<Loaded>, Vec<FileSkipped>)> {
    let filter = &config::fly(None, None)?.0.cycle.filter;
    let filter = filter.try_into().map_err(|error: SettingError| error.under("cycle.filter"))?;
    read_once(
        paths,
        |path| load_one(path, filter),
        |log: &Loaded| (log.sha256.as_str(), &log.motions),
    )
}

/// What `read` makes of each recording in `paths`, in the order of [`find`]; and the files that cannot be used, with
/// the reason. `key` gives the SHA-256 of its bytes and its motions: of the copies of a flight one is used.
///
/// # Errors
/// As [`find`].
pub(crate) fn read_once<T: Send>(
    paths: &[PathBuf],
    read: impl Fn(&Path) -> Result<T> + Sync,
    key: impl Fn(&T) -> (&str, &Motions),
) -> Result<(Vec<T>, Vec<FileSkipped>)> {
    let (files, mut unusable) = find(paths)?;
    let results: Vec<Result<T>> = files.par_iter().map(|path| read(path)).collect();
    let mut known = Vec::with_capacity(files.len());
    for (path, result) in files.into_iter().zip(results) {
        match result {
            Ok(one) => known.push((path, one)),
            Err(error) => unusable.push(FileSkipped { path, why: format!("{error:#}") }),
        }
    }
    // Twice the same flight would count as two.
    let keys: Vec<_> = known.iter().map(|(_, one)| key(one)).collect();
    let why = |(index, original): (usize, Option<usize>)| {
        let original = original?;
        let what = if keys[original].0 == keys[index].0 { "bytes" } else { "poses" };
        Some(format!("its {what} are those of {}", known[original].0.display()))
    };
    let whys: Vec<_> = known_flights::originals(&keys).into_iter().enumerate().map(why).collect();
    let mut once = Vec::with_capacity(known.len());
    for ((path, one), why) in known.into_iter().zip(whys) {
        match why {
            None => once.push(one),
            Some(why) => unusable.push(FileSkipped { path, why }),
        }
    }
    Ok((once, unusable))
}

/// The files that `paths` name, each once: a file as it is, of a folder every recording by its name,
/// `2.log` before `10.log`. Then those whose names are not UTF-8: reports name files in JSON, which has no other texts.
///
/// # Errors
/// A path does not exist, or a folder has no recording or cannot be read.
pub fn find(paths: &[PathBuf]) -> Result<(Vec<PathBuf>, Vec<FileSkipped>)> {
    let mut files: Vec<PathBuf> = Vec::new();
    for path in paths {
        let kind = fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?;
        if !kind.is_dir() {
            files.push(path.clone());
            continue;
        }
        let mut inside = recordings_in(path)
            .with_context(|| format!("cannot read the folder {}", path.display()))?;
        if inside.is_empty() {
            bail!("no recording in {}: no file named *.log, *.csv or *.mcap", path.display());
        }
        inside.sort_by(|a, b| natural(&a.to_string_lossy(), &b.to_string_lossy()));
        files.append(&mut inside);
    }
    let mut known = BTreeSet::new();
    files.retain(|path| known.insert(path.canonicalize().unwrap_or_else(|_| path.clone())));
    let (files, unnamed): (Vec<_>, Vec<_>) =
        files.into_iter().partition(|path| path.to_str().is_some());
    let skipped = |path: PathBuf| FileSkipped {
        path: path.to_string_lossy().into_owned().into(),
        why: "its name is not UTF-8: choose another one".to_owned(),
    };
    Ok((files, unnamed.into_iter().map(skipped).collect()))
}

fn recordings_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let extension = path.extension().and_then(|extension| extension.to_str());
        if extension.is_some_and(|extension| EXTENSIONS.contains(&extension)) && path.is_file() {
            found.push(path);
        }
    }
    Ok(found)
}

/// Order of names in which runs of digits are numbers.
fn natural(a: &str, b: &str) -> Ordering {
    let is_digit = |c: &char| c.is_ascii_digit();
    let chunks = |text: &str| -> Vec<String> {
        let letters: Vec<char> = text.chars().collect();
        letters
            .chunk_by(|a, b| is_digit(a) == is_digit(b))
            .map(|run| run.iter().collect())
            .collect()
    };
    // Of numbers without leading zeros the longer one is larger, whatever its length.
    let number = |chunk: &str| -> Option<(usize, String)> {
        let digits = chunk.trim_start_matches('0');
        chunk.starts_with(|c| is_digit(&c)).then(|| (digits.len(), digits.to_owned()))
    };
    let (a_chunks, b_chunks) = (chunks(a), chunks(b));
    let pairs = a_chunks.iter().zip(&b_chunks).map(|(a, b)| match (number(a), number(b)) {
        (Some(a), Some(b)) => a.cmp(&b),
        _ => a.cmp(b),
    });
    pairs.fold(Ordering::Equal, Ordering::then).then_with(|| a.cmp(b))
}

/// Whether a file begins as MCAP files do; `None` if it is empty.
///
/// # Errors
/// It cannot be read.
pub fn begins_as_mcap(path: &Path) -> io::Result<Option<bool>> {
    let mut head = Vec::new();
    fs::File::open(path)?.take(MCAP_MAGIC.len() as u64).read_to_end(&mut head)?;
    Ok((!head.is_empty()).then(|| head == MCAP_MAGIC))
}

/// Whether a file with a flight, which an empty file is not, begins as MCAP files do.
pub(crate) fn is_mcap(path: &Path) -> Result<bool> {
    begins_as_mcap(path)
        .with_context(|| format!("cannot read {}", path.display()))?
        .with_context(|| format!("{} is empty: there is no flight in it", path.display()))
}

fn load_one(path: &Path, filter: FilterSettings) -> Result<Loaded> {
    let bytes = atomic_file::read(path, RECORDING_BYTES_MAX).context("it cannot be read")?;
    let (mut skipped, mut is_simulated, mut motions) = (Vec::new(), false, Motions::new());
    let samples = if bytes.is_empty() {
        bail!("it is empty");
    } else if bytes.starts_with(MCAP_MAGIC) {
        let mut log = LogReader::open(path)?;
        is_simulated = flight_log::is_simulated(&log);
        if rows::is_recording(&log) {
            from_rows::samples(rows::of_log(&mut log)?, filter, &mut skipped)?
        } else {
            let ticks = ticks::of_recording(&mut log, &mut skipped)?;
            motions = known_flights::of_ticks(&ticks);
            ticks.iter().map(ticks::sample).collect()
        }
    } else {
        from_rows::samples(csv::flight(&bytes)?.into(), filter, &mut skipped)?
    };
    let recording = assemble(&samples, &mut skipped).map_err(|error| because(error, &skipped))?;
    motions.append(&mut known_flights::of_recording(&recording));
    let sha256 = format!("{:x}", Sha256::digest(&bytes));
    Ok(Loaded { path: path.to_owned(), sha256, is_simulated, recording, skipped, motions })
}

/// An error with what was left out of the file, which may have caused it.
fn because(error: anyhow::Error, skipped: &[String]) -> anyhow::Error {
    if skipped.is_empty() { error } else { anyhow::anyhow!("{error}; {}", skipped.join("; ")) }
}

/// Input and observation of one step of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Sample {
    step: u64,
    /// Sticks sent, if the file has them.
    u: Option<Sticks>,
    o: Observed<{ pose::COUNT }>,
    /// Whether no vehicle gets to this pose from the one before it.
    has_jumped: bool,
}

/// The recording of samples by ascending step.
fn assemble(
    samples: &[Sample],
    skipped: &mut Vec<String>,
) -> Result<Recording<{ stick::COUNT }, { pose::COUNT }>> {
    let follows = |a: &Sample, b: &Sample| b.step - a.step <= GAP_STEPS_MAX + 1 && !b.has_jumped;
    let parts = samples.chunk_by(follows);
    let Some(part) = parts.max_by_key(|part| part.len()) else { bail!("no step in it") };
    let beyond = "beyond a gap of more than a second or a jump of the pose";
    note(skipped, samples.len() - part.len(), "step", beyond);
    let (mut u, mut o) = (Vec::with_capacity(part.len()), Vec::with_capacity(part.len()));
    let mut u_sent = Sticks::zeros();
    let (mut missing, mut too_wide, mut too_far) = (0, 0, 0);
    let mut step = part.first().map_or(0, |first| first.step);
    for sample in part {
        for _ in step..sample.step {
            missing += 1;
            u.push(u_sent);
            o.push(Observed::missing());
        }
        step = sample.step + 1;
        match sample.u {
            Some(sent) if sent.amax() <= 1.0 => u_sent = sent,
            Some(_) => too_wide += 1,
            None => {}
        }
        u.push(u_sent);
        let is_far = sample.o.o.amax() > POSE_MAX;
        too_far += usize::from(is_far);
        o.push(if is_far { Observed::missing() } else { sample.o });
    }
    note(skipped, missing, "step", "missing");
    note(skipped, too_wide, "input", "beyond full sticks");
    note(skipped, too_far, "pose", "out of any room");
    if !o.iter().any(|o| o.is_present.contains(&true)) {
        bail!("no pose that can be used");
    }
    if u.iter().all(|sent| Some(sent) == u.first()) {
        bail!("constant sticks: nothing moves the vehicle by command");
    }
    Ok(Recording { u, o })
}

/// Notes that `count` of `noun`, which is singular, were left out, if any were.
pub(crate) fn note(skipped: &mut Vec<String>, count: usize, noun: &str, which: &str) {
    if count > 0 {
        let plural = if count == 1 { "" } else { "s" };
        skipped.push(format!("{count} {noun}{plural} {which}"));
    }
}

/// Observation of `o`; a missing one if there is none.
fn observed(o: Option<Pose>) -> Observed<{ pose::COUNT }> {
    o.map_or_else(Observed::missing, Observed::full)
}

#[cfg(test)]
mod tests;
