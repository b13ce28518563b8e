//! The drone as the tick sees it, whatever protocol it speaks.
//!
//! Bytes are none of this: the protocols are in `tello-io`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{SpanNs, TimeNs};

/// Silence of the control thread after which the sender sends neutral sticks in place of the approved
/// ones.
pub const CONTROL_SILENCE_NEUTRAL: SpanNs = SpanNs::from_ms(100);

/// How we talk to the drone. It takes the first that it hears and no other until it is switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// What the vendor's app speaks: sticks of 660 steps, and a status that says whether it flies.
    Binary,
    /// The documented SDK: sticks of 100 steps, and a state line that does not say it.
    Text,
}

impl Protocol {
    /// Steps of a stick from neutral to full deflection.
    pub const fn stick_steps(self) -> i16 {
        match self {
            Self::Binary => 660,
            Self::Text => 100,
        }
    }
}

/// What the drone last said of itself. What a protocol does not tell is `None`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DroneStatus {
    /// When the packet arrived.
    pub received_at: TimeNs,
    /// In the air: by the drone's own judgement in the binary protocol; in the text SDK, its motors run,
    /// which shows for 3 s longer.
    pub is_flying: bool,
    /// Standing, likewise.
    pub is_on_ground: bool,
    /// Whether sticks are sent: in the text SDK not before a take-off is over.
    pub takes_sticks: bool,
    /// Charge is low by the drone's own thresholds. Binary only.
    pub is_battery_low: Option<bool>,
    /// Charge. %, 0..=100
    pub battery_pct: u8,
    /// Battery voltage. mV. Binary only.
    pub battery_mv: Option<i16>,
    /// Height. dm; low by an offset that differs from flight to flight
    pub height_dm: Option<i16>,
    /// Velocity by its own sensors: two horizontal axes, whose names and signs differ between reports,
    /// and down. dm/s
    #[serde(default)]
    pub velocity_dm_s: Option<[i16; 3]>,
    /// 1 landed, 6 flying; others are undocumented. Binary only.
    pub flight_mode: Option<u8>,
}

/// What changes the phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Start the motors and climb to about 1 m.
    TakeOff,
    /// Descend and stop the motors.
    Land,
    /// Stop the motors now: the drone falls. Stronger than a landing, which follows if it has no effect.
    Cut,
}
