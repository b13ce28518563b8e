//! The cost around a plan, to second order, and the step that follows from it.
//!
//! Owns derivatives, reduced gradient, costates and the step; inputs and bounds belong to the caller. Only the `NR`
//! controllable rows of the state are part of it: inputs do not change the other rows.

use horizon_model::DriveHessian;
use nalgebra::SVector;

use crate::horizon::Horizon;
use crate::qp::penalty::of_stage;
use crate::qp::product::{mul, tr_mul};
use crate::qp::{Bounds, CostHessian, Penalty, Stage};

/// Derivatives along a plan, and a step away from it.
#[derive(Debug)]
pub(super) struct Expansion<const NR: usize, const NU: usize> {
    /// Second derivatives of the cost by inputs and states as independent variables, constant along every plan.
    curvature: CostHessian<NR, NU>,
    /// Linear dynamics along the plan that was rolled out last.
    pub(super) stages: Vec<Stage<NR, NU>>,
    /// First derivatives of the cost by inputs and states as independent variables.
    pub(super) gradient: Horizon<NR, NU>,
    /// By step, first derivatives of the cost by the input along the dynamics: the reduced gradient.
    /// 1 / unit of the row
    pub(super) reduced_gradient: Vec<SVector<f64, NU>>,
    /// By step, first derivatives of the cost to go by the state: the costates (adjoint). 1 / unit of the row
    pub(super) costate: Vec<SVector<f64, NR>>,
    /// By step, second derivatives of the dynamics weighted with the costate; none for models without them.
    pub(super) second_derivatives: Vec<DriveHessian<NR, NU>>,
    /// Soft constraints, linearized at the states of the plan, by stage.
    pub(super) penalties: Vec<Penalty<NR>>,
    /// By step, how much the inputs change. Unit of each row
    pub(super) du: Vec<SVector<f64, NU>>,
}

/// Predicted decrease of the cost by a step. 1
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain {
    /// First order: minus the directional derivative along the step.
    pub(super) descent: f64,
    /// Second order: the decrease of the quadratic model.
    pub(super) decrease: f64,
}

impl<const NR: usize, const NU: usize> Expansion<NR, NU> {
    /// Zeros, with the curvature of the cost and at most `penalties_max` penalties per stage. The only allocations.
    pub(super) fn new(curvature: CostHessian<NR, NU>, penalties_max: usize) -> Self {
        let steps = curvature.diagonal.steps();
        Self {
            curvature,
            stages: vec![Stage::zeros(); steps],
            gradient: Horizon::zeros(steps),
            reduced_gradient: vec![SVector::zeros(); steps],
            costate: vec![SVector::zeros(); steps],
            second_derivatives: Vec::with_capacity(steps),
            penalties: Vec::with_capacity(steps * penalties_max),
            du: vec![SVector::zeros(); steps],
        }
    }

    /// Fills costates and reduced gradient from the gradient and the penalties by the backward (adjoint) recursion.
    pub(super) fn fill_gradients(&mut self) {
        let mut by_next = SVector::zeros();
        for (k, Stage { by_state, by_input }) in self.stages.iter().enumerate().rev() {
            by_next += self.gradient.s[k];
            for penalty in &self.penalties[of_stage(&self.penalties, k)] {
                by_next += penalty.gradient_at_zero();
            }
            self.costate[k] = by_next;
            self.reduced_gradient[k] = self.gradient.u[k] + tr_mul(by_input, &by_next);
            by_next = tr_mul(by_state, &by_next);
        }
    }

    /// Clips the step so that `u + du` lies within the bounds exactly. Returns the predicted decrease along the
    /// dynamics; second derivatives count if `has_second_derivatives`, that is, if they were part of the subproblem.
    pub(super) fn complete_step(
        &mut self,
        u: &[SVector<f64, NU>],
        bounds: &[Bounds<NU>],
        has_second_derivatives: bool,
    ) -> Gain {
        let CostHessian { diagonal, coupling } = &self.curvature;
        let (mut ds, mut du_before) = (SVector::zeros(), SVector::zeros());
        let (mut descent, mut curved) = (0.0, 0.0);
        for (k, stage) in self.stages.iter().enumerate() {
            let du = bounds[k].clamp(&(u[k] + self.du[k])) - u[k];
            descent -= self.reduced_gradient[k].dot(&du);
            curved += diagonal.u[k].component_mul(&du).dot(&du);
            if let Some(coupling) = coupling.get(k) {
                curved += 2.0 * coupling.component_mul(&du_before).dot(&du);
            }
            if let Some(second) = self.second_derivatives.get(k).filter(|_| has_second_derivatives)
            {
                curved += mul(&second.by_state, &ds).dot(&ds);
                curved +=
                    (2.0 * mul(&second.by_input_state, &ds) + mul(&second.by_input, &du)).dot(&du);
            }
            ds = stage.next(&ds, &du);
            curved += diagonal.s[k].component_mul(&ds).dot(&ds);
            for penalty in &self.penalties[of_stage(&self.penalties, k)] {
                curved += 2.0 * penalty.above_tangent(&ds);
            }
            self.du[k] = du;
            du_before = du;
        }
        Gain { descent, decrease: descent - 0.5 * curved }
    }
}
