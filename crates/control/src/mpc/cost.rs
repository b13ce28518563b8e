//! The cost of a plan, its gradient and its curvature: thesis equations 3.46-3.48.

use nalgebra::SVector;

use super::settings::{InputCost, MpcSettings};
use crate::horizon::Horizon;
use crate::qp::Curvature;

/// What a plan is measured against.
#[derive(Debug, Clone, Copy)]
pub(super) struct Against<'a, const NS: usize, const NU: usize> {
    /// The input before `u_0`.
    pub(super) u_before: &'a SVector<f64, NU>,
    /// References of `s_1 .. s_L`.
    pub(super) s_ref: &'a [SVector<f64, NS>],
}

/// Squared weights of `1/2 (sum |C_u du_k|^2 + sum |C_s (s_k - s_ref_k)|^2 + |C_t (s_L - s_ref_L)|^2)`.
///
/// `du_k` is `u_k` or `u_k - u_{k-1}`, by [`InputCost`]. A quadratic function of inputs and states,
/// so its second derivative is the same everywhere.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cost<const NS: usize, const NU: usize> {
    input_cost: InputCost,
    input: SVector<f64, NU>,
    stage: SVector<f64, NS>,
    end: SVector<f64, NS>,
}

impl<const NS: usize, const NU: usize> Cost<NS, NU> {
    pub(super) fn new<const NP: usize>(settings: &MpcSettings<NS, NU, NP>) -> Self {
        let squared = |weights: &SVector<f64, NS>| weights.component_mul(weights);
        Self {
            input_cost: settings.input_cost(),
            input: settings.c_u().component_mul(settings.c_u()),
            stage: squared(settings.c_s()),
            end: squared(settings.c_s_end()),
        }
    }

    /// Cost of `plan`. 1
    pub(super) fn value(&self, plan: &Horizon<NS, NU>, against: &Against<'_, NS, NU>) -> f64 {
        let mut cost = 0.0;
        for (k, u) in plan.u.iter().enumerate() {
            cost += weighted_square(&self.input, &(u - self.input_origin(k, plan, against)));
        }
        for (k, weight) in self.state_weights(plan.steps()).enumerate() {
            cost += weighted_square(weight, &(plan.s[k] - against.s_ref[k]));
        }
        0.5 * cost
    }

    /// Writes the derivative of [`Cost::value`] by every input and state, as if they were free.
    pub(super) fn gradient(
        &self,
        plan: &Horizon<NS, NU>,
        against: &Against<'_, NS, NU>,
        gradient: &mut Horizon<NS, NU>,
    ) {
        for (k, u) in plan.u.iter().enumerate() {
            let by_du = self.input.component_mul(&(u - self.input_origin(k, plan, against)));
            gradient.u[k] = by_du;
            if self.input_cost == InputCost::Difference && k > 0 {
                gradient.u[k - 1] -= by_du;
            }
        }
        for (k, weight) in self.state_weights(plan.steps()).enumerate() {
            gradient.s[k] = weight.component_mul(&(plan.s[k] - against.s_ref[k]));
        }
    }

    /// Second derivative of [`Cost::value`] over `steps` steps.
    pub(super) fn curvature(&self, steps: usize) -> Curvature<NS, NU> {
        let mut diagonal = Horizon::zeros(steps);
        for (k, weight) in self.state_weights(steps).enumerate() {
            diagonal.s[k] = *weight;
            // A difference is counted at both of its inputs; the last input has no successor.
            let is_counted_twice = self.input_cost == InputCost::Difference && k + 1 < steps;
            diagonal.u[k] = if is_counted_twice { 2.0 * self.input } else { self.input };
        }
        let coupling = (self.input_cost == InputCost::Difference).then_some(-self.input);
        Curvature { diagonal, coupling }
    }

    /// Weights of `s_1 .. s_L`.
    fn state_weights(&self, steps: usize) -> impl Iterator<Item = &SVector<f64, NS>> {
        (1..=steps).map(move |k| if k < steps { &self.stage } else { &self.end })
    }

    /// What `u_k` is compared with.
    fn input_origin(
        &self,
        k: usize,
        plan: &Horizon<NS, NU>,
        against: &Against<'_, NS, NU>,
    ) -> SVector<f64, NU> {
        match self.input_cost {
            InputCost::Absolute => SVector::zeros(),
            InputCost::Difference if k == 0 => *against.u_before,
            InputCost::Difference => plan.u[k - 1],
        }
    }
}

/// `sum weight_i v_i^2`.
fn weighted_square<const N: usize>(weight: &SVector<f64, N>, v: &SVector<f64, N>) -> f64 {
    weight.component_mul(v).dot(v)
}
