//! The checks of the bench: what to do, which packets are sent and when, and what is expected.
//!
//! The table that `tello-ctl bench --list` prints is `checks.json`. What depends on each assumption stands in
//! `docs/bench-test.md`.

use std::fmt::{self, Display, Formatter};

use anyhow::{Context as _, Result};
use serde::Deserialize;
use tello_io::config;

/// Where a check is done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum TestSite {
    /// On the table or in the hand: no packet of the check starts a motor.
    Still,
    /// On the table without propellers: the motors run.
    PropsOff,
    /// In the air, inside of a net.
    Net,
}

impl TestSite {
    /// Whether motors run there.
    pub fn spins(self) -> bool {
        self != Self::Still
    }
}

impl Display for TestSite {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Still => "props off, motors stay off",
            Self::PropsOff => "props off, motors run",
            Self::Net => "in the net, flies",
        })
    }
}

/// Proof by the drone's reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DroneEvidence {
    /// Nothing: eyes, or the table of velocities.
    None,
    /// The motors ran and are off before the ending begins.
    Down,
    /// Only eyes can see it: motors that are not off before the ending begins disprove it.
    NotDown,
    /// Every question was answered.
    Answered,
}

/// One part of a check.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Step {
    /// The order to take off, once.
    TakeOff,
    /// The order to land, once, with a new sequence number.
    Land,
    /// The order to land alone every 0.5 s for so long, with the same sequence number or new ones. s
    Lands {
        /// Duration. s
        for_s: f64,
        /// Whether each has the sequence number of the first.
        has_same_number: bool,
    },
    /// The order to stop the motors, twice: one datagram of fifty is lost.
    Emergency,
    /// The request for a connection, or for SDK mode, once.
    Hello,
    /// The question for the firmware's version, with this sequence number. Binary protocol only.
    Ask(u16),
    /// Sticks (roll, pitch, yaw, throttle) at 20 Hz for so long. s
    Sticks([f64; 4], f64),
    /// Neutral sticks at 20 Hz from us and these from a second socket, for so long. s
    Second([f64; 4], f64),
    /// Nothing is sent for so long. s
    Quiet(f64),
    /// Nothing is sent until the drone reports that it flies, at most for so long. s
    Flying(f64),
    /// Nothing is sent until the drone reports that its motors are off, at most for so long. s
    Down(f64),
}

impl Display for Step {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::TakeOff => f.write_str("take-off"),
            Self::Land => f.write_str("LAND"),
            Self::Lands { for_s, has_same_number } => {
                let number = if *has_same_number { "one sequence number" } else { "new numbers" };
                write!(f, "LAND every 0.5 s with {number} for {for_s} s")
            }
            Self::Emergency => f.write_str("emergency twice"),
            Self::Hello => f.write_str("request for a connection"),
            Self::Ask(sequence) => write!(f, "version? #{sequence} (binary protocol)"),
            Self::Sticks(NEUTRAL, 0.0) => f.write_str("neutral sticks once"),
            Self::Sticks(NEUTRAL, for_s) => write!(f, "neutral sticks {for_s} s"),
            Self::Sticks(u, for_s) => write!(f, "sticks {u:?} {for_s} s"),
            Self::Second(u, for_s) => write!(f, "a second program's sticks {u:?} {for_s} s"),
            Self::Quiet(for_s) => write!(f, "nothing {for_s} s"),
            Self::Flying(most_s) => write!(f, "nothing until it flies, {most_s} s at most"),
            Self::Down(most_s) => write!(f, "nothing until it is down, {most_s} s at most"),
        }
    }
}

/// One check.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Check {
    /// Its name on the command line and in the report.
    pub name: String,
    /// Where it is done.
    pub site: TestSite,
    /// What this program assumes of the drone.
    pub assumption: String,
    /// Task of the owner.
    pub todo: String,
    /// What is sent, in its order.
    pub steps: Vec<Step>,
    /// What the drone's reports prove.
    pub proof: DroneEvidence,
    /// What only eyes can see; yes is what is expected.
    pub question: Option<String>,
}

impl Check {
    /// Whether it needs sequence numbers, or sends sticks soon after the take-off, for which a drone in the
    /// text SDK breaks the take-off off.
    pub fn is_binary_only(&self) -> bool {
        self.site == TestSite::Net || self.proof == DroneEvidence::Answered
    }
}

const NEUTRAL: [f64; 4] = [0.0; 4];

/// All checks, in the order in which they are done.
///
/// # Errors
/// The built-in table is no list of checks.
pub fn checks() -> Result<Vec<Check>> {
    config::parse(include_str!("checks.json")).context("in the built-in checks.json")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_unique_and_only_what_spins_is_ordered_to_take_off() {
        let checks = checks().unwrap();
        for (i, check) in checks.iter().enumerate() {
            assert!(checks.iter().skip(i + 1).all(|other| other.name != check.name));
            assert_eq!(check.steps.contains(&Step::TakeOff), check.site.spins(), "{}", check.name);
            let turns = |step: &Step| matches!(step, Step::Sticks(u, _) if *u != NEUTRAL);
            assert!(check.site.spins() || !check.steps.iter().any(turns), "{}", check.name);
        }
    }
}
