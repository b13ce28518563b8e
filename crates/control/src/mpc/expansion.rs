//! The cost around a plan, to second order, and the step that follows from it.
//!
//! Owns derivatives, reduced gradient, costates and the step; inputs and bounds belong to the caller. Only the `NR`
//! controllable rows of the state are part of it: inputs do not change the other rows.

use horizon_model::{Bounds, InputHessian, Vector};

use crate::horizon::Horizon;
use crate::qp::penalty::of_stage;
use crate::qp::product::{mul_sparse, tr_mul_vector};
use crate::qp::{CostHessian, Penalty, Stage};

/// Derivatives along a plan, and a step away from it.
#[derive(Debug)]
pub(super) struct Expansion<const NR: usize, const NU: usize> {
    /// Second derivatives of the cost by inputs and states as independent variables, constant along every plan.
    curvature: CostHessian<NR, NU>,
    /// Linear dynamics along the plan that was rolled out last.
    pub(super) stages: Vec<Stage<NR, NU>>,
    /// First derivatives of the cost by inputs and states as independent variables. 1 / unit of the row
    pub(super) gradient: Horizon<NR, NU>,
    /// By step, first derivatives of the cost by the input along the dynamics: the reduced gradient.
    /// 1 / unit of the row
    pub(super) reduced_gradient: Vec<Vector<NU>>,
    /// By step, first derivatives of the cost to go by the state: the costates (adjoint). 1 / unit of the row
    pub(super) costate: Vec<Vector<NR>>,
    /// By step, second derivatives of the dynamics weighted with the costate; none for models without them.
    /// 1 / (unit of the row, unit of the column)
    pub(super) second_derivatives: Vec<InputHessian<NR, NU>>,
    /// Soft constraints, linearized at the states of the plan, by stage. Units: [`Penalty`]
    pub(super) penalties: Vec<Penalty<NR>>,
    /// By step, how much the inputs change. Unit of each row
    pub(super) du: Vec<Vector<NU>>,
}

/// Predicted decrease of the cost by a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gain {
    /// Minus the directional derivative along the step. 1
    pub(super) descent: f64,
    /// Predicted decrease of the quadratic model. 1
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
            reduced_gradient: vec![Vector::zeros(); steps],
            costate: vec![Vector::zeros(); steps],
            second_derivatives: Vec::with_capacity(steps),
            penalties: Vec::with_capacity(steps * penalties_max),
            du: vec![Vector::zeros(); steps],
        }
    }

    /// Fills costates and reduced gradient from the gradient and the penalties by the backward (adjoint) recursion.
    pub(super) fn fill_gradients(&mut self) {
        let mut by_next = Vector::zeros();
        for (k, Stage { by_state, by_input }) in self.stages.iter().enumerate().rev() {
            by_next += self.gradient.s[k];
            for penalty in &self.penalties[of_stage(&self.penalties, k)] {
                by_next += penalty.gradient_at_zero();
            }
            self.costate[k] = by_next;
            self.reduced_gradient[k] = self.gradient.u[k] + tr_mul_vector(by_input, &by_next);
            by_next = tr_mul_vector(by_state, &by_next);
        }
    }

    /// Clips the step so that `u + du` lies within the bounds exactly. Returns the predicted decrease along the
    /// dynamics; second derivatives count if `has_second_derivatives`, that is, if they were part of the subproblem.
    pub(super) fn complete_step(
        &mut self,
        u: &[Vector<NU>],
        bounds: &[Bounds<NU>],
        has_second_derivatives: bool,
    ) -> Gain {
        let CostHessian { diagonal, coupling } = &self.curvature;
        let (mut ds, mut du_before) = (Vector::zeros(), Vector::zeros());
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
                curved += mul_sparse(&second.by_state, &ds).dot(&ds);
                curved += (2.0 * mul_sparse(&second.by_input_state, &ds)
                    + mul_sparse(&second.by_input, &du))
                .dot(&du);
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

#[cfg(test)]
mod tests {

    use super::*;
    use horizon_model::{Matrix, Vector};

    const STEPS: usize = 4;

    fn wave(at: usize) -> f64 {
        (1.7 * at as f64 + 0.4).sin()
    }

    /// An expansion of which no entry is zero, with penalties inside and outside of their bounds.
    fn expansion() -> Expansion<2, 2> {
        let vector = |at: usize| Vector::<2>::from_fn(|i, _| wave(3 * at + i));
        let matrix = |at: usize| Matrix::<2, 2>::from_fn(|i, j| wave(5 * at + 2 * i + j));
        let positive = |at: usize| vector(at).add_scalar(2.0);
        let diagonal = Horizon {
            u: (0..STEPS).map(positive).collect(),
            s: (0..STEPS).map(|k| positive(k + 10)).collect(),
        };
        let coupling = (0..STEPS).map(|k| vector(k + 20)).collect();
        let mut expansion = Expansion::new(CostHessian { diagonal, coupling }, 2);
        for k in 0..STEPS {
            expansion.stages[k] = Stage { by_state: matrix(k), by_input: matrix(k + 30) };
            (expansion.gradient.u[k], expansion.gradient.s[k]) = (vector(k + 40), vector(k + 50));
            let [by_state, by_input] =
                [60, 70].map(|at| matrix(k + at) + matrix(k + at).transpose());
            let by_input_state = matrix(k + 80);
            expansion.second_derivatives.push(InputHessian { by_state, by_input_state, by_input });
        }
        for (stage, excess) in [(0, 0.3), (1, -0.2), (1, 0.1), (3, -5.0)] {
            let gradient = vector(90 + stage);
            expansion.penalties.push(Penalty { stage, squared_weight: 3.0, excess, gradient });
        }
        expansion
    }

    /// What the step `du` adds to the cost of the quadratic model with its one-sided penalties.
    fn added(at: &Expansion<2, 2>, du: &[Vector<2>], has_second_derivatives: bool) -> f64 {
        let CostHessian { diagonal, coupling } = &at.curvature;
        let (mut cost, mut ds, mut before) = (0.0, Vector::<2>::zeros(), Vector::<2>::zeros());
        for (k, du) in du.iter().enumerate() {
            cost += at.gradient.u[k].dot(du) + 0.5 * diagonal.u[k].component_mul(du).dot(du);
            cost += before.dot(&coupling[k].component_mul(du));
            if has_second_derivatives {
                let InputHessian { by_state, by_input_state, by_input } = &at.second_derivatives[k];
                cost += 0.5 * (ds.dot(&(by_state * ds)) + du.dot(&(by_input * du)));
                cost += du.dot(&(by_input_state * ds));
            }
            ds = at.stages[k].by_state * ds + at.stages[k].by_input * du;
            cost += at.gradient.s[k].dot(&ds) + 0.5 * diagonal.s[k].component_mul(&ds).dot(&ds);
            for penalty in at.penalties.iter().filter(|penalty| penalty.stage == k) {
                let square = |excess: f64| 1.5 * f64::max(excess, 0.0).powi(2);
                cost += square(penalty.excess + penalty.gradient.dot(&ds)) - square(penalty.excess);
            }
            before = *du;
        }
        cost
    }

    fn steps(length: f64) -> Vec<Vector<2>> {
        (0..STEPS).map(|k| Vector::from_fn(|i, _| length * wave(100 + 2 * k + i))).collect()
    }

    #[test]
    fn the_reduced_gradient_meets_its_numeric_twin() {
        let mut expansion = expansion();
        expansion.fill_gradients();
        for (k, i) in (0..STEPS).flat_map(|k| [(k, 0), (k, 1)]) {
            let [there, back] = [1e-6, -1e-6].map(|aside| {
                let mut du = steps(0.0);
                du[k][i] = aside;
                added(&expansion, &du, false)
            });
            let (numeric, given) = ((there - back) / 2e-6, expansion.reduced_gradient[k][i]);
            assert!(
                (given - numeric).abs() < 1e-8,
                "input {i} of step {k}: {given}, not {numeric}"
            );
        }
    }

    #[test]
    fn the_predicted_decrease_is_that_of_the_model_with_its_penalties() {
        let wide = [Bounds { lo: Vector::repeat(-9.0), hi: Vector::repeat(9.0) }; STEPS];
        let mut expansion = expansion();
        expansion.fill_gradients();
        for (length, has_second_derivatives) in
            [-2.0, -0.1, 0.1, 3.0].into_iter().flat_map(|length| [(length, true), (length, false)])
        {
            expansion.du = steps(length);
            let Gain { descent, decrease } =
                expansion.complete_step(&steps(0.0), &wide, has_second_derivatives);
            let expected = -added(&expansion, &steps(length), has_second_derivatives);
            let scale = 1.0 + expected.abs();
            assert!((decrease - expected).abs() < 1e-12 * scale, "{decrease}, not {expected}");
            let gradients = expansion.reduced_gradient.iter().zip(steps(length));
            let along: f64 = gradients.map(|(gradient, du)| gradient.dot(&du)).sum();
            assert!((descent + along).abs() < 1e-12 * scale, "{descent}, not {along}");
        }
    }

    #[test]
    fn a_step_ends_at_the_bounds_and_counts_as_it_ends() {
        let mut expansion = expansion();
        expansion.fill_gradients();
        let u = steps(0.2);
        let narrow = [Bounds { lo: Vector::repeat(-0.3), hi: Vector::repeat(0.25) }; STEPS];
        expansion.du = steps(5.0);
        let Gain { decrease, .. } = expansion.complete_step(&u, &narrow, false);
        let mut at_bounds = 0;
        for (k, (u, du)) in u.iter().zip(&expansion.du).enumerate() {
            let (wished, got) = (u + steps(5.0)[k], u + du);
            for i in 0..2 {
                let nearest = wished[i].clamp(-0.3, 0.25);
                assert!((got[i] - nearest).abs() < 1e-15, "{got} of {wished} in step {k}");
                at_bounds += usize::from((wished[i] - nearest).abs() > 0.0);
            }
        }
        assert!(at_bounds > 4, "{at_bounds} at bounds");
        let expected = -added(&expansion, &expansion.du, false);
        assert!((decrease - expected).abs() < 1e-12 * (1.0 + expected.abs()), "{decrease}");
    }
}
