//! Horizons whose stages last several steps.

use horizon_model::check::amax;
use horizon_model::rows::{Motion, motion};

use super::indefinite::{P, controller_of};
use super::*;

/// A plan over the horizon of `stages` to a place ahead and to the left, from flight: the report and the plan.
fn plan(stages: &[(usize, u32)]) -> (MpcReport, Vec<Sticks>) {
    let (mut s_0, mut s_ref) = (Motion::zeros(), Motion::zeros());
    (s_0[motion::V_X], s_0[motion::OMEGA]) = (0.3, 0.1);
    (s_ref[motion::X], s_ref[motion::Y], s_ref[motion::Z]) = (0.5, 0.3, 0.1);
    let mut mpc = controller_of(QpKind::Riccati, 64, stages);
    let problem = MpcProblem {
        s_0: &s_0,
        p: &P.into(),
        u_before: &Sticks::zeros(),
        s_ref: &vec![s_ref; mpc.plan().len()],
        u_given: &[],
        given_steps: [0; 4],
    };
    let report = mpc.solve(&problem, &mut || false).unwrap();
    (report, mpc.plan().to_vec())
}

#[test]
fn stages_of_one_step_are_the_horizon() {
    assert_eq!(plan(&[(64, 1)]), plan(&[]));
}

#[test]
fn long_stages_plan_nearly_what_short_ones_plan() {
    let (_, fine) = plan(&[]);
    let (_, coarse) = plan(&[(8, 1), (8, 2), (10, 4)]);
    for (k, (fine, coarse)) in fine.iter().zip(&coarse[..8]).enumerate() {
        let gap = amax(&(fine - coarse));
        // A hundredth of the way of a stick, from -1 to 1.
        assert!(gap < 0.02, "{gap} in step {k}: {coarse} beside {fine}");
    }
}

#[test]
fn both_solvers_plan_the_same_over_stages() {
    for input_cost in [InputCost::Absolute, InputCost::Difference] {
        let [(riccati, by_riccati), (interior, by_interior)] = [QpKind::Riccati, QpKind::Clarabel]
            .map(|qp| {
                let table = MpcTable {
                    input_cost,
                    stages: vec![(3, 1), (2, 3), (4, 5), (1, 1)],
                    ..table(30, 0.35)
                };
                let solver = SolverTable { qp, ..table.solver };
                let mut case = Case::new(&MpcTable { solver, ..table });
                case.s_ref.truncate(10);
                (case.solve(), case.mpc.plan().to_vec())
            });
        assert_eq!((riccati.stop, interior.stop), (SqpStop::CostTolerance, SqpStop::CostTolerance));
        assert!((riccati.cost / interior.cost - 1.0).abs() < 1e-8, "{riccati:?}, {interior:?}");
        for (a, b) in by_riccati.iter().zip(&by_interior) {
            // Costs that agree to 1e-9 leave inputs off by the square root of that.
            assert!(amax(&(a - b)) < 1e-4, "{a} beside {b}");
        }
    }
}

#[test]
fn given_inputs_act_as_their_mean_over_a_stage() {
    let mut case = Case::new(&MpcTable { stages: vec![(1, 1), (4, 3)], ..table(13, 0.8) });
    case.s_ref.truncate(5);
    case.u_given = (0..7).map(|k| Sticks::from_element(0.1 * f64::from(k))).collect();
    case.given_steps = [7, 4, 1, 0];
    assert!(case.solve().has_new_plan());
    let plan = case.mpc.plan();
    for (row, given) in [vec![0.0, 0.2, 0.5], vec![0.0, 0.2], vec![0.0]].into_iter().enumerate() {
        for (k, given) in given.into_iter().enumerate() {
            assert!((plan[k][row] - given).abs() < 1e-15, "row {row}, stage {k}: {}", plan[k]);
        }
    }
    assert!(plan.iter().all(|u| amax(u) <= 0.8));
    case.given_steps = [7, 5, 1, 0];
    let refused = case.solve_while(&mut || false).unwrap_err();
    assert_eq!(refused, SqpError::Inside { row: 1, given_steps: 5 });
}

#[test]
fn a_horizon_that_is_refused_is_shown_in_steps() {
    let table = MpcTable { stages: vec![(1, 1), (4, 3)], ..table(13, 0.8) };
    let error = refusal(&table.check::<Kinematic, 4, 4, 4, 4>().unwrap(), &"a horizon that fits");
    assert_eq!(error.to_string(), "horizon_steps = 13: expected a horizon that fits");
}

#[test]
fn a_plan_that_moves_on_mixes_neighbouring_stages() {
    let mut case = Case::new(&MpcTable { stages: vec![(2, 1), (2, 4), (1, 3)], ..table(13, 0.8) });
    case.s_ref.truncate(5);
    assert!(case.solve().has_new_plan());
    let before = case.mpc.plan().to_vec();
    case.mpc.shift();
    let expected = [
        before[1],
        before[2],
        0.75 * before[2] + 0.25 * before[3],
        0.75 * before[3] + 0.25 * before[4],
        before[4],
    ];
    for (u, expected) in case.mpc.plan().iter().zip(expected) {
        assert!(amax(&(u - expected)) < 1e-15, "{u} instead of {expected}");
    }
}
