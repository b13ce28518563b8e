//! The facts of a tick: their names, units and how they follow from what the tick recorded.

use horizon_model::rows::{Pose, Sticks, motion, pose, stick};
use serde::Serialize;
use tello_flight::cycle::{Inbox, Outcome, Timing};
use tello_flight::{Fault, Operator, Phase, Pilot};
use tello_io::clock::TimeNs;
use tello_io::tello::DroneStatus;

use tello_eval::predicted_trajectory::Ahead;
use tello_eval::view_numbers::{PosW, to_thousandths};

/// Facts of one tick, for viewers.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub(in crate::fly) struct Facts {
    /// Ticks since the start of the log.
    pub(in crate::fly) step: u64,
    /// Time since the start of the log. s
    pub(in crate::fly) t_s: f64,
    /// Part of the flight; `None` before the first tick.
    pub(in crate::fly) phase: Option<Phase>,
    /// Who steers; `None` while the vehicle is not steered.
    pub(in crate::fly) pilot: Option<Pilot>,
    /// Whether a person holds the sticks.
    pub(in crate::fly) is_by_hand: bool,
    /// The strongest order so far.
    pub(in crate::fly) operator: Operator,
    /// Present faults.
    pub(in crate::fly) faults: Vec<Fault>,
    /// Newest pose that the filter accepted.
    pub(in crate::fly) measured: Option<Spot>,
    /// The estimate.
    pub(in crate::fly) estimate: Option<Spot>,
    /// Estimated velocity x, y, z in the world frame; `None` for a model without it. m/s
    pub(in crate::fly) velocity_w: Option<[f64; 3]>,
    /// Part of the velocity that is disturbance, world frame. m/s
    pub(in crate::fly) disturbance_w: Option<[f64; 3]>,
    /// The place to be reached next.
    pub(in crate::fly) target: Spot,
    /// Its number, from 1.
    pub(in crate::fly) target_number: usize,
    /// Targets reached so far.
    pub(in crate::fly) targets_reached: usize,
    /// Where the mission wants the vehicle when the sticks of this tick act.
    pub(in crate::fly) reference: Option<Spot>,
    /// Distance and height from the reference path. m
    pub(in crate::fly) offset: Option<[f64; 2]>,
    /// Sent sticks.
    pub(in crate::fly) sticks: SticksFact,
    /// Whether sent sticks act; `None` without a link monitor.
    pub(in crate::fly) link: Option<LinkFact>,
    /// The last status of the drone.
    pub(in crate::fly) drone: Option<DroneFact>,
    /// Facts of the mocap stream.
    pub(in crate::fly) mocap: MocapFact,
    /// Times of this tick.
    pub(in crate::fly) times: Times,
    /// Largest value of each time in the last second.
    pub(in crate::fly) worst: Times,
    /// Whether the log has failed: nothing is recorded any more.
    pub(in crate::fly) has_log_failed: bool,
    /// Periods without a tick so far.
    pub(in crate::fly) missed_periods: u64,
    /// Where sticks that are sent already lead, from the estimate on.
    pub(in crate::fly) committed: Vec<PosW>,
    /// The plan from there on.
    pub(in crate::fly) plan: Vec<PosW>,
    /// Where the vehicle was. Not in what is sent every time: it can be gathered.
    #[serde(skip)]
    pub(in crate::fly) trail: Vec<PosW>,
}

/// A pose with its rows by name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(in crate::fly) struct Spot {
    /// World x. m
    pub(in crate::fly) x: f64,
    /// World y. m
    pub(in crate::fly) y: f64,
    /// World z, up. m
    pub(in crate::fly) z: f64,
    /// Yaw, counter-clockwise from above. rad
    pub(in crate::fly) theta: f64,
}

/// Sticks with their rows by name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(in crate::fly) struct SticksFact {
    /// Roll, positive to the right. 1
    pub(in crate::fly) roll: f64,
    /// Pitch, positive forward. 1
    pub(in crate::fly) pitch: f64,
    /// Yaw, positive counter-clockwise from above. 1
    pub(in crate::fly) yaw: f64,
    /// Throttle, positive upwards. 1
    pub(in crate::fly) throttle: f64,
}

/// Result of the link monitor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(in crate::fly) struct LinkFact {
    /// Whether sent sticks do not act.
    pub(in crate::fly) is_down: bool,
    /// Log likelihood ratio, less the evidence that a change takes: positive exactly while the link is down. 1
    pub(in crate::fly) score: f64,
}

/// The newest report of the drone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(in crate::fly) struct DroneFact {
    /// Age of this status. s
    pub(in crate::fly) age_s: f64,
    /// Charge. %
    pub(in crate::fly) battery_pct: u8,
    /// By the drone's own judgement.
    pub(in crate::fly) is_battery_low: Option<bool>,
    /// In the air, by the drone's own judgement.
    pub(in crate::fly) is_flying: bool,
    /// Height by the drone's own measure. m
    pub(in crate::fly) height_m: Option<f64>,
}

/// Facts of the mocap stream.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(in crate::fly) struct MocapFact {
    /// Time since the newest pose was measured; `None` before the first. s
    pub(in crate::fly) age_s: Option<f64>,
    /// Poses in the last second. Hz
    pub(in crate::fly) rate_hz: f64,
    /// Frames without a pose so far.
    pub(in crate::fly) unseen: u64,
    /// Times that no frame came.
    pub(in crate::fly) gaps: u64,
}

/// Times of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
#[expect(clippy::struct_field_names, reason = "the unit of each")]
pub(in crate::fly) struct Times {
    /// Time from the due moment of the tick to its begin. ms
    pub(in crate::fly) late_ms: f64,
    /// Time of the estimator. ms
    pub(in crate::fly) estimate_ms: f64,
    /// Time of the controller. ms
    pub(in crate::fly) plan_ms: f64,
    /// Time from the begin of the tick to its end. ms
    pub(in crate::fly) tick_ms: f64,
}

impl Facts {
    /// Facts of inbox and outcome of one tick; the rest is empty.
    pub(super) fn of(inbox: &Inbox, out: &Outcome, ahead: Ahead) -> Self {
        let velocities = velocities(out);
        Self {
            step: out.step,
            t_s: inbox.now.seconds(),
            phase: Some(out.phase()),
            pilot: out.decision.and_then(|decision| decision.pilot),
            is_by_hand: inbox.manual.is_some(),
            operator: inbox.operator,
            faults: out
                .decision
                .map(|decision| decision.faults.iter().collect())
                .unwrap_or_default(),
            estimate: out.pose_hat().map(Into::into),
            velocity_w: velocities.map(|[total, _]| total),
            disturbance_w: velocities.map(|[_, drift]| drift),
            target: out.target.into(),
            target_number: out.target_number,
            targets_reached: out.targets_reached,
            reference: out.reference.map(Into::into),
            sticks: out.u_sent.into(),
            link: out
                .link
                .map(|link| LinkFact { is_down: link.state.is_down(), score: link.score }),
            committed: ahead.committed,
            plan: ahead.plan,
            ..Self::default()
        }
    }
}

/// Velocity and its part that is disturbance, x, y, z in the world frame, of a model that has them. m/s
fn velocities(out: &Outcome) -> Option<[[f64; 3]; 2]> {
    let s: &[f64; motion::COUNT] = out.s_hat.first_chunk()?;
    let drift = [s[motion::D_X], s[motion::D_Y], s[motion::D_Z]];
    let total = [
        s[motion::V_X] + s[motion::D_X],
        s[motion::V_Y] + s[motion::D_Y],
        s[motion::V_Z] + s[motion::D_Z],
    ];
    Some([total, drift].map(|velocity| velocity.map(to_thousandths)))
}

impl From<Pose> for Spot {
    fn from(at: Pose) -> Self {
        let [x, y, z] = [at[pose::X], at[pose::Y], at[pose::Z]].map(to_thousandths);
        Self { x, y, z, theta: to_thousandths(at[pose::THETA]) }
    }
}

impl From<Sticks> for SticksFact {
    fn from(u: Sticks) -> Self {
        let [roll, pitch, yaw, throttle] =
            [u[stick::ROLL], u[stick::PITCH], u[stick::YAW], u[stick::THROTTLE]]
                .map(to_thousandths);
        Self { roll, pitch, yaw, throttle }
    }
}

impl DroneFact {
    /// Facts of `status` at `now`.
    pub(super) fn of(status: &DroneStatus, now: TimeNs) -> Self {
        Self {
            age_s: now.since(status.received_at).seconds(),
            battery_pct: status.battery_pct,
            is_battery_low: status.is_battery_low,
            is_flying: status.is_flying,
            height_m: status.height_m,
        }
    }
}

impl From<&Timing> for Times {
    fn from(timing: &Timing) -> Self {
        let ms = |ns: i64| to_thousandths(ns as f64 * 1e-6);
        Self {
            late_ms: ms(timing.late_ns),
            estimate_ms: ms(timing.estimate_ns),
            plan_ms: ms(timing.plan_ns),
            tick_ms: ms(timing.tick_ns),
        }
    }
}

impl Times {
    /// The longer of each.
    pub(super) fn sup(self, other: &Self) -> Self {
        Self {
            late_ms: self.late_ms.max(other.late_ms),
            estimate_ms: self.estimate_ms.max(other.estimate_ms),
            plan_ms: self.plan_ms.max(other.plan_ms),
            tick_ms: self.tick_ms.max(other.tick_ms),
        }
    }
}

#[cfg(test)]
mod tests;
