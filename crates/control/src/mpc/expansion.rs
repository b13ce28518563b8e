//! The cost around a plan, to second order, and the step that follows from it.
//!
//! Owns derivatives, slopes and the step; inputs and bounds are the caller's. Only the `NR` rows of the
//! state that inputs reach are part of it: the others move the same whatever is planned.

use horizon_model::DriveCurvature;
use nalgebra::SVector;

use crate::horizon::Horizon;
use crate::qp::product::{mul, tr_mul};
use crate::qp::{Bounds, Curvature, Stage};

/// Derivatives along a plan, and a step away from it.
#[derive(Debug)]
pub(super) struct Expansion<const NR: usize, const NU: usize> {
    /// Second derivatives of the cost by inputs and states as if they were free, the same along every plan.
    curvature: Curvature<NR, NU>,
    /// Linear dynamics along the plan that was rolled out last.
    pub(super) stages: Vec<Stage<NR, NU>>,
    /// First derivatives of the cost by inputs and states as if they were free.
    pub(super) gradient: Horizon<NR, NU>,
    /// First derivatives of the cost by each input and state with all that follows from it.
    pub(super) slope: Horizon<NR, NU>,
    /// By step, second derivatives of the cost to go by the dynamics; none for models without them.
    pub(super) bends: Vec<DriveCurvature<NR, NU>>,
    /// By step, how much the inputs change.
    pub(super) du: Vec<SVector<f64, NU>>,
}

/// What a step gains.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain {
    /// By the slope alone.
    pub(super) descent: f64,
    /// If the quadratic subproblem were the truth.
    pub(super) drop: f64,
}

impl<const NR: usize, const NU: usize> Expansion<NR, NU> {
    /// Zeros, with the curvature of the cost. The only allocations.
    pub(super) fn new(curvature: Curvature<NR, NU>) -> Self {
        let steps = curvature.diagonal.steps();
        Self {
            curvature,
            stages: vec![Stage::zeros(); steps],
            gradient: Horizon::zeros(steps),
            slope: Horizon::zeros(steps),
            bends: Vec::with_capacity(steps),
            du: vec![SVector::zeros(); steps],
        }
    }

    /// Fills the slopes from the gradient, from the last stage back.
    pub(super) fn fill_slopes(&mut self) {
        let mut by_next = SVector::zeros();
        for (k, Stage { by_state, by_input }) in self.stages.iter().enumerate().rev() {
            by_next += self.gradient.s[k];
            self.slope.s[k] = by_next;
            self.slope.u[k] = self.gradient.u[k] + tr_mul(by_input, &by_next);
            by_next = tr_mul(by_state, &by_next);
        }
    }

    /// Cuts the step so that `u + du` lies within the bounds exactly. What it gains with states that follow it
    /// comes back; bends count if `is_bent`, that is, if they were part of the subproblem.
    pub(super) fn complete_step(
        &mut self,
        u: &[SVector<f64, NU>],
        bounds: &[Bounds<NU>],
        is_bent: bool,
    ) -> Gain {
        let Curvature { diagonal, coupling } = &self.curvature;
        let (mut ds, mut du_before) = (SVector::zeros(), SVector::zeros());
        let (mut descent, mut curved) = (0.0, 0.0);
        for (k, stage) in self.stages.iter().enumerate() {
            let du = bounds[k].clamp(&(u[k] + self.du[k])) - u[k];
            descent -= self.slope.u[k].dot(&du);
            curved += diagonal.u[k].component_mul(&du).dot(&du);
            if let Some(coupling) = coupling.get(k) {
                curved += 2.0 * coupling.component_mul(&du_before).dot(&du);
            }
            if let Some(bend) = self.bends.get(k).filter(|_| is_bent) {
                curved += mul(&bend.by_state, &ds).dot(&ds);
                curved +=
                    (2.0 * mul(&bend.by_input_state, &ds) + mul(&bend.by_input, &du)).dot(&du);
            }
            ds = stage.next(&ds, &du);
            curved += diagonal.s[k].component_mul(&ds).dot(&ds);
            self.du[k] = du;
            du_before = du;
        }
        Gain { descent, drop: descent - 0.5 * curved }
    }
}
