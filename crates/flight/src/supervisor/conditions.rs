//! From the evidence of a tick to the faults that are present.
//!
//! Owns the condition of every fault. What follows from a fault stands in `fault.rs`.

use super::braking::ControlMode;
use super::condition_timer::LeakyTimer;
use super::evidence::{Evidence, Operator, Outage, Phase};
use super::fault::{Fault, FaultSet};
use super::{DOWN_HOLD_S, FLYING_UNORDERED_S, Supervisor, elapsed_s, exceeds};
use crate::monitor::{Agreement, Findings};

/// How long the vehicle must be off its reference. s
const OFF_REFERENCE_S: f64 = 0.3;

/// How long the vehicle must be faster than `failsafe.speed_mps`. s
const TOO_FAST_S: f64 = 0.3;

/// How long the heading must be off that of the reference: the link monitor finds an outage within this time. s
const HEADING_OFF_REFERENCE_S: f64 = 1.5;

/// How long an obstacle must be near a vehicle that takes off: two wrong positions of the obstacle look like a
/// step towards the vehicle. s
const OBSTACLE_NEAR_S: f64 = 0.3;

/// How long the sticks must act too late: for a moment the beginning of an outage looks the same. s
const DEAD_TIME_LONG_S: f64 = 3.0;

/// Largest speed, by the drone, of a vehicle that receives no commands and drifts with the wind. m/s
const DRIFT_MAX_MPS: f64 = 0.35;

/// How long an outage must be unconfirmed before the vehicle may be where its commands lead: after the link returns,
/// the drone moves before the link monitor has decided. s
const OUTAGE_UNCONFIRMED_S: f64 = 0.5;

/// A vehicle that has come down so far below its reference sinks or is pulled down. In real flights it comes down by
/// up to 0.37 m (docs/benchmarks/2026-11-27-poses). m
const SUNK_M: f64 = 0.45;

/// Difference between the velocities of vehicle and reference, and how long it lasts in sum, if the vehicle oscillates
/// around its reference: its velocity loop is weakly damped, or its dead time is much longer than the model's. m/s, s
const VELOCITY_OFF_REFERENCE_MPS: f64 = 0.6;
const VELOCITY_OFF_REFERENCE_S: f64 = 4.0;
/// Largest factor by which that time counts while the vehicle recedes from its reference: the square of the difference
/// over [`VELOCITY_OFF_REFERENCE_MPS`]. 1
const RECEDING_WEIGHT_MAX: f64 = 2.0;

/// A steered vehicle whose pose is still for so long below its reference stands on something: the effect of a throttle
/// that acts shows within half of this time. s
const STANDING_ON_OBJECT_S: f64 = 1.2;
/// [`STANDING_ON_OBJECT_S`] in what looks like an outage, in which a vehicle in calm air may hover. s
const STANDING_ON_OBJECT_IN_OUTAGE_S: f64 = 2.4;
/// Least height of the reference over a vehicle that stands on something. m
const BELOW_REFERENCE_MIN_M: f64 = 0.2;

/// A drone that reports to fly and has not risen after so long is held: rotors take about a second to spin up, and the
/// climb shows half a second later. s
const NOT_RISING_S: f64 = 3.0;

/// How long the charge must be critical: for less time it may be a sag of the voltage or a wrong report. s
const BATTERY_CRITICAL_S: f64 = 1.0;

/// Whether the drone confirms that its commands are lost: its velocity agrees with the poses, or it hardly moves.
pub(super) fn is_confirmed(findings: &Findings) -> bool {
    let is_slow = findings.drone_speed_mps.is_some_and(|v_mps| v_mps <= DRIFT_MAX_MPS);
    findings.velocity == Agreement::Agrees || is_slow
}

impl Supervisor {
    /// What is wrong at this tick.
    pub(super) fn faults(&self, e: &Evidence) -> FaultSet {
        let mut faults = FaultSet::default();
        for fault in Fault::ALL {
            faults.set(*fault, self.is_present(*fault, e));
        }
        faults
    }

    /// Whether `fault` is present at this tick. No wildcard: a new fault does not compile without a condition.
    fn is_present(&self, fault: Fault, e: &Evidence) -> bool {
        let Self { table, timers, is_dry_run, .. } = self;
        let is_idle = self.phase == Phase::Idle;
        let is_aloft = self.is_taking_off_or_flying();
        match fault {
            Fault::MocapStale => self.is_pose_stale(e),
            Fault::MocapLost => self.is_pose_lost(e),
            Fault::MocapFrozen => self.is_pose_frozen(e),
            Fault::MocapJumped => is_aloft && self.has_pose_jumped(e),
            Fault::MocapRough => is_aloft && e.poses.is_rough,
            Fault::MocapUnsettled => is_idle && !e.poses.is_settled,
            Fault::MocapUndated => is_idle && e.incidents.is_mocap_undated,
            Fault::PoseDoubtful => self.worst_agreement(e) >= Agreement::Doubtful,
            Fault::PoseInconsistent => self.agreement(e) >= Agreement::Disagrees,
            Fault::HeadingWrong => self.is_heading_wrong(e),
            Fault::StartMisplaced => is_idle && !self.may_start(e),
            Fault::PlanBlocked => self.is_blocked(e),
            Fault::BlockedLong => self.is_blocked_long(e),
            Fault::ObstacleEntered => {
                is_aloft && e.obstacles.is_vehicle_inside && !self.is_pose_stale(e)
            }
            Fault::ObstacleUnseen => e.obstacles.is_unseen && !is_dry_run,
            Fault::ObstacleApproaches => timers.obstacle_near.has_lasted(e.t_ns, OBSTACLE_NEAR_S),
            Fault::FenceNear => is_aloft && self.would_leave(e),
            Fault::FenceLeft => is_aloft && self.is_outside(e),
            Fault::TrackingLost => self.has_lost_reference(e),
            Fault::Immobile => self.is_immobile(e),
            Fault::TooFast => timers.too_fast.has_lasted(e.t_ns, TOO_FAST_S),
            Fault::DeadTimeLong => timers.dead_time_long.has_lasted(e.t_ns, DEAD_TIME_LONG_S),
            Fault::MissionOverdue => self.is_mission_overdue(e),
            Fault::OutageHeld => self.outage(e).is_some_and(|outage| outage.is_held),
            Fault::OutageLong => self.is_outage_long(e),
            Fault::OutageUnsafe => self.is_outage_unsafe(e),
            Fault::DroneUnheard => self.is_drone_unheard(e) && !is_dry_run,
            Fault::DroneAloft => self.reports_flight_before_order(e),
            Fault::TookOffUnasked => self.has_flown_before_order(),
            Fault::DroneSilent => self.is_drone_silent(e) && !is_dry_run,
            Fault::NotFlying => timers.reports_standing.has_lasted(DOWN_HOLD_S) && !is_dry_run,
            Fault::BatteryLow => self.is_battery_low(e),
            Fault::BatteryCritical => timers.battery_critical.has_lasted(BATTERY_CRITICAL_S),
            Fault::EstimatorFailed => e.has_estimator_failed,
            Fault::ControllerFailed => self.is_without_plan(e),
            Fault::SolverFailing => self.failures.value() > f64::from(table.solver_failures_max),
            Fault::TicksLate => self.late_periods.value() > f64::from(table.late_periods_max),
            Fault::TakeOffTimeout => self.is_take_off_overdue(e),
            Fault::LandingTimeout => self.is_landing_overdue(e),
            Fault::GuardianLost => e.incidents.is_guardian_lost,
            Fault::ProgramStalled => e.incidents.has_landed_unasked,
            Fault::PersonGone => self.is_person_gone(e),
            Fault::InputExpired => e.incidents.has_input_expired,
            // How a landing was confirmed is known once it is: `note_confirmation`.
            Fault::LandedByPose | Fault::LandedByDrone => self.ended_by.contains(fault),
            Fault::OperatorStop => e.operator == Operator::Land,
            Fault::OperatorEmergencyStop => e.operator == Operator::EmergencyStop,
        }
    }

    /// The worse of both agreements of poses and drone, velocity and height: the drone's velocity counts in flight,
    /// since it is compared by what it showed in level flight, its height from the take-off on.
    fn agreement(&self, e: &Evidence) -> Agreement {
        let is_aloft = self.is_taking_off_or_flying();
        let height = if is_aloft { e.findings.height } else { Agreement::Unknown };
        if self.is_flying() { height.max(e.findings.velocity) } else { height }
    }

    /// The worse of [`Supervisor::agreement`] and that of the headings, which counts in flight.
    fn worst_agreement(&self, e: &Evidence) -> Agreement {
        let by_heading = if self.is_flying() { e.findings.heading } else { Agreement::Unknown };
        self.agreement(e).max(by_heading)
    }

    /// Whether the heading is wrong by the direction of the motion or by the drone's heading.
    fn is_heading_wrong(&self, e: &Evidence) -> bool {
        let is_wrong = e.findings.is_direction_wrong || e.findings.heading >= Agreement::Disagrees;
        self.is_flying() && is_wrong
    }

    /// Whether position, velocity or heading of the vehicle have been off those of the reference for too long.
    fn has_lost_reference(&self, e: &Evidence) -> bool {
        let timers = &self.timers;
        timers.velocity_off_reference.exceeds(VELOCITY_OFF_REFERENCE_S)
            || timers.off_reference.has_lasted(e.t_ns, OFF_REFERENCE_S)
            || timers.heading_off_reference.has_lasted(e.t_ns, HEADING_OFF_REFERENCE_S)
    }

    /// Whether a vehicle that the controller flies is held or blocked, has hit something or stands on something.
    fn is_immobile(&self, e: &Evidence) -> bool {
        let is_outage = self.outage(e).is_some();
        // In an outage the inputs drive nothing.
        let has_hit = e.tracking.has_hit && !is_outage;
        let pressed_max_s = self.table.failsafe.pressed_s;
        let is_pressed =
            pressed_max_s.is_some_and(|limit_s| exceeds(e.tracking.pressed_s, limit_s));
        let stands_s =
            if is_outage { STANDING_ON_OBJECT_IN_OUTAGE_S } else { STANDING_ON_OBJECT_S };
        let stands = self.timers.standing_below_reference.has_lasted(e.t_ns, stands_s);
        self.is_flying() && !e.is_by_hand() && (has_hit || is_pressed || stands)
    }

    /// The command outage of a flying vehicle.
    fn outage<'a>(&self, e: &'a Evidence) -> Option<&'a Outage> {
        e.outage.as_ref().filter(|_| self.is_flying())
    }

    fn is_outage_long(&self, e: &Evidence) -> bool {
        let failsafe = &self.table.failsafe;
        self.outage(e).is_some_and(|outage| exceeds(outage.for_s, failsafe.outage_s))
            || self.timers.outage_unconfirmed.has_lasted(e.t_ns, failsafe.outage_alone_s)
    }

    /// Whether the drone does not confirm the outage, and the vehicle would leave the room if its commands act
    /// nevertheless.
    fn is_outage_unsafe(&self, e: &Evidence) -> bool {
        self.timers.outage_unconfirmed.has_lasted(e.t_ns, OUTAGE_UNCONFIRMED_S)
            && self.room.zip(self.outage(e)).is_some_and(|(room, outage)| {
                outage.if_applied.iter().any(|motion| room.is_left_by(motion))
            })
    }

    fn is_mission_overdue(&self, e: &Evidence) -> bool {
        self.is_flying() && exceeds(e.tracking.overtime_s, self.table.failsafe.overtime_s)
    }

    /// Whether the vehicle has gone too far away from its reference, or has come down too far below it.
    pub(super) fn is_off_reference(&self, e: &Evidence) -> bool {
        let limit_m = self.table.failsafe.tracking_m;
        e.tracking.position_growth_m.is_some_and(|error_m| exceeds(error_m, limit_m))
            || e.tracking.sink_depth_m.is_some_and(|sink_depth_m| exceeds(sink_depth_m, SUNK_M))
    }

    /// Updates for how long the velocity of a vehicle that follows its reference was far from that of the reference,
    /// faster while it receded. A person who steers resets the time.
    pub(super) fn update_velocity_off_reference(&mut self, e: &Evidence) {
        if e.is_by_hand() {
            self.timers.velocity_off_reference = LeakyTimer::default();
        }
        let follows_reference = match self.control {
            ControlMode::Off => false,
            ControlMode::Mission => true,
            // In the descent the reference is a place at rest.
            ControlMode::Brake => self.descends_to_m().is_some(),
        };
        let counts = self.is_flying() && follows_reference && e.outage.is_none();
        let is_off = |error_mps: &f64| exceeds(*error_mps, VELOCITY_OFF_REFERENCE_MPS);
        let off_mps = e.tracking.velocity_error_mps.filter(is_off).filter(|_| counts);
        let weight = |error_mps: f64| {
            let squared = (error_mps / VELOCITY_OFF_REFERENCE_MPS).powi(2);
            if e.tracking.is_receding { squared.min(RECEDING_WEIGHT_MAX) } else { 1.0 }
        };
        let weight = off_mps.map_or(0.0, weight);
        self.timers.velocity_off_reference.update_weighted(weight, e.t_ns);
    }

    /// Whether a vehicle that should climb to its reference is stiller than one that flies, by poses that are new.
    pub(super) fn seems_to_stand(&self, e: &Evidence) -> bool {
        let follows_mission = self.control == ControlMode::Mission;
        let is_asked = !e.is_by_hand() && (follows_mission || e.outage.is_some());
        let is_new = !self.is_pose_stale(e) && !e.poses.is_repeated;
        let is_still = is_new && e.findings.still_s.is_some();
        let is_below = e
            .tracking
            .height_deficit_m
            .is_some_and(|height_deficit_m| exceeds(height_deficit_m, BELOW_REFERENCE_MIN_M));
        self.is_flying() && is_asked && is_still && is_below
    }

    /// Whether the drone has not reported yet, or is silent on the ground.
    fn is_drone_unheard(&self, e: &Evidence) -> bool {
        e.drone.is_none() || (self.phase == Phase::Idle && self.is_drone_silent(e))
    }

    /// Whether the newest report of the drone, or without one the first tick, is too long ago.
    fn is_drone_silent(&self, e: &Evidence) -> bool {
        let silent_s = e.drone.map_or_else(|| self.running_s(e), |drone| drone.age_s);
        exceeds(silent_s, self.table.drone_silent_s)
    }

    /// Time since the first tick. s
    pub(super) fn running_s(&self, e: &Evidence) -> f64 {
        self.began_ns.map_or(0.0, |began_ns| elapsed_s(began_ns, e.t_ns))
    }

    fn is_battery_low(&self, e: &Evidence) -> bool {
        e.drone.is_some_and(|drone| {
            let is_charged = (self.table.battery_low_pct..=100).contains(&drone.battery_pct);
            drone.is_battery_low || !is_charged
        })
    }

    /// Whether the drone takes sticks. An old report does not show that it takes none.
    pub(super) fn takes_sticks(&self, e: &Evidence) -> bool {
        self.fresh_report(e).is_none_or(|drone| drone.takes_sticks)
    }

    /// Whether the drone reports to fly and no take-off was ordered.
    pub(super) fn reports_flight_before_order(&self, e: &Evidence) -> bool {
        self.phase == Phase::Idle && !self.is_dry_run && self.drone_reports_flying(e) == Some(true)
    }

    /// Whether the drone has reported to fly, before any order to take off, for too long to be a mistake.
    pub(super) fn has_flown_before_order(&self) -> bool {
        self.timers.flying_unordered.has_lasted(FLYING_UNORDERED_S)
    }

    /// Whether the take-off was not confirmed in time, or the drone reports to fly and does not rise.
    fn is_take_off_overdue(&self, e: &Evidence) -> bool {
        let phase_s = elapsed_s(self.phase_since_ns, e.t_ns);
        let is_late = phase_s >= self.table.take_off_timeout_s
            || self.timers.not_rising.has_lasted(e.t_ns, NOT_RISING_S);
        self.phase == Phase::TakingOff && is_late && !self.is_take_off_complete(e)
    }

    /// Whether the vehicle flies: it is past its take-off, does not land yet and is not carried by hand. Who steers it
    /// is left open.
    pub(super) fn is_flying(&self) -> bool {
        self.phase == Phase::Flying && !self.is_dry_run
    }

    /// Whether the vehicle takes off or flies, and is not carried by hand: it is in the air, or about to be.
    pub(super) fn is_taking_off_or_flying(&self) -> bool {
        matches!(self.phase, Phase::TakingOff | Phase::Flying) && !self.is_dry_run
    }

    /// Whether a controller that steers has no new plan. The flag belongs to the plan of the previous tick, which was
    /// made only if it could be used.
    pub(super) fn is_without_plan(&self, e: &Evidence) -> bool {
        e.has_controller_failed && self.control != ControlMode::Off
    }
}

#[cfg(test)]
mod tests;
