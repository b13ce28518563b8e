//! Braking before a landing.
//!
//! Owns when a flight that has to end is brought to rest, and down to `land_from_m`, by the controller first. A landing
//! flies with neutral sticks: a vehicle at 1 m/s coasts on for 0.7 m, and a draught, or a drone that has lost its own
//! velocity control, carries one that lands from 1.3 m up to 2 m away. A fault that leaves poses and controller trusted
//! ([`Reaction::BrakeAndLand`]) gives the time, and so does a mission that is done: a person may have handed the
//! vehicle back far from the last target.

use horizon_model::rows::pose;

use super::condition_timer::{HoldTimer, elapsed_s};
use super::evidence::{Evidence, Phase};
use super::fault::{Fault, FaultSet, Pilot, Reaction};
use super::{Assessment, Supervisor};

/// A vehicle that is slower lands at once, or comes down. m/s
pub(crate) const SLOW_MPS: f64 = 0.2;

/// Longest braking: a dead time of 0.34 s, and 1.2 m/s at 1.1 m/s^2. s
const BRAKE_MAX_S: f64 = 1.5;

/// A vehicle within this of the height from which it lands has come down. m
const LOW_M: f64 = 0.05;

/// A vehicle that comes down lands if it does not get lower by this within [`BRAKE_MAX_S`]: it stands on something or
/// does not obey. The first 0.1 m at 0.4 m/s take 0.25 s, a dead time of up to 0.34 s and a lag of 0.25 s. m
const PROGRESS_M: f64 = 0.1;

/// Longest descent before a landing: from 2.5 m at 0.4 m/s, and half as long again. s
const DESCENT_MAX_S: f64 = 8.0;

/// The newest progress of a vehicle that comes down before a landing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Descent {
    /// Height at that time, world frame. m
    at_m: f64,
    /// When that was. ns
    since_ns: i64,
}

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
    /// Updates since when the vehicle brakes: the flight then ends, unless a person takes over and flies on.
    pub(super) fn update_braking(&mut self, e: &Evidence, found: &Assessment) {
        let ending = self.ended_by.union(found.faults);
        let flies_on =
            found.pilot == Pilot::Person && ending.reaction(found.pilot) < Reaction::BrakeAndLand;
        if self.phase == Phase::Flying && flies_on {
            self.timers.braking.update(false, e.t_ns);
            self.ended_by = FaultSet::default();
        }
        let has_to_land = found.reaction == Reaction::BrakeAndLand || self.is_final_wait_over(e);
        if self.phase == Phase::Flying && has_to_land {
            self.timers.braking.update(true, e.t_ns);
            self.note_ending(found);
        }
        self.update_descent(e);
    }

    /// Updates when a braking vehicle became slow, and its progress from then on. While it waits for the moving
    /// obstacle, its height does not matter, and the time of the descent begins anew.
    fn update_descent(&mut self, e: &Evidence) {
        let Some(at) = e.pose.filter(|_| self.timers.braking.holds()) else {
            self.descent = None;
            return;
        };
        let (at_m, is_waiting) = (at[pose::Z], self.is_waiting(e));
        let progresses = match self.descent {
            None => e.speed_mps <= SLOW_MPS,
            Some(descent) => at_m <= descent.at_m - PROGRESS_M || is_waiting,
        };
        if is_waiting {
            self.timers.braking = HoldTimer::default();
            self.timers.braking.update(true, e.t_ns);
        }
        if progresses {
            self.descent = Some(Descent { at_m, since_ns: e.t_ns });
        }
    }

    /// Whether a vehicle that has become slow after its mission waits for the moving obstacle before it lands.
    fn is_waiting(&self, e: &Evidence) -> bool {
        self.descent.is_some() && self.ended_by.is_empty() && self.waits_for_moving_obstacle(e)
    }

    /// Height, world frame, to which the controller brings the vehicle down before a landing for which it brakes;
    /// `None`: the vehicle lands from where it is, or does not land. One that does not report lands at once. m
    pub(crate) fn descends_to_m(&self) -> Option<f64> {
        let (ground_m, land_from_m) = self.take_off.ground_m.zip(self.table.land_from_m)?;
        let brakes = self.timers.braking.holds() && !self.ended_by.contains(Fault::DroneSilent);
        brakes.then_some(ground_m + land_from_m)
    }

    /// Whether a vehicle that has to land brakes no longer: it is slow and low, braked long enough, does not get lower,
    /// or the controller may not steer. In a command outage it does not come down.
    pub(super) fn has_braked(&self, e: &Evidence, found: &Assessment) -> bool {
        let Assessment { pilot, faults, .. } = *found;
        let is_fast = e.speed_mps > SLOW_MPS;
        let descends = self.descends_to_m().filter(|_| e.outage.is_none()).zip(e.pose);
        let is_high = descends.is_some_and(|(to_m, at)| at[pose::Z] > to_m + LOW_M);
        let forbids = |one: Reaction| one >= Reaction::Hold && one != Reaction::BrakeAndLand;
        let may_brake = self.control != ControlMode::Off
            && pilot == Pilot::Controller
            && e.speed_mps.is_finite()
            && self.takes_sticks(e)
            // A drone that keeps an old command does not brake.
            && !faults.contains(Fault::OutageHeld)
            && !faults.iter().any(|fault| forbids(fault.reaction(pilot)));
        let lasts_too_long = |limit_s| self.timers.braking.has_lasted(e.t_ns, limit_s);
        let is_late = match self.descent.filter(|_| is_high) {
            Some(descent) => {
                elapsed_s(descent.since_ns, e.t_ns) >= BRAKE_MAX_S
                    || lasts_too_long(BRAKE_MAX_S + DESCENT_MAX_S)
            }
            None => lasts_too_long(BRAKE_MAX_S),
        };
        let has_come_down = !(is_fast || is_high);
        let is_over = !may_brake || (!self.is_waiting(e) && (is_late || has_come_down));
        self.timers.braking.holds() && is_over
    }
}

#[cfg(test)]
mod tests;
