//! The cost of a plan, its gradient and its curvature: thesis equations 3.46-3.48.

use super::settings::{InputCost, MpcSettings};
use crate::SoftConstraints;
use crate::horizon::Horizon;
use crate::qp::CostHessian;
use crate::qp::product::resized;
use horizon_model::Vector;

/// What the cost of a plan depends on beside the plan.
#[derive(Clone, Copy)]
pub(super) struct CostContext<'a, const NS: usize, const NU: usize> {
    /// The input before `u_0`. In the units of its rows
    pub(super) u_before: &'a Vector<NU>,
    /// References of `s_1 .. s_N`. In the units of their rows
    pub(super) s_ref: &'a [Vector<NS>],
    /// Soft constraints on `s_1 .. s_N`.
    pub(super) constraints: Option<&'a dyn SoftConstraints<NS>>,
}

/// Squared weights of `1/2 (sum |C_u Delta u_k|^2 + sum |C_s (s_k - s_ref_k)|^2 + |C_s_end (s_N - s_ref_N)|^2)`.
///
/// `Delta u_k` is `u_k` or `u_k - u_{k-1}`, by [`InputCost`]. A quadratic function of inputs and states,
/// so its second derivative is the same everywhere.
///
/// In a stage of several steps state and input count once for each step. A change of the input counts as if it were
/// spread evenly over the steps from the middle of one stage to the middle of the next.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Cost<const NS: usize, const NU: usize> {
    kind: InputCost,
    /// Squared weights of the input or its change, by stage. 1 / unit^2 of the row
    input: Vec<Vector<NU>>,
    input_reciprocal: Vec<Vector<NU>>,
    /// Squared weights of `s_1 .. s_N`. 1 / unit^2 of the row
    state: Vec<Vector<NS>>,
}

impl<const NS: usize, const NU: usize> Cost<NS, NU> {
    pub(super) fn new(settings: &MpcSettings<NS, NU>) -> Self {
        let squared = |weights: &Vector<NS>| weights.component_mul(weights);
        let input = settings.c_u.component_mul(&settings.c_u);
        let (state, end) = (squared(&settings.c_s), squared(&settings.c_s_end));
        Self::of_squares(settings.input_cost, settings.stage_steps(), input, state, end)
    }

    /// The cost with the steps of each stage, and the squared weights of the inputs of a step, of the state after a
    /// step and of the last one.
    fn of_squares(
        kind: InputCost,
        stage_steps: &[u32],
        input: Vector<NU>,
        state: Vector<NS>,
        end: Vector<NS>,
    ) -> Self {
        let mut before = 1.0;
        let mut weigh = |steps: &u32| {
            let steps = f64::from(*steps);
            let middles = 0.5 * (std::mem::replace(&mut before, steps) + steps);
            match kind {
                InputCost::Absolute => input * steps,
                InputCost::Difference => input / middles,
            }
        };
        let input: Vec<_> = stage_steps.iter().map(&mut weigh).collect();
        let mut state: Vec<_> = stage_steps.iter().map(|steps| state * f64::from(*steps)).collect();
        if let Some(last) = state.last_mut() {
            *last = end;
        }
        let input_reciprocal = input.iter().map(|weight| weight.map(f64::recip)).collect();
        Self { kind, input, input_reciprocal, state }
    }

    /// Cost of `plan`. 1
    pub(super) fn value(&self, plan: &Horizon<NS, NU>, context: &CostContext<'_, NS, NU>) -> f64 {
        let mut cost = 0.0;
        for (k, u) in plan.u.iter().enumerate() {
            cost += weighted_square(&self.input[k], &(u - self.input_origin(k, plan, context)));
        }
        for (k, weight) in self.state.iter().enumerate() {
            cost += weighted_square(weight, &(plan.s[k] - context.s_ref[k]));
        }
        0.5 * cost
    }

    /// Writes the derivative of [`Cost::value`] by every input and the first `NR` rows of every state, as independent
    /// variables.
    pub(super) fn gradient<const NR: usize>(
        &self,
        plan: &Horizon<NS, NU>,
        context: &CostContext<'_, NS, NU>,
        gradient: &mut Horizon<NR, NU>,
    ) {
        for (k, u) in plan.u.iter().enumerate() {
            let by_du = self.input[k].component_mul(&(u - self.input_origin(k, plan, context)));
            gradient.u[k] = by_du;
            if self.kind == InputCost::Difference && k > 0 {
                gradient.u[k - 1] -= by_du;
            }
        }
        for (k, weight) in self.state.iter().enumerate() {
            gradient.s[k] = resized(&weight.component_mul(&(plan.s[k] - context.s_ref[k])));
        }
    }

    /// The derivative of [`Cost::gradient`].
    pub(super) fn curvature<const NR: usize>(&self) -> CostHessian<NR, NU> {
        let mut diagonal =
            Horizon { u: self.input.clone(), s: self.state.iter().map(resized).collect() };
        let mut coupling = Vec::new();
        if self.kind == InputCost::Difference {
            // A difference is counted at both of its inputs.
            for (u, next) in diagonal.u.iter_mut().zip(self.input.iter().skip(1)) {
                *u += next;
            }
            coupling.extend(self.input.iter().map(|weight| -weight));
        }
        CostHessian { diagonal, coupling }
    }

    /// Upper bound of the decrease by any step, from the reduced gradient of each input: with `D` mapping inputs to the
    /// inputs or changes that are weighted, `1/2 g' (D' C_u^2 D)^-1 g`, the decrease of the input cost's quadratic
    /// alone. It is a bound since the states only add to the curvature.
    pub(super) fn gain_max(&self, gradient: impl DoubleEndedIterator<Item = Vector<NU>>) -> f64 {
        let (mut gain, mut sum) = (0.0, Vector::zeros());
        for (gradient, reciprocal) in gradient.rev().zip(self.input_reciprocal.iter().rev()) {
            // Each change of an input moves all inputs after it.
            sum = if self.kind == InputCost::Difference { sum + gradient } else { gradient };
            gain += sum.component_mul(&sum).dot(reciprocal);
        }
        0.5 * gain
    }

    /// Decrease that is lost in the rounding of states and inputs near a plan of the cost `cost`. With the weighted
    /// squares `m` of references and inputs and the rounding error `e` of a roll-out: `e sqrt(m) sqrt(cost) + e^2 m`.
    pub(super) fn rounding(&self, cost: f64, plan: &Horizon<NS, NU>, s_ref: &[Vector<NS>]) -> f64 {
        let states = self.state.iter().zip(s_ref).map(|(weight, s)| s.component_mul(s).dot(weight));
        let inputs =
            self.input.iter().zip(&plan.u).map(|(weight, u)| u.component_mul(u).dot(weight));
        let error = f64::EPSILON * plan.u.len() as f64;
        let size = error * states.chain(inputs).sum::<f64>().sqrt();
        size * cost.sqrt() + size * size
    }

    /// What `u_k` is compared with.
    fn input_origin(
        &self,
        k: usize,
        plan: &Horizon<NS, NU>,
        context: &CostContext<'_, NS, NU>,
    ) -> Vector<NU> {
        match self.kind {
            InputCost::Absolute => Vector::zeros(),
            InputCost::Difference if k == 0 => *context.u_before,
            InputCost::Difference => plan.u[k - 1],
        }
    }
}

/// `sum weight_i v_i^2`.
fn weighted_square<const N: usize>(weight: &Vector<N>, v: &Vector<N>) -> f64 {
    weight.component_mul(v).dot(v)
}

#[cfg(test)]
mod tests {
    use horizon_model::check::jacobian_gap;
    use horizon_model::{Matrix, Vector};
    use nalgebra::Vector1;

    use super::*;

    const STEPS: usize = 3;
    const KINDS: [InputCost; 2] = [InputCost::Absolute, InputCost::Difference];

    /// Steps of each stage.
    const EVEN: [u32; STEPS] = [1; STEPS];
    const UNEVEN: [u32; STEPS] = [1, 3, 2];

    fn cost(kind: InputCost, stages: [u32; STEPS]) -> Cost<2, 1> {
        let (state, end) = (Vector::from([1.0, 9.0]), Vector::from([100.0, 25.0]));
        Cost::of_squares(kind, &stages, Vector::from([4.0]), state, end)
    }

    fn cases() -> impl Iterator<Item = (InputCost, Cost<2, 1>)> {
        let stages = [EVEN, UNEVEN].into_iter();
        stages.flat_map(|stages| KINDS.map(|kind| (kind, cost(kind, stages))))
    }

    /// What the costs of the plans depend on: `u_{-1}` and `s_ref`.
    fn given() -> (Vector<1>, [Vector<2>; STEPS]) {
        (Vector1::new(0.25), [[0.5, 0.0], [0.5, 1.0], [0.0, -1.0]].map(Vector::from))
    }

    /// `u_0, u_1, u_2, s_1, s_2, s_3` as a plan, and back.
    fn plan(x: &Vector<9>) -> Horizon<2, 1> {
        let (u, s) = x.as_slice().split_at(STEPS);
        Horizon {
            u: u.chunks(1).map(Vector::from_column_slice).collect(),
            s: s.chunks(2).map(Vector::from_column_slice).collect(),
        }
    }

    fn flat(plan: &Horizon<2, 1>) -> Vector<9> {
        let u = plan.u.iter().flat_map(|u| u.iter());
        Vector::from_iterator(u.chain(plan.s.iter().flat_map(|s| s.iter())).copied())
    }

    fn gradient(cost: &Cost<2, 1>, x: &Vector<9>) -> Vector<9> {
        let (u_before, s_ref) = &given();
        // Whatever was there before must not matter.
        let mut gradient = plan(&Vector::from_element(7.0));
        cost.gradient(&plan(x), &CostContext { u_before, s_ref, constraints: None }, &mut gradient);
        flat(&gradient)
    }

    fn some_plan() -> Vector<9> {
        Vector::from([0.5, 1.0, -2.0, 1.0, 0.0, 0.5, 3.0, 0.25, -2.0])
    }

    #[test]
    fn the_cost_is_the_sum_of_equation_3_46() {
        let (u_before, s_ref) = &given();
        let context = CostContext { u_before, s_ref, constraints: None };
        // Stage: 0.5^2 + 9 * 2^2; end: 100 * 0.25^2 + 25 * 1^2.
        let states = 0.25 + 36.0 + 6.25 + 25.0;
        let absolute = 4.0 * (0.25 + 1.0 + 4.0);
        let difference = 4.0 * (0.0625 + 0.25 + 9.0);
        for (kind, inputs) in KINDS.into_iter().zip([absolute, difference]) {
            let value = cost(kind, EVEN).value(&plan(&some_plan()), &context);
            assert!((value - 0.5 * (states + inputs)).abs() < 1e-12, "{kind:?}: {value}");
        }
    }

    #[test]
    fn a_stage_of_several_steps_costs_what_they_cost() {
        let (u_before, s_ref) = &given();
        let context = CostContext { u_before, s_ref, constraints: None };
        // Stages of 1, 3 and 2 steps: the second state counts three times, the last one has its own weight.
        let states = 0.25 + 3.0 * 36.0 + 6.25 + 25.0;
        let absolute = 4.0 * (0.25 + 3.0 * 1.0 + 2.0 * 4.0);
        // Changes spread evenly between the middles of the stages, 2 and 2.5 steps apart.
        let difference = 4.0 * (0.0625 + 0.25 / 2.0 + 9.0 / 2.5);
        for (kind, inputs) in KINDS.into_iter().zip([absolute, difference]) {
            let value = cost(kind, UNEVEN).value(&plan(&some_plan()), &context);
            assert!((value - 0.5 * (states + inputs)).abs() < 1e-12, "{kind:?}: {value}");
        }
    }

    #[test]
    fn the_gradient_meets_its_numeric_twin() {
        let (u_before, s_ref) = &given();
        let context = CostContext { u_before, s_ref, constraints: None };
        for (kind, cost) in cases() {
            for x in [some_plan(), -some_plan(), Vector::zeros()] {
                let value = |x: &Vector<9>| Vector1::new(cost.value(&plan(x), &context));
                let gap = jacobian_gap(value, &x, &gradient(&cost, &x).transpose());
                // Central differences of a quadratic are exact up to rounding over 6e-6.
                assert!(gap < 1e-8, "gap {gap:e}, {kind:?} at {x}");
            }
        }
    }

    #[test]
    fn the_largest_gain_is_that_of_the_inputs_alone() {
        let gradients = Vector::from([0.3, -1.2, 0.5]);
        for (kind, cost) in cases() {
            let CostHessian { diagonal, coupling } = cost.curvature::<2>();
            let mut hessian = Matrix::<STEPS, STEPS>::zeros();
            for k in 0..STEPS {
                hessian[(k, k)] = diagonal.u[k][0];
                if k > 0 {
                    hessian[(k - 1, k)] = coupling.get(k).map_or(0.0, |coupling| coupling[0]);
                    hessian[(k, k - 1)] = hessian[(k - 1, k)];
                }
            }
            let expected = 0.5 * gradients.dot(&hessian.cholesky().unwrap().solve(&gradients));
            let gain = cost.gain_max(gradients.iter().map(|gradient| Vector1::new(*gradient)));
            assert!((gain - expected).abs() < 1e-12, "{kind:?}: {gain} instead of {expected}");
        }
    }

    #[test]
    fn the_curvature_meets_its_numeric_twin() {
        for (kind, cost) in cases() {
            let curvature = cost.curvature::<2>();
            let mut hessian = Matrix::from_diagonal(&flat(&curvature.diagonal));
            for k in 1..STEPS {
                let coupling = curvature.coupling.get(k).map_or(0.0, |coupling| coupling[0]);
                hessian[(k - 1, k)] = coupling;
                hessian[(k, k - 1)] = coupling;
            }
            let gap = jacobian_gap(|x| gradient(&cost, x), &some_plan(), &hessian);
            assert!(gap < 1e-8, "gap {gap:e}, {kind:?}");
        }
    }
}
