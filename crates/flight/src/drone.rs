//! The drone as the tick sees it, whatever protocol it speaks.
//!
//! Owns the status of the drone, in SI units as logs have it; how it is read from logs is `older_log.rs`, the times
//! on which its users agree are `timing.rs`. No bytes here: the protocols are in `tello-io`. The factors of the drone's
//! own units stand here because older logs have them, too.

mod older_log;
mod timing;

use std::fmt;
use std::str::FromStr;

use schemars::JsonSchema;
use serde::de::{self, IntoDeserializer};
use serde::{Deserialize, Serialize};

pub use self::timing::{
    ALONE_HOLD, CONTROL_SILENCE_NEUTRAL, LAND_PERIOD, MOTORS_REST, STATUS_FRESH, TAKE_OFF_TAIL,
    TAKE_OFF_UNSEEN,
};

use crate::time::TimeNs;

/// Volts of a millivolt, in which the binary protocol and older logs have the battery. V/mV
pub const V_PER_MV: f64 = 1e-3;

/// Metres, or m/s, of a tenth, in which the protocols and older logs have height and velocity. m/dm
pub const M_PER_DM: f64 = 0.1;

/// Height above that on the ground beyond which a drone does not stand, whatever it reports. Heights come in
/// steps of 0.1 m and drift by less in a flight. m
const STANDING_RISE_MAX_M: f64 = 0.4;

/// Whether the drone's own height contradicts that it stands; `ground_m` is its height before the take-off. A
/// height that is missing, or did not rise, contradicts nothing.
pub fn denies_standing(height_m: Option<f64>, ground_m: Option<f64>) -> bool {
    let rise_m = height_m.zip(ground_m).map(|(height_m, ground_m)| height_m - ground_m);
    // Heights are whole decimetres: 0.4 m is within.
    rise_m.is_some_and(|rise_m| rise_m > STANDING_RISE_MAX_M + 1e-6)
}

/// How we talk to the drone. It takes the first that it receives and no other until it is switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Protocol {
    /// Protocol of the vendor's app: sticks of 660 steps, and a status that reports whether it flies.
    Binary,
    /// The documented SDK: sticks of 100 steps, and a state line that does not report it.
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

    /// Whether the drone reports its state at a port of its own.
    pub const fn has_state_port(self) -> bool {
        match self {
            Self::Binary => false,
            Self::Text => true,
        }
    }
}

/// Its name in settings.
impl fmt::Display for Protocol {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.serialize(f)
    }
}

impl FromStr for Protocol {
    type Err = de::value::Error;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::deserialize(name.into_deserializer())
    }
}

/// The last status of the drone. `None`: the protocol does not report this.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, JsonSchema)]
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
    /// Charge is critical by the drone's own thresholds. Binary only; missing in older logs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub is_battery_critical: Option<bool>,
    /// Charge. %, 0..=100
    pub battery_pct: u8,
    /// Battery voltage, in steps of 1 mV. V. Binary only.
    pub battery_v: Option<f64>,
    /// Height by its own sensors over a level that differs from flight to flight, in steps of 0.1 m. m
    pub height_m: Option<f64>,
    /// Velocity by its own sensors: two horizontal axes, whose names and signs differ between reports,
    /// and down, in steps of 0.1 m/s. m/s
    #[serde(rename = "velocity_mps")]
    pub velocity_d_mps: Option<[f64; 3]>,
    /// Heading by its own sensors, from an unknown direction; counter-clockwise from above if its documents are right;
    /// missing in logs if it reports none. rad
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub heading_rad: Option<f64>,
    /// 1 landed, 6 flying; others are undocumented. Binary only.
    pub flight_mode: Option<u8>,
}

/// Order that changes the phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DroneOrder {
    /// Start the motors and climb to about 1 m.
    TakeOff,
    /// Descend and stop the motors.
    Land,
    /// Stop the motors now: the drone falls. Stronger than a landing, which follows if it has no effect.
    EmergencyStop,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_log_has_a_status_in_si_to_the_last_bit() {
        let status = DroneStatus {
            received_at: TimeNs(5),
            is_flying: true,
            is_on_ground: false,
            takes_sticks: true,
            is_battery_low: None,
            is_battery_critical: Some(false),
            battery_pct: 80,
            battery_v: Some(3.95),
            height_m: Some(f64::from(3_i16) * 0.1),
            velocity_d_mps: Some([-0.7, 1e-9, 0.0]),
            heading_rad: Some(0.1),
            flight_mode: Some(6),
        };
        let text = serde_json::to_string(&status).unwrap();
        assert_eq!(
            text,
            r#"{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"is_battery_low":null,"is_battery_critical":false,"battery_pct":80,"battery_v":3.95,"height_m":0.30000000000000004,"velocity_mps":[-0.7,1e-9,0.0],"heading_rad":0.1,"flight_mode":6}"#
        );
        assert_eq!(serde_json::from_str::<DroneStatus>(&text).unwrap(), status);
    }

    #[test]
    fn what_a_protocol_does_not_report_stays_away() {
        let text = r#"{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"is_battery_low":null,"battery_pct":80,"battery_v":null,"height_m":null,"velocity_mps":null,"flight_mode":null}"#;
        let status: DroneStatus = serde_json::from_str(text).unwrap();
        assert_eq!((status.battery_v, status.height_m, status.velocity_d_mps), (None, None, None));
        assert_eq!(serde_json::to_string(&status).unwrap(), text);
    }

    #[test]
    fn a_key_that_is_not_known_is_refused() {
        let text = r#"{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"battery_pct":80,"height_cm":3}"#;
        let error = serde_json::from_str::<DroneStatus>(text).unwrap_err().to_string();
        assert!(error.contains("height_cm"), "{error}");
    }
}
