//! What lasts longer than a tick: since when conditions hold, failures and missed periods, what has been seen of the
//! take-off and where the ground is.
//!
//! Owns the order in which this memory is updated. What follows from a condition stands in `conditions.rs`.

use horizon_model::rows::pose;

use super::conditions::is_confirmed;
use super::evidence::{Evidence, Phase};
use super::{Supervisor, TakeOffSeen, exceeds};
use crate::time::SpanNs;

/// Fraction of a missed period that is forgiven at each tick: one may be missed after each ten ticks for ever.
const LATE_FORGIVEN: f64 = 0.1;

/// Failures of a solver that a tick without one makes up for, off the ground: one in three may fail for ever.
const FAILURE_FORGIVEN: f64 = 0.5;

/// Turn away from the heading of the reference that no controlled vehicle makes. rad
const TURNED_RAD: f64 = 1.0;

/// Yaw rate above which a vehicle turns by itself in an outage. rad/s
const TURNING_RADPS: f64 = 0.3;

impl Supervisor {
    /// Updates what lasts longer than a tick.
    pub(super) fn remember(&mut self, e: &Evidence) {
        self.began_ns.get_or_insert(e.t_ns);
        self.remember_troubles(e);
        self.remember_ground_and_take_off(e);
        self.remember_landing(e);
        self.remember_reports(e);
        self.remember_climb(e);
        self.remember_flight(e);
        self.remember_settling(e);
    }

    /// Updates the failures of solvers and the missed periods.
    fn remember_troubles(&mut self, e: &Evidence) {
        let has_failed = e.has_estimator_failed || self.is_without_plan(e);
        self.failures = match self.phase {
            _ if has_failed => self.failures + 1.0,
            Phase::Idle => 0.0,
            _ => (self.failures - FAILURE_FORGIVEN).max(0.0),
        };
        self.late_periods = (self.late_periods - LATE_FORGIVEN).max(0.0) + e.skipped as f64;
    }

    /// Updates the heights on the ground, and what has been seen of the take-off.
    fn remember_ground_and_take_off(&mut self, e: &Evidence) {
        let says_flying = self.drone_says_flying(e);
        let is_standing = self.phase == Phase::Idle && says_flying != Some(true);
        if is_standing && !self.is_pose_stale(e) {
            self.ground_height_m = e.pose.map(|at| at[pose::Z]);
        }
        if is_standing && let Some(drone) = e.drone {
            self.drone_ground_m = drone.height_m;
        }
        if self.take_off_ordered_ns.is_some() {
            self.take_off_seen = self.take_off_seen.max(match says_flying {
                Some(true) => TakeOffSeen::Reported,
                _ if self.has_risen(e) => TakeOffSeen::Measured,
                _ => TakeOffSeen::No,
            });
        }
    }

    /// Updates for how long the drone has reported something.
    fn remember_reports(&mut self, e: &Evidence) {
        let reported_ns = e.drone.map(|drone| e.t_ns - SpanNs::from_seconds(drone.age_s).0);
        self.since.aloft.keep(self.is_aloft_unasked(e), reported_ns);
        // A report may be late, but does not take itself back.
        let counts = match (self.phase, self.take_off_seen) {
            (Phase::TakingOff | Phase::Flying, TakeOffSeen::Reported) => true,
            (Phase::TakingOff, TakeOffSeen::Measured) | (Phase::Flying, _) => {
                self.is_past_take_off(e)
            }
            _ => false,
        };
        let is_grounded = counts && self.drone_says_flying(e) == Some(false);
        self.since.grounded.keep(is_grounded, reported_ns);
        let is_critical = e.drone.is_some_and(|drone| {
            drone.is_battery_critical || drone.battery_pct < self.table.battery_critical_pct
        });
        self.since.battery_critical.keep(is_critical, reported_ns);
    }

    /// Updates for how long a vehicle that takes off has not been seen to rise.
    fn remember_climb(&mut self, e: &Evidence) {
        let climbs_still = self.phase == Phase::TakingOff
            && e.findings.still_s.is_some()
            && self.drone_has_risen(e);
        self.since.climbs_still.keep(climbs_still, e.t_ns);
        self.since.unrisen.keep(self.is_unrisen(e), e.t_ns);
    }

    /// Updates for how long a vehicle that flies has done what it should not, and since when the mission is done.
    fn remember_flight(&mut self, e: &Evidence) {
        let is_done = e.is_mission_done && !e.is_by_hand;
        self.since.done.keep(is_done, e.t_ns);
        let is_flying = self.is_flying();
        let is_left_to_controller = is_flying && !e.is_by_hand;
        let is_astray = is_left_to_controller && self.is_off_reference(e);
        self.since.astray.keep(is_astray, e.t_ns);
        self.remember_swings(e);
        self.since.stands.keep(self.seems_to_stand(e), e.t_ns);
        // In an outage the reference may turn on without the vehicle.
        let turns = e.motion.is_some_and(|motion| motion.rate[pose::THETA].abs() > TURNING_RADPS);
        let should_turn = is_left_to_controller && (e.outage.is_none() || turns);
        let is_turned = should_turn && e.turned_rad.is_some_and(|rad| exceeds(rad, TURNED_RAD));
        self.since.turned.keep(is_turned, e.t_ns);
        let is_fast = is_flying && exceeds(e.speed_mps, self.table.failsafe.speed_mps);
        self.since.fast.keep(is_fast, e.t_ns);
        let is_long = is_left_to_controller && e.is_dead_time_long;
        self.since.dead_time_long.keep(is_long, e.t_ns);
        self.remember_idle_hand(e, is_fast);
        self.remember_blocked(e);
        self.remember_stuck(e);
        let is_alone = is_flying && e.outage.is_some() && !is_confirmed(&e.findings);
        self.since.alone.keep(is_alone, e.t_ns);
    }
}
