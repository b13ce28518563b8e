mod coverage;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use horizon_model::check::amax;
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Vector};

use super::*;
use crate::ident::{IdentSettings, Piece};
use crate::levenberg::LmTable;
use crate::residual::Observed;

const DT_S: f64 = 0.02;
const PIECES: usize = 12;

/// Pieces of 40 steps that the model explains with its own parameter each.
pub(super) fn pieces() -> Vec<Piece<4, 4>> {
    pieces_of(|i| Vector::from([1.0, 0.5, 0.9, 0.0]).map(|p| p + 0.2 * (i as f64).sin()))
}

/// Pieces of 40 steps that the model explains with the parameter of each.
pub(super) fn pieces_of(p_of: impl Fn(usize) -> Vector<4>) -> Vec<Piece<4, 4>> {
    let steady = |i: usize, k: usize| 0.4 * ((0.7 * i as f64) + 0.11 * k as f64).sin();
    let piece = |i: usize| {
        let p = p_of(i);
        let mut s = Pose::new(0.0, 0.0, 1.0, 0.3 * i as f64);
        let (mut u, mut o) = (Vec::new(), Vec::new());
        for k in 0..40 {
            let applied = Sticks::from_fn(|axis, _| steady(i + 3 * axis, k));
            o.push(Observed::full(s));
            u.push(applied);
            s = Kinematic.step(&s, &applied, &p, DT_S);
        }
        Piece { u, o }
    };
    (0..PIECES).map(piece).collect()
}

pub(super) fn solved(pieces: Vec<Piece<4, 4>>) -> Ident<Kinematic, 4, 4, 4, 4> {
    let solver = LmTable {
        damping_start: 1e-8,
        cost_tolerance: 1e-12,
        step_tolerance: 1e-10,
        iterations_max: 100,
    };
    let settings = IdentSettings::builder([1.0, 0.5, 0.9, 0.0])
        .c_o([3.0, 3.0, 2.0, 1.0])
        .c_p([0.1; 4])
        .bounds([-10.0; 4], [10.0; 4])
        .solver(solver)
        .build(&Kinematic)
        .unwrap();
    let mut ident = Ident::new(Kinematic, &settings, DT_S, pieces).unwrap();
    let report = ident.solve(&mut || false).unwrap();
    assert!(report.stop != LmStop::IterationLimit, "{report:?}");
    ident
}

fn run(ident: &Ident<Kinematic, 4, 4, 4, 4>, resamples: &[u64]) -> Vec<Resample<4>> {
    bootstrap(ident, 5, resamples, &|| false, &|_| ()).unwrap()
}

#[test]
fn the_first_draws_never_change() {
    let drawn = [(1, 0), (1, 1), (2, 0)].map(|(seed, resample)| multiplicities(seed, resample, 12));
    assert_eq!(drawn, GOLDEN);
}

const GOLDEN: [[u32; 12]; 3] = [
    [1, 1, 1, 1, 1, 2, 1, 1, 2, 0, 1, 0],
    [1, 2, 0, 0, 2, 0, 1, 0, 1, 0, 3, 2],
    [1, 0, 3, 0, 0, 0, 1, 0, 1, 2, 2, 2],
];

#[test]
fn every_piece_is_drawn_as_often_as_any_other() {
    let mut drawn = [0_u32; 7];
    for resample in 0..10_000 {
        let counts = multiplicities(3, resample, 7);
        assert_eq!(counts.iter().sum::<u32>(), 7);
        for (sum, count) in drawn.iter_mut().zip(counts) {
            *sum += count;
        }
    }
    // Binomial: 10 000 +- 93; four deviations.
    assert!(drawn.iter().all(|sum| sum.abs_diff(10_000) < 370), "{drawn:?}");
    assert!(multiplicities(3, 0, 0).is_empty());
}

#[test]
fn shards_merge_to_the_bits_of_one_run() {
    let ident = solved(pieces());
    let all: Vec<u64> = (0..20).collect();
    let whole = run(&ident, &all);
    assert_eq!(whole.len(), 20);
    let shard =
        |i: u64| run(&ident, &all.iter().copied().filter(|n| n % 3 == i).collect::<Vec<_>>());
    let mut merged = [shard(2), shard(0), shard(1)].concat();
    merged.sort_by_key(|resample| resample.index);
    let bits = |resamples: &[Resample<4>]| -> Vec<_> {
        resamples.iter().map(|r| (r.index, r.cost.to_bits(), r.p.map(f64::to_bits))).collect()
    };
    assert_eq!(bits(&whole), bits(&merged));
}

#[test]
fn the_number_of_threads_does_not_matter() {
    let ident = solved(pieces());
    let with_threads = |count| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(count).build().unwrap();
        pool.install(|| run(&ident, &[3, 1, 4, 5, 9]))
    };
    assert_eq!(with_threads(1), with_threads(2));
}

#[test]
fn a_resample_is_the_problem_with_its_pieces_repeated() {
    let ident = solved(pieces());
    let [resample] = run(&ident, &[7])[..] else { panic!("one resample") };
    let counts = multiplicities(5, 7, PIECES);
    let repeated = |(piece, count)| std::iter::repeat_n(piece, count as usize);
    let drawn = pieces().into_iter().zip(counts).flat_map(repeated).collect();
    let written_out = solved(drawn);
    let gap = amax(&(written_out.parameter() - resample.p));
    // Both stop where a step gains less than 1e-12 of the cost.
    assert!(gap < 1e-6, "gap {gap:e}");
}

#[test]
fn a_stopped_run_keeps_what_is_done() {
    let ident = solved(pieces());
    let done = AtomicUsize::new(0);
    let seen = Mutex::new(Vec::new());
    let is_stopped = || done.load(Ordering::Relaxed) >= 4;
    let on_done = |resample: &Resample<4>| {
        seen.lock().unwrap().push(*resample);
        done.fetch_add(1, Ordering::Relaxed);
    };
    let all: Vec<u64> = (0..200).collect();
    let kept = bootstrap(&ident, 5, &all, &is_stopped, &on_done).unwrap();
    assert!((4..50).contains(&kept.len()), "{} kept", kept.len());
    let mut seen = seen.into_inner().unwrap();
    seen.sort_by_key(|resample| resample.index);
    assert_eq!(kept, seen);
    assert_eq!(kept, run(&ident, &kept.iter().map(|r| r.index).collect::<Vec<_>>()));
}

#[test]
fn the_sandwich_is_what_the_bootstrap_tends_to() {
    let ident = solved(pieces());
    let samples: Vec<_> = run(&ident, &(0..400).collect::<Vec<_>>()).iter().map(|r| r.p).collect();
    let resampled = Spread::of(&samples).unwrap();
    let laplace = Spread::normal(ident.parameter(), &Laplace::of(&ident).unwrap().clustered);
    for (row, (a, b)) in laplace.std.iter().zip(&resampled.std).enumerate() {
        // 400 resamples know a deviation to 4 %; with 12 pieces, weights of their own add to it.
        assert!((a / b - 1.0).abs() < 0.25, "row {row}: {a} by sandwich, {b} by bootstrap");
    }
}
