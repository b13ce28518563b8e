//! Whether the vehicle is in the air or on the ground, by its poses and by the drone's reports.
//!
//! Owns how both are weighed: the poses confirm a take-off, poses and drone together confirm a landing. Where one of
//! them is missing, the other decides alone; a landing then takes longer to be confirmed.

use horizon_model::rows::{Pose, pose};

use super::condition_timer::HoldTimer;
use super::evidence::{DroneReport, Evidence, Phase};
use super::fault::Fault;
use super::{DOWN_HOLD_S, Supervisor, elapsed_s, exceeds};
use crate::drone::{ALONE_HOLD, denies_standing};

/// Fraction of `airborne_height_m` below which a vehicle looks grounded. 1
const DOWN_HEIGHT_FRACTION: f64 = 0.5;

/// Largest drop of an accepted pose beyond that of a descent at 2 m/s. Real flights reach 0.11 m
/// (docs/benchmarks/2026-11-27-poses). m
const DROP_MAX_M: f64 = 0.3;

/// Distance within which a pose is still that of a stream that stood still when the landing began: a vehicle that lands
/// leaves it. m
const FROZEN_MOVE_M: f64 = 0.02;

/// Rise by the drone's own height above which the vehicle has left the ground: between two steps of that height. m
const CLIMB_MIN_M: f64 = 0.35;

/// Rise by the poses above which the drone has received the order to take off. m
const ORDER_OBEYED_RISE_M: f64 = 0.15;

/// Whether a vehicle that lands is down, by poses and drone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Ground {
    /// One source reports the vehicle in the air, or both report nothing.
    Unconfirmed,
    /// The poses show it down, and the drone reports nothing.
    ByPose,
    /// The drone reports that it is down, and there is no pose that counts.
    ByDrone,
    /// Poses and drone show it down.
    ByBoth,
}

/// For how long a vehicle that lands has been shown on the ground.
#[derive(Debug, Clone, Default)]
pub(super) struct LandingConfirmation {
    /// By poses or drone, and neither contradicts it.
    by_any: HoldTimer,
    /// By poses and drone.
    by_both: HoldTimer,
    /// Whether the pose came to the ground by a jump: then it does not confirm a landing.
    is_pose_displaced: bool,
    /// The pose of a stream that stood still in flight, as long as it goes on doing so: it does not show where the
    /// vehicle is. On the ground, and in a landing, poses may stand still, so that nothing else refuses them there.
    frozen: Option<Pose>,
}

impl Supervisor {
    /// Whether the drone flies by its own fresh report.
    pub(super) fn drone_reports_flying(&self, e: &Evidence) -> Option<bool> {
        self.fresh_report(e).map(|drone| drone.is_flying)
    }

    /// The drone's own report, unless it is older than `drone_silent_s`.
    pub(super) fn fresh_report<'a>(&self, e: &'a Evidence) -> Option<&'a DroneReport> {
        e.drone.as_ref().filter(|drone| !exceeds(drone.age_s, self.table.drone_silent_s))
    }

    /// Height above the ground by a fresh position. m
    fn rise_m(&self, e: &Evidence) -> Option<f64> {
        let rise_m = e.pose?[pose::Z] - self.take_off.ground_m?;
        (rise_m.is_finite() && !self.is_pose_stale(e)).then_some(rise_m)
    }

    /// Whether a fresh pose shows the vehicle above the ground. A pose that came to the ground by a jump is
    /// that of another object and shows nothing, one in the air that stood still in flight neither.
    pub(super) fn pose_is_airborne(&self, e: &Evidence) -> Option<bool> {
        let limit_m = DOWN_HEIGHT_FRACTION * self.table.airborne_height_m;
        let is_airborne = self.rise_m(e)? >= limit_m;
        let counts = if is_airborne {
            self.landing.frozen.is_none()
        } else {
            !self.landing.is_pose_displaced
        };
        counts.then_some(is_airborne)
    }

    /// Whether the drone flies by its own fresh report; `None` without one, or if it reports to stand at a height at
    /// which it cannot.
    fn drone_is_airborne(&self, e: &Evidence) -> Option<bool> {
        let height_m = e.drone.and_then(|drone| drone.height_m);
        let is_contradicted = denies_standing(height_m, self.take_off.drone_ground_m);
        self.drone_reports_flying(e).filter(|is_flying| *is_flying || !is_contradicted)
    }

    /// Whether the vehicle is so high that a take-off is complete: by a fresh pose; without one, whether the drone
    /// reports that it flies.
    pub(super) fn is_take_off_complete(&self, e: &Evidence) -> bool {
        match self.rise_m(e) {
            Some(rise_m) => rise_m >= self.table.airborne_height_m,
            None => self.drone_reports_flying(e) == Some(true),
        }
    }

    /// Whether the vehicle is off the ground by the drone's own fresh height.
    pub(super) fn drone_has_risen(&self, e: &Evidence) -> bool {
        let height_m = self.fresh_report(e).and_then(|drone| drone.height_m);
        let rise_m =
            height_m.zip(self.take_off.drone_ground_m).map(|(at_m, ground_m)| at_m - ground_m);
        rise_m.is_some_and(|rise_m| rise_m > CLIMB_MIN_M)
    }

    /// Whether a drone that takes off has left the ground by any measurement.
    pub(super) fn has_risen(&self, e: &Evidence) -> bool {
        self.drone_has_risen(e) || self.rise_m(e).is_some_and(|rise_m| rise_m > ORDER_OBEYED_RISE_M)
    }

    /// Whether a drone that takes off flies by its own report, and fresh poses and its height show no rise.
    pub(super) fn is_not_rising(&self, e: &Evidence) -> bool {
        self.phase == Phase::TakingOff
            && self.drone_reports_flying(e) == Some(true)
            && self.rise_m(e).is_some()
            && !self.has_risen(e)
    }

    /// Which source shows the vehicle down, if neither source contradicts it. A vehicle that is carried never flew.
    fn ground(&self, e: &Evidence) -> Ground {
        if self.is_dry_run {
            return Ground::ByBoth;
        }
        if !self.is_past_take_off(e) {
            return Ground::Unconfirmed;
        }
        match (self.pose_is_airborne(e), self.drone_is_airborne(e)) {
            (Some(false), Some(false)) => Ground::ByBoth,
            (Some(false), None) => Ground::ByPose,
            (None, Some(false)) => Ground::ByDrone,
            (Some(true), _) | (_, Some(true)) | (None, None) => Ground::Unconfirmed,
        }
    }

    /// Updates since when the vehicle is down, and whether the pose is that of another object.
    pub(super) fn update_landing_confirmation(&mut self, e: &Evidence) {
        let jumped_m = |excess_m: Option<f64>, limit_m| {
            excess_m.is_some_and(|excess_m| exceeds(excess_m, limit_m))
        };
        self.update_frozen_pose(e);
        let has_jumped =
            jumped_m(e.poses.jump_m, self.table.jump_m) || jumped_m(e.poses.drop_m, DROP_MAX_M);
        self.landing.is_pose_displaced |= has_jumped && self.phase != Phase::Idle;
        self.landing.is_pose_displaced &= self.pose_is_airborne(e) != Some(true);
        let is_landing =
            matches!(self.phase, Phase::Landing | Phase::LandingUnconfirmed | Phase::MotorsStopped);
        let ground = if is_landing { self.ground(e) } else { Ground::Unconfirmed };
        self.landing.by_any.update(ground != Ground::Unconfirmed, e.t_ns);
        self.landing.by_both.update(ground == Ground::ByBoth, e.t_ns);
    }

    /// Updates whether the pose is that of a stream that stood still in flight.
    fn update_frozen_pose(&mut self, e: &Evidence) {
        if matches!(self.phase, Phase::Idle | Phase::TakingOff | Phase::Flying) {
            self.landing.frozen = e.pose.filter(|_| self.is_flying() && self.is_pose_frozen(e));
        } else if let (Some(then), Some(now)) = (self.landing.frozen, e.pose) {
            let moved_m = (now - then).fixed_rows::<3>(pose::X).norm();
            self.landing.frozen = Some(then).filter(|_| !exceeds(moved_m, FROZEN_MOVE_M));
        }
    }

    /// Whether the landing is confirmed: by both sources for 1 s, or by one of them alone for longer.
    pub(super) fn is_down(&self, e: &Evidence) -> bool {
        self.landing.by_both.has_lasted(e.t_ns, DOWN_HOLD_S)
            || self.landing.by_any.has_lasted(e.t_ns, ALONE_HOLD.seconds())
    }

    /// Notes the source that confirmed the landing alone, if one did.
    pub(super) fn note_confirmation(&mut self, e: &Evidence) {
        let by_both = self.landing.by_both.has_lasted(e.t_ns, DOWN_HOLD_S);
        let ground = self.ground(e);
        self.ended_by.set(Fault::LandedByPose, !by_both && ground == Ground::ByPose);
        self.ended_by.set(Fault::LandedByDrone, !by_both && ground == Ground::ByDrone);
    }

    /// Whether the landing was not confirmed in time. While one source shows the vehicle down, its longer time is
    /// awaited.
    pub(super) fn is_landing_overdue(&self, e: &Evidence) -> bool {
        let phase_s = elapsed_s(self.phase_since_ns, e.t_ns);
        self.phase == Phase::Landing
            && phase_s >= self.table.landing_timeout_s
            && !self.landing.by_any.holds()
    }
}

#[cfg(test)]
#[expect(clippy::large_types_passed_by_value, reason = "tests change copies of the evidence")]
mod tests;
