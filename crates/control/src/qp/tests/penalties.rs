//! Soft constraints: the stage-wise solver against the slack variables of Clarabel.

use super::*;
use horizon_model::Vector;
use horizon_model::check::maximum;

/// Penalties per stage.
const MAX: usize = 3;
const PENALIZED: Limits = Limits { penalties_max: MAX, ..LIMITS };

/// What a comparison found.
#[derive(Debug, Default)]
struct Seen {
    solved: usize,
    given_up: u64,
    penalties: usize,
    violated: usize,
    /// Penalties whose constraint changed its side by the step.
    changed: usize,
    iterations: u32,
    residual: f64,
    cost_gap: f64,
}

/// So many problems, horizons 1 to 61, each with penalties on the first `rows` rows.
fn compare_all<const NS: usize, const NU: usize>(
    name: &str,
    problems: u64,
    rows: usize,
    make: impl Fn(u64, Kind) -> Case<NS, NU>,
) {
    let mut seen = Seen::default();
    for (seed, steps) in (0..problems).zip((1..=61).cycle()) {
        let mut case = make(seed, Kind { steps, couples: seed % 2 == 0, gives: seed % 3 == 0 });
        case.penalize(seed, MAX, rows);
        let mut du = vec![Vector::zeros(); steps];
        let mut oracle_du = du.clone();
        let mut oracle = Clarabel::new(&case.curvature, PENALIZED).unwrap();
        oracle.solve(&case.problem(), &mut oracle_du).unwrap();
        let solved = ActiveSet::new(&case.curvature, PENALIZED).solve(&case.problem(), &mut du);
        let Ok(iterations) = solved else {
            seen.given_up += 1;
            continue;
        };
        let (cost, oracle_cost) = (case.cost(&du), case.cost(&oracle_du));
        let residual = case.kkt_residual(&du);
        assert!(residual.is_finite() && cost.is_finite(), "residual {residual}, cost {cost}");
        let violated = case.violated_count(&du);
        seen.solved += 1;
        seen.penalties += case.penalties.len();
        seen.violated += violated;
        let before = case.penalties.iter().filter(|one| one.excess > 0.0).count();
        seen.changed += before.abs_diff(violated);
        seen.iterations += iterations;
        seen.residual = maximum(seen.residual, residual);
        seen.cost_gap = maximum(seen.cost_gap, (cost - oracle_cost) / (1.0 + oracle_cost.abs()));
    }
    println!("{name}: {seen:?}");
    assert!(seen.given_up <= problems / 100, "{name}: {seen:?}");
    assert!(seen.residual < 1e-8, "{name}: {seen:?}");
    assert!(seen.cost_gap < 1e-9, "{name}: {seen:?}");
    // Both sides of the penalty are met, and the working set has to be searched.
    let fraction = seen.violated as f64 / seen.penalties as f64;
    assert!((0.05..0.95).contains(&fraction) && seen.changed > seen.solved, "{name}: {seen:?}");
}

#[test]
fn random_problems_with_penalties_are_solved_as_by_slack_variables() {
    compare_all("random", QUICK, 3, random);
}

#[test]
fn kinematic_problems_with_penalties_are_solved_as_by_slack_variables() {
    compare_all("kinematic", QUICK, 3, kinematic);
}

#[test]
fn lagged_problems_with_penalties_are_solved_as_by_slack_variables() {
    compare_all("lagged", QUICK, 3, lagged);
}

#[test]
#[ignore = "2,100 problems: in .ci/run all"]
fn thousands_of_problems_with_penalties_are_solved_as_by_slack_variables() {
    compare_all("random", THOROUGH, 3, random);
    compare_all("kinematic", THOROUGH, 3, kinematic);
    compare_all("lagged", THOROUGH, 3, lagged);
}

#[test]
fn constraints_that_are_met_leave_the_bits_of_a_problem_without_them() {
    for seed in 0..50 {
        let mut case = lagged(seed, Kind { steps: 30, couples: true, gives: true });
        let (mut without, mut with) = (vec![Vector::zeros(); 30], vec![Vector::zeros(); 30]);
        ActiveSet::new(&case.curvature, LIMITS).solve(&case.problem(), &mut without).unwrap();
        case.penalize(seed, MAX, 3);
        case.penalties.iter_mut().for_each(|one| one.excess = -100.0);
        ActiveSet::new(&case.curvature, PENALIZED).solve(&case.problem(), &mut with).unwrap();
        assert_eq!(with, without, "seed {seed}");
    }
}

#[test]
fn a_problem_after_one_with_penalties_is_solved_by_clarabel_as_by_a_new_solver() {
    let kind = Kind { steps: 12, couples: false, gives: false };
    let mut penalized = random(3, kind);
    penalized.penalize(3, MAX, 3);
    let plain = random(4, kind);
    let mut reused = Clarabel::new(&plain.curvature, PENALIZED).unwrap();
    let (mut du, mut fresh_du) = (vec![Vector::zeros(); 12], vec![Vector::zeros(); 12]);
    reused.solve(&penalized.problem(), &mut du).unwrap();
    reused.solve(&plain.problem(), &mut du).unwrap();
    let mut fresh = Clarabel::new(&plain.curvature, PENALIZED).unwrap();
    fresh.solve(&plain.problem(), &mut fresh_du).unwrap();
    assert_eq!(du, fresh_du);
}
