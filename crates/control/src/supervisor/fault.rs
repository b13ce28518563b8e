//! What can go wrong in a flight, and the only place that says what happens then.

use std::fmt::{self, Debug, Formatter};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Something that is wrong at a tick.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The newest accepted position is older than `stale_s`, or there never was one.
    MocapStale,
    /// No position was accepted for longer than `lost_s`.
    MocapLost,
    /// The drone has not reported yet.
    DroneUnheard,
    /// The drone has not reported for longer than `drone_silent_s`.
    DroneSilent,
    /// The drone says for a second that it stands while control flies it: it landed by itself.
    NotFlying,
    /// The battery is below `battery_low_pct`.
    BatteryLow,
    /// The battery is below `battery_critical_pct`.
    BatteryCritical,
    /// The estimator has no estimate.
    EstimatorFailed,
    /// The controller has no plan; the previous one goes on.
    ControllerFailed,
    /// Estimator or controller failed in more than `solver_failures_max` ticks in a row.
    SolverFailing,
    /// The take-off was not confirmed within `take_off_timeout_s`.
    TakeOffTimeout,
    /// The landing was not confirmed within `landing_timeout_s`.
    LandingTimeout,
    /// The operator asks to land.
    OperatorStop,
}

/// What a fault leads to, mildest first; of several the strongest counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Nothing but a line in the log.
    Note,
    /// A vehicle on the ground stays there; a flight goes on.
    StayDown,
    /// Neutral sticks while it lasts; a vehicle on the ground stays there.
    Hold,
    /// The flight ends by landing, whatever comes later; a vehicle on the ground stays there.
    Land,
}

impl Fault {
    /// Name on terminals.
    pub fn name(self) -> &'static str {
        match self {
            Self::MocapStale => "mocap stale",
            Self::MocapLost => "mocap lost",
            Self::DroneUnheard => "drone unheard",
            Self::DroneSilent => "drone silent",
            Self::NotFlying => "not flying",
            Self::BatteryLow => "battery low",
            Self::BatteryCritical => "battery critical",
            Self::EstimatorFailed => "estimator failed",
            Self::ControllerFailed => "controller failed",
            Self::SolverFailing => "solver failing",
            Self::TakeOffTimeout => "take-off not confirmed",
            Self::LandingTimeout => "landing not confirmed",
            Self::OperatorStop => "operator stop",
        }
    }

    /// All faults, in the order of their declaration.
    pub const ALL: [Self; Self::OperatorStop as usize + 1] = [
        Self::MocapStale,
        Self::MocapLost,
        Self::DroneUnheard,
        Self::DroneSilent,
        Self::NotFlying,
        Self::BatteryLow,
        Self::BatteryCritical,
        Self::EstimatorFailed,
        Self::ControllerFailed,
        Self::SolverFailing,
        Self::TakeOffTimeout,
        Self::LandingTimeout,
        Self::OperatorStop,
    ];

    /// What it leads to. No wildcard: a new fault does not compile until somebody has decided.
    pub fn reaction(self) -> Reaction {
        match self {
            // The shifted plan goes on; SolverFailing is the limit.
            Self::ControllerFailed => Reaction::Note,
            Self::BatteryLow | Self::DroneUnheard => Reaction::StayDown,
            Self::MocapStale | Self::EstimatorFailed => Reaction::Hold,
            Self::MocapLost
            | Self::DroneSilent
            | Self::NotFlying
            | Self::BatteryCritical
            | Self::SolverFailing
            | Self::TakeOffTimeout
            | Self::LandingTimeout
            | Self::OperatorStop => Reaction::Land,
        }
    }
}

/// A set of faults.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultSet(u32);

impl FaultSet {
    /// Adds `fault` if `is_present`.
    pub fn set(&mut self, fault: Fault, is_present: bool) {
        self.0 |= u32::from(is_present) << fault as u32;
    }

    /// Whether `fault` is in the set.
    pub fn contains(self, fault: Fault) -> bool {
        self.0 >> fault as u32 & 1 == 1
    }

    /// Whether nothing is wrong.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The faults in the order of their declaration.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.into_iter().filter(move |fault| self.contains(*fault))
    }

    /// Faults in either set.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The faults of this set that end a flight.
    #[must_use]
    pub fn ending_flight(self) -> Self {
        let mut ending = Self::default();
        for fault in self.iter() {
            ending.set(fault, fault.reaction() == Reaction::Land);
        }
        ending
    }

    /// The strongest reaction, [`Reaction::Note`] without any fault.
    pub fn reaction(self) -> Reaction {
        self.iter().map(Fault::reaction).max().unwrap_or(Reaction::Note)
    }
}

impl Debug for FaultSet {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_of_faults_is_complete_and_in_order() {
        for (i, fault) in Fault::ALL.into_iter().enumerate() {
            assert_eq!(fault as usize, i, "{fault:?}");
        }
    }

    #[test]
    fn every_fault_has_the_reaction_that_was_decided() {
        let reactions = Fault::ALL.map(|fault| (fault, fault.reaction()));
        let expected = [
            (Fault::MocapStale, Reaction::Hold),
            (Fault::MocapLost, Reaction::Land),
            (Fault::DroneUnheard, Reaction::StayDown),
            (Fault::DroneSilent, Reaction::Land),
            (Fault::NotFlying, Reaction::Land),
            (Fault::BatteryLow, Reaction::StayDown),
            (Fault::BatteryCritical, Reaction::Land),
            (Fault::EstimatorFailed, Reaction::Hold),
            (Fault::ControllerFailed, Reaction::Note),
            (Fault::SolverFailing, Reaction::Land),
            (Fault::TakeOffTimeout, Reaction::Land),
            (Fault::LandingTimeout, Reaction::Land),
            (Fault::OperatorStop, Reaction::Land),
        ];
        assert_eq!(reactions, expected);
    }

    #[test]
    fn a_set_holds_what_was_put_in_and_reacts_to_the_strongest() {
        let mut faults = FaultSet::default();
        assert!(faults.is_empty());
        assert_eq!(faults.reaction(), Reaction::Note);
        faults.set(Fault::OperatorStop, false);
        faults.set(Fault::BatteryLow, true);
        faults.set(Fault::MocapStale, true);
        faults.set(Fault::MocapStale, false);
        assert!(!faults.is_empty());
        assert_eq!(faults.iter().collect::<Vec<_>>(), [Fault::MocapStale, Fault::BatteryLow]);
        assert_eq!(faults.reaction(), Reaction::Hold);
        assert_eq!(format!("{faults:?}"), "{MocapStale, BatteryLow}");
    }

    #[test]
    fn only_landing_faults_end_a_flight() {
        let all = Fault::ALL.into_iter().fold(FaultSet::default(), |mut set, fault| {
            set.set(fault, true);
            set
        });
        let ending = all.ending_flight();
        for fault in Fault::ALL {
            assert_eq!(ending.contains(fault), fault.reaction() == Reaction::Land, "{fault:?}");
        }
        assert_eq!(ending.union(all), all);
        assert_eq!(FaultSet::default().union(ending), ending);
    }
}
