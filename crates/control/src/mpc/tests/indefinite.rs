//! Where a plan meets the acceleration limit of the lagged vehicle.

use horizon_model::Lagged;
use horizon_model::rows::{Motion, lag, motion};

use super::*;

pub(super) type Controller =
    Mpc<Lagged, { motion::COUNT }, 4, 4, { lag::COUNT }, { motion::CONTROLLABLE }>;

/// A vehicle like those of real flights.
pub(super) const P: [f64; lag::COUNT] =
    [1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1];

/// [`controller_of`] a horizon of 40 steps.
pub(super) fn controller(qp: QpKind) -> Controller {
    controller_of(qp, 40, &[])
}

/// Weights of `configs/fly.json`, differences of the inputs weighed.
pub(super) fn controller_of(
    qp: QpKind,
    horizon_steps: usize,
    stages: &[(usize, u32)],
) -> Controller {
    let weights = [10.0, 10.0, 10.0, 5.0].into_iter().chain([0.0; 7]).collect::<Vec<_>>();
    let table = MpcTable {
        input_cost: InputCost::Difference,
        c_u: vec![2.0, 2.0, 6.0, 4.0],
        c_s: weights.clone(),
        c_s_end: weights,
        solver: SolverTable { qp, iterations_max: 100, ..table(1, 1.0).solver },
        stages: stages.to_vec(),
        ..table(horizon_steps, 1.0)
    };
    Mpc::new(Lagged::default().core(), table.check::<Lagged, _, _, _, _>().unwrap(), DT_S).unwrap()
}

/// A solve from flight to a place a metre behind: the report, and the plan that is left.
fn turn_back(qp: QpKind, angle: f64) -> (MpcReport, Vec<Sticks>) {
    let mut s_0 = Motion::zeros();
    (s_0[motion::V_X], s_0[motion::V_Y]) = (0.9 * angle.cos(), 0.9 * angle.sin());
    let mut s_ref = Motion::zeros();
    (s_ref[motion::X], s_ref[motion::Y]) = (-(angle + 0.5).cos(), -(angle + 0.5).sin());
    let mut mpc = controller(qp);
    let problem = MpcProblem {
        s_0: &s_0,
        p: &P.into(),
        u_before: &Sticks::zeros(),
        s_ref: &[s_ref; 40],
        u_given: &[],
        given_steps: [0; 4],
    };
    let report = mpc.solve(&problem, &mut || false).unwrap();
    (report, mpc.plan().to_vec())
}

#[test]
fn second_derivatives_lead_to_the_same_optimum_in_few_iterations() {
    let (mut exact_iterations, mut linear_iterations) = (0, 0);
    for k in 0..5 {
        let angle = 1.3 * f64::from(k);
        let (exact, _) = turn_back(QpKind::Riccati, angle);
        // Clarabel gets the subproblems without second derivatives.
        let (linear, _) = turn_back(QpKind::Clarabel, angle);
        assert_eq!(exact.stop, SqpStop::CostTolerance, "{exact:?}");
        assert!(exact.cost <= linear.cost * (1.0 + 1e-6), "{exact:?} beside {linear:?}");
        exact_iterations += exact.iterations;
        linear_iterations += linear.iterations;
    }
    assert!(3 * exact_iterations < linear_iterations, "{exact_iterations}, {linear_iterations}");
}

#[test]
fn a_converged_plan_is_optimal_without_another_iteration() {
    let mut case = Case::new(&MpcTable {
        solver: SolverTable { qp: QpKind::Riccati, ..table(1, 1.0).solver },
        ..table(13, 0.8)
    });
    let first = case.solve();
    let second = case.solve();
    assert_eq!((second.stop, second.iterations), (SqpStop::CostTolerance, 0), "{second:?}");
    assert!(first.qp_iterations > 0);
    assert_eq!(second.qp_iterations, 0, "{second:?}");
}
