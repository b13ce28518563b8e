//! Braking before a landing.
//!
//! Owns when a flight that has to end is brought to rest by the controller first. A landing flies with neutral sticks:
//! a vehicle at 1 m/s coasts on for 0.7 m. A fault that leaves poses and controller trusted
//! ([`Reaction::BrakeAndLand`]) gives the time, and so does a mission that is done: a person may have handed the
//! vehicle back far from the last target.

use super::Supervisor;
use super::evidence::{Evidence, Phase};
use super::fault::{Fault, FaultSet, Pilot, Reaction};

/// A vehicle that is slower lands at once. m/s
const SLOW_MPS: f64 = 0.2;

/// Longest braking: a dead time of 0.34 s, and 1.2 m/s at 1.1 m/s^2. s
const BRAKE_MAX_S: f64 = 1.5;

/// Longest wait at the end of a mission for an obstacle that comes near, or could. s
const LET_PAST_S: f64 = 60.0;

/// What the controller does with the vehicle in a tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum ControlMode {
    /// The controller does not steer: others do, or nobody.
    Off,
    /// The controller follows the mission.
    Mission,
    /// The controller brings the vehicle to rest.
    Brake,
}

impl ControlMode {
    /// The activity of a controller that steers or not, while the vehicle brakes or not.
    pub(super) fn of(steers: bool, is_braking: bool) -> Self {
        match (steers, is_braking) {
            (false, _) => Self::Off,
            (true, false) => Self::Mission,
            (true, true) => Self::Brake,
        }
    }
}

impl Supervisor {
    /// Remembers when the vehicle began to brake: from then on the flight ends, whatever comes later.
    pub(super) fn remember_braking(&mut self, e: &Evidence, faults: FaultSet, pilot: Pilot) {
        let has_to_land = faults.reaction(pilot) == Reaction::BrakeAndLand || self.is_held_out(e);
        if self.phase == Phase::Flying && has_to_land {
            self.timers.braking.update(true, e.t_ns);
            self.ended_by = self.ended_by.union(faults.ending_flight(pilot));
        }
    }

    /// Whether the mission has been done for long enough. A landing evades nothing: an obstacle that comes near, or
    /// walks so near that it could, is let past first.
    fn is_held_out(&self, e: &Evidence) -> bool {
        let is_near = e.is_approached || e.may_be_approached;
        let let_past_s = if is_near { LET_PAST_S } else { 0.0 };
        self.timers.mission_done.has_lasted(e.t_ns, self.table.finish_hold_s + let_past_s)
    }

    /// Whether a vehicle that has to land brakes no longer: it is slow, or braked long enough, or the controller may
    /// not steer.
    pub(super) fn has_braked(&self, e: &Evidence, faults: FaultSet, pilot: Pilot) -> bool {
        let is_fast = e.speed_mps > SLOW_MPS;
        let forbids = |one: Reaction| one >= Reaction::Hold && one != Reaction::BrakeAndLand;
        let may_brake = self.control != ControlMode::Off
            && pilot == Pilot::Controller
            && self.takes_sticks(e)
            // A drone that keeps an old command does not brake.
            && !faults.contains(Fault::OutageHeld)
            && !faults.iter().any(|fault| forbids(fault.reaction(pilot)));
        let is_over =
            !(is_fast && may_brake) || self.timers.braking.has_lasted(e.t_ns, BRAKE_MAX_S);
        self.timers.braking.holds() && is_over
    }
}

#[cfg(test)]
mod tests;
