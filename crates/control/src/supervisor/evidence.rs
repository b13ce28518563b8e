//! What the supervisor is told at a tick, and what it answers.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fault::FaultSet;

/// Where a flight begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// On the ground, with a take-off.
    Grounded,
    /// In the air; control starts at once.
    Airborne,
    /// In somebody's hands, motors off: control plans at once and nothing is sent.
    Carried,
}

/// Part of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// On the ground, waiting for the order to fly and for everything it takes.
    Idle,
    /// Take-off ordered and not yet confirmed.
    TakingOff,
    /// In the air; control steers unless something is wrong.
    Flying,
    /// Landing ordered, again and again; there is no way back.
    Landing,
    /// Down. The end.
    Landed,
    /// The landing was not confirmed in time; it is ordered until the vehicle is down. The end.
    Fault,
}

impl Phase {
    /// Name on terminals.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::TakingOff => "taking off",
            Self::Flying => "flying",
            Self::Landing => "landing",
            Self::Landed => "landed",
            Self::Fault => "fault",
        }
    }
}

/// What the drone says of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DroneReport {
    /// Age of the report. s
    pub age_s: f64,
    /// Whether it flies.
    pub is_flying: bool,
    /// Battery charge. %
    pub battery_pct: u8,
}

/// Everything that a ruling rests on, at one tick. An age of NaN counts as too old.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "five unrelated observations, not a state")]
pub struct Evidence {
    /// Time of the tick. ns since any fixed moment
    pub t_ns: i64,
    /// Age of the newest accepted position; `None` before the first. s
    pub pose_age_s: Option<f64>,
    /// Height of the vehicle in the newest accepted position. m
    pub height_m: Option<f64>,
    /// Newest report of the drone; `None` before the first.
    pub drone: Option<DroneReport>,
    /// Whether the operator asks to take off.
    pub asks_to_fly: bool,
    /// Whether the operator asks to land; stronger than the order to fly.
    pub asks_to_land: bool,
    /// Whether the last target is reached.
    pub is_mission_done: bool,
    /// Whether the newest estimate failed.
    pub estimator_failed: bool,
    /// Whether the newest plan failed.
    pub controller_failed: bool,
}

/// What to send beside the sticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Nothing.
    None,
    /// Take off.
    TakeOff,
    /// Land.
    Land,
}

/// What the supervisor decides for one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub struct Ruling {
    /// Phase after the tick.
    pub phase: Phase,
    /// Whether the controller's sticks pass; neutral sticks otherwise.
    pub may_steer: bool,
    /// What to send beside the sticks.
    pub order: Order,
    /// What is wrong, and what ended the flight.
    pub faults: FaultSet,
}
