use super::*;
use crate::qp::tests::LIMITS;
use crate::qp::tests::case::{Case, Kind, lagged};
use horizon_model::Vector;

/// Iterations for a problem and the inputs, from what `solver` remembers.
fn search(solver: &mut ActiveSet<11, 4>, case: &Case<11, 4>) -> (u32, Vec<Vector<4>>) {
    let mut du = vec![Vector::zeros(); case.steps()];
    (solver.solve(&case.problem(), &mut du).unwrap(), du)
}

#[test]
fn a_warm_start_at_the_solution_takes_one_iteration_and_gives_equal_bits() {
    for couples in [false, true] {
        let case = lagged(5, Kind { steps: 40, couples, gives: true });
        let mut solver = ActiveSet::new(&case.curvature, LIMITS);
        let (iterations, du) = search(&mut solver, &case);
        assert!(iterations > 1, "{iterations} iterations");
        // Its last iteration began in the middle; this one does not.
        assert_eq!(search(&mut solver, &case), (1, du.clone()));
        solver.reset();
        assert_eq!(search(&mut solver, &case), (iterations, du));
    }
}

#[test]
fn what_is_not_finite_is_not_solved_and_leaves_no_trace() {
    type Spoil = fn(&mut Case<11, 4>);
    let good = lagged(5, Kind { steps: 20, couples: true, gives: false });
    let mut solver = ActiveSet::new(&good.curvature, LIMITS);
    let solution = search(&mut solver, &good);
    // A gradient spoils the step, a derivative a pivot.
    let spoils: [(Spoil, Reason); 5] = [
        (|case| case.gradient.u[7][1] = f64::NAN, Reason::NotFinite),
        (|case| case.gradient.s[19][0] = f64::INFINITY, Reason::NotFinite),
        (|case| case.stages[3].by_state[(0, 4)] = f64::NAN, Reason::NotPositive),
        (|case| case.stages[19].by_input[(4, 0)] = f64::INFINITY, Reason::NotPositive),
        (|case| case.stages[0].by_input.fill(f64::NAN), Reason::NotPositive),
    ];
    for (number, (spoil, reason)) in spoils.into_iter().enumerate() {
        let mut bad = good.clone();
        spoil(&mut bad);
        let mut du = vec![Vector::from_element(0.25); 20];
        let before = du.clone();
        let unsolved = solver.solve(&bad.problem(), &mut du).unwrap_err();
        assert_eq!(unsolved.reason, reason, "spoil {number}: {unsolved}");
        assert_eq!(du, before, "spoil {number}");
        assert_eq!(search(&mut solver, &good), solution, "spoil {number}");
    }
}
