use horizon_model::check::jacobian_gap;
use horizon_model::rows::{Pose, Sticks, lag};
use horizon_model::{Kinematic, Lagged, Vector};
use nalgebra::Vector1;

use super::*;
use crate::loss::Loss;

const FIXED: ArrivalSettings<4> = ArrivalSettings::Fixed;
const CARRIED: ArrivalSettings<4> =
    ArrivalSettings::Carried { c_0: Vector::<4>::new(3.0, 3.0, 2.0, 0.5), forget_s: 10.0 };

/// Five steps that neither the model nor the prior explains.
fn problem(arrival: ArrivalSettings<4>) -> WindowProblem<Kinematic, 4, 4, 4, 4> {
    let residuals = Residuals {
        model: Kinematic,
        dt_s: 0.02,
        c_o: Vector::from([3.0, 3.0, 2.0, 0.5]),
        c_s: Vector::from([0.4, 0.4, 0.4, 0.2]),
        observation_loss: Loss::Huber { scale: 1.0 },
        transition_loss: Loss::None,
    };
    let p_prior = Vector::from([1.2, 0.5, 0.9, 0.1]);
    let bounds = Bounds { lo: p_prior - Pose::repeat(0.5), hi: p_prior + Pose::repeat(0.5) };
    let prior = Prior { c_p: Pose::repeat(2.0), p_prior, bounds };
    let mut problem = WindowProblem::new(residuals, prior, arrival, 5);
    let s = Pose::new(0.1, 0.2, 1.0, 3.1);
    problem.start(s);
    for k in 1..=5 {
        let drift = 0.04 * f64::from(k);
        let observed = Observed::full(s + Pose::new(drift, -drift, 0.1, drift));
        problem.push(&Sticks::new(0.5, 0.8, -0.3, 0.2), &observed);
    }
    // Away from the prior, so that it too has a gradient.
    problem.p += Pose::new(0.1, -0.1, 0.05, 0.2);
    problem
}

#[test]
fn a_box_that_lets_a_time_constant_vanish_is_refused() {
    let mut p_lb = [0.1; lag::COUNT];
    let check = |p_lb: &[f64]| {
        let p = [0.2; lag::COUNT];
        Prior::check(&Lagged::PARAMETER, &p, &p, p_lb, &[0.5; lag::COUNT]).map(|_| ())
    };
    p_lb[lag::THETA_0] = -1.0;
    assert_eq!(check(&p_lb), Ok(()));
    p_lb[lag::TAU_H] = -1.0;
    let error = check(&p_lb).unwrap_err().to_string();
    assert_eq!(error, "p_lb[4] = -1: expected > 0: tau_h is positive");
}

#[test]
fn a_short_step_gains_what_the_model_expects() {
    for arrival in [FIXED, CARRIED] {
        let mut problem = problem(arrival);
        let start = problem.linearize().unwrap();
        let step = problem.try_step(1e3 * start.diagonal_max).unwrap();
        let gain = start.cost - problem.candidate_cost();
        // The damping leaves a thousandth of the way: higher orders are that small.
        let gap = (gain / step.decrease - 1.0).abs();
        assert!(gap < 2e-3, "{arrival:?}: {gain} instead of {}", step.decrease);
    }
}

#[test]
fn a_fixed_first_state_never_moves() {
    let mut problem = problem(FIXED);
    let s_0 = problem.states()[0];
    problem.linearize().unwrap();
    problem.try_step(0.0).unwrap();
    problem.accept();
    assert_eq!(problem.states()[0], s_0);
    assert!((problem.newest() - s_0).norm() > 0.01);
}

type Assembled = WindowProblem<Kinematic, 4, 4, 4, 4>;

/// A problem with another state `k`, or with another parameter if there is no `k`.
fn moved(problem: &Assembled, k: Option<usize>, value: &Pose) -> Assembled {
    let mut moved = problem.clone();
    match k {
        Some(k) => moved.s[k] = *value,
        None => moved.p = *value,
    }
    moved
}

/// Gradient by the parameter, then by each state.
fn gradients(mut problem: Assembled) -> Vec<Pose> {
    problem.linearize().unwrap();
    let by_parameter = problem.chain.parameter_block.gradient;
    let by_states = problem.chain.blocks_mut().iter().map(|block| block.gradient);
    std::iter::once(by_parameter).chain(by_states).collect()
}

#[test]
fn the_assembled_gradient_with_prior_or_arrival_is_the_derivative_of_the_cost() {
    for arrival in [FIXED, CARRIED] {
        let mut problem = problem(arrival);
        if arrival != FIXED {
            // An arrival cost that couples state and parameter.
            problem.pop();
        }
        let by_all = gradients(problem.clone());
        let value = |k, x: &Pose| {
            let cost = moved(&problem, k, x).linearize().map_or(f64::NAN, |at| at.cost);
            Vector1::new(cost)
        };
        let gap = jacobian_gap(|p| value(None, p), &problem.p, &by_all[0].transpose());
        assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by p");
        for (k, s) in problem.s.iter().enumerate() {
            if k == 0 && arrival == FIXED {
                assert_eq!(by_all[1], Pose::zeros());
                continue;
            }
            let gap = jacobian_gap(|s| value(Some(k), s), s, &by_all[k + 1].transpose());
            assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by s[{k}]");
        }
    }
}

#[test]
fn the_assembled_hessian_is_the_derivative_of_the_gradient_where_residuals_vanish() {
    for arrival in [FIXED, CARRIED] {
        let mut problem = problem(arrival);
        if arrival != FIXED {
            problem.pop();
        }
        for k in 0..problem.u.len() {
            let Iterate { s, u, p, .. } = problem.iterate();
            problem.s[k + 1] = Kinematic.step(&s[k], &u[k], p, 0.02);
        }
        for (observed, s) in problem.o.iter_mut().zip(&problem.s) {
            *observed = Observed::full(*s);
        }
        let mut at = problem.clone();
        at.linearize().unwrap();
        let by_parameter = |k| {
            let problem = &problem;
            move |p: &Pose| gradients(moved(problem, None, p))[k]
        };
        let hessian = &at.chain.parameter_block.hessian;
        let gap = jacobian_gap(by_parameter(0), &problem.p, hessian);
        assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by p twice");
        for k in usize::from(arrival == FIXED)..problem.s.len() {
            let block = at.chain.blocks_mut()[k];
            let gap = jacobian_gap(by_parameter(k + 1), &problem.p, &block.border);
            assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by s[{k}] and p");
            let by_state = |other| {
                let problem = &problem;
                move |s: &Pose| gradients(moved(problem, Some(other), s))[k + 1]
            };
            let gap = jacobian_gap(by_state(k), &problem.s[k], &block.diagonal);
            assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by s[{k}] twice");
            if k > usize::from(arrival == FIXED) {
                let gap = jacobian_gap(by_state(k - 1), &problem.s[k - 1], &block.before);
                assert!(gap < 1e-6, "{arrival:?}: gap {gap:e} by s[{k}] and the one before");
            }
        }
    }
}
