//! Part files: some rows of a batch, a campaign or a bootstrap, from one process of many.
//!
//! A part is text, one JSON value a line: what was asked for ([`PartHeader`]), one row per seed, and a checksum of the
//! lines before it. It appears whole or not at all. A row depends on settings and seed alone, so rows from any
//! machines with equal heads are, side by side, the rows of one process, bit for bit.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use tello_io::atomic_file;
use thiserror::Error;

use crate::REVISION;

/// First field of a part file.
const FORMAT: &str = "tello-ctl part 1";

/// Kind of the rows of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// Flights of a batch, one of each contender in a row.
    Batch,
    /// Flights of a fault-injection campaign.
    Campaign,
    /// Estimates of an identification; their seeds are the indices of the resamples.
    Bootstrap,
}

/// Part `part` of `parts` of a batch, a campaign or a bootstrap, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PartNumber {
    part: u64,
    parts: u64,
}

impl PartNumber {
    /// The only part, if a batch is not divided.
    pub const ONLY: Self = Self { part: 1, parts: 1 };

    /// Number of the part, counted from 1, and number of parts.
    pub fn numbers(self) -> [u64; 2] {
        [self.part, self.parts]
    }
}

/// A text that names no part.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is not i/n with 1 <= i <= n, e.g. 2/8")]
pub struct ParsePartError(String);

impl FromStr for PartNumber {
    type Err = ParsePartError;

    fn from_str(text: &str) -> Result<Self, ParsePartError> {
        let numbers = |text: &str| {
            let (part, parts) = text.split_once('/')?;
            Some((part.parse().ok()?, parts.parse().ok()?))
        };
        match numbers(text) {
            Some((part, parts)) if (1..=parts).contains(&part) => Ok(Self { part, parts }),
            _ => Err(ParsePartError(text.to_owned())),
        }
    }
}

/// First line of a part file: what was asked for, equal in all parts but for the number of the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartHeader {
    format: String,
    /// Git revision of the program.
    revision: String,
    /// Kind of the rows.
    pub kind: Kind,
    /// SHA-256 of `settings`, hexadecimal.
    settings_sha256: String,
    /// All settings that the rows depend on.
    pub settings: Value,
    /// Names of the settings of both contenders, for the table.
    pub names: [String; 2],
    /// First seed of all parts.
    pub seed: u64,
    /// Number of seeds of all parts.
    pub count: u64,
    /// Number of this part, from 1.
    part: u64,
    /// Number of all parts.
    parts: u64,
}

/// A row of a part file.
pub trait Seeded: Serialize + DeserializeOwned + PartialEq {
    /// The seed that the row belongs to.
    fn seed(&self) -> Option<u64>;
}

/// The rows of all contenders with one seed.
impl<T: Seeded> Seeded for Vec<T> {
    fn seed(&self) -> Option<u64> {
        self.first().and_then(Seeded::seed)
    }
}

impl PartHeader {
    /// The header of part `part` of `parts`, of `count` seeds from `seed` on. `settings` are those of the run, `names`
    /// as in [`PartHeader::names`].
    pub fn new(
        kind: Kind,
        (settings, names): (Value, [String; 2]),
        (seed, count): (u64, u64),
        PartNumber { part, parts }: PartNumber,
    ) -> Self {
        let settings_sha256 = checksum(settings.to_string().as_bytes());
        let (format, revision) = (FORMAT.into(), REVISION.into());
        Self { format, revision, kind, settings_sha256, settings, names, seed, count, part, parts }
    }

    /// The seeds of this part: neighbours, as evenly many in each part as possible.
    pub fn seeds(&self) -> Range<u64> {
        let until = |part: u64| {
            let done = u128::from(self.count) * u128::from(part) / u128::from(self.parts);
            self.seed.saturating_add(u64::try_from(done).unwrap_or(u64::MAX))
        };
        until(self.part.saturating_sub(1))..until(self.part)
    }

    /// Which part it is, from 1, and of how many.
    pub fn numbers(&self) -> [u64; 2] {
        [self.part, self.parts]
    }

    /// Revision of the program that computed it.
    pub fn revision(&self) -> &str {
        &self.revision
    }

    /// Why a part with the header `other` does not belong to this one; `None` if it does.
    pub fn difference(&self, other: &Self) -> Option<String> {
        let differs = |what: &str, ours: &dyn std::fmt::Debug, theirs: &dyn std::fmt::Debug| {
            Some(format!("another {what}: {theirs:?} in place of {ours:?}"))
        };
        if self.kind != other.kind {
            differs("kind", &self.kind, &other.kind)
        } else if self.revision != other.revision {
            differs("revision of the program", &self.revision, &other.revision)
        } else if self.settings != other.settings {
            differs("hash of the settings", &self.settings_sha256, &other.settings_sha256)
        } else if (self.seed, self.count) != (other.seed, other.count) {
            let ours = (self.seed, self.count);
            differs("first seed and count", &ours, &(other.seed, other.count))
        } else if self.parts != other.parts {
            differs("number of parts", &self.parts, &other.parts)
        } else {
            None
        }
    }
}

/// Writes a part, whole or not at all.
///
/// # Errors
/// A file that is there already, such as another part; rows that are not those of the seeds, or do not survive their
/// JSON form (numbers that are not finite); a folder that cannot be written.
pub fn write<T: Seeded>(path: &Path, header: &PartHeader, rows: &[T]) -> Result<()> {
    let mut text = serde_json::to_string(header)? + "\n";
    for row in rows {
        let line = serde_json::to_string(row)?;
        text.push_str(&line);
        text.push('\n');
    }
    text += &tail_of(&text);
    let (_, again) = parse::<T>(&text)?;
    ensure!(again == rows, "{}: a row does not survive its JSON form", path.display());
    // Another process may have written its part meanwhile: there is no --force for parts.
    let is_there = atomic_file::is_there(path);
    ensure!(!is_there, "{} exists already: choose another name", path.display());
    atomic_file::write_contents(path, false, text)
}

/// Header and rows of the part at `path`.
///
/// # Errors
/// A file that cannot be read, is none, torn or altered, or lacks a seed.
pub fn read<T: Seeded>(path: &Path) -> Result<(PartHeader, Vec<T>)> {
    parse(&text_of(path)?).with_context(|| format!("{}", path.display()))
}

/// Whether `path` is the finished part `header`; false if there is no such file.
///
/// # Errors
/// Another part, or no whole one, is there.
pub fn is_done<T: Seeded>(path: &Path, header: &PartHeader) -> Result<bool> {
    if !path.exists() {
        return Ok(false);
    }
    let (there, _) = read::<T>(path)?;
    if let Some(why) = header.difference(&there) {
        bail!("{} exists already, with {why}; choose another name", path.display());
    }
    ensure!(
        there.part == header.part,
        "{} exists already, and is part {}",
        path.display(),
        there.part
    );
    Ok(true)
}

/// Whether the file at `path` begins as a part does.
///
/// # Errors
/// A file that cannot be read.
pub fn is_part(path: &Path) -> Result<bool> {
    Ok(parse_header(&text_of(path)?).is_ok())
}

/// Kind of the rows of the part at `path`.
///
/// # Errors
/// A file that cannot be read or is no part.
pub fn kind(path: &Path) -> Result<Kind> {
    let text = text_of(path)?;
    let header = parse_header(&text).with_context(|| format!("{}", path.display()))?;
    Ok(header.kind)
}

/// Parts of one batch, campaign or bootstrap, by their number.
#[derive(Debug, Clone, Default)]
pub struct PartSet(BTreeMap<u64, (PathBuf, PartHeader)>);

impl PartSet {
    /// Adds the part at `path`.
    ///
    /// # Errors
    /// A file that cannot be read, is no part, or a torn one; a part that does not belong to the others, or whose
    /// number is there.
    pub fn add(&mut self, path: &Path) -> Result<()> {
        self.insert(path, &text_of(path)?)
    }

    /// Adds the part `text` of the file `path`, without a look at its rows.
    fn insert(&mut self, path: &Path, text: &str) -> Result<()> {
        let header = parse_header(text)
            .and_then(|header| checked_lines(text).map(|_| header))
            .with_context(|| format!("{}", path.display()))?;
        if let Some((first, known)) = self.0.values().next()
            && let Some(why) = known.difference(&header)
        {
            bail!("{} does not belong to {}: {why}", path.display(), first.display());
        }
        let part = header.part;
        if let Some((known, _)) = self.0.get(&part) {
            bail!("part {part} occurs twice: {}, {}", known.display(), path.display());
        }
        self.0.insert(part, (path.to_owned(), header));
        Ok(())
    }

    /// Whether the part at `path` was added.
    pub fn contains(&self, path: &Path) -> bool {
        self.0.values().any(|(known, _)| known == path)
    }

    /// Number of the parts.
    pub fn count(&self) -> u64 {
        self.0.len() as u64
    }

    /// Number of their seeds.
    pub fn seed_count(&self) -> u64 {
        self.0.values().map(|(_, header)| header.seeds()).map(|seeds| seeds.end - seeds.start).sum()
    }

    /// The header of the first part; `None` before there is one.
    pub fn first(&self) -> Option<&PartHeader> {
        self.0.values().map(|(_, header)| header).next()
    }

    /// The files, in the order of their numbers.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.0.values().map(|(path, _)| &**path)
    }

    fn check_complete(&self) -> Result<()> {
        let all = self.first().map_or(0, |header| header.parts);
        let missing = (1..=all).find(|part| !self.0.contains_key(part));
        if let Some(part) = missing {
            bail!("part {part} of {all} is missing; {} are there", self.count());
        }
        Ok(())
    }
}

/// The header of the first part, and all rows in the order of their seeds.
///
/// # Errors
/// As [`read`]; a part that is missing, there twice, or of other settings, seeds or revision.
pub fn merge<T: Seeded>(paths: &[PathBuf]) -> Result<(PartHeader, Vec<T>)> {
    let mut parts = PartSet::default();
    let mut rows_by_part = BTreeMap::new();
    for path in paths {
        let text = text_of(path)?;
        parts.insert(path, &text)?;
        let (header, rows) = parse::<T>(&text).with_context(|| format!("{}", path.display()))?;
        rows_by_part.insert(header.part, rows);
    }
    parts.check_complete()?;
    let first = parts.first().context("no part to merge")?;
    Ok((first.clone(), rows_by_part.into_values().flatten().collect()))
}

fn text_of(path: &Path) -> Result<String> {
    let bytes = atomic_file::read(path, atomic_file::RECORDING_BYTES_MAX)
        .with_context(|| format!("cannot read {}", path.display()))?;
    let text = String::from_utf8(bytes).ok();
    text.with_context(|| format!("{}: not a part file", path.display()))
}

fn parse_header(text: &str) -> Result<PartHeader> {
    let line = text.lines().next().unwrap_or_default();
    let header: PartHeader =
        serde_json::from_str(line).context("not a part file, or a torn one")?;
    ensure!(header.format == FORMAT, "its format is {:?} in place of {FORMAT:?}", header.format);
    Ok(header)
}

fn parse<T: Seeded>(text: &str) -> Result<(PartHeader, Vec<T>)> {
    let header = parse_header(text)?;
    let body = checked_lines(text)?;
    let settings_sum = checksum(header.settings.to_string().as_bytes());
    ensure!(settings_sum == header.settings_sha256, "the hash of its settings is wrong");
    ensure!(
        (1..=header.parts).contains(&header.part),
        "part = {}: expected 1..={}",
        header.part,
        header.parts
    );
    let rows: Result<Vec<T>, _> = body.lines().skip(1).map(serde_json::from_str).collect();
    let rows = rows.context("a row cannot be read")?;
    let is_complete = rows.iter().map(Seeded::seed).eq(header.seeds().map(Some));
    ensure!(is_complete, "its rows are not those of its seeds {:?}", header.seeds());
    Ok((header, rows))
}

/// All lines of a part but the last, which is their checksum.
fn checked_lines(text: &str) -> Result<&str> {
    let end = text.strip_suffix('\n').and_then(|text| text.rfind('\n')).unwrap_or(0) + 1;
    let (body, tail) = text.split_at_checked(end).unwrap_or((text, ""));
    ensure!(tail == tail_of(body), "it is torn or was altered: the checksum is wrong");
    Ok(body)
}

/// The last line of a part whose other lines are `body`.
fn tail_of(body: &str) -> String {
    format!("{{\"sha256\":\"{}\"}}\n", checksum(body.as_bytes()))
}

/// SHA-256, hexadecimal.
fn checksum(bytes: &[u8]) -> String {
    format!("{:x}", Sha256::digest(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_hold_every_seed_once() {
        for (count, parts) in [(10, 3), (2, 5), (1_000_000, 7)] {
            let seeds = |part| {
                let number = format!("{part}/{parts}").parse().unwrap();
                let names = [String::new(), String::new()];
                PartHeader::new(Kind::Batch, (Value::Null, names), (4, count), number).seeds()
            };
            let all: Vec<u64> = (1..=parts).flat_map(seeds).collect();
            assert!(all.into_iter().eq(4..4 + count), "{count} in {parts} parts");
        }
    }

    #[test]
    fn a_text_that_names_no_part_is_refused() {
        for text in ["", "1", "0/3", "4/3", "1/0", "a/2", "1/2/3"] {
            assert!(text.parse::<PartNumber>().is_err(), "{text}");
        }
    }
}
