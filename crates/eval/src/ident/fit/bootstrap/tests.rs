use std::sync::atomic::{AtomicUsize, Ordering};

use horizon_estim::{Observed, Recording};
use horizon_model::Lagged;
use horizon_model::rows::{Pose, Sticks, lag, motion};

use super::*;
use crate::ident::job::fixtures;
use crate::ident::{IdentFileTable, Job, Observer};
use crate::recordings::Loaded;

const PIECES: usize = 4;

fn table() -> IdentFileTable {
    let mut table = crate::ident::settings(None).unwrap();
    (table.clean_observations, table.lost_commands) = (false, None);
    table.piece_steps_min = 10;
    table
}

/// A vehicle that stands for as long as the pieces are.
fn log(sha256: &str) -> Loaded {
    let o = vec![Observed::full(Pose::new(0.0, 0.0, 1.0, 0.0)); 10 * PIECES];
    let recording = Recording { u: vec![Sticks::zeros(); o.len()], o };
    Loaded { sha256: sha256.to_owned(), ..fixtures::log("a.log", recording) }
}

type LaggedIdentification<'a> = Identification<'a, Lagged, { motion::COUNT }, { lag::COUNT }>;

/// Result of `of` for an identification with these settings and logs.
fn identification<T>(
    table: &IdentFileTable,
    logs: &[Loaded],
    of: impl FnOnce(&mut LaggedIdentification<'_>) -> T,
) -> T {
    let job = fixtures::job(table, logs);
    of(&mut Identification::new(Lagged::default(), &job).unwrap())
}

fn problem(table: &IdentFileTable, sha256: &str) -> String {
    identification(table, &[log(sha256)], |identification| identification.problem().unwrap())
}

#[test]
fn results_are_taken_up_whatever_does_not_change_an_estimate() {
    let plain = problem(&table(), "ab");
    assert_eq!(plain.len(), 64);
    let mut elsewhere = table();
    elsewhere.threads = 7;
    elsewhere.logs = vec!["logs".into()];
    elsewhere.logs_max = 3;
    elsewhere.clear_estimates = !elsewhere.clear_estimates;
    assert_eq!(problem(&elsewhere, "ab"), plain);
}

#[test]
fn results_of_other_data_settings_or_dead_times_are_of_another_problem() {
    let plain = problem(&table(), "ab");
    assert_ne!(problem(&table(), "cd"), plain);
    let mut other = table();
    other.map.c_p[0] *= 2.0;
    assert_ne!(problem(&other, "ab"), plain);
    let found_later = identification(&table(), &[log("ab")], |identification| {
        identification.dead_time_s[0] += 0.001;
        identification.problem().unwrap()
    });
    assert_ne!(found_later, plain);
}

#[test]
fn resamples_of_one_piece_have_no_spread() {
    let spread = |pieces: usize| {
        let mut log = log("ab");
        log.recording.u.truncate(10 * pieces);
        log.recording.o.truncate(10 * pieces);
        identification(&table(), &[log], |identification| {
            let shard = crate::part_file::PartNumber::ONLY;
            let plan =
                BootstrapPlan { resamples: 3, seed: 1, shard, part: None, earlier: Vec::new() };
            identification.bootstrap(&plan).unwrap().1
        })
    };
    assert!(spread(1).is_none());
    assert_eq!(spread(2).unwrap().0.resamples, 3);
}

/// Stops a computation after some of its steps.
struct StopsAfter(AtomicUsize);

impl Observer for StopsAfter {
    fn is_stopped(&self) -> bool {
        self.0.load(Ordering::Relaxed) == 0
    }

    fn advance(&self) {
        self.0.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1)).ok();
    }
}

#[test]
fn resamples_that_were_cut_short_have_no_spread() {
    let (table, logs) = (table(), [log("ab")]);
    let observer = StopsAfter(AtomicUsize::new(2));
    let job = Job { observer: &observer, ..fixtures::job(&table, &logs) };
    let identification: LaggedIdentification<'_> =
        Identification::new(Lagged::default(), &job).unwrap();
    let shard = crate::part_file::PartNumber::ONLY;
    let plan = BootstrapPlan { resamples: 1000, seed: 1, shard, part: None, earlier: Vec::new() };
    let (found, report) = identification.bootstrap(&plan).unwrap();
    assert!((2..1000).contains(&found.file.count()), "{}", found.file.count());
    assert!(report.is_none());
}

#[test]
fn a_resample_moves_by_its_own_dead_times_as_often_as_its_pieces_were_drawn() {
    const SEED: u64 = 5;
    let influence = |row: usize, by_piece_s: [f64; PIECES]| {
        let mut by = SVector::zeros();
        by[row] = 3.0;
        let by_piece_s = by_piece_s.to_vec();
        DelayInfluence { by_piece_s, parameter_by_dead_time: by, information: 1.0 }
    };
    identification(&table(), &[log("ab")], |identification| {
        assert_eq!(identification.spans.len(), PIECES);
        let given = identification.by_dead_times(SEED, 2);
        assert!(given.iter().all(|row| row.abs() < 1e-300), "they were not searched: {given}");
        let (first, second) = ([0.01, 0.02, 0.04, 0.08], [-0.5, 0.0, 0.0, 0.0]);
        identification.influences =
            vec![influence(lag::TAU_H, first), influence(lag::TAU_A, second)];
        for resample in 0..5 {
            let counts = horizon_estim::multiplicities(SEED, resample, PIECES);
            let more = |by_piece_s: [f64; PIECES]| -> f64 {
                counts.iter().zip(by_piece_s).map(|(n, by_s)| (f64::from(*n) - 1.0) * by_s).sum()
            };
            let mut expected = SVector::zeros();
            (expected[lag::TAU_H], expected[lag::TAU_A]) = (3.0 * more(first), 3.0 * more(second));
            let gap = (identification.by_dead_times(SEED, resample) - expected).norm();
            assert!(gap < 1e-12, "{gap:e} of {counts:?}");
        }
    });
}
