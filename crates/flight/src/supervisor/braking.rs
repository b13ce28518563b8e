//! Braking before a landing.
//!
//! Owns when a flight that has to end is brought to rest, and down to `land_from_m`, by the controller first. A landing
//! flies with neutral sticks: a vehicle at 1 m/s coasts on for 0.7 m, and a draught, or a drone that has lost its own
//! velocity control, carries one that lands from 1.3 m up to 2 m away. A fault that leaves poses and controller trusted
//! ([`Reaction::BrakeAndLand`]) gives the time, and so does a mission that is done: a person may have handed the
//! vehicle back far from the last target.

use horizon_model::rows::pose;

use super::evidence::{Evidence, Phase};
use super::fault::{Fault, Pilot, Reaction};
use super::{Assessment, Supervisor};

/// A vehicle that is slower lands at once. m/s
const SLOW_MPS: f64 = 0.2;

/// Longest braking: a dead time of 0.34 s, and 1.2 m/s at 1.1 m/s^2. s
const BRAKE_MAX_S: f64 = 1.5;

/// A vehicle within this of the height from which it lands has come down. m
const LOW_M: f64 = 0.05;

/// Longest descent before a landing: from 2.5 m at 0.4 m/s, and half as long again. s
const DESCENT_MAX_S: f64 = 8.0;

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
    /// Remembers when the vehicle began to brake: the flight then ends in any case.
    pub(super) fn remember_braking(&mut self, e: &Evidence, found: &Assessment) {
        let has_to_land = found.reaction == Reaction::BrakeAndLand || self.is_held_out(e);
        if self.phase == Phase::Flying && has_to_land {
            self.timers.braking.update(true, e.t_ns);
            self.note_ending(found);
        }
    }

    /// Height, world frame, to which the controller brings the vehicle down before a landing for which it brakes;
    /// `None`: the vehicle lands from where it is, or does not land. One that does not report lands at once. m
    pub(crate) fn descends_to_m(&self) -> Option<f64> {
        let (ground_m, land_from_m) = self.take_off.ground_m.zip(self.table.land_from_m)?;
        let brakes = self.timers.braking.holds() && !self.ended_by.contains(Fault::DroneSilent);
        brakes.then_some(ground_m + land_from_m)
    }

    /// Whether a vehicle that has to land brakes no longer: it is slow and low, or braked long enough, or the
    /// controller may not steer.
    pub(super) fn has_braked(&self, e: &Evidence, found: &Assessment) -> bool {
        let Assessment { pilot, faults, .. } = *found;
        let is_fast = e.speed_mps > SLOW_MPS;
        let is_high =
            self.descends_to_m().zip(e.pose).is_some_and(|(to_m, at)| at[pose::Z] > to_m + LOW_M);
        let forbids = |one: Reaction| one >= Reaction::Hold && one != Reaction::BrakeAndLand;
        let may_brake = self.control != ControlMode::Off
            && pilot == Pilot::Controller
            && self.takes_sticks(e)
            // A drone that keeps an old command does not brake.
            && !faults.contains(Fault::OutageHeld)
            && !faults.iter().any(|fault| forbids(fault.reaction(pilot)));
        let limit_s = if is_high { BRAKE_MAX_S + DESCENT_MAX_S } else { BRAKE_MAX_S };
        let is_over =
            !(may_brake && (is_fast || is_high)) || self.timers.braking.has_lasted(e.t_ns, limit_s);
        self.timers.braking.holds() && is_over
    }
}

#[cfg(test)]
mod tests;
