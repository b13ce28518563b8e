//! The facts of a tick for viewers: their names, units and how they follow from the record of the tick.
//!
//! Thread in flight: the log's, not the tick's. Allocates.

mod builder;

use horizon_model::rows::{Pose, Sticks, motion, pose, stick};
use serde::Serialize;
use tello_flight::cycle::{Inbox, Outcome, Timing};
use tello_flight::{Fault, Operator, Phase, Pilot};
use tello_io::clock::TimeNs;
use tello_io::tello::DroneStatus;

pub use self::builder::{FlightHeader, TelemetryBuilder};
use crate::display_rounding::{PosW, to_thousandths};
use crate::predicted_trajectory::PredictedTrajectory;

/// Telemetry of one tick, for viewers.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct Telemetry {
    /// Ticks since the start of the log.
    pub step: u64,
    /// Time since the start of the log. s
    pub t_s: f64,
    /// Part of the flight; `None` before the first tick.
    pub phase: Option<Phase>,
    /// Who steers; `None` while the vehicle is not steered.
    pub pilot: Option<Pilot>,
    /// Whether a person holds the sticks.
    pub is_by_hand: bool,
    /// The strongest order so far.
    pub operator: Operator,
    /// Present faults.
    pub faults: Vec<Fault>,
    /// Newest pose that the filter accepted.
    pub measured: Option<Spot>,
    /// The estimate.
    pub estimate: Option<Spot>,
    /// Estimated velocity x, y, z in the world frame; `None` for a model without it. m/s
    pub velocity_w: Option<[f64; 3]>,
    /// Part of the velocity that is disturbance, world frame. m/s
    pub disturbance_w: Option<[f64; 3]>,
    /// The place to be reached next.
    pub target: Spot,
    /// Its number, from 1.
    pub target_number: usize,
    /// Targets reached so far.
    pub targets_reached: usize,
    /// Where the mission wants the vehicle when the sticks of this tick act.
    pub reference: Option<Spot>,
    /// Distance and height from the reference path. m
    pub offset: Option<[f64; 2]>,
    /// Sent sticks; in a dry run those that would be sent.
    pub sticks: SticksFact,
    /// Whether sent sticks act; `None` without a link monitor.
    pub link: Option<LinkTelemetry>,
    /// The last status of the drone.
    pub drone: Option<DroneTelemetry>,
    /// Telemetry of the mocap stream.
    pub mocap: MocapTelemetry,
    /// Times of this tick.
    pub times: Times,
    /// Largest value of each time in the last second.
    pub worst: Times,
    /// Whether the log has failed: nothing is recorded any more.
    pub has_log_failed: bool,
    /// Periods without a tick so far.
    pub missed_periods: u64,
    /// Where sticks that are sent already lead, from the estimate on.
    pub committed: Vec<PosW>,
    /// The plan from there on.
    pub plan: Vec<PosW>,
    /// Where the vehicle was. Not in what is sent every time: it can be gathered.
    #[serde(skip)]
    pub trail: Vec<PosW>,
}

/// A pose with its rows by name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Spot {
    /// World x. m
    pub x: f64,
    /// World y. m
    pub y: f64,
    /// World z, up. m
    pub z: f64,
    /// Yaw, counter-clockwise from above. rad
    pub theta: f64,
}

/// Sticks with their rows by name.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct SticksFact {
    /// Roll, positive to the right. 1
    pub roll: f64,
    /// Pitch, positive forward. 1
    pub pitch: f64,
    /// Yaw, positive counter-clockwise from above. 1
    pub yaw: f64,
    /// Throttle, positive upwards. 1
    pub throttle: f64,
}

/// Result of the link monitor.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LinkTelemetry {
    /// Whether sent sticks do not act.
    pub is_down: bool,
    /// Log likelihood ratio, less the evidence that a change takes: positive exactly while the link is down. 1
    pub score: f64,
}

/// The newest report of the drone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct DroneTelemetry {
    /// Age of this status. s
    pub age_s: f64,
    /// Charge. %
    pub battery_pct: u8,
    /// By the drone's own judgement.
    pub is_battery_low: Option<bool>,
    /// In the air, by the drone's own judgement.
    pub is_flying: bool,
    /// Height by the drone's own measure. m
    pub height_m: Option<f64>,
}

/// Telemetry of the mocap stream.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct MocapTelemetry {
    /// Time since the newest pose was measured; `None` before the first. s
    pub age_s: Option<f64>,
    /// Poses in the last second. Hz
    pub rate_hz: f64,
    /// Frames without a pose so far.
    pub unseen: u64,
    /// Times that no frame came.
    pub gaps: u64,
}

/// Times of a tick.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Times {
    /// Time from the due moment of the tick to its begin. ms
    pub late_ms: f64,
    /// Time of the estimator. ms
    pub estimate_ms: f64,
    /// Time of the controller. ms
    pub plan_ms: f64,
    /// Time from the begin of the tick to its end. ms
    pub tick_ms: f64,
}

impl Telemetry {
    /// Telemetry of inbox and outcome of one tick; the rest is empty.
    pub fn of(inbox: &Inbox, out: &Outcome, ahead: PredictedTrajectory) -> Self {
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
            sticks: out.u_shown(inbox).into(),
            link: out
                .link
                .map(|link| LinkTelemetry { is_down: link.state.is_down(), score: link.score }),
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

impl DroneTelemetry {
    /// Telemetry of `status` at `now`.
    pub fn of(status: &DroneStatus, now: TimeNs) -> Self {
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
    #[must_use]
    pub fn sup(self, other: &Self) -> Self {
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
