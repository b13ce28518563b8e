//! The drone as the tick sees it, whatever protocol it speaks.
//!
//! Bytes are none of this: the protocols are in `tello-io`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{SpanNs, TimeNs};

/// Silence of the control thread after which the sender sends neutral sticks in place of the approved
/// ones.
pub const CONTROL_SILENCE_NEUTRAL: SpanNs = SpanNs::from_ms(100);

/// Time for which one witness, motion capture or the drone, has to say without a break that the drone is
/// down where the other says nothing: LAND is repeated meanwhile. Drones were measured to refuse LAND for
/// 9 s. Longer than 15 s is of no use: a drone that hears nothing lands by itself then.
pub const ALONE_HOLD: SpanNs = SpanNs::from_ms(10_000);

/// Height above that on the ground from which a drone does not stand, whatever it says. Heights come in
/// steps of 0.1 m and drift by less in a flight. m
const STANDING_RISE_MAX_M: f64 = 0.4;

/// Whether the drone's own height denies that it stands; `ground_m` is its height before the take-off. A
/// height that is missing, or did not rise, denies nothing.
pub fn denies_standing(height_m: Option<f64>, ground_m: Option<f64>) -> bool {
    let rise_m = height_m.zip(ground_m).map(|(height_m, ground_m)| height_m - ground_m);
    // Heights are whole decimetres: 0.4 m is within.
    rise_m.is_some_and(|rise_m| rise_m > STANDING_RISE_MAX_M + 1e-6)
}

/// The drone reports height and velocity in tenths of our units.
const M_PER_DM: f64 = 0.1;

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

/// The last status of the drone, in the drone's units, as logs have it; the methods convert to SI. `None`: the protocol
/// does not report this.
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

impl DroneStatus {
    /// Its own height over an unknown level. m
    pub fn height_m(&self) -> Option<f64> {
        self.height_dm.map(|height_dm| f64::from(height_dm) * M_PER_DM)
    }

    /// Its velocity: two horizontal axes, whose names and signs differ between reports, and down. m/s
    pub fn velocity_mps(&self) -> Option<[f64; 3]> {
        self.velocity_dm_s.map(|velocity| velocity.map(|tenths| f64::from(tenths) * M_PER_DM))
    }
}

/// What changes the phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DroneOrder {
    /// Start the motors and climb to about 1 m.
    TakeOff,
    /// Descend and stop the motors.
    Land,
    /// Stop the motors now: the drone falls. Stronger than a landing, which follows if it has no effect.
    EmergencyStop,
}
