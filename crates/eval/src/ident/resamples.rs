//! Bootstrap estimates in files: kept on Ctrl-C, spread over machines, merged exactly.
//!
//! A resample depends on the seed and its own index alone, so any set of files that together hold
//! every index is the whole bootstrap, bit for bit.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Display, Formatter};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use horizon_estim::{LmStop, Spread};
use nalgebra::SVector;
use serde::{Deserialize, Serialize};
use serde_json::json;

use tello_io::atomic_file::write_json;
use tello_io::config;

use crate::REVISION;
use crate::part_file::{self, Kind, PartHeader, PartNumber, Seeded};

/// Plan of the bootstrap: resamples, seed, and files of parts.
#[derive(Debug, Clone)]
pub struct BootstrapPlan {
    /// Number of resamples.
    pub resamples: u64,
    /// Seed of the resampling.
    pub seed: u64,
    /// Part of the resamples that is computed.
    pub shard: PartNumber,
    /// The file of that part; `None` for all resamples.
    pub part: Option<PathBuf>,
    /// Files of earlier runs and of other shards.
    pub earlier: Vec<PathBuf>,
}

impl BootstrapPlan {
    /// Where a part is kept that was stopped before its last resample.
    fn unfinished(&self) -> Option<PathBuf> {
        self.part.as_ref().map(|part| part.with_extension("unfinished.json"))
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
pub struct ResampleFile {
    /// SHA-256 of all that an estimate depends on beside its resample: settings, dead times and data.
    pub(super) problem: String,
    /// Seed of the resampling.
    pub(super) seed: u64,
    /// Names of the entries of `p`.
    pub(super) parameters: Vec<String>,
    /// The estimates, by ascending index.
    pub(super) resamples: Vec<ResampleRow>,
}

/// The settings of a part file: the fields of a [`ResampleFile`] without its estimates.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct PartSettings {
    problem: String,
    seed: u64,
    parameters: Vec<String>,
}

/// The estimate of one resample.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ResampleRow {
    /// Index of the resample, from 0.
    pub(super) index: u64,
    /// Estimate. In the units of its rows
    pub(super) p: Vec<f64>,
    /// Cost of the estimate. 1
    pub(super) cost: f64,
    /// Why its solve stopped, see [`LmStop::name`].
    pub(super) stop: String,
}

impl ResampleRow {
    pub(super) fn new(index: u64, p: &[f64], cost: f64, stop: LmStop) -> Self {
        Self { index, p: p.to_vec(), cost, stop: stop.name().to_owned() }
    }

    /// Whether its solve ended at a limit in place of a minimum.
    pub(super) fn is_unconverged(&self) -> bool {
        [LmStop::IterationLimit.name(), LmStop::DampingLimit.name()].contains(&self.stop.as_str())
    }
}

/// The first digits of a hash, which in a foreign file may be any text.
fn short(hash: &str) -> &str {
    hash.get(..8).unwrap_or(hash)
}

impl Seeded for ResampleRow {
    fn seed(&self) -> Option<u64> {
        Some(self.index)
    }
}

impl ResampleFile {
    /// A file of the problem `problem` that holds what earlier files of `plan` have of it.
    ///
    /// # Errors
    /// A file that cannot be read, or that belongs to another problem, seed or revision.
    pub(super) fn gather(
        problem: String,
        parameters: Vec<String>,
        plan: &BootstrapPlan,
    ) -> Result<Self> {
        let seed = plan.seed;
        let mut gathered = Self { problem, seed, parameters, resamples: Vec::new() };
        let mut paths = plan.earlier.clone();
        match &plan.part {
            Some(part) if part_file::is_done::<ResampleRow>(part, &gathered.head(plan))? => {
                paths.push(part.clone());
            }
            _ => paths.extend(plan.unfinished().filter(|path| path.exists())),
        }
        let mut rows = BTreeMap::new();
        for path in &paths {
            let file = Self::read(path)?;
            if file.problem != gathered.problem || file.seed != seed {
                bail!(
                    "{} belongs to another identification (seed {} here, {} there; problem {} here, \
                     {} there): its logs, settings, dead times or program differ",
                    path.display(),
                    seed,
                    file.seed,
                    short(&gathered.problem),
                    short(&file.problem),
                );
            }
            file.check(gathered.parameters.len()).with_context(|| path.display().to_string())?;
            rows.extend(file.resamples.into_iter().map(|row| (row.index, row)));
        }
        gathered.resamples = rows.into_values().collect();
        Ok(gathered)
    }

    /// Estimates in the file.
    pub fn count(&self) -> usize {
        self.resamples.len()
    }

    /// A part file, or what [`Self::save`] wrote.
    fn read(path: &Path) -> Result<Self> {
        if !part_file::is_part(path)? {
            return config::load(path);
        }
        let (head, rows) = part_file::read::<ResampleRow>(path)?;
        if head.revision() != REVISION {
            let (path, theirs) = (path.display(), head.revision());
            bail!(
                "{path} is of revision {theirs} of the program, and this one is {REVISION}: compute it anew"
            );
        }
        Self::of(&head, rows).with_context(|| path.display().to_string())
    }

    fn of(head: &PartHeader, resamples: Vec<ResampleRow>) -> Result<Self> {
        let PartSettings { problem, seed, parameters } =
            config::from_value(&head.settings).context("it is no part of a bootstrap")?;
        Ok(Self { problem, seed, parameters, resamples })
    }

    fn check(&self, parameters: usize) -> Result<()> {
        match self.resamples.iter().find(|row| row.p.len() != parameters) {
            Some(row) => bail!(
                "resample {} has {} values in place of {parameters}, one a parameter: compute it anew",
                row.index,
                row.p.len()
            ),
            None => Ok(()),
        }
    }

    /// The head of the part of `plan`.
    fn head(&self, plan: &BootstrapPlan) -> PartHeader {
        let Self { problem, seed, parameters, .. } = self;
        let settings = json!({ "problem": problem, "seed": seed, "parameters": parameters });
        let names = [String::new(), String::new()];
        PartHeader::new(Kind::Bootstrap, (settings, names), (0, plan.resamples), plan.shard)
    }

    /// The estimates of all parts of a bootstrap: the file that one process writes for all resamples.
    ///
    /// # Errors
    /// As [`part_file::merge`].
    pub fn merge(paths: &[PathBuf]) -> Result<Self> {
        let (head, rows) = part_file::merge::<ResampleRow>(paths)?;
        let merged = Self::of(&head, rows)?;
        merged.check(merged.parameters.len())?;
        Ok(merged)
    }

    /// The text of the file, without the last line break.
    ///
    /// # Errors
    /// None in practice: all values have a JSON form.
    pub fn json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }

    /// Indices below `plan.resamples` in its shard that are not here yet.
    pub(super) fn missing(&self, plan: &BootstrapPlan) -> Vec<u64> {
        let known: Vec<u64> = self.resamples.iter().map(|row| row.index).collect();
        let wanted = self.head(plan).seeds();
        wanted.filter(|index| known.binary_search(index).is_err()).collect()
    }

    /// Adds estimates.
    pub(super) fn add(&mut self, rows: impl IntoIterator<Item = ResampleRow>) {
        self.resamples.extend(rows);
        self.resamples.sort_by_key(|row| row.index);
    }

    /// Writes the part of `plan`, or `bootstrap.json` to `dir` if that is all of it.
    ///
    /// A part that was stopped is kept beside its name; the same command continues it.
    pub(super) fn save(&self, dir: &Path, plan: &BootstrapPlan) -> Result<PathBuf> {
        let whole = || dir.join("bootstrap.json");
        let path = plan.unfinished().unwrap_or_else(whole);
        let Some(part) = plan.part.as_ref().filter(|_| self.missing(plan).is_empty()) else {
            write_json(&path, true, self)
                .with_context(|| format!("cannot keep {}", path.display()))?;
            return Ok(path);
        };
        if !part.exists() {
            let head = self.head(plan);
            let mine = |row: &&ResampleRow| head.seeds().contains(&row.index);
            let rows: Vec<ResampleRow> = self.resamples.iter().filter(mine).cloned().collect();
            part_file::write(part, &head, &rows)?;
        }
        // All of it is in the part.
        fs::remove_file(&path).ok();
        Ok(part.clone())
    }
}

/// Mean, standard deviation and 95 % interval of each parameter.
impl Display for ResampleFile {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let unconverged = self.resamples.iter().filter(|row| row.is_unconverged()).count();
        let (count, seed) = (self.resamples.len(), self.seed);
        writeln!(f, "bootstrap     {count} resamples, {unconverged} not converged, seed {seed}")?;
        writeln!(
            f,
            "              at the dead times of all pieces; `ident --resume` adds the spread of the dead times"
        )?;
        let are_equal = |(row, next): (&ResampleRow, &ResampleRow)| row.p == next.p;
        if count > 1 && self.resamples.iter().zip(self.resamples.iter().skip(1)).all(are_equal) {
            return writeln!(f, "no intervals: all resamples are the same sample, as of one piece");
        }
        writeln!(f, "{:<13} {:>10} {:>9}  95 % interval", "parameter", "mean", "std")?;
        for (row, name) in self.parameters.iter().enumerate() {
            let value =
                |resample: &ResampleRow| resample.p.get(row).copied().map(|p| SVector::from([p]));
            let values: Vec<_> = self.resamples.iter().filter_map(value).collect();
            let Some(spread) = Spread::<1>::of(&values) else { continue };
            let [mean, std, lower, upper] =
                [spread.mean, spread.std, spread.lower, spread.upper].map(|value| value.x);
            writeln!(f, "{name:<13} {mean:>10.5} {std:>9.5}  {lower:>9.4} .. {upper:<9.4}")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan(resamples: u64, shard: &str) -> BootstrapPlan {
        let (part, earlier) = (None, Vec::new());
        BootstrapPlan { resamples, seed: 1, shard: shard.parse().unwrap(), part, earlier }
    }

    fn empty() -> ResampleFile {
        ResampleFile::gather("abc".into(), vec!["a".into()], &plan(2, "1/1")).unwrap()
    }

    fn rows<const N: usize>(indices: [u64; N]) -> [ResampleRow; N] {
        indices.map(|index| ResampleRow::new(index, &[1.0 / 3.0], 2.0, LmStop::CostTolerance))
    }

    #[test]
    fn two_pieces_have_three_samples() {
        assert_eq!(distinct(1, 0..300, 2), 3);
        assert_eq!(distinct(1, 0..300, 1), 1);
        assert!(distinct(1, 0..300, 40) > 290);
    }

    #[test]
    fn equal_estimates_have_no_intervals() {
        let mut file = empty();
        file.add(rows([0, 1]));
        assert!(file.to_string().ends_with("as of one piece\n"), "{file}");
        file.add([ResampleRow::new(2, &[0.5], 2.0, LmStop::CostTolerance)]);
        assert!(file.to_string().contains("95 % interval"), "{file}");
    }

    #[test]
    fn what_is_known_is_not_done_again() {
        let mut file = empty();
        file.add(rows([3, 0]));
        assert_eq!(file.missing(&plan(5, "1/1")), [1, 2, 4]);
        assert_eq!(file.missing(&plan(5, "2/2")), [2, 4]);
    }

    fn folder(name: &str) -> PathBuf {
        let dir = std::env::temp_dir().join(format!("tello-ctl-{}-{name}", std::process::id()));
        fs::create_dir_all(&dir).unwrap();
        dir
    }

    #[test]
    fn a_part_that_was_stopped_continues() {
        let dir = folder("unfinished");
        let mut plan = plan(6, "2/2");
        plan.part = Some(dir.join("b.part"));
        let gather = || ResampleFile::gather("abc".into(), vec!["a".into()], &plan).unwrap();
        let mut file = gather();
        file.add(rows([5, 3]));
        let kept = file.save(&dir, &plan).unwrap();
        let mut again = gather();
        assert_eq!(again.missing(&plan), [4]);
        // Those of other parts do not get into this one.
        again.add(rows([4, 0]));
        again.save(&dir, &plan).unwrap();
        assert!(!kept.exists());
        assert_eq!(gather().resamples, rows([3, 4, 5]));
        fs::remove_dir_all(dir).unwrap();
    }

    #[test]
    fn the_estimates_of_another_problem_are_refused() {
        let dir = folder("resamples");
        for part in [None, Some(dir.join("a.part"))] {
            let mut written = plan(2, "1/1");
            written.part = part;
            let mut file = empty();
            file.add(rows([0, 1]));
            let path = file.save(&dir, &written).unwrap();
            let gather = |problem: &str, seed, name: &str| {
                let mut plan = plan(2, "1/1");
                (plan.seed, plan.earlier) = (seed, vec![path.clone()]);
                let names = name.split(' ').map(str::to_owned).collect();
                ResampleFile::gather(problem.into(), names, &plan)
            };
            assert_eq!(gather("abc", 1, "a").unwrap().resamples, rows([0, 1]));
            assert!(gather("abd", 1, "a").is_err());
            assert!(gather("abc", 2, "a").is_err());
            assert!(gather("abc", 1, "a b").is_err());
        }
        fs::remove_dir_all(dir).unwrap();
    }
}
