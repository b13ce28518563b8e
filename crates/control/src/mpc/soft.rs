//! Soft constraints along a plan: their penalties, and their linearization.

use super::Mpc;
use super::cost::Against;
use super::report::SolveError;
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
    /// Whether there is a place for each of the constraints.
    pub(super) fn check_constraints(
        &self,
        constraints: Option<&dyn SoftConstraints<NS>>,
    ) -> Result<(), SolveError> {
        let (given, max) =
            (constraints.map_or(0, SoftConstraints::count), self.settings.constraints_max());
        if given > max { Err(SolveError::Constraints { given, max }) } else { Ok(()) }
    }

    /// The penalties of the plan under trial. 1
    pub(super) fn penalty(&self, against: &Against<'_, NS, NU>) -> f64 {
        let mut cost = 0.0;
        self.visit_excesses(&self.trial, against, |_, squared_weight, excess| {
            cost += one_sided(squared_weight, excess.value);
        });
        cost
    }

    /// Linearizes the constraints along the plan.
    pub(super) fn fill_penalties(&mut self, against: &Against<'_, NS, NU>) {
        let mut penalties = std::mem::take(&mut self.expansion.penalties);
        penalties.clear();
        self.visit_excesses(&self.plan, against, |stage, weight, excess| {
            let gradient = resized(&excess.gradient);
            penalties.push(Penalty { stage, weight, excess: excess.value, gradient });
        });
        self.expansion.penalties = penalties;
    }

    /// Visits each constraint that is near, stage by stage, with the squared weight of the steps of the stage.
    fn visit_excesses(
        &self,
        plan: &Horizon<NS, NU>,
        against: &Against<'_, NS, NU>,
        mut visit: impl FnMut(usize, f64, &Excess<NS>),
    ) {
        let Some(constraints) = against.constraints else { return };
        let mut ahead_s = 0.0;
        let stages = self.settings.stage_steps().iter().zip(&self.stage_s);
        for (k, (s, (steps, stage_s))) in plan.s.iter().zip(stages).enumerate() {
            ahead_s += stage_s;
            for i in 0..constraints.count() {
                let Some(excess) = constraints.excess(i, s, ahead_s) else { continue };
                visit(k, f64::from(*steps) * excess.weight * excess.weight, &excess);
            }
        }
    }
}
