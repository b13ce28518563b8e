//! The drone's own heading beside that of the poses.
//!
//! Owns leaky sums of three turns: by the poses, by the drone, and of a typical vehicle under the inputs. The zero and
//! the sense of rotation of the drone's heading are not known, and a drone may report no heading or a constant one. Its
//! heading counts from the first turn on in which it followed the inputs or the poses, with the sense of that turn.
//! Inputs get lost and gains differ, so the inputs alone never change a known sense. The drone contradicts the poses
//! only while it is twice as near to the inputs as the poses are: the drone's own drift is no fault of the poses.

use horizon_model::angle::wrap;
use horizon_model::rows::pose;

use super::typical_vehicle::{YAW_LAG_S, yaw_rate_radps};
use super::{Agreement, Doubt, FORGET_S, Sample};
use crate::forgetting::decay;

/// Least turn by the drone that shows its sense of rotation. rad
const TURN_MIN_RAD: f64 = 0.3;
/// Largest difference between two turns of which one follows the other, over the larger: gains differ between vehicles.
/// 1
const TOLERANCE: f64 = 0.5;
/// Largest difference between drone and inputs, over that between poses and inputs, if the drone contradicts the poses.
/// 1
const NEARER: f64 = 0.5;
/// Largest turn between two reports: with a larger one the drone has set a new zero. rad
const TURN_MAX_RAD: f64 = 1.0;
/// Longest time without a heading over which a turn is known: in a longer time a vehicle may make more than half a
/// turn, which looks like less. s
const GAP_MAX_S: f64 = 1.0;

/// Comparison of the turn by the poses with the drone's.
#[derive(Debug, Clone, Default)]
pub(super) struct HeadingMonitor {
    limit_rad: f64,
    dt_s: f64,
    /// Newest heading by the poses. rad
    before_pose_rad: Option<f64>,
    /// Newest heading by the drone. rad
    before_drone_rad: Option<f64>,
    /// Times since the newest headings by the poses and by the drone. s
    since_s: [f64; 2],
    /// Whether the heading of the next pose is that of an earlier one.
    is_held: bool,
    /// Yaw rate that the inputs ask for, after the lag. rad/s
    asked_radps: f64,
    turns: Turns,
    /// Sense of the drone's heading, once a turn has shown it.
    sense: Option<Sense>,
    doubt: Doubt,
}

/// Sense of rotation in which the drone's heading grows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Sense {
    CounterClockwise,
    Clockwise,
}

/// Exponentially forgotten sums of turns.
#[derive(Debug, Clone, Copy, Default)]
#[expect(clippy::struct_field_names, reason = "the postfix is the unit")]
struct Turns {
    /// `q_o`, by the poses. rad
    by_poses_rad: f64,
    /// `q_d`, by the drone, whose sense is not known. rad
    by_drone_rad: f64,
    /// `q_u`, by the inputs of a typical vehicle. rad
    by_inputs_rad: f64,
}

impl HeadingMonitor {
    pub(super) fn new(limit_rad: f64, dt_s: f64) -> Self {
        Self { limit_rad, dt_s, ..Self::default() }
    }

    /// Forgets the turns; the sense of the drone's heading stays.
    pub(super) fn reset(&mut self) {
        (self.before_pose_rad, self.before_drone_rad) = (None, None);
        self.since_s = [0.0; 2];
        self.asked_radps = 0.0;
        self.turns = Turns::default();
        self.doubt = Doubt::default();
    }

    /// Takes whether the heading of the next tick's pose was measured with it.
    pub(super) fn observe(&mut self, is_its_own: bool) {
        self.is_held = !is_its_own;
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. rad
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let by_drone = sample.drone.and_then(|drone| drone.heading_rad);
        let is_held = std::mem::take(&mut self.is_held);
        let by_pose = sample.pose.filter(|_| !is_held).map(|pose| pose[pose::THETA]);
        if self.since_s.iter().any(|since_s| *since_s > GAP_MAX_S) {
            self.reset();
        }
        for (since_s, heading_rad) in self.since_s.iter_mut().zip([by_pose, by_drone]) {
            *since_s = if heading_rad.is_some() { 0.0 } else { *since_s + self.dt_s };
        }
        let turned_rad =
            by_drone.map_or(0.0, |by_drone| turned(&mut self.before_drone_rad, by_drone));
        if turned_rad.abs() > TURN_MAX_RAD {
            self.reset();
            return (Agreement::Unknown, 0.0);
        }
        let keep = decay(self.dt_s, FORGET_S);
        let target_radps = yaw_rate_radps(&sample.u_applied);
        self.asked_radps += (target_radps - self.asked_radps) * (1.0 - decay(self.dt_s, YAW_LAG_S));
        let turns = &mut self.turns;
        turns.by_drone_rad = turns.by_drone_rad * keep + turned_rad;
        turns.by_inputs_rad = turns.by_inputs_rad * keep + self.asked_radps * self.dt_s;
        turns.by_poses_rad *= keep;
        if let Some(by_pose) = by_pose {
            turns.by_poses_rad += turned(&mut self.before_pose_rad, by_pose);
        }
        let shown =
            [turns.by_inputs_rad, turns.by_poses_rad].map(|turn_rad| turns.sense_of(turn_rad));
        self.sense = match (self.sense, shown) {
            (_, [Some(by_inputs), Some(by_poses)]) if by_inputs == by_poses => Some(by_poses),
            (None, [by_inputs, by_poses]) if by_inputs.is_none() || by_poses.is_none() => {
                by_inputs.or(by_poses)
            }
            (known, _) => known,
        };
        let Some(sense) = self.sense else { return (Agreement::Unknown, 0.0) };
        let error_rad = (turns.by_poses_rad - turns.signed_by_drone_rad(sense)).abs();
        if by_pose.is_none() {
            self.doubt.wait(self.dt_s);
        }
        // The next heading includes the turn since the one before.
        if by_pose.is_none()
            || by_drone.is_none()
            || error_rad > self.limit_rad && !turns.is_drone_nearer(sense)
        {
            return (Agreement::Unknown, error_rad);
        }
        (self.doubt.update(error_rad, self.limit_rad, self.dt_s), error_rad)
    }
}

impl Turns {
    /// Turn by the drone, counter-clockwise if its heading grows in this sense. rad
    fn signed_by_drone_rad(&self, sense: Sense) -> f64 {
        match sense {
            Sense::CounterClockwise => self.by_drone_rad,
            Sense::Clockwise => -self.by_drone_rad,
        }
    }

    /// Sense in which the drone followed `turn_rad`; `None` if it turned too little or by another amount.
    fn sense_of(&self, turn_rad: f64) -> Option<Sense> {
        let largest_rad = TOLERANCE * self.by_drone_rad.abs().max(turn_rad.abs());
        let follows =
            |sense: &Sense| (self.signed_by_drone_rad(*sense) - turn_rad).abs() <= largest_rad;
        let has_turned = self.by_drone_rad.abs() >= TURN_MIN_RAD;
        [Sense::CounterClockwise, Sense::Clockwise].into_iter().find(follows).filter(|_| has_turned)
    }

    /// Whether the drone is so much nearer to the inputs than the poses are that it contradicts them.
    fn is_drone_nearer(&self, sense: Sense) -> bool {
        let poses_off_rad = (self.by_poses_rad - self.by_inputs_rad).abs();
        (self.signed_by_drone_rad(sense) - self.by_inputs_rad).abs() <= NEARER * poses_off_rad
    }
}

/// Turn from the heading before, if there was one, to `now_rad`, which replaces it: the short way round. rad
fn turned(before_rad: &mut Option<f64>, now_rad: f64) -> f64 {
    before_rad.replace(now_rad).map_or(0.0, |before_rad| wrap(now_rad - before_rad))
}

#[cfg(test)]
mod tests;
