//! Faults on order.
//!
//! Owns the faults that a test or a user switches on, by script or live, beside those that happen by
//! chance. What a fault does stands where it acts: [`crate::mocap`], `world` and `wire`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_model::setting::{SettingError, not_negative, positive};

use crate::DT_S;

/// Something that breaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The cameras do not see the drone: its pose is reported as lost.
    MocapLost,
    /// The pose stream is silent.
    MocapSilent,
    /// Another object is taken for the drone: a constant wrong pose.
    MocapGhost,
    /// The pose stream repeats its last pose.
    MocapFrozen,
    /// The pose is not a number.
    MocapNan,
    /// The pose is 10 m away, along x.
    MocapFar,
    /// The pose is 3 m away, along x.
    MocapAside,
    /// The heading is the opposite one.
    MocapFlipped,
    /// The position comes in millimetres.
    MocapMillimetres,
    /// Only another object is seen.
    MocapOther,
    /// The drone hears nothing: neither sticks nor orders.
    DroneDeaf,
    /// The drone reports nothing.
    DroneMute,
}

impl Fault {
    /// Every fault, in the order of declaration.
    pub const ALL: [Self; 12] = [
        Self::MocapLost,
        Self::MocapSilent,
        Self::MocapGhost,
        Self::MocapFrozen,
        Self::MocapNan,
        Self::MocapFar,
        Self::MocapAside,
        Self::MocapFlipped,
        Self::MocapMillimetres,
        Self::MocapOther,
        Self::DroneDeaf,
        Self::DroneMute,
    ];
}

/// A fault with its time.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ScriptedFault {
    /// What breaks.
    pub fault: Fault,
    /// When, since the start of the simulation. s, >= 0.
    pub from_s: f64,
    /// For how long. s, > 0.
    pub for_s: f64,
}

/// The faults of a world: those of its script and those switched on by hand.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Faults {
    script: Vec<ScriptedFault>,
    by_hand: [bool; Fault::ALL.len()],
}

impl Faults {
    /// The faults of `script`; they may overlap.
    ///
    /// # Errors
    /// A time that is negative or not finite, or no duration.
    pub fn new(script: Vec<ScriptedFault>) -> Result<Self, SettingError> {
        for (i, entry) in script.iter().enumerate() {
            not_negative(&format!("faults[{i}].from_s"), entry.from_s)?;
            positive(&format!("faults[{i}].for_s"), entry.for_s)?;
        }
        Ok(Self { script, by_hand: Default::default() })
    }

    /// Switches a fault on or off, beside the script.
    pub fn set(&mut self, fault: Fault, is_on: bool) {
        self.by_hand[fault as usize] = is_on;
    }

    /// Whether `fault` is present in `step`.
    pub fn is_on(&self, fault: Fault, step: u64) -> bool {
        // The middle of the step: a time that is a whole number of steps up to rounding stays one.
        let now_s = (step as f64 + 0.5) * DT_S;
        self.by_hand[fault as usize]
            || self.script.iter().any(|entry| {
                entry.fault == fault && (entry.from_s..entry.from_s + entry.for_s).contains(&now_s)
            })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scripted_fault_lasts_as_long_as_it_says() {
        let script = vec![
            ScriptedFault { fault: Fault::MocapLost, from_s: 0.6, for_s: 0.1 },
            ScriptedFault { fault: Fault::DroneDeaf, from_s: 0.0, for_s: 0.02 },
        ];
        let faults = Faults::new(script).unwrap();
        let steps = |fault| (0..100).filter(|k| faults.is_on(fault, *k)).collect::<Vec<_>>();
        assert_eq!(steps(Fault::MocapLost), [30, 31, 32, 33, 34]);
        assert_eq!(steps(Fault::DroneDeaf), [0]);
        assert!(steps(Fault::MocapGhost).is_empty());
    }

    #[test]
    fn a_fault_set_by_hand_lasts_until_it_is_cleared() {
        let mut faults = Faults::default();
        for fault in Fault::ALL {
            faults.set(fault, true);
            let on = Fault::ALL.into_iter().filter(|other| faults.is_on(*other, 7));
            assert!(on.eq([fault]), "{fault:?}");
            faults.set(fault, false);
        }
        assert!(Fault::ALL.into_iter().all(|fault| !faults.is_on(fault, 7)));
    }

    #[test]
    fn nonsense_is_refused() {
        let entry = ScriptedFault { fault: Fault::MocapLost, from_s: -1.0, for_s: 1.0 };
        let error = Faults::new(vec![entry]).unwrap_err();
        assert_eq!(error.to_string(), "faults[0].from_s = -1 violates finite and >= 0");
    }
}
