//! Soft constraints along a plan: their penalties, and their linearization.

use super::Mpc;
use super::cost::CostContext;
use super::report::SqpError;
use crate::constraint::{Excess, SoftConstraints};
use crate::horizon::Horizon;
use crate::qp::Penalty;
use crate::qp::penalty::one_sided;
use crate::qp::product::resized;
use horizon_model::Model;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize, const NR: usize>
    Mpc<M, NS, NU, NO, NP, NR>
where
    M: Model<NS, NU, NO, NP>,
{
    /// Checks that the settings have a place for each of the constraints.
    ///
    /// # Errors
    /// [`SqpError::Constraints`].
    pub(super) fn check_constraints(
        &self,
        constraints: Option<&dyn SoftConstraints<NS>>,
    ) -> Result<(), SqpError> {
        let (given, max) =
            (constraints.map_or(0, SoftConstraints::count), self.settings.constraints_max);
        if given > max { Err(SqpError::Constraints { given, max }) } else { Ok(()) }
    }

    /// The penalties of the plan under trial. 1
    pub(super) fn penalty(&self, context: &CostContext<'_, NS, NU>) -> f64 {
        let mut cost = 0.0;
        self.visit_excesses(&self.trial, context, |_, squared_weight, excess| {
            cost += one_sided(squared_weight, excess.value);
        });
        cost
    }

    /// Linearizes the constraints along the plan.
    ///
    /// # Errors
    /// [`SqpError::Constraint`].
    pub(super) fn fill_penalties(
        &mut self,
        context: &CostContext<'_, NS, NU>,
    ) -> Result<(), SqpError> {
        let mut penalties = std::mem::take(&mut self.expansion.penalties);
        penalties.clear();
        let mut is_valid = true;
        self.visit_excesses(&self.plan, context, |(stage, _), squared_weight, excess| {
            is_valid &= invalid_field(squared_weight, excess).is_none();
            let gradient = resized(&excess.gradient);
            penalties.push(Penalty { stage, squared_weight, excess: excess.value, gradient });
        });
        self.expansion.penalties = penalties;
        if is_valid { Ok(()) } else { self.check_excesses(&self.plan, context) }
    }

    /// Checks that every constraint along `plan` that is near is finite, with a weight that is not negative.
    ///
    /// # Errors
    /// [`SqpError::Constraint`] for the first that is not.
    pub(super) fn check_excesses(
        &self,
        plan: &Horizon<NS, NU>,
        context: &CostContext<'_, NS, NU>,
    ) -> Result<(), SqpError> {
        let mut checked = Ok(());
        self.visit_excesses(plan, context, |(stage, constraint), squared_weight, excess| {
            if let (Ok(()), Some((what, value))) = (&checked, invalid_field(squared_weight, excess))
            {
                checked = Err(SqpError::Constraint { constraint, stage, what, value });
            }
        });
        checked
    }

    /// Visits each constraint that is near, stage by stage: stage and index, the squared weight of the steps of the
    /// stage, and the excess.
    fn visit_excesses(
        &self,
        plan: &Horizon<NS, NU>,
        context: &CostContext<'_, NS, NU>,
        mut visit: impl FnMut((usize, usize), f64, &Excess<NS>),
    ) {
        let Some(constraints) = context.constraints else { return };
        let mut ahead_s = 0.0;
        let stages = self.settings.stage_steps().iter().zip(&self.stage_s);
        for (k, (s, (steps, stage_s))) in plan.s.iter().zip(stages).enumerate() {
            ahead_s += stage_s;
            for i in 0..constraints.count() {
                let Some(excess) = constraints.excess(i, s, ahead_s) else { continue };
                visit((k, i), f64::from(*steps) * excess.weight * excess.weight, &excess);
            }
        }
    }
}

/// Field of an [`Excess`] that makes it no constraint, and its value; `None` if it is valid. The weight may be finite
/// and its square not: then the field is `squared weight`.
#[inline]
fn invalid_field<const NS: usize>(
    squared_weight: f64,
    excess: &Excess<NS>,
) -> Option<(&'static str, f64)> {
    let Excess { value, gradient, weight } = excess;
    if !value.is_finite() {
        return Some(("value", *value));
    }
    if *weight < 0.0 || !weight.is_finite() {
        return Some(("weight", *weight));
    }
    if !squared_weight.is_finite() {
        return Some(("squared weight", squared_weight));
    }
    gradient.iter().find(|entry| !entry.is_finite()).map(|entry| ("gradient", *entry))
}

#[cfg(test)]
mod tests {
    use horizon_model::Vector;
    use std::cell::RefCell;

    use horizon_model::Kinematic;
    use horizon_model::rows::{Pose, Sticks, pose};

    use super::*;
    use crate::qp::penalty::of_stage;
    use crate::{MpcSettings, MpcTable, SolverTable};

    /// The height above `floor_m` in one constraint, and another that is far away; notes the times it is asked for.
    struct Floor {
        floor_m: f64,
        asked_s: RefCell<Vec<f64>>,
    }

    impl SoftConstraints<4> for Floor {
        fn count(&self) -> usize {
            2
        }

        fn excess(&self, i: usize, s: &Pose, ahead_s: f64) -> Option<Excess<4>> {
            if i == 1 {
                return None;
            }
            self.asked_s.borrow_mut().push(ahead_s);
            let mut gradient = Pose::zeros();
            gradient[pose::Z] = -1.0;
            Some(Excess { value: self.floor_m - s[pose::Z], gradient, weight: 5.0 })
        }
    }

    /// Stages of 1, 3 and 2 steps of 0.1 s.
    fn mpc() -> Mpc<Kinematic, 4, 4, 4, 4, 4> {
        let table = MpcTable {
            horizon_steps: 6,
            stages: vec![(1, 1), (1, 3), (1, 2)],
            input_cost: crate::InputCost::Absolute,
            c_u: vec![1.0; 4],
            c_s: vec![1.0; 4],
            c_s_end: vec![1.0; 4],
            u_lb: vec![-1.0; 4],
            u_ub: vec![1.0; 4],
            solver: SolverTable::default(),
        };
        let settings: MpcSettings<4, 4> = table.check::<Kinematic, 4, 4, 4, 4>().unwrap();
        let mut mpc = Mpc::new(Kinematic, settings.with_constraints(2), 0.1).unwrap();
        for plan in [&mut mpc.plan, &mut mpc.trial] {
            for (s, height_m) in plan.s.iter_mut().zip([0.5, 1.5, 0.9]) {
                s[pose::Z] = height_m;
            }
        }
        mpc
    }

    fn context<'a>(floor: &'a Floor, s_ref: &'a [Pose]) -> CostContext<'a, 4, 4> {
        const NEUTRAL: &Sticks = &Vector::<4>::new(0.0, 0.0, 0.0, 0.0);
        CostContext { u_before: NEUTRAL, s_ref, constraints: Some(floor) }
    }

    #[test]
    fn a_stage_is_penalized_once_for_each_of_its_steps() {
        let floor = Floor { floor_m: 1.0, asked_s: RefCell::default() };
        let cost = mpc().penalty(&context(&floor, &[]));
        // 0.5 m below for a step, 0.1 m below for two.
        let expected = 0.5 * 25.0 * (0.25 + 2.0 * 0.01);
        assert!((cost - expected).abs() < 1e-12, "{cost}, not {expected}");
        let asked_s = floor.asked_s.into_inner();
        for (asked_s, end_s) in asked_s.iter().zip([0.1, 0.4, 0.6]) {
            assert!((asked_s - end_s).abs() < 1e-12, "{asked_s} s, not {end_s} s");
        }
        assert_eq!(asked_s.len(), 3);
    }

    #[test]
    fn what_is_near_is_linearized_at_the_end_of_its_stage() {
        let floor = Floor { floor_m: 1.0, asked_s: RefCell::default() };
        let mut mpc = mpc();
        // Twice: what was there before is replaced.
        for _ in 0..2 {
            mpc.fill_penalties(&context(&floor, &[])).unwrap();
        }
        let penalties = &mpc.expansion.penalties;
        assert_eq!(penalties.len(), 3);
        for (k, (squared_weight, excess)) in
            [(25.0, 0.5), (75.0, -0.5), (50.0, 0.1)].into_iter().enumerate()
        {
            let [penalty] = &penalties[of_stage(penalties, k)] else { panic!("{penalties:?}") };
            assert!((penalty.squared_weight - squared_weight).abs() < 1e-12, "{penalty:?}");
            assert!((penalty.excess - excess).abs() < 1e-12, "{penalty:?}");
            assert!((penalty.gradient[pose::Z] + 1.0).abs() <= 0.0, "{penalty:?}");
        }
    }

    #[test]
    fn a_plan_that_is_not_finite_has_a_penalty_that_is_not() {
        let floor = Floor { floor_m: f64::NAN, asked_s: RefCell::default() };
        assert!(mpc().penalty(&context(&floor, &[])).is_nan());
    }
}
