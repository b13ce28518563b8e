//! The thesis' controller as it flew, still selectable: `configs/thesis/as_flown.json`.
//!
//! Owns in which tick estimate and plan are made, and what only this baseline needs: held observations, the correction
//! of the parameter and the distance to which targets are clipped. Outside of the tick the baseline has its vehicle
//! (`KinematicPublished`) and the shift of the prior in the estimator (`MheTable::shift_prior`).

use horizon_estim::MheTable;
use horizon_model::setting::{SettingError, finite, in_range, positive, vector};
use nalgebra::SVector;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::measurement_time::TickObservations;
use super::{
    COMING, Cycle, CycleTable, JUST_ENDED, JUST_ENDED_AFTER_PUSH, Outcome, PlanningTable, Vehicle,
    Watch,
};

/// Most by which an angle of the parameter is corrected: a plan whose heading is as wrong still converges. rad
const TURN_MAX_RAD: f64 = 0.8;

/// When an estimate and a plan are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pipeline {
    /// In the tick that made them.
    SameTick,
    /// One tick later each, as the published controller's asynchronous handlers do.
    #[serde(alias = "lagged")]
    NextTick,
}

/// What the estimator gets while the filter holds a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HeldObservations {
    /// Nothing: the row is absent.
    Skip,
    /// The held value, as if it had been observed; the published controller does so.
    Use,
}

/// Checked form of what [`PlanningTable`] adds to the settings of the controller.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Baseline<const NP: usize> {
    /// Distance to which the target is clipped, thesis equation 4.20: the norm over the pose, m and rad alike
    pub(super) max_target_distance: f64,
    /// Added to the estimated parameter. Unit of each row
    pub(super) p_correction: SVector<f64, NP>,
}

impl<const NP: usize> Baseline<NP> {
    /// The checked values of `table`, against the parameter rows of a model.
    ///
    /// # Errors
    /// The first value that breaks its rule.
    pub(super) fn new<M: Vehicle<NS, NP>, const NS: usize>(
        table: &PlanningTable,
    ) -> Result<Self, SettingError> {
        Ok(Self {
            max_target_distance: positive("max_target_distance", table.max_target_distance)?,
            p_correction: vector("p_correction", &table.p_correction, &M::PARAMETER, finite)?,
        })
    }
}

/// Refuses a correction that inverts the vehicle, or makes another one of it: with it the prior lies within the bounds
/// of the estimator, and an estimate at its lower bound stays positive; an angle changes by [`TURN_MAX_RAD`] at most.
/// Sizes are checked.
///
/// # Errors
/// The first value that breaks its rule, with its key below `cycle.mpc`.
pub(super) fn check_correction<M: Vehicle<NS, NP>, const NS: usize, const NP: usize>(
    cycle: &CycleTable,
) -> Result<(), SettingError> {
    let MheTable { p_prior, p_lb, p_ub, .. } = &cycle.mhe;
    let rows = M::PARAMETER.iter().zip(&cycle.mpc.p_correction).enumerate();
    for (i, (row, correction)) in rows {
        let key = format!("p_correction[{i}]");
        let at = |place: usize| [p_lb, p_prior, p_ub].map(|p| p.get(place).copied().unwrap_or(0.0));
        let [low, prior, high] = at(i);
        if row.is_angle {
            in_range(&key, *correction, -TURN_MAX_RAD..=TURN_MAX_RAD)?;
        } else if !(low..=high).contains(&(prior + correction)) {
            let rule = format!(
                "{prior} + p_correction within {low}..={high}, the bounds of {} in cycle.mhe",
                row.name
            );
            return Err(SettingError::new(key, correction, rule));
        } else if low > 0.0 && low + correction <= 0.0 {
            let rule = format!(
                "above {}: an estimate at its bound cycle.mhe.p_lb must stay positive",
                -low
            );
            return Err(SettingError::new(key, correction, rule));
        }
    }
    Ok(())
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// The estimate of [`Pipeline::SameTick`] from the newest observation; nothing in the other pipeline.
    pub(super) fn estimate_in_same_tick(
        &mut self,
        seen: Option<&TickObservations>,
        watch: &mut dyn Watch,
        out: &mut Outcome,
    ) {
        if self.pipeline == Pipeline::SameTick {
            self.estimate(seen, JUST_ENDED, watch, out);
        }
    }

    /// Progress of the mission and the plan of [`Pipeline::SameTick`], by the estimate of this tick; nothing in the
    /// other pipeline.
    pub(super) fn plan_in_same_tick(&mut self, watch: &mut dyn Watch, out: &mut Outcome) {
        if self.pipeline == Pipeline::SameTick {
            self.advance_mission();
            self.plan(COMING, watch, out);
        }
    }

    /// Plan and estimate of [`Pipeline::NextTick`], made after the sticks of this tick are sent: the plan by the
    /// estimate of the tick before; nothing in the other pipeline.
    pub(super) fn solve_for_next_tick(
        &mut self,
        may_steer: bool,
        seen: Option<&TickObservations>,
        watch: &mut dyn Watch,
        out: &mut Outcome,
    ) {
        if self.pipeline != Pipeline::NextTick {
            return;
        }
        if may_steer {
            self.plan(JUST_ENDED_AFTER_PUSH, watch, out);
            self.advance_mission();
        }
        self.estimate(seen, JUST_ENDED_AFTER_PUSH, watch, out);
    }
}

#[cfg(test)]
mod tests;
