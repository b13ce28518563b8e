//! From the evidence of a tick to what is wrong at it.
//!
//! Owns the condition of every fault. What follows from a fault stands in `fault.rs`.

use super::braking::ControlMode;
use super::evidence::{Evidence, Operator, Phase};
use super::fault::{Fault, FaultSet};
use super::{ALOFT_S, DOWN_HOLD_S, Leaky, Supervisor, elapsed_s, exceeds};
use crate::monitor::{Agreement, Findings};

/// How long the vehicle must be off its reference, or too fast. s
const ASTRAY_S: f64 = 0.3;

/// How long the vehicle must be turned away from its reference: an outage is found within this time. s
const TURNED_S: f64 = 1.5;

/// How long somebody must come near a vehicle that takes off: two places that are wrong look like a step. s
const ENDANGERED_S: f64 = 0.3;

/// How long the sticks must act too late: an outage that begins looks like it for a moment. s
const DEAD_TIME_LONG_S: f64 = 3.0;

/// Speed of a vehicle without commands, wind included. m/s
const LEVEL_MPS: f64 = 0.35;

/// How long an outage must be unconfirmed before the vehicle may be where the commands lead: after
/// a return of the link the drone moves before the link monitor has decided. s
const ALONE_S: f64 = 0.5;

/// A vehicle that has come down so far below its reference sinks or is pulled down: real flights by up to 0.37 m
/// (docs/benchmarks/2026-11-27-poses). m
const SUNK_M: f64 = 0.45;

/// A vehicle whose velocity is further from that of its reference for so long in sum swings around it: the velocity
/// loop of the vehicle is weakly damped, or its dead time much longer than that of the model. m/s, s
const SWINGS_MPS: f64 = 0.6;
const SWINGS_S: f64 = 4.0;

/// A steered vehicle whose pose is still for so long below its reference stands on something: a throttle that acts
/// shows within half of it. s
const STANDS_S: f64 = 1.2;
/// [`STANDS_S`] in what looks like an outage, in which a calm vehicle may hover. s
const STANDS_IN_OUTAGE_S: f64 = 2.4;
/// How far below its reference. m
const STANDS_BELOW_M: f64 = 0.2;

/// A drone that flies by its own report and has not risen after so long is held: rotors take about a second to spin up,
/// and the climb shows half a second later. s
const UNRISEN_S: f64 = 3.0;

/// A charge that is critical for less time may be a sag of the voltage or a report that is wrong. s
const BATTERY_CRITICAL_S: f64 = 1.0;

/// Whether the drone confirms that its commands are lost: its velocity agrees with the poses, or it
/// does not move.
pub(super) fn is_confirmed(findings: &Findings) -> bool {
    let is_slow = findings.drone_speed_mps.is_some_and(|v_mps| v_mps <= LEVEL_MPS);
    findings.velocity == Agreement::Agrees || is_slow
}

impl Supervisor {
    /// What is wrong at this tick.
    pub(super) fn faults(&self, e: &Evidence) -> FaultSet {
        let mut faults = FaultSet::default();
        for (fault, is_present) in self
            .pose_faults(e)
            .into_iter()
            .chain(self.motion_faults(e))
            .chain(self.drone_faults(e))
            .chain(self.flight_faults(e))
        {
            faults.set(fault, is_present);
        }
        faults
    }

    /// What is wrong with the motion.
    fn motion_faults(&self, e: &Evidence) -> [(Fault, bool); 17] {
        let (failsafe, findings) = (&self.table.failsafe, &e.findings);
        let is_flying = self.is_flying();
        // The drone's velocity is judged by what it showed in level flight, its height from the ground on.
        let velocity = if is_flying { findings.velocity } else { Agreement::Unknown };
        let height =
            if self.is_taking_off_or_flying() { findings.height } else { Agreement::Unknown };
        let heading = if is_flying { findings.heading } else { Agreement::Unknown };
        let worst = velocity.max(height);
        let is_heading_wrong = findings.is_direction_wrong || heading >= Agreement::Disagrees;
        let outage = e.outage.filter(|_| is_flying);
        let is_alone_for = |limit_s| self.since.alone.has_lasted(e.t_ns, limit_s);
        let is_long = outage.is_some_and(|outage| exceeds(outage.for_s, failsafe.outage_s));
        // In an outage the inputs drive nothing.
        let has_hit = e.has_hit && outage.is_none();
        let is_pressed =
            has_hit || failsafe.pressed_s.is_some_and(|limit_s| exceeds(e.pressed_s, limit_s));
        let stands_s = if outage.is_some() { STANDS_IN_OUTAGE_S } else { STANDS_S };
        let is_immobile = is_pressed || self.since.stands.has_lasted(e.t_ns, stands_s);
        let may_have_left = self.room.zip(outage).is_some_and(|(room, outage)| {
            outage.unseen.iter().any(|motion| room.is_left_by(motion))
        });
        [
            (Fault::WitnessDoubtful, worst.max(heading) >= Agreement::Doubtful),
            (Fault::WitnessDisagrees, worst >= Agreement::Disagrees),
            (Fault::HeadingWrong, is_flying && is_heading_wrong),
            (Fault::PlanBlocked, self.is_blocked(e)),
            (Fault::BlockedLong, self.is_blocked_long(e)),
            (Fault::ObstacleEntered, self.has_entered_obstacle(e)),
            (Fault::ObstacleUnseen, e.is_obstacle_unseen && !self.is_carried),
            (Fault::ObstacleApproaches, self.since.endangered.has_lasted(e.t_ns, ENDANGERED_S)),
            (Fault::FenceNear, self.is_taking_off_or_flying() && self.would_leave(e)),
            (Fault::FenceLeft, self.is_taking_off_or_flying() && self.is_outside(e)),
            (
                Fault::TrackingLost,
                self.since.swinging.exceeds(SWINGS_S)
                    || self.since.astray.has_lasted(e.t_ns, ASTRAY_S)
                    || self.since.turned.has_lasted(e.t_ns, TURNED_S),
            ),
            (Fault::Immobile, is_flying && !e.is_by_hand && is_immobile),
            (Fault::TooFast, self.since.fast.has_lasted(e.t_ns, ASTRAY_S)),
            (Fault::DeadTimeLong, self.since.dead_time_long.has_lasted(e.t_ns, DEAD_TIME_LONG_S)),
            (Fault::OutageHeld, outage.is_some_and(|outage| outage.is_held)),
            (Fault::OutageLong, is_long || is_alone_for(failsafe.outage_alone_s)),
            (Fault::OutageUnsafe, may_have_left && is_alone_for(ALONE_S)),
        ]
    }

    /// Whether the vehicle is further from its reference than it may be: away from it, or below it by what it has come
    /// down.
    pub(super) fn is_off_reference(&self, e: &Evidence) -> bool {
        let limit_m = self.table.failsafe.tracking_m;
        e.tracking_m.is_some_and(|error_m| exceeds(error_m, limit_m))
            || e.sunk_m.is_some_and(|sunk_m| exceeds(sunk_m, SUNK_M))
    }

    /// Updates for how long the velocity of a vehicle that follows its reference was far from that of the reference.
    /// What was before a person steered does not count.
    pub(super) fn remember_swings(&mut self, e: &Evidence) {
        if e.is_by_hand {
            self.since.swinging = Leaky::default();
        }
        let follows_mission =
            self.is_flying() && self.control == ControlMode::Mission && e.outage.is_none();
        let swings = e.velocity_error_mps.is_some_and(|error_mps| exceeds(error_mps, SWINGS_MPS));
        self.since.swinging.keep(follows_mission && swings, e.t_ns);
    }

    /// Whether a vehicle that should climb to its reference is stiller than one that flies, by poses that are new.
    pub(super) fn seems_to_stand(&self, e: &Evidence) -> bool {
        let follows_mission = self.control == ControlMode::Mission;
        let is_asked = !e.is_by_hand && (follows_mission || e.outage.is_some());
        let is_new = !self.is_pose_stale(e) && !e.is_pose_repeated;
        let is_still = is_new && e.findings.still_s.is_some();
        let is_below = e.below_m.is_some_and(|below_m| exceeds(below_m, STANDS_BELOW_M));
        self.is_flying() && is_asked && is_still && is_below
    }

    /// What is wrong with the drone.
    fn drone_faults(&self, e: &Evidence) -> [(Fault, bool); 7] {
        let table = &self.table;
        let running_s = self.began_ns.map_or(0.0, |began_ns| elapsed_s(began_ns, e.t_ns));
        let silent_s = e.drone.map_or(running_s, |drone| drone.age_s);
        let is_silent = exceeds(silent_s, table.drone_silent_s);
        let is_unheard = e.drone.is_none() || (self.phase == Phase::Idle && is_silent);
        let has_little_charge = e.drone.is_some_and(|drone| {
            drone.is_battery_low || !(table.battery_low_pct..=100).contains(&drone.battery_pct)
        });
        let has_no_charge = self.since.battery_critical.has_lasted(BATTERY_CRITICAL_S);
        let is_grounded = self.since.grounded.has_lasted(DOWN_HOLD_S);
        [
            (Fault::DroneUnheard, is_unheard && !self.is_carried),
            (Fault::DroneAloft, self.is_aloft_unasked(e)),
            (Fault::TookOffUnasked, self.has_taken_off_unasked()),
            (Fault::DroneSilent, is_silent && !self.is_carried),
            (Fault::NotFlying, is_grounded && !self.is_carried),
            (Fault::BatteryLow, has_little_charge),
            (Fault::BatteryCritical, has_no_charge),
        ]
    }

    /// Whether the drone is sent sticks. A report that is old does not show it.
    pub(super) fn takes_sticks(&self, e: &Evidence) -> bool {
        self.fresh_report(e).is_none_or(|drone| drone.takes_sticks)
    }

    /// Whether the drone reports that it flies and no take-off was ordered.
    pub(super) fn is_aloft_unasked(&self, e: &Evidence) -> bool {
        self.phase == Phase::Idle && !self.is_carried && self.drone_says_flying(e) == Some(true)
    }

    /// Whether it has reported so for too long to be a mistake.
    pub(super) fn has_taken_off_unasked(&self) -> bool {
        self.since.aloft.has_lasted(ALOFT_S)
    }

    /// What is wrong with the program, or has taken too long, and what the operator asks for.
    fn flight_faults(&self, e: &Evidence) -> [(Fault, bool); 13] {
        let table = &self.table;
        let phase_s = elapsed_s(self.phase_since_ns, e.t_ns);
        let is_take_off_overdue = self.phase == Phase::TakingOff
            && (phase_s >= table.take_off_timeout_s
                || self.since.unrisen.has_lasted(e.t_ns, UNRISEN_S))
            && !self.is_take_off_complete(e);
        [
            (
                Fault::MissionOverdue,
                self.is_flying() && exceeds(e.overtime_s, table.failsafe.overtime_s),
            ),
            (Fault::EstimatorFailed, e.has_estimator_failed),
            (Fault::ControllerFailed, self.is_without_plan(e)),
            (Fault::SolverFailing, self.failures > f64::from(table.solver_failures_max)),
            (Fault::TicksLate, self.late_periods > f64::from(table.late_periods_max)),
            (Fault::TakeOffTimeout, is_take_off_overdue),
            (Fault::LandingTimeout, self.is_landing_overdue(e)),
            (Fault::GuardianLost, e.incidents.is_guardian_lost),
            (Fault::ProgramStalled, e.incidents.has_landed_unasked),
            (Fault::PersonGone, self.is_person_gone(e)),
            (Fault::InputExpired, e.incidents.has_input_expired),
            (Fault::OperatorStop, e.operator == Operator::Land),
            (Fault::OperatorEmergencyStop, e.operator == Operator::EmergencyStop),
        ]
    }

    /// Whether the vehicle flies: it is past its take-off, does not land yet and is not carried by hand. Who steers it
    /// is left open.
    pub(super) fn is_flying(&self) -> bool {
        self.phase == Phase::Flying && !self.is_carried
    }

    /// Whether the vehicle takes off or flies, and is not carried by hand: it is in the air, or about to be.
    pub(super) fn is_taking_off_or_flying(&self) -> bool {
        matches!(self.phase, Phase::TakingOff | Phase::Flying) && !self.is_carried
    }

    /// Whether neutral sticks would bring the vehicle to rest outside of the room, where no plan knows better. After a
    /// hold the controller plans anew: with neutral sticks wind carries the vehicle on.
    fn would_leave(&self, e: &Evidence) -> bool {
        if !e.is_by_hand && e.is_plan_clear.is_some() {
            return false;
        }
        self.room.zip(e.motion).is_some_and(|(room, motion)| room.is_left_by(&motion))
    }

    /// Whether the vehicle is outside of the room by a position that is no guess.
    pub(super) fn is_outside(&self, e: &Evidence) -> bool {
        let fresh = e.pose.filter(|_| !self.is_pose_stale(e));
        self.room.zip(fresh).is_some_and(|(room, at)| !room.contains(&at))
    }

    /// Whether it is inside of an obstacle by such a position.
    fn has_entered_obstacle(&self, e: &Evidence) -> bool {
        self.is_taking_off_or_flying() && e.is_in_obstacle && !self.is_pose_stale(e)
    }

    /// Whether a controller that steers has no new plan. The flag belongs to the plan of the previous tick, which was
    /// made only if it could be used.
    pub(super) fn is_without_plan(&self, e: &Evidence) -> bool {
        e.has_controller_failed && self.control != ControlMode::Off
    }
}

#[cfg(test)]
mod tests;
