//! Bootstrap estimates in files: kept on Ctrl-C, spread over machines, merged exactly.
//!
//! A resample depends on the seed and its own index alone, so any set of files that together hold
//! every index is the whole bootstrap, bit for bit.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use horizon_estim::Stop;
use serde::{Deserialize, Serialize};

use tello_io::config;
use tello_io::whole_file::write_json;

/// What is asked of the bootstrap.
#[derive(Debug, Clone)]
pub struct BootstrapPlan {
    /// Number of resamples.
    pub resamples: u64,
    /// Seed of the resampling.
    pub seed: u64,
    /// Part of the resamples that is computed.
    pub shard: Shard,
    /// Files of earlier runs and of other shards.
    pub earlier: Vec<PathBuf>,
}

/// Part `part` of `parts` of a bootstrap or a batch, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    part: u64,
    parts: u64,
}

impl Shard {
    /// All of it.
    pub const WHOLE: Self = Self { part: 1, parts: 1 };

    fn has(self, index: u64) -> bool {
        index % self.parts == self.part - 1
    }

    /// Which part, counted from 1, and of how many.
    pub fn numbers(self) -> [u64; 2] {
        [self.part, self.parts]
    }

    /// Name of the file with the estimates of this part.
    pub(super) fn file_name(self) -> String {
        match self {
            Self::WHOLE => "bootstrap.json".to_owned(),
            Self { part, parts } => format!("bootstrap-{part}-of-{parts}.json"),
        }
    }
}

impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refused = || format!("{text:?} is not i/n with 1 <= i <= n, e.g. 2/8");
        let (part, parts) = text.split_once('/').ok_or_else(refused)?;
        let number = |text: &str| text.parse::<u64>().map_err(|error| format!("{text:?}: {error}"));
        let (part, parts) = (number(part)?, number(parts)?);
        if (1..=parts).contains(&part) { Ok(Self { part, parts }) } else { Err(refused()) }
    }
}

/// How many of the resamples `indices` of `seed` are different samples of `pieces` pieces.
pub(super) fn distinct(seed: u64, indices: impl Iterator<Item = u64>, pieces: usize) -> usize {
    let samples = indices.map(|index| horizon_estim::multiplicities(seed, index, pieces));
    samples.collect::<BTreeSet<Vec<u32>>>().len()
}

/// A file of bootstrap estimates.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ResampleFile {
    /// SHA-256 of all that an estimate depends on beside its resample: settings, dead times and data.
    pub(super) problem: String,
    /// Seed of the resampling.
    pub(super) seed: u64,
    /// Names of the entries of `p`.
    pub(super) parameters: Vec<String>,
    /// The estimates, by ascending index.
    pub(super) resamples: Vec<ResampleRow>,
}

/// The estimate of one resample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ResampleRow {
    /// Index of the resample, from 0.
    pub(super) index: u64,
    /// Estimate.
    pub(super) p: Vec<f64>,
    /// Cost of the estimate.
    pub(super) cost: f64,
    /// Why its solve stopped, see [`Stop::name`].
    pub(super) stop: String,
}

impl ResampleRow {
    pub(super) fn new(index: u64, p: &[f64], cost: f64, stop: Stop) -> Self {
        Self { index, p: p.to_vec(), cost, stop: stop.name().to_owned() }
    }
}

impl ResampleFile {
    /// A file of the problem `problem` that holds what `earlier` files have of it.
    ///
    /// # Errors
    /// A file that cannot be read, or that belongs to another problem or seed.
    pub(super) fn gather(
        problem: String,
        seed: u64,
        parameters: Vec<String>,
        earlier: &[PathBuf],
    ) -> Result<Self> {
        let mut rows = BTreeMap::new();
        for path in earlier {
            let file: Self = config::load(path)?;
            if file.problem != problem || file.seed != seed {
                bail!(
                    "{} belongs to another identification (seed {} here, {} there; problem {} here, \
                     {} there): its logs, settings or dead times differ",
                    path.display(),
                    seed,
                    file.seed,
                    &problem[..8.min(problem.len())],
                    &file.problem[..8.min(file.problem.len())],
                );
            }
            if let Some(row) = file.resamples.iter().find(|row| row.p.len() != parameters.len()) {
                bail!("{}: resample {} has {} values", path.display(), row.index, row.p.len());
            }
            rows.extend(file.resamples.into_iter().map(|row| (row.index, row)));
        }
        Ok(Self { problem, seed, parameters, resamples: rows.into_values().collect() })
    }

    /// Indices below `plan.resamples` in its shard that are not here yet.
    pub(super) fn missing(&self, plan: &BootstrapPlan) -> Vec<u64> {
        let known: Vec<u64> = self.resamples.iter().map(|row| row.index).collect();
        let wanted = (0..plan.resamples).filter(|index| plan.shard.has(*index));
        wanted.filter(|index| known.binary_search(index).is_err()).collect()
    }

    /// Adds estimates.
    pub(super) fn add(&mut self, rows: impl IntoIterator<Item = ResampleRow>) {
        self.resamples.extend(rows);
        self.resamples.sort_by_key(|row| row.index);
    }

    /// Writes it to `dir`, under the name of its shard.
    pub(super) fn save(&self, dir: &Path, shard: Shard) -> Result<PathBuf> {
        let path = dir.join(shard.file_name());
        write_json(&path, self).with_context(|| format!("cannot keep {}", path.display()))?;
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(resamples: u64, shard: &str) -> BootstrapPlan {
        BootstrapPlan { resamples, seed: 1, shard: shard.parse().unwrap(), earlier: Vec::new() }
    }

    fn empty() -> ResampleFile {
        ResampleFile::gather("abc".into(), 1, vec!["a".into()], &[]).unwrap()
    }

    #[test]
    fn shards_hold_every_index_once() {
        let mut all: Vec<u64> = ["1/3", "2/3", "3/3"]
            .iter()
            .flat_map(|shard| empty().missing(&plan(10, shard)))
            .collect();
        all.sort_unstable();
        assert_eq!(all, (0..10).collect::<Vec<u64>>());
    }

    #[test]
    fn two_pieces_have_three_samples() {
        assert_eq!(distinct(1, 0..300, 2), 3);
        assert_eq!(distinct(1, 0..300, 1), 1);
        assert!(distinct(1, 0..300, 40) > 290);
    }

    #[test]
    fn what_is_known_is_not_done_again() {
        let mut file = empty();
        file.add([3, 0].map(|index| ResampleRow::new(index, &[1.0], 2.0, Stop::CostTolerance)));
        assert_eq!(file.missing(&plan(5, "1/1")), [1, 2, 4]);
    }

    #[test]
    fn a_shard_that_is_none_is_refused() {
        for text in ["", "1", "0/3", "4/3", "1/0", "a/2", "1/2/3"] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
    }

    #[test]
    fn the_estimates_of_another_problem_are_refused() {
        let dir = std::env::temp_dir().join("tello-ctl-resamples");
        std::fs::create_dir_all(&dir).unwrap();
        let path = empty().save(&dir, Shard::WHOLE).unwrap();
        let gather = |problem: &str, seed| {
            ResampleFile::gather(
                problem.into(),
                seed,
                vec!["a".into()],
                std::slice::from_ref(&path),
            )
        };
        assert!(gather("abc", 1).is_ok());
        assert!(gather("abd", 1).is_err());
        assert!(gather("abc", 2).is_err());
    }
}
