//! The cost around a plan, to second order, and the step that follows from it.
//!
//! Owns what the quadratic subproblem consists of. Only the `NR` rows of the state that inputs reach are
//! part of it: the others move the same whatever is planned.

use nalgebra::{ArrayStorage, SMatrix, SVector};
use tello_model::DriveCurvature;

use crate::horizon::Horizon;
use crate::qp::product::{mul, tr_mul};
use crate::qp::{Bounds, Curvature, Stage};

/// Derivatives along a plan, and a step away from it.
#[derive(Debug)]
pub(super) struct Local<const NR: usize, const NU: usize> {
    /// Of the cost by inputs and states as if they were free, the same along every plan.
    curvature: Curvature<NR, NU>,
    pub(super) stages: Vec<Stage<NR, NU>>,
    /// Of the cost by inputs and states as if they were free.
    pub(super) gradient: Horizon<NR, NU>,
    /// Of the cost by each input and state with all that follows from it.
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

impl<const NR: usize, const NU: usize> Local<NR, NU> {
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

    /// Makes the slope of the gradient, back along the stages.
    pub(super) fn carry_slope(&mut self) {
        let mut by_next = SVector::zeros();
        for (k, Stage { by_state, by_input }) in self.stages.iter().enumerate().rev() {
            by_next += self.gradient.s[k];
            self.slope.s[k] = by_next;
            self.slope.u[k] = self.gradient.u[k] + tr_mul(by_input, &by_next);
            by_next = tr_mul(by_state, &by_next);
        }
    }

    /// Moves the step away from the inputs `u` into the bounds exactly. What it gains if the states follow
    /// comes back, the bends counted if `is_bent`.
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
            if let Some(coupling) = coupling {
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

/// The leading block of `a`, or `a` with zeros behind it.
#[inline]
pub(super) fn leading<const R: usize, const C: usize, const TO_R: usize, const TO_C: usize>(
    a: &SMatrix<f64, R, C>,
) -> SMatrix<f64, TO_R, TO_C> {
    let mut block = [[0.0; TO_R]; TO_C];
    for (to, from) in block.iter_mut().zip(&a.data.0) {
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from;
        }
    }
    SMatrix::from_data(ArrayStorage(block))
}
