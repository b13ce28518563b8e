//! State of the supervisor from tick to tick: the timers of the conditions, failed solves and missed periods,
//! the signs that the take-off order was received, and the height of the ground.
//!
//! Owns the timers and the order of the updates. What follows from a condition stands in `conditions.rs`.

use horizon_model::rows::pose;

use super::condition_timer::{HoldTimer, LeakyTimer, ReportTimer};
use super::conditions::is_confirmed;
use super::evidence::{Evidence, Phase};
use super::take_off::TakeOffSeen;
use super::{Supervisor, exceeds};
use crate::forgetting::LeakySum;
use crate::time::SpanNs;

/// Missed periods subtracted from their sum at each tick: one missed period per ten ticks never ends a flight.
/// periods per tick
const LATE_LEAK: f64 = 0.1;

/// Failures subtracted from their sum at each tick without a failure, off the ground: one failed solve in three never
/// ends a flight. failures per tick
const FAILURE_LEAK: f64 = 0.5;

/// Difference between the headings of vehicle and reference above which the controller has lost the heading. rad
const HEADING_OFF_REFERENCE_RAD: f64 = 1.0;

/// Yaw rate above which a vehicle in an outage is turning: then its heading counts in an outage, too. rad/s
const TURNING_RADPS: f64 = 0.3;

/// For how long each of these conditions has held.
#[derive(Debug, Clone, Default)]
pub(super) struct Timers {
    /// In flight the drone reports that it stands.
    pub(super) reports_standing: ReportTimer,
    /// The drone reports its charge as critical.
    pub(super) battery_critical: ReportTimer,
    /// In the take-off the pose is still while the drone reports that it climbs.
    pub(super) still_in_climb: HoldTimer,
    /// The drone reports that it flies and no measurement shows that it rises.
    pub(super) not_rising: HoldTimer,
    /// The mission is done.
    pub(super) mission_done: HoldTimer,
    /// The vehicle that the controller flies is too far from its reference.
    pub(super) off_reference: HoldTimer,
    /// The vehicle's velocity is far from that of its reference.
    pub(super) velocity_off_reference: LeakyTimer,
    /// Plans are blocked.
    pub(super) blocked: LeakyTimer,
    /// The pose is still below the reference: the vehicle seems to stand on something.
    pub(super) standing_below_reference: HoldTimer,
    /// The heading is far from that of the reference.
    pub(super) heading_off_reference: HoldTimer,
    /// The vehicle is too fast.
    pub(super) too_fast: HoldTimer,
    /// The dead time is too long.
    pub(super) dead_time_long: HoldTimer,
    /// The sticks in a person's hand are neutral.
    pub(super) hand_neutral: HoldTimer,
    /// The sticks are neutral while the vehicle is outside of the room or too fast.
    pub(super) hand_neutral_in_danger: HoldTimer,
    /// The vehicle brakes before a landing.
    pub(super) braking: HoldTimer,
    /// The moving obstacle came near within the last seconds.
    pub(super) approached: LeakyTimer,
    /// The drone reports that it flies, without an order to take off.
    pub(super) flying_unordered: ReportTimer,
    /// There is a command outage that the drone does not confirm.
    pub(super) outage_unconfirmed: HoldTimer,
    /// The moving obstacle comes near, or its position is unknown, while the vehicle cannot evade it yet.
    pub(super) obstacle_near: HoldTimer,
}

impl Supervisor {
    /// Updates timers, sums and evidence by those of this tick.
    pub(super) fn update_timers(&mut self, e: &Evidence) {
        self.began_ns.get_or_insert(e.t_ns);
        self.update_failure_sums(e);
        self.update_take_off_evidence(e);
        self.update_landing_confirmation(e);
        self.update_report_timers(e);
        self.update_climb_timers(e);
        self.update_flight_timers(e);
        self.update_hover_after_take_off(e);
        self.update_obstacle_timers(e);
    }

    /// Updates the failures of solvers and the missed periods.
    fn update_failure_sums(&mut self, e: &Evidence) {
        let has_failed = e.has_estimator_failed || self.is_without_plan(e);
        match self.phase {
            _ if has_failed => self.failures.add(1.0),
            Phase::Idle => self.failures = LeakySum::default(),
            _ => self.failures.leak(FAILURE_LEAK),
        }
        self.late_periods.leak(LATE_LEAK);
        self.late_periods.add(e.skipped as f64);
    }

    /// Updates the heights on the ground, and what has been seen of the take-off.
    fn update_take_off_evidence(&mut self, e: &Evidence) {
        let reports_flying = self.drone_reports_flying(e);
        let is_standing = self.phase == Phase::Idle && reports_flying != Some(true);
        if is_standing && !self.is_pose_stale(e) {
            self.take_off.ground_m = e.pose.map(|at| at[pose::Z]);
        }
        if is_standing && let Some(drone) = e.drone {
            self.take_off.drone_ground_m = drone.height_m;
        }
        if self.take_off.ordered_ns.is_some() {
            self.take_off.seen = self.take_off.seen.max(match reports_flying {
                Some(true) => TakeOffSeen::Reported,
                _ if self.has_risen(e) => TakeOffSeen::Measured,
                _ => TakeOffSeen::No,
            });
        }
    }

    /// Updates for how long the drone has reported something.
    fn update_report_timers(&mut self, e: &Evidence) {
        let reported_ns = e.drone.map(|drone| e.t_ns - SpanNs::from_seconds(drone.age_s).0);
        self.timers.flying_unordered.update(self.reports_flight_before_order(e), reported_ns);
        // After a report that the drone flies, a report that it stands is newer. Before, it may be an old one.
        let counts = match (self.phase, self.take_off.seen) {
            (Phase::TakingOff | Phase::Flying, TakeOffSeen::Reported) => true,
            (Phase::TakingOff, TakeOffSeen::Measured) | (Phase::Flying, _) => {
                self.is_past_take_off(e)
            }
            _ => false,
        };
        let is_grounded = counts && self.drone_reports_flying(e) == Some(false);
        self.timers.reports_standing.update(is_grounded, reported_ns);
        let is_critical = e.drone.is_some_and(|drone| {
            drone.is_battery_critical || drone.battery_pct < self.table.battery_critical_pct
        });
        self.timers.battery_critical.update(is_critical, reported_ns);
    }

    /// Updates for how long a vehicle that takes off has risen by one source and not by another.
    fn update_climb_timers(&mut self, e: &Evidence) {
        let climbs_still = self.phase == Phase::TakingOff
            && e.findings.still_s.is_some()
            && self.drone_has_risen(e);
        self.timers.still_in_climb.update(climbs_still, e.t_ns);
        self.timers.not_rising.update(self.is_not_rising(e), e.t_ns);
    }

    /// Updates the timers of the faults of a flight and of the end of the mission.
    fn update_flight_timers(&mut self, e: &Evidence) {
        let is_done = e.is_mission_done && !e.is_by_hand();
        self.timers.mission_done.update(is_done, e.t_ns);
        let is_flying = self.is_flying();
        let is_left_to_controller = is_flying && !e.is_by_hand();
        let is_off = is_left_to_controller && self.is_off_reference(e);
        self.timers.off_reference.update(is_off, e.t_ns);
        self.update_velocity_off_reference(e);
        self.timers.standing_below_reference.update(self.seems_to_stand(e), e.t_ns);
        // In an outage the reference may turn while the vehicle does not.
        let is_turning =
            e.motion.is_some_and(|motion| motion.rate[pose::THETA].abs() > TURNING_RADPS);
        let heading_counts = is_left_to_controller && (e.outage.is_none() || is_turning);
        let is_heading_off = heading_counts
            && e.tracking
                .heading_growth_rad
                .is_some_and(|rad| exceeds(rad, HEADING_OFF_REFERENCE_RAD));
        self.timers.heading_off_reference.update(is_heading_off, e.t_ns);
        let is_fast = is_flying && exceeds(e.speed_mps, self.table.failsafe.speed_mps);
        self.timers.too_fast.update(is_fast, e.t_ns);
        let is_long = is_left_to_controller && e.is_dead_time_long;
        self.timers.dead_time_long.update(is_long, e.t_ns);
        self.update_idle_hand_timers(e, is_fast);
        self.update_blocked_timer(e);
        self.update_stuck_detection(e);
        let is_unconfirmed = is_flying && e.outage.is_some() && !is_confirmed(&e.findings);
        self.timers.outage_unconfirmed.update(is_unconfirmed, e.t_ns);
    }
}

#[cfg(test)]
mod tests;
