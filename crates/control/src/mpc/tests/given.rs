//! Committed inputs, and the two solvers of the subproblems.

use super::*;
use horizon_model::check::{amax, maximum};

const KINDS: [QpKind; 2] = [QpKind::Riccati, QpKind::Clarabel];
const COSTS: [InputCost; 2] = [InputCost::Absolute, InputCost::Difference];

fn case(qp: QpKind, input_cost: InputCost, horizon_steps: usize) -> Case {
    let table = table(horizon_steps, 0.35);
    let solver = SolverTable { qp, cost_tolerance: 1e-12, ..table.solver };
    let mut case = Case::new(&MpcTable { input_cost, solver, ..table });
    case.s_ref.fill(case.s_0 + Pose::new(-0.3, 0.2, 0.04, -0.25));
    case
}

/// Some inputs of which some rows lie outside of the box.
fn committed(count: u32) -> Vec<Sticks> {
    (0..count).map(|k| Sticks::new(0.5, -0.1, -0.4, 0.05) * (1.0 - 0.1 * f64::from(k))).collect()
}

#[test]
fn the_plan_behind_given_inputs_is_that_of_a_later_start() {
    const GIVEN: usize = 4;
    for qp in KINDS {
        for input_cost in COSTS {
            let mut case = case(qp, input_cost, 20);
            case.u_given = committed(4);
            case.given_steps = [GIVEN; 4];
            let report = case.solve();
            assert_eq!(report.stop, SqpStop::CostTolerance, "{report:?}");
            assert_eq!(report.qp_fallbacks, 0);
            assert_eq!(case.mpc.plan()[..GIVEN], case.u_given);

            let mut later = self::case(qp, input_cost, 20 - GIVEN);
            later.s_ref.fill(case.s_ref[0]);
            later.u_before = case.u_given[GIVEN - 1];
            later.s_0 = case.mpc.planned_states()[GIVEN - 1];
            assert_eq!(later.solve().stop, SqpStop::CostTolerance);
            for (k, (u, later)) in case.mpc.plan()[GIVEN..].iter().zip(later.mpc.plan()).enumerate()
            {
                // The outer iteration ends at a relative drop of 1e-12: inputs to its square root.
                assert!(
                    amax(&(u - later)) < 3e-6,
                    "{qp:?} {input_cost:?}: {u} at {k}, not {later}"
                );
            }
        }
    }
}

#[test]
fn each_axis_has_its_own_given_inputs_and_both_solvers_agree_on_the_rest() {
    for input_cost in COSTS {
        let mut plans = Vec::new();
        for qp in KINDS {
            let mut case = case(qp, input_cost, 25);
            case.u_given = committed(9);
            case.given_steps = [8, 9, 0, 3];
            let report = case.solve();
            assert_eq!(report.stop, SqpStop::CostTolerance, "{report:?}");
            for (k, u) in case.mpc.plan().iter().enumerate() {
                for (i, value) in u.iter().enumerate() {
                    if k < case.given_steps[i] {
                        assert_eq!(value.to_bits(), case.u_given[k][i].to_bits(), "u_{k}[{i}]");
                    } else {
                        assert!(value.abs() <= 0.35, "{qp:?}: u_{k}[{i}] = {value}");
                    }
                }
            }
            plans.push(case.mpc.plan().to_vec());
        }
        for (k, (riccati, clarabel)) in plans[0].iter().zip(&plans[1]).enumerate() {
            // The interior point leaves inputs at weakly active bounds off by 1e-5.
            assert!(amax(&(riccati - clarabel)) < 3e-5, "u_{k}: {riccati} and {clarabel}");
        }
    }
}

#[test]
fn what_is_no_longer_given_returns_into_the_box() {
    for qp in KINDS {
        let mut case = case(qp, InputCost::Difference, 10);
        case.u_given = committed(6);
        case.given_steps = [6; 4];
        assert!(case.solve().has_new_plan());
        case.given_steps = [0; 4];
        // Even if there is no time to solve anything.
        assert_eq!(case.solve_while(&mut || true).unwrap().stop, SqpStop::Late);
        let largest = case.mpc.plan().iter().map(amax).fold(0.0, maximum);
        assert!(largest <= 0.35, "{largest}");

        let fresh_plan = case.solve();
        let mut fresh = self::case(qp, InputCost::Difference, 10);
        let gap = (fresh_plan.cost / fresh.solve().cost - 1.0).abs();
        assert!(gap < 1e-9, "{qp:?}: both end at the same optimum, gap {gap:e}");
    }
}

#[test]
fn a_plan_that_is_given_whole_has_nothing_to_decide() {
    for qp in KINDS {
        let mut case = case(qp, InputCost::Difference, 5);
        case.u_given = committed(5);
        case.given_steps = [5; 4];
        let report = case.solve();
        assert_eq!((report.stop, report.iterations), (SqpStop::CostTolerance, 0), "{report:?}");
        assert_eq!(case.mpc.plan(), case.u_given);
    }
}

#[test]
fn bad_given_inputs_are_refused_and_change_nothing() {
    let mut case = case(QpKind::Riccati, InputCost::Absolute, 5);
    assert!(case.solve().has_new_plan());
    let plan = case.mpc.plan().to_vec();
    case.u_given = committed(3);
    for (given_steps, message) in [
        ([0, 4, 0, 0], "given_steps[1] = 4 with 3 given inputs and a horizon of 5 steps"),
        ([0, 0, 0, 9], "given_steps[3] = 9 with 3 given inputs and a horizon of 5 steps"),
    ] {
        case.given_steps = given_steps;
        assert_eq!(case.solve_while(&mut || false).unwrap_err().to_string(), message);
    }
    case.u_given = committed(9);
    case.given_steps = [0, 0, 6, 0];
    assert_eq!(
        case.solve_while(&mut || false).unwrap_err().to_string(),
        "given_steps[2] = 6 with 9 given inputs and a horizon of 5 steps"
    );
    case.given_steps = [1; 4];
    case.u_given[0][stick::YAW] = f64::NAN;
    assert_eq!(
        case.solve_while(&mut || false).unwrap_err().to_string(),
        "u_given[0][2] = NaN is not finite"
    );
    assert_eq!(case.mpc.plan(), plan);
}

#[test]
fn a_shifted_plan_keeps_its_active_set() {
    let solve_next = |keeps: bool| {
        let mut case = case(QpKind::Riccati, InputCost::Difference, 40);
        case.s_ref.fill(case.s_0 + Pose::new(-2.0, 1.5, 1.0, -2.5));
        assert!(case.solve().has_new_plan());
        case.s_0 = case.mpc.planned_states()[0];
        case.u_before = case.mpc.plan()[0];
        case.mpc.shift();
        if !keeps {
            case.mpc.qp.reset();
        }
        case.solve()
    };
    let (kept, forgotten) = (solve_next(true), solve_next(false));
    let iterations = (kept.qp_iterations, forgotten.qp_iterations);
    assert!(iterations.0 < iterations.1, "{iterations:?} iterations");
    let gap = (kept.cost / forgotten.cost - 1.0).abs();
    assert!(gap < 1e-9, "both end at the same optimum, gap {gap:e}");
}
