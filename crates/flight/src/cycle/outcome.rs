//! Everything that a tick reports, in buffers that are filled again and again.

use horizon_control::{MpcReport, SqpError};
use horizon_estim::{MheError, SolveReport};
use horizon_model::Row;
use horizon_model::rows::{Pose, Sticks, pose, stick};
use nalgebra::SVector;
use schemars::JsonSchema;
use serde::Serialize;
use thiserror::Error;

use super::Inbox;
use super::dead_time::DeadTimeChange;
use super::walls::Clearance;
use crate::drone::DroneOrder;
use crate::gate::Approved;
use crate::{Decision, Filtered, Findings, LinkDecision, Mission, Phase, Sighting};

/// How a solve ended.
#[derive(Debug, Clone, PartialEq)]
pub enum Solve {
    /// The solve left an iterate.
    Done(SolveFigures),
    /// The solve left no iterate.
    Failed(SolveFailure),
}

/// Why a solve left no iterate.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum SolveFailure {
    /// The estimator's reason.
    #[error(transparent)]
    Estimator(MheError),
    /// The controller's reason.
    #[error(transparent)]
    Controller(SqpError),
}

/// Figures of a finished solve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
pub struct SolveFigures {
    /// Why it stopped.
    pub stop: &'static str,
    /// Iterations of the outer solver.
    pub iterations: u32,
    /// Cost at the start. 1
    pub cost_start: f64,
    /// Cost at the end. 1
    pub cost: f64,
    /// Subproblems of the controller that the stage-wise solver left to Clarabel, which allocates. Not in the log.
    #[serde(skip)]
    pub qp_fallbacks: u32,
}

impl From<Result<SolveReport, MheError>> for Solve {
    fn from(solved: Result<SolveReport, MheError>) -> Self {
        match solved {
            Ok(SolveReport { stop, iterations, cost_start, cost, .. }) => {
                let stop = stop.name();
                Self::Done(SolveFigures { stop, iterations, cost_start, cost, qp_fallbacks: 0 })
            }
            Err(error) => Self::Failed(SolveFailure::Estimator(error)),
        }
    }
}

impl From<Result<MpcReport, SqpError>> for Solve {
    fn from(solved: Result<MpcReport, SqpError>) -> Self {
        match solved {
            Ok(MpcReport { stop, iterations, cost_start, cost, qp_fallbacks, .. }) => {
                let stop = stop.name();
                Self::Done(SolveFigures { stop, iterations, cost_start, cost, qp_fallbacks })
            }
            Err(error) => Self::Failed(SolveFailure::Controller(error)),
        }
    }
}

/// Result of one tick.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outcome {
    /// Ticks since the start of the log.
    pub step: u64,
    /// Newest raw pose of the tick, world frame, heading as received; `None`: no pose arrived. m, rad
    pub raw: Option<Pose>,
    /// Result of the outlier filter on the newest poses; `None` before the tick came to the filter.
    pub filtered: Option<Filtered>,
    /// Newest state estimate, rows and units [`Outcome::state_rows`]; empty if the tick estimated nothing.
    pub s_hat: Vec<f64>,
    /// Parameter estimate, rows and units [`Outcome::parameter_rows`]; empty if the tick estimated nothing.
    pub p_hat: Vec<f64>,
    /// Whether the sent sticks act; `None` without a link monitor, or if the estimator was not started.
    pub link: Option<LinkDecision>,
    /// Sticks that act in place of all sent ones; `None` while the link is up, or as for `link`. 1
    pub outage_input: Option<Sticks>,
    /// Correction of the dead times; `None` if the settings allow none, or the tick estimated nothing.
    pub dead_time: Option<DeadTimeChange>,
    /// How the estimator ended; `None` if it did not solve.
    pub estimator: Option<Solve>,
    /// State predicted over the dead time, rows and units [`Outcome::state_rows`]; empty if the tick planned nothing.
    pub s_pred: Vec<f64>,
    /// Where the mission wants the vehicle to be when the sticks of this tick begin to act, world frame; `None` if the
    /// tick planned nothing. m, rad
    pub reference: Option<Pose>,
    /// Planned sticks over the horizon, a period each; empty if the tick planned nothing, or nobody reads the plan. 1
    pub plan: Vec<[f64; stick::COUNT]>,
    /// How the controller ended; `None` if it did not solve.
    pub controller: Option<Solve>,
    /// How near the plan comes to walls and obstacles; `None` if it stays 1 m away, knows none, or there is no plan.
    pub clearance: Option<Clearance>,
    /// Ticks since the plan in use was solved; `None` without a plan.
    pub plan_lag: Option<u32>,
    /// Sticks asked for by control. 1
    pub u_proposed: Sticks,
    /// Sticks that passed the gate; what the link sends.
    pub approved: Approved,
    /// Sticks that entered the FIFO. 1
    pub u_sent: Sticks,
    /// Present target, world frame. m, rad
    pub target: Pose,
    /// Number of the present target, from 1.
    pub target_number: usize,
    /// Number of targets reached.
    pub targets_reached: usize,
    /// What the monitors found; `None` in the recording of another controller.
    pub findings: Option<Findings>,
    /// Distance of the estimate from the reference less the least one since the mission began or was resumed; `None`
    /// before the first estimate. m
    pub tracking_m: Option<f64>,
    /// Integral of the inputs in one direction that have not moved the vehicle. s of full deflection
    pub pressed_s: f64,
    /// Speed by the estimate; 0 without one. m/s
    pub speed_mps: f64,
    /// The supervisor's decision; `None` in the recording of another controller.
    pub decision: Option<Decision>,
    /// Rows of the model's state.
    pub state_rows: &'static [Row],
    /// Rows of the model's parameter.
    pub parameter_rows: &'static [Row],
}

impl Outcome {
    /// An empty outcome; the only allocation.
    pub fn with_buffers(
        state_rows: &'static [Row],
        parameter_rows: &'static [Row],
        horizon_steps: usize,
    ) -> Self {
        Self {
            s_hat: Vec::with_capacity(state_rows.len()),
            p_hat: Vec::with_capacity(parameter_rows.len()),
            s_pred: Vec::with_capacity(state_rows.len()),
            plan: Vec::with_capacity(horizon_steps),
            target_number: 1,
            state_rows,
            parameter_rows,
            ..Self::default()
        }
    }

    /// The supervisor's phase after the tick.
    pub fn phase(&self) -> Phase {
        self.decision.map_or(Phase::Idle, |decision| decision.phase)
    }

    /// The order that the tick gives to the drone; `None`: no order.
    pub fn order(&self) -> Option<DroneOrder> {
        self.decision?.order
    }

    /// Whether a fresh pose shows the vehicle above the ground; `None` without such a pose.
    pub fn pose_is_airborne(&self) -> Option<bool> {
        self.decision?.pose_is_airborne
    }

    /// The pose rows of the state estimate, which every vehicle model has first; `None` without one. World
    /// frame. m, rad
    pub fn pose_hat(&self) -> Option<Pose> {
        self.s_hat.get(..pose::COUNT).map(SVector::from_column_slice)
    }

    /// The sticks of the tick of `inbox` for displays: those that are sent, or in a dry run, which sends neutral ones,
    /// those that would be: they show whether axes and nose are right. 1
    pub fn u_shown(&self, inbox: &Inbox) -> Sticks {
        if inbox.flown.is_some() { self.u_sent } else { self.approved.sticks() }
    }

    /// Begins the outcome of `step`. The buffers stay, so that nothing is allocated.
    pub(super) fn clear(&mut self, step: u64) {
        let [s_hat, p_hat, s_pred] =
            [&mut self.s_hat, &mut self.p_hat, &mut self.s_pred].map(emptied);
        *self = Self {
            step,
            s_hat,
            p_hat,
            s_pred,
            plan: emptied(&mut self.plan),
            target_number: 1,
            state_rows: self.state_rows,
            parameter_rows: self.parameter_rows,
            ..Self::default()
        };
    }

    pub(super) fn observe(&mut self, sighting: Option<&Sighting>, filtered: &Filtered) {
        self.raw = sighting.and_then(|sighting| sighting.pose).or(self.raw);
        self.filtered = Some(*filtered);
    }

    /// Copies the target of `mission`, its number and the count of those reached.
    pub(super) fn note_targets(&mut self, mission: &Mission) {
        self.target = *mission.target();
        self.targets_reached = mission.targets_reached();
        self.target_number = mission.targets_reached() + usize::from(!mission.is_finished());
    }
}

/// The memory of `buffer`, without its values.
fn emptied<T>(buffer: &mut Vec<T>) -> Vec<T> {
    buffer.clear();
    std::mem::take(buffer)
}

#[cfg(test)]
mod tests {
    use horizon_model::{Kinematic, Model};
    use serde_json::json;

    use super::*;
    use crate::time::TimeNs;
    use crate::{Acceptance, FaultSet, Pilot, Reference};

    const HERE: Pose = Pose::new(1.0, 2.0, 1.5, 0.3);

    fn outcome() -> Outcome {
        Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3)
    }

    fn decision(order: Option<DroneOrder>) -> Decision {
        Decision {
            phase: Phase::Flying,
            pilot: Some(Pilot::Controller),
            is_braking: false,
            order,
            faults: FaultSet::default(),
            ended_by: FaultSet::default(),
            pose_is_airborne: Some(true),
        }
    }

    fn sighting(pose: Option<Pose>) -> Sighting {
        Sighting { frame: 1, measured_at: TimeNs(0), received_at: TimeNs(0), pose }
    }

    #[test]
    fn an_outcome_has_the_order_and_the_phase_of_its_ruling() {
        let mut out = outcome();
        assert_eq!((out.order(), out.phase(), out.pose_is_airborne()), (None, Phase::Idle, None));
        for order in [None, Some(DroneOrder::Land)] {
            out.decision = Some(decision(order));
            assert_eq!(out.order(), order);
            assert_eq!((out.phase(), out.pose_is_airborne()), (Phase::Flying, Some(true)));
        }
    }

    #[test]
    fn the_pose_of_an_estimate_is_its_first_rows_and_none_without_all_of_them() {
        let mut out = outcome();
        assert_eq!(out.pose_hat(), None);
        out.s_hat.extend([1.0, 2.0, 1.5]);
        assert_eq!(out.pose_hat(), None, "three rows");
        out.s_hat.extend([0.3, 9.0]);
        assert_eq!(out.pose_hat(), Some(HERE));
    }

    #[test]
    fn a_sighting_without_a_pose_leaves_the_one_before_and_a_new_tick_none() {
        let mut out = outcome();
        let held = Filtered { o: None, position: Acceptance::Held, heading: Acceptance::Held };
        out.observe(Some(&sighting(Some(HERE))), &held);
        out.observe(Some(&sighting(None)), &held);
        out.observe(None, &held);
        assert_eq!((out.raw, out.filtered), (Some(HERE), Some(held)));
        let there = HERE + Pose::new(0.1, 0.0, 0.0, 0.0);
        out.observe(Some(&sighting(Some(there))), &held);
        assert_eq!(out.raw, Some(there), "the newest");
        out.s_hat.push(1.0);
        out.plan.push([0.0; stick::COUNT]);
        out.reference = Some(HERE);
        out.decision = Some(decision(Some(DroneOrder::Land)));
        out.clear(7);
        assert_eq!(out, Outcome { step: 7, ..outcome() });
    }

    #[test]
    fn the_number_of_the_target_is_the_next_one_until_the_last_is_reached() {
        let targets = json!({ "targets": {
            "reach": 0.2, "targets": [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]]
        }});
        let mut mission = Mission::new(&serde_json::from_value(targets).unwrap(), 0.02).unwrap();
        let mut out = outcome();
        for (reached, number, x_m) in [(0, 1, 0.0), (1, 2, 1.0), (2, 2, 1.0)] {
            out.note_targets(&mission);
            let found = (out.targets_reached, out.target_number, out.target);
            assert_eq!(found, (reached, number, Pose::new(x_m, 0.0, 1.0, 0.0)));
            let mut next = [Reference::default()];
            mission.fill(0, &[1], &mut next);
            mission.advance(&next[0].pose);
        }
    }
}
