//! Uncontrollable rows of the state: they are no part of the subproblems, but of the truth.

use horizon_model::Lagged;
use horizon_model::rows::{Motion, motion};

use super::indefinite::{P, controller};
use super::*;

/// Equation 3.46 for the inputs `plan`, directly from the model.
fn cost(plan: &[Sticks], s_0: &Motion, s_ref: &Motion) -> f64 {
    let (c_u, c_s) = (Sticks::new(2.0, 2.0, 6.0, 4.0), Pose::new(10.0, 10.0, 10.0, 5.0));
    let (mut cost, mut s, mut u_before) = (0.0, *s_0, Sticks::zeros());
    for u in plan {
        s = Lagged::default().core().step(&s, u, &P.into(), DT_S);
        let gap = Lagged::default().observe(&(s - s_ref)).component_mul(&c_s);
        let change = (u - u_before).component_mul(&c_u);
        cost += 0.5 * (gap.norm_squared() + change.norm_squared());
        u_before = *u;
    }
    cost
}

#[test]
fn no_input_of_a_plan_against_the_wind_can_gain() {
    let (mut s_0, mut s_ref) = (Motion::zeros(), Motion::zeros());
    for (row, wind) in [(motion::D_X, 0.3), (motion::D_Y, -0.2), (motion::D_Z, 0.1)] {
        s_0[row] = wind;
    }
    s_ref[motion::X] = 0.2;
    let mut mpc = controller(QpKind::Riccati);
    let problem = MpcProblem {
        s_0: &s_0,
        p: &P.into(),
        u_before: &Sticks::zeros(),
        s_ref: &[s_ref; 40],
        u_given: &[],
        given_steps: [0; 4],
    };
    let report = mpc.solve(&problem, &mut || false).unwrap();
    assert_eq!(report.stop, SqpStop::CostTolerance, "{report:?}");
    let plan = mpc.plan().to_vec();
    let least = cost(&plan, &s_0, &s_ref);
    assert!((least - report.cost).abs() < 1e-12 * least, "{least} beside {report:?}");
    // The plan works against the wind.
    assert!(plan[20].x.abs() > 0.05 && plan[20].y.abs() > 0.05, "{}", plan[20]);
    for (k, i) in (0..40).flat_map(|k| (0..4).map(move |i| (k, i))) {
        assert!(plan[k][i].abs() < 0.99, "u_{k} rests at a bound: {}", plan[k]);
        let moved = |by: f64| {
            let mut plan = plan.clone();
            plan[k][i] += by;
            cost(&plan, &s_0, &s_ref)
        };
        let gradient = (moved(1e-4) - moved(-1e-4)) / 2e-4;
        // What is left to gain, 1e-9 of the cost, is gradient^2 / (2 h) along one input, whose own h is 8 or more.
        assert!(
            gradient.abs() < (16.0 * 1e-9 * least).sqrt(),
            "gradient {gradient:e} by input {i} of step {k}"
        );
    }
}
