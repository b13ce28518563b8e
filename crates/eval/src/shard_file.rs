//! Part files: some rows of a batch, a campaign or a bootstrap, from one process of many.
//!
//! A part is text, one JSON value a line: what was asked for ([`Head`]), one row per seed, and a checksum of the
//! lines before it. It appears whole or not at all. A row depends on settings and seed alone, so rows from any
//! machines with equal heads are, side by side, the rows of one process, bit for bit.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail, ensure};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use sha2::{Digest, Sha256};
use tello_io::whole_file;
use thiserror::Error;

use crate::REVISION;

/// First field of a part file.
const FORMAT: &str = "tello-ctl part 1";

/// What the rows of a part are.
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

/// Part `part` of `parts` of a batch or a bootstrap, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    part: u64,
    parts: u64,
}

impl Shard {
    /// The only part of one.
    pub const WHOLE: Self = Self { part: 1, parts: 1 };

    /// Number of the part, counted from 1, and number of parts.
    pub fn numbers(self) -> [u64; 2] {
        [self.part, self.parts]
    }
}

/// A text that names no part.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{0:?} is not i/n with 1 <= i <= n, e.g. 2/8")]
pub struct NoShard(String);

impl FromStr for Shard {
    type Err = NoShard;

    fn from_str(text: &str) -> Result<Self, NoShard> {
        let numbers = |text: &str| {
            let (part, parts) = text.split_once('/')?;
            Some((part.parse().ok()?, parts.parse().ok()?))
        };
        match numbers(text) {
            Some((part, parts)) if (1..=parts).contains(&part) => Ok(Self { part, parts }),
            _ => Err(NoShard(text.to_owned())),
        }
    }
}

/// What was asked for: the same in all parts but for the number of the part.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Head {
    format: String,
    /// Of the program.
    revision: String,
    /// Of the rows.
    pub kind: Kind,
    /// SHA-256 of `settings`, hexadecimal.
    settings_sha256: String,
    /// All settings that the rows depend on.
    pub settings: Value,
    /// Names of the settings of both contenders, for the table.
    pub names: [String; 2],
    /// First seed of the whole.
    pub seed: u64,
    /// Seeds of the whole.
    pub count: u64,
    /// Number of this part, from 1.
    part: u64,
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

impl Head {
    /// The head of `shard` of `count` seeds from `seed` on.
    pub fn new(
        kind: Kind,
        (settings, names): (Value, [String; 2]),
        (seed, count): (u64, u64),
        shard: Shard,
    ) -> Self {
        let [part, parts] = shard.numbers();
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

    /// Why a part with the head `other` does not belong to this one.
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
/// Rows that are not those of the seeds, or do not survive their JSON form (numbers that are not finite); a
/// folder that cannot be written.
pub fn write<T: Seeded>(path: &Path, head: &Head, rows: &[T]) -> Result<()> {
    let mut text = serde_json::to_string(head)? + "\n";
    for row in rows {
        let line = serde_json::to_string(row)?;
        text.push_str(&line);
        text.push('\n');
    }
    text += &tail_of(&text);
    let (_, again) = parse::<T>(&text)?;
    ensure!(again == rows, "{}: a row does not survive its JSON form", path.display());
    whole_file::write(path, true, |part| Ok(fs::write(part, &text)?))
}

/// Head and rows of the part at `path`.
///
/// # Errors
/// A file that cannot be read, is none, torn or altered, or lacks a seed.
pub fn read<T: Seeded>(path: &Path) -> Result<(Head, Vec<T>)> {
    parse(&text_of(path)?).with_context(|| format!("{}", path.display()))
}

/// What the part at `path` was asked for.
///
/// # Errors
/// As [`read`], but for rows that are whole and not those of the head.
fn head(path: &Path) -> Result<Head> {
    let text = text_of(path)?;
    parse_head(&text)
        .and_then(|head| checked_lines(&text).map(|_| head))
        .with_context(|| format!("{}", path.display()))
}

/// Whether `path` is the finished part `head`; false if there is no such file.
///
/// # Errors
/// Another part, or no whole one, is there.
pub fn is_done<T: Seeded>(path: &Path, head: &Head) -> Result<bool> {
    if !path.exists() {
        return Ok(false);
    }
    let (there, _) = read::<T>(path)?;
    if let Some(why) = head.difference(&there) {
        bail!("{} exists already, with {why}; choose another name", path.display());
    }
    ensure!(
        there.part == head.part,
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
    Ok(parse_head(&text_of(path)?).is_ok())
}

/// What the rows of the part at `path` are.
///
/// # Errors
/// A file that cannot be read or is no part.
pub fn kind(path: &Path) -> Result<Kind> {
    let text = text_of(path)?;
    let head = parse_head(&text).with_context(|| format!("{}", path.display()))?;
    Ok(head.kind)
}

/// Parts of one whole, by their number.
#[derive(Debug, Clone, Default)]
pub struct PartSet(BTreeMap<u64, (PathBuf, Head)>);

impl PartSet {
    /// Adds the part at `path`.
    ///
    /// # Errors
    /// A file that cannot be read, is no part, or a torn one; a part of another whole, or one whose number is there.
    pub fn add(&mut self, path: &Path) -> Result<()> {
        let head = head(path)?;
        if let Some((first, known)) = self.0.values().next()
            && let Some(why) = known.difference(&head)
        {
            bail!("{} does not belong to {}: {why}", path.display(), first.display());
        }
        let part = head.part;
        if let Some((known, _)) = self.0.get(&part) {
            bail!("part {part} occurs twice: {}, {}", known.display(), path.display());
        }
        self.0.insert(part, (path.to_owned(), head));
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
        self.0.values().map(|(_, head)| head.seeds()).map(|seeds| seeds.end - seeds.start).sum()
    }

    /// The head of the first part; `None` before there is one.
    pub fn first(&self) -> Option<&Head> {
        self.0.values().map(|(_, head)| head).next()
    }

    /// The files, in the order of their numbers.
    pub fn paths(&self) -> impl Iterator<Item = &Path> {
        self.0.values().map(|(path, _)| &**path)
    }

    fn check_whole(&self) -> Result<()> {
        let all = self.first().map_or(0, |head| head.parts);
        let missing = (1..=all).find(|part| !self.0.contains_key(part));
        if let Some(part) = missing {
            bail!("part {part} of {all} is missing; {} are there", self.count());
        }
        Ok(())
    }
}

/// The head of the first part, and all rows in the order of their seeds.
///
/// # Errors
/// As [`read`]; a part that is missing, there twice, or of other settings, seeds or revision.
pub fn merge<T: Seeded>(paths: &[PathBuf]) -> Result<(Head, Vec<T>)> {
    let mut parts = PartSet::default();
    paths.iter().try_for_each(|path| parts.add(path))?;
    parts.check_whole()?;
    let mut all = Vec::new();
    for (path, known) in parts.0.values() {
        let (head, rows) = read::<T>(path)?;
        ensure!(head == *known, "{} changed while it was merged", path.display());
        all.extend(rows);
    }
    let first = parts.first().context("no part to merge")?;
    Ok((first.clone(), all))
}

fn text_of(path: &Path) -> Result<String> {
    let bytes = whole_file::read(path, whole_file::RECORDING_BYTES_MAX)
        .with_context(|| format!("cannot read {}", path.display()))?;
    let text = String::from_utf8(bytes).ok();
    text.with_context(|| format!("{}: not a part file", path.display()))
}

fn parse_head(text: &str) -> Result<Head> {
    let line = text.lines().next().unwrap_or_default();
    let head: Head = serde_json::from_str(line).context("not a part file, or a torn one")?;
    ensure!(head.format == FORMAT, "its format is {:?} in place of {FORMAT:?}", head.format);
    Ok(head)
}

fn parse<T: Seeded>(text: &str) -> Result<(Head, Vec<T>)> {
    let head = parse_head(text)?;
    let body = checked_lines(text)?;
    let settings_sum = checksum(head.settings.to_string().as_bytes());
    ensure!(settings_sum == head.settings_sha256, "the hash of its settings is wrong");
    ensure!(
        (1..=head.parts).contains(&head.part),
        "part = {}: expected 1..={}",
        head.part,
        head.parts
    );
    let rows: Result<Vec<T>, _> = body.lines().skip(1).map(serde_json::from_str).collect();
    let rows = rows.context("a row cannot be read")?;
    let is_whole = rows.iter().map(Seeded::seed).eq(head.seeds().map(Some));
    ensure!(is_whole, "its rows are not those of its seeds {:?}", head.seeds());
    Ok((head, rows))
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
    fn shards_hold_every_seed_once() {
        for (count, parts) in [(10, 3), (2, 5), (1_000_000, 7)] {
            let seeds = |part| {
                let shard = format!("{part}/{parts}").parse().unwrap();
                let names = [String::new(), String::new()];
                Head::new(Kind::Batch, (Value::Null, names), (4, count), shard).seeds()
            };
            let all: Vec<u64> = (1..=parts).flat_map(seeds).collect();
            assert!(all.into_iter().eq(4..4 + count), "{count} in {parts} parts");
        }
    }

    #[test]
    fn a_shard_that_is_none_is_refused() {
        for text in ["", "1", "0/3", "4/3", "1/0", "a/2", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }
}
