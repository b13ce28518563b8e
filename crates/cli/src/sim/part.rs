//! One part of a batch: what `sim --shard` flies, and whether it was flown before.

use std::path::PathBuf;

use anyhow::Result;
use serde_json::Value;
use tello_eval::part_file::{self, Kind, PartHeader, Seeded};
use tello_io::atomic_file;

use super::Arguments;
use crate::{Verdict, stdio};

/// The part that is asked for, and its file.
pub(super) struct Target {
    pub(super) header: PartHeader,
    path: PathBuf,
}

impl Target {
    /// `None` without `--shard`.
    pub(super) fn of(
        arguments: &Arguments,
        kind: Kind,
        settings: Value,
        count: u64,
    ) -> Option<Self> {
        let (part, path) = arguments.shard.zip(arguments.part.clone())?;
        let header = PartHeader::new(
            kind,
            (settings, super::names(arguments)),
            (arguments.seed, count),
            part,
        );
        Some(Self { header, path })
    }

    /// Notes it if the whole file exists already, else checks that it can be written. Returns whether it exists.
    ///
    /// # Errors
    /// It is another part, or it could not be written.
    pub(super) fn check_existing<T: Seeded>(&self) -> Result<bool> {
        let is_done = part_file::is_done::<T>(&self.path, &self.header)?;
        if is_done {
            stdio::note(format_args!("{} exists already", self.path.display()));
        } else {
            atomic_file::probe(&self.path)?;
        }
        Ok(is_done)
    }

    /// Writes the file.
    pub(super) fn write<T: Seeded>(&self, rows: &[T]) -> Result<Verdict> {
        part_file::write(&self.path, &self.header, rows)?;
        Ok(Verdict::Good)
    }
}

#[cfg(test)]
mod tests;
