//! The expansion of the cost away from an optimum: reduced gradient and quadratic model against the true cost.

use std::f64::consts::PI;

use horizon_model::check::jacobian_gap;
use horizon_model::rows::{Motion, motion};
use horizon_model::{HessianKind, Vector};

use super::super::expansion::Gain;
use super::indefinite::{Controller, P, controller_of};
use super::*;
use crate::qp::Problem;

/// Number of stages; two of them last three steps.
pub(super) const STAGES: usize = 6;

/// Inputs of a plan, one after the other.
pub(super) type Inputs = Vector<{ 4 * STAGES }>;

/// A plan that is not optimal, expanded.
pub(super) struct At {
    pub(super) mpc: Controller,
    pub(super) s_0: Motion,
    s_ref: [Motion; STAGES],
    pub(super) u: Inputs,
}

impl At {
    /// A plan from a heading of `theta`; `variant` chooses velocities and inputs.
    fn new(theta: f64, variant: f64) -> Self {
        let (mut s_0, mut s_ref) = (Motion::zeros(), Motion::zeros());
        for (row, value) in [
            (motion::THETA, theta),
            (motion::V_X, 0.8 * variant.cos()),
            (motion::V_Y, 0.8 * variant.sin()),
            (motion::V_Z, 0.1),
            (motion::OMEGA, -0.3),
            (motion::D_X, 0.05),
            (motion::D_Y, -0.1),
        ] {
            s_0[row] = value;
        }
        for (row, value) in
            [(motion::X, 0.6), (motion::Y, -0.4), (motion::Z, 0.2), (motion::THETA, theta + 0.5)]
        {
            s_ref[row] = value;
        }
        let mpc = controller_of(QpKind::Riccati, 10, &[(4, 1), (2, 3)]);
        let u = Inputs::from_fn(|i, _| 0.7 * (1.3 * i as f64 + variant).sin());
        let mut at = Self { mpc, s_0, s_ref: [s_ref; STAGES], u };
        at.gradient(&u);
        let cost = at.cost(&u, RollOut::States);
        assert!(cost > 0.1, "{cost}");
        at
    }

    /// Makes `u` the plan and expands it; the reduced gradient.
    pub(super) fn gradient(&mut self, u: &Inputs) -> Inputs {
        self.cost(u, RollOut::StatesAndDynamics);
        self.mpc.take_trial();
        self.with(|mpc, _, context| mpc.fill_gradients(context)).unwrap();
        let gradients = &self.mpc.expansion.reduced_gradient;
        Inputs::from_iterator(gradients.iter().flat_map(|g| g.iter()).copied().take(u.len()))
    }

    /// Does `act` with the controller and what is asked of it.
    fn with<T>(
        &mut self,
        act: impl FnOnce(&mut Controller, &MpcProblem<'_, 11, 4, 11>, &CostContext<'_, 11, 4>) -> T,
    ) -> T {
        let Self { mpc, s_0, s_ref, .. } = self;
        let u_before = &Sticks::repeat(0.1);
        let p = &P.into();
        let problem = MpcProblem { s_0, p, u_before, s_ref, u_given: &[], given_steps: [0; 4] };
        act(mpc, &problem, &CostContext { u_before, s_ref, constraints: None })
    }

    /// Cost of the inputs `u` along the nonlinear model.
    pub(super) fn cost(&mut self, u: &Inputs, results: RollOut) -> f64 {
        self.with(|mpc, problem, context| {
            for (k, u) in u.as_slice().chunks(4).enumerate() {
                mpc.trial.u[k].copy_from_slice(u);
            }
            mpc.roll_out(problem, context, results)
        })
    }

    /// Predicted decrease by the step `du`, with second derivatives of `kind`.
    pub(super) fn gain(&mut self, du: &Inputs, kind: Option<HessianKind>) -> Gain {
        self.with(|mpc, problem, _| {
            mpc.fill_second_derivatives(problem, kind);
            for (k, du) in du.as_slice().chunks(4).enumerate() {
                mpc.expansion.du[k].copy_from_slice(du);
            }
            mpc.expansion.complete_step(&mpc.plan.u, &mpc.bounds, kind.is_some())
        })
    }

    /// Step of the subproblem without bounds, with second derivatives of `kind`.
    pub(super) fn newton_step(&mut self, kind: HessianKind) -> Inputs {
        let bounds = [Bounds { lo: Sticks::repeat(-1e9), hi: Sticks::repeat(1e9) }; STAGES];
        self.with(|mpc, problem, _| {
            mpc.fill_second_derivatives(problem, Some(kind));
            let u = &mpc.plan.u;
            let Expansion { stages, gradient, second_derivatives, penalties, du, .. } =
                &mut mpc.expansion;
            let bounds = &bounds;
            let problem = Problem { stages, gradient, u, bounds, second_derivatives, penalties };
            let solved = mpc.qp.solve(&problem, du, &mut || false).unwrap();
            assert!(solved.has_second_derivatives, "{solved:?}");
            Inputs::from_iterator(du.iter().flat_map(|du| du.iter()).copied())
        })
    }
}

/// Plans from several headings, both sides of the wrap among them.
pub(super) fn plans() -> impl Iterator<Item = At> {
    let headings = [-7.0, -PI, 0.0, 1.0, PI - 1e-9, PI + 1e-9];
    headings.into_iter().enumerate().map(|(k, theta)| At::new(theta, 1.1 * k as f64))
}

#[test]
fn the_reduced_gradient_away_from_the_optimum_meets_its_numeric_twin() {
    for mut at in plans() {
        let (u, theta) = (at.u, at.s_0[motion::THETA]);
        let gradient = at.gradient(&u);
        assert!(gradient.norm() > 1.0, "nothing to gain: {gradient}");
        let cell = std::cell::RefCell::new(&mut at);
        let cost = |u: &Inputs| Vector1::new(cell.borrow_mut().cost(u, RollOut::States));
        let gap = jacobian_gap(cost, &u, &gradient.transpose());
        assert!(gap < 1e-7, "gap {gap:e} at theta = {theta}");
    }
}

#[test]
fn the_predicted_decrease_with_second_derivatives_is_that_of_the_true_cost_to_second_order() {
    let mut missed = 0;
    for mut at in plans() {
        let (u, theta) = (at.u, at.s_0[motion::THETA]);
        let cost = at.cost(&u, RollOut::States);
        for direction in 0..8 {
            let du = Inputs::from_fn(|i, _| {
                1e-3 * f64::from(direction * 5 + 1).mul_add(i as f64, 0.3).sin()
            });
            let [ahead, behind] =
                [1.0, -1.0].map(|sign| at.cost(&(u + sign * du), RollOut::States));
            // Odd orders cancel in the sum, even ones in the difference.
            let (first, second) = (0.5 * (behind - ahead), ahead + behind - 2.0 * cost);
            let curved = |at: &mut At, kind| {
                let [there, back] = [1.0, -1.0].map(|sign| at.gain(&(sign * du), kind));
                assert!((there.descent - first).abs() < 1e-4 * first.abs() + 1e-7, "{there:?}");
                -(there.decrease + back.decrease)
            };
            let gap = (curved(&mut at, Some(HessianKind::Exact)) / second - 1.0).abs();
            assert!(gap < 1e-3, "gap {gap:e} in direction {direction} at theta = {theta}");
            let gap = (curved(&mut at, None) / second - 1.0).abs();
            missed += u32::from(gap > 1e-2);
        }
    }
    // Without second derivatives of the dynamics it is not.
    assert!(missed > 20, "{missed} of 48");
}
