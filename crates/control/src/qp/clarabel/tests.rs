use ::clarabel::algebra::TriangularMatrixChecks;
use horizon_model::Vector;

use super::*;
use crate::qp::tests::case::{Case, Kind, random};

const STEPS: usize = 6;
const LIMITS: Limits = Limits { tolerance: 1e-10, iterations_max: 50, penalties_max: 0 };

fn case(seed: u64, couples: bool) -> Case<3, 2> {
    random(seed, Kind { steps: STEPS, couples, gives: false })
}

fn solve(solver: &mut Clarabel<3, 2>, case: &Case<3, 2>) -> Vec<Vector<2>> {
    let mut du = vec![Vector::zeros(); STEPS];
    solver.solve(&case.problem(), &mut du).unwrap();
    du
}

#[test]
fn an_update_in_place_equals_a_new_solver() {
    for couples in [false, true] {
        let mut cases = [3, 8, 5].map(|seed| case(seed, couples));
        // What was given must be free again in the problem after it.
        cases[1] = random(8, Kind { steps: STEPS, couples, gives: true });
        let mut reused = Clarabel::new(&cases[0].curvature, LIMITS).unwrap();
        for case in &cases {
            let mut fresh = Clarabel::new(&case.curvature, LIMITS).unwrap();
            // Without equilibration nothing of the problem before stays: equal bits.
            assert_eq!(solve(&mut reused, case), solve(&mut fresh, case));
        }
        assert_ne!(solve(&mut reused, &cases[0]), solve(&mut reused, &cases[2]));
    }
}

#[test]
fn zeros_in_the_data_do_not_change_the_shape() {
    let mut case = case(1, true);
    let mut solver = Clarabel::new(&case.curvature, LIMITS).unwrap();
    let du_full = solve(&mut solver, &case);
    let full = case.stages.clone();
    case.stages.fill(Stage::zeros());
    let residual = case.kkt_residual(&solve(&mut solver, &case));
    // A gap of 1e-10 leaves inputs at weakly active bounds off by its square root.
    assert!(residual < 1e-5, "residual {residual:e} with zero blocks");
    case.stages = full;
    assert_eq!(solve(&mut solver, &case), du_full);
}

#[test]
fn sparse_matrices_are_well_formed() {
    let case = case(2, true);
    let constraint = by_columns(STEPS * 7, STEPS * 5, |entry| {
        constraint_entries(&case.stages, &case.bounds, &[], 0, entry);
    });
    assert!(constraint.check_format().is_ok());
    // Rows at their bounds, then full blocks for all but the first state, then one -1 per state.
    assert_eq!(constraint.nnz(), STEPS * (2 * 2 + 3 * 2 + 3) + (STEPS - 1) * 9);
    let curvature = by_columns(STEPS * 5, STEPS * 5, |entry| {
        curvature_entries(&case.curvature, &case.bounds, 0, entry);
    });
    assert!(curvature.check_format().is_ok() && curvature.is_triu());
}

#[test]
fn a_solve_cut_short_is_no_solution() {
    let case = case(4, false);
    let limits = Limits { iterations_max: 2, ..LIMITS };
    let mut solver = Clarabel::new(&case.curvature, limits).unwrap();
    let mut du = vec![Vector::from([0.25, 0.5]); STEPS];
    let before = du.clone();
    let unsolved = solver.solve(&case.problem(), &mut du).unwrap_err();
    let reason = Reason::Clarabel(SolverStatus::MaxIterations);
    assert_eq!(unsolved, Unsolved { reason, iterations: 2 });
    assert_eq!(
        unsolved.to_string(),
        "the quadratic subproblem ended by MaxIterations after 2 iterations"
    );
    assert_eq!(du, before);
}
