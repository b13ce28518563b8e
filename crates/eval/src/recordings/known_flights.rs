//! Flights known again in other files: equal bytes, and converted, torn or recovered copies.
//!
//! Owns when two files hold one flight: most positions of the shorter one are those of the other, one by one.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::hash::{DefaultHasher, Hash as _, Hasher as _};

use horizon_estim::{Observed, Recording};
use horizon_model::rows::{Pose, pose, stick};
use tello_flight::Phase;

use super::Loaded;
use super::ticks::TickRow;

/// Positions on end by which a flight is known: a third of a second.
const MOTION_POSES: usize = 16;

/// Positions are rounded as in CSV. 1/m
const PER_M: f64 = 1e4;

/// The hashes of all runs of [`MOTION_POSES`] positions on end, repeated ones left out. Noise makes each run its own.
pub(crate) type Motions = BTreeSet<u64>;

/// Flights, by which one is known again in another file.
#[derive(Debug, Default)]
pub(crate) struct KnownFlights {
    /// The first flight with each of these bytes.
    by_bytes: BTreeMap<String, usize>,
    /// The first flight with each of these motions.
    by_motion: BTreeMap<u64, usize>,
    /// Number of the motions of each flight.
    motions: BTreeMap<usize, usize>,
}

impl KnownFlights {
    /// Those of `logs`, at their indices.
    pub(crate) fn of(logs: &[Loaded]) -> Self {
        let mut known = Self::default();
        for (index, log) in logs.iter().enumerate() {
            known.add(index, &log.sha256, &log.motions);
        }
        known
    }

    /// The index of the flight of `log`.
    pub(crate) fn index_of_log(&self, log: &Loaded) -> Option<usize> {
        self.index_of(&log.sha256, &log.motions)
    }

    fn add(&mut self, index: usize, sha256: &str, motions: &Motions) {
        self.motions.insert(index, motions.len());
        self.by_bytes.entry(sha256.to_owned()).or_insert(index);
        for motion in motions {
            self.by_motion.entry(*motion).or_insert(index);
        }
    }

    /// The index of the flight that has these bytes, or most of the motions of the shorter one.
    fn index_of(&self, sha256: &str, motions: &Motions) -> Option<usize> {
        let mut shared: BTreeMap<usize, usize> = BTreeMap::new();
        for index in motions.iter().filter_map(|motion| self.by_motion.get(motion)) {
            *shared.entry(*index).or_default() += 1;
        }
        let is_same = |(index, shared): (usize, usize)| {
            (2 * shared > motions.len().min(self.motions[&index])).then_some(index)
        };
        self.by_bytes.get(sha256).copied().or_else(|| shared.into_iter().find_map(is_same))
    }
}

/// For each of `files`, by the SHA-256 of its bytes and its motions, the one whose copy it is. Of the files of a
/// flight the one with the most motions is the original: the log before its CSV, the whole one before the torn one.
pub(crate) fn originals(files: &[(&str, &Motions)]) -> Vec<Option<usize>> {
    let mut indices: Vec<usize> = (0..files.len()).collect();
    indices.sort_by_key(|index| Reverse(files[*index].1.len()));
    let (mut known, mut originals) = (KnownFlights::default(), vec![None; files.len()]);
    for index in indices {
        let (sha256, motions) = files[index];
        originals[index] = known.index_of(sha256, motions);
        if originals[index].is_none() {
            known.add(index, sha256, motions);
        }
    }
    originals
}

/// The motions of a recording.
pub(super) fn of_recording(recording: &Recording<{ stick::COUNT }, { pose::COUNT }>) -> Motions {
    let is_seen = |o: &&Observed<{ pose::COUNT }>| (pose::X..=pose::Z).all(|row| o.is_present[row]);
    motions(recording.o.iter().filter(is_seen).map(|o| &o.o))
}

/// The motions of `ticks` in flight: those of raw, filtered and estimated poses, one of which a copy in CSV has.
pub(crate) fn of_ticks(ticks: &[TickRow]) -> Motions {
    let flying = || ticks.iter().filter(|tick| matches!(tick.phase, None | Some(Phase::Flying)));
    let mut all = motions(flying().filter_map(|tick| tick.estimate.as_ref()));
    all.extend(motions(flying().filter_map(|tick| tick.raw.as_ref())));
    all.extend(motions(flying().filter_map(|tick| Some(&tick.filtered.as_ref()?.0))));
    all
}

fn motions<'a>(poses: impl Iterator<Item = &'a Pose>) -> Motions {
    #[expect(
        clippy::cast_possible_truncation,
        reason = "a cast of a number beyond the type ends at its bound"
    )]
    let rounded =
        |at: &Pose| [pose::X, pose::Y, pose::Z].map(|row| (PER_M * at[row]).round() as i64);
    let mut places: Vec<[i64; 3]> = poses.map(rounded).collect();
    places.dedup();
    let hash = |run: &[[i64; 3]]| {
        let mut hasher = DefaultHasher::new();
        run.hash(&mut hasher);
        hasher.finish()
    };
    places.windows(MOTION_POSES).map(hash).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log in flight with noise of its own on raw poses and estimates.
    fn ticks(seed: u64, count: u64) -> Vec<TickRow> {
        let noise = |k: u64, row: u64| {
            let mut hasher = DefaultHasher::new();
            [seed, k, row].hash(&mut hasher);
            1e-3 * (hasher.finish() % 1_000_000) as f64 * 1e-6
        };
        let at = |k: u64, first: u64| {
            let [x, y, z] = [0, 1, 2].map(|row| noise(k, first + row));
            Pose::new(0.01 * k as f64 + x, y, 1.0 + z, 0.0)
        };
        let tick = |k| TickRow {
            raw: Some(at(k, 0)),
            filtered: Some((at(k, 0), [true; 2])),
            estimate: Some(at(k, 3)),
            phase: Some(Phase::Flying),
            ..TickRow::default()
        };
        (0..count).map(tick).collect()
    }

    /// What CSV keeps of one pose of each tick.
    fn csv(ticks: &[TickRow], pick: fn(&TickRow) -> Option<Pose>) -> Motions {
        let rounded = |at: f64| format!("{at:.4}").parse::<f64>().unwrap();
        let row =
            |tick| TickRow { estimate: pick(tick).map(|at| at.map(rounded)), ..TickRow::default() };
        of_ticks(&ticks.iter().map(row).collect::<Vec<_>>())
    }

    #[test]
    fn a_log_is_known_in_its_csv_torn_or_with_a_hole_and_another_flight_is_not() {
        let whole = ticks(1, 200);
        let holed = [&whole[..60], &whole[90..]].concat();
        let files = [
            csv(&whole, |tick| tick.estimate),
            of_ticks(&whole[..50]),
            of_ticks(&whole),
            csv(&whole, |tick| tick.raw),
            of_ticks(&ticks(2, 200)),
            of_ticks(&holed),
            of_ticks(&[]),
            of_ticks(&[]),
        ];
        let names = ["a", "b", "c", "d", "e", "f", "g", "g"];
        let files: Vec<_> = names.into_iter().zip(&files).collect();
        let same = Some(2);
        assert_eq!(originals(&files), [same, same, None, same, None, same, None, Some(6)]);
    }
}
