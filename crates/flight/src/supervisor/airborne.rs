//! Whether the vehicle is in the air or down, by all who can tell.
//!
//! Owns how pose and drone are weighed: a take-off is believed to the pose, a landing to both. One of them alone
//! decides where the other is missing.

use horizon_model::rows::pose;

use super::evidence::{Evidence, Phase};
use super::{DOWN_HOLD_S, Supervisor, elapsed_s, has_lasted, is_older};

/// A Tello ignores `land` during the first 1-3 s of a take-off and may not yet report to fly. Only
/// later than this after the last take-off order is a grounded vehicle believed. s
const TAKE_OFF_TAIL_S: f64 = 4.0;

/// Fraction of `airborne_height_m` below which a vehicle looks grounded.
const DOWN_HEIGHT_FRACTION: f64 = 0.5;

impl Supervisor {
    /// Whether the drone flies by its own fresh report.
    pub(super) fn drone_says_flying(&self, e: &Evidence) -> Option<bool> {
        e.drone
            .filter(|drone| !is_older(drone.age_s, self.table.drone_silent_s))
            .map(|drone| drone.is_flying)
    }

    /// Height above the ground by a fresh position. m
    fn rise_m(&self, e: &Evidence) -> Option<f64> {
        let rise_m = e.pose?[pose::Z] - self.ground_height_m?;
        (rise_m.is_finite() && !self.is_pose_stale(e)).then_some(rise_m)
    }

    /// Whether a fresh pose shows the vehicle above the ground.
    pub(super) fn pose_is_airborne(&self, e: &Evidence) -> Option<bool> {
        let limit_m = DOWN_HEIGHT_FRACTION * self.table.airborne_height_m;
        self.rise_m(e).map(|rise_m| rise_m >= limit_m)
    }

    /// The position decides; without one the drone is believed.
    pub(super) fn is_airborne(&self, e: &Evidence) -> bool {
        match self.rise_m(e) {
            Some(rise_m) => rise_m >= self.table.airborne_height_m,
            None => self.drone_says_flying(e) == Some(true),
        }
    }

    /// Whether no take-off may still be in progress.
    pub(super) fn is_past_take_off(&self, e: &Evidence) -> bool {
        self.take_off_ordered_ns
            .is_none_or(|ordered_ns| elapsed_s(ordered_ns, e.t_ns) >= TAKE_OFF_TAIL_S)
    }

    /// Whether all who can tell say that the vehicle is down, and somebody can. What is carried never flew.
    pub(super) fn looks_grounded(&self, e: &Evidence) -> bool {
        let by_pose = self.pose_is_airborne(e);
        let by_drone = self.drone_says_flying(e);
        let has_witness = by_pose.is_some() || by_drone.is_some();
        let is_grounded = has_witness && by_pose != Some(true) && by_drone != Some(true);
        self.is_carried || (self.is_past_take_off(e) && is_grounded)
    }

    pub(super) fn is_down(&self, e: &Evidence) -> bool {
        has_lasted(self.down_since_ns, e.t_ns, DOWN_HOLD_S)
    }

    pub(super) fn is_landing_overdue(&self, e: &Evidence) -> bool {
        let phase_s = elapsed_s(self.phase_since_ns, e.t_ns);
        self.phase == Phase::Landing && phase_s >= self.table.landing_timeout_s && !self.is_down(e)
    }
}
