use horizon_model::check::maximum;
use horizon_model::{InputHessian, Matrix, Vector, differences};

use super::*;
use crate::qp::Horizon;
use crate::qp::tests::case::Numbers;

const NS: usize = 2;
const NU: usize = 3;
/// The other penalty of a [`Step`] is outside of the working set.
const PENALIZED: [bool; 2] = [true, false];

/// Every choice of active bounds.
fn patterns() -> impl Iterator<Item = [Option<f64>; NU]> {
    let step = |i: usize| 0.4 - 0.3 * i as f64;
    (0..1 << NU)
        .map(move |bits: usize| std::array::from_fn(|i| ((bits >> i) & 1 == 1).then(|| step(i))))
}

fn definite<const N: usize>(numbers: &mut Numbers) -> Matrix<N, N> {
    let root = numbers.fill::<N, N>();
    root * root.transpose() + Matrix::identity() * 0.5
}

/// A stage with everything that can add to its cost, and what follows it.
struct Step {
    curvature: CostHessian<NS, NU>,
    stages: [Stage<NS, NU>; 1],
    gradient: Horizon<NS, NU>,
    second_derivatives: [InputHessian<NS, NU>; 1],
    penalties: [Penalty<NS>; 2],
    next: Value<NS, NU>,
}

impl Step {
    fn random(seed: u64, couples: bool) -> Self {
        let mut numbers = Numbers::new(seed);
        let mut horizon = || Horizon::<NS, NU> { u: vec![numbers.fill()], s: vec![numbers.fill()] };
        let (gradient, mut diagonal) = (horizon(), horizon());
        diagonal.u[0].apply(|entry| *entry = entry.abs() + 1.0);
        diagonal.s[0].apply(|entry| *entry = entry.abs());
        let mut next = Value::zeros();
        let joint = definite::<{ NS + NU }>(&mut numbers);
        next.by_state = joint.fixed_view::<NS, NS>(0, 0).into();
        next.gradient = numbers.fill();
        let mut coupling = Vec::new();
        if couples {
            coupling.push(numbers.fill());
            next.by_state_before = joint.fixed_view::<NS, NU>(0, NS).into();
            next.by_before = joint.fixed_view::<NU, NU>(NS, NS).into();
            next.gradient_before = numbers.fill();
        }
        let penalty = |squared_weight, excess, gradient| Penalty {
            stage: 0,
            squared_weight,
            excess,
            gradient,
        };
        Self {
            curvature: CostHessian { diagonal, coupling },
            stages: [Stage { by_state: numbers.fill(), by_input: numbers.fill() }],
            gradient,
            second_derivatives: [InputHessian {
                by_state: definite(&mut numbers),
                by_input_state: numbers.fill(),
                by_input: definite(&mut numbers),
            }],
            penalties: [penalty(3.0, 0.2, numbers.fill()), penalty(5.0, -0.2, numbers.fill())],
            next,
        }
    }

    fn eliminate(
        &self,
        active: [Option<f64>; NU],
    ) -> Result<(Policy<NS, NU>, Value<NS, NU>), Reason> {
        let problem = Problem {
            stages: &self.stages,
            gradient: &self.gradient,
            u: &[],
            bounds: &[],
            second_derivatives: &self.second_derivatives,
            penalties: &self.penalties,
        };
        let working = Working { k: 0, active, penalties: &self.penalties, penalized: &PENALIZED };
        let (mut policy, mut value) = (Policy::zeros(), Value::zeros());
        let (curvature, next) = (&self.curvature, &self.next);
        eliminate(&problem, curvature, &working, next, &mut policy, &mut value)?;
        Ok((policy, value))
    }

    /// What the module's equation minimizes over `du`.
    fn cost(&self, ds: &Vector<NS>, dv: &Vector<NU>, du: &Vector<NU>) -> f64 {
        let [stage] = &self.stages;
        let [second] = &self.second_derivatives;
        let ds_next = stage.next(ds, du);
        let Horizon { u, s } = &self.curvature.diagonal;
        let by_input = u[0].component_mul(du) + second.by_input * du;
        let by_state = s[0].component_mul(&ds_next);
        let coupled = self.curvature.coupling.iter().map(|c| dv.dot(&c.component_mul(du)));
        let penalized = self.penalties.iter().zip(PENALIZED).filter(|(_, is_active)| *is_active);
        let penalties =
            penalized.map(|(one, _)| 0.5 * one.squared_weight * one.excess_at(&ds_next).powi(2));
        du.dot(&(0.5 * by_input + second.by_input_state * ds + self.gradient.u[0]))
            + 0.5 * ds.dot(&(second.by_state * ds))
            + ds_next.dot(&(0.5 * by_state + self.gradient.s[0]))
            + coupled.sum::<f64>()
            + penalties.sum::<f64>()
            + cost_to_go(&self.next, &ds_next, du)
    }
}

/// `V(ds, dv)` without its constant.
fn cost_to_go(v: &Value<NS, NU>, ds: &Vector<NS>, dv: &Vector<NU>) -> f64 {
    ds.dot(&(0.5 * v.by_state * ds + v.by_state_before * dv + v.gradient))
        + dv.dot(&(0.5 * v.by_before * dv + v.gradient_before))
}

#[test]
fn the_transform_is_the_inverse_over_the_inputs_that_are_left() {
    let hessian = definite::<NU>(&mut Numbers::new(1));
    for active in patterns() {
        let found = transform(hessian, &active).unwrap();
        for row in 0..NU {
            // Rows and columns of the other active inputs become those of the unit matrix.
            let is_left = |i: usize| i == row || active[i].is_none();
            let left = Matrix::<NU, NU>::from_fn(|i, j| match (is_left(i), is_left(j)) {
                (true, true) => hessian[(i, j)],
                _ => f64::from(u8::from(i == j)),
            });
            let inverse = left.try_inverse().unwrap();
            for col in 0..NU {
                let expected = if is_left(col) { -inverse[(row, col)] } else { 0.0 };
                let gap = (found[(row, col)] - expected).abs();
                assert!(gap < 1e-13, "({row}, {col}) of {active:?}: {gap:e}");
            }
        }
    }
}

#[test]
fn only_pivots_of_inactive_bounds_have_to_be_positive() {
    let mut hessian = definite::<NU>(&mut Numbers::new(2));
    hessian[(1, 1)] = -1.0;
    for active in patterns() {
        let expected = active[1].is_none().then_some(Reason::NotPositive);
        assert_eq!(transform(hessian, &active).err(), expected, "{active:?}");
    }
    hessian[(1, 1)] = f64::NAN;
    assert_eq!(transform(hessian, &[None; NU]), Err(Reason::NotPositive));
}

#[test]
fn the_policy_minimizes_the_cost_and_the_value_is_its_minimum() {
    for (seed, couples) in [(3, false), (4, true), (5, true)] {
        let step = Step::random(seed, couples);
        let mut numbers = Numbers::new(seed + 100);
        for active in patterns() {
            let (policy, value) = step.eliminate(active).unwrap();
            let chosen = |ds: &Vector<NS>, dv: &Vector<NU>| {
                let minimizers = policy.minimizers(ds, dv);
                Vector::from_fn(|i, _| active[i].unwrap_or(minimizers[i]))
            };
            let minimum = |ds: &Vector<NS>, dv: &Vector<NU>| {
                step.cost(ds, dv, &chosen(ds, dv)) - cost_to_go(&value, ds, dv)
            };
            // The constant that the value leaves out.
            let constant = minimum(&Vector::zeros(), &Vector::zeros());
            for _ in 0..5 {
                let ds = numbers.fill();
                let dv = if couples { numbers.fill() } else { Vector::zeros() };
                let gap = (minimum(&ds, &dv) - constant).abs();
                // Rounding of costs of about 10.
                assert!(gap < 1e-12, "seed {seed}, {active:?}: cost {gap:e}");
                let cost = |du: &Vector<NU>| Vector::from([step.cost(&ds, &dv, du)]);
                let gradient = differences::jacobian(cost, &chosen(&ds, &dv));
                let inactive = (0..NU).filter(|i| active[*i].is_none());
                let worst = inactive.map(|i| gradient[i].abs()).fold(0.0, maximum);
                // Rounding error divided by the step of the differences.
                assert!(worst < 1e-8, "seed {seed}, {active:?}: gradient {worst:e}");
            }
        }
    }
}

#[test]
fn the_law_at_an_active_bound_is_the_minimizer_without_that_bound() {
    let step = Step::random(6, true);
    let mut numbers = Numbers::new(106);
    for active in patterns() {
        let (ds, dv) = (numbers.fill(), numbers.fill());
        let minimizers = step.eliminate(active).unwrap().0.minimizers(&ds, &dv);
        for i in (0..NU).filter(|i| active[*i].is_some()) {
            let mut without = active;
            without[i] = None;
            let expected = step.eliminate(without).unwrap().0.minimizers(&ds, &dv);
            let gap = (minimizers[i] - expected[i]).abs();
            assert!(gap < 1e-12, "input {i} of {active:?}: {gap:e}");
        }
    }
}
