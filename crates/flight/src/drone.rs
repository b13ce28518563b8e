//! The drone as the tick sees it, whatever protocol it speaks.
//!
//! Owns the record of a status, which keeps the drone's own units in logs. No bytes here: the protocols are in
//! `tello-io`.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::{SpanNs, TimeNs};

/// Silence of the control thread after which the sender sends neutral sticks in place of the approved
/// ones.
pub const CONTROL_SILENCE_NEUTRAL: SpanNs = SpanNs::from_ms(100);

/// LAND, or the emergency stop, is repeated this often: one of fifty datagrams is lost, and a drone that takes off
/// ignores the first ones.
pub const LAND_PERIOD: SpanNs = SpanNs::from_ms(500);

/// Time for which one witness, motion capture or the drone, has to say without a break that the drone is
/// down where the other says nothing: LAND is repeated meanwhile, since a drone may
/// refuse it for seconds. Longer than 15 s is of no use: a drone that hears nothing lands by itself then.
pub const ALONE_HOLD: SpanNs = SpanNs::from_ms(10_000);

/// Height above that on the ground beyond which a drone does not stand, whatever it says. Heights come in
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
pub const M_PER_DM: f64 = 0.1;

/// Metres, or m/s, of a whole number of the drone's tenths.
pub fn from_tenths(tenths: i16) -> f64 {
    f64::from(tenths) * M_PER_DM
}

/// And the voltage of its battery in thousandths.
pub const V_PER_MV: f64 = 1e-3;

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

/// The last status of the drone. `None`: the protocol does not report this.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(from = "StatusRecord", into = "StatusRecord")]
#[schemars(with = "StatusRecord")]
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
    /// Charge is critical by the drone's own thresholds. Binary only.
    pub is_battery_critical: Option<bool>,
    /// Charge. %, 0..=100
    pub battery_pct: u8,
    /// Battery voltage, in steps of 1 mV. V. Binary only.
    pub battery_v: Option<f64>,
    /// Its own height over a level that differs from flight to flight, in steps of 0.1 m. m
    pub height_m: Option<f64>,
    /// Velocity by its own sensors: two horizontal axes, whose names and signs differ between reports,
    /// and down, in steps of 0.1 m/s. m/s
    pub velocity_mps: Option<[f64; 3]>,
    /// Heading by its own sensors, from an unknown direction; counter-clockwise from above if its documents are right. rad
    pub heading_rad: Option<f64>,
    /// 1 landed, 6 flying; others are undocumented. Binary only.
    pub flight_mode: Option<u8>,
}

/// A [`DroneStatus`] in the drone's units, as logs have it.
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct StatusRecord {
    /// When the packet arrived.
    received_at: TimeNs,
    /// In the air: by the drone's own judgement in the binary protocol; in the text SDK, its motors run,
    /// which shows for 3 s longer.
    is_flying: bool,
    /// Standing, likewise.
    is_on_ground: bool,
    /// Whether sticks are sent: in the text SDK not before a take-off is over.
    takes_sticks: bool,
    /// Charge is low by the drone's own thresholds. Binary only.
    is_battery_low: Option<bool>,
    /// Charge is critical by the drone's own thresholds. Binary only; missing in older logs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    is_battery_critical: Option<bool>,
    /// Charge. %, 0..=100
    battery_pct: u8,
    /// Battery voltage. mV. Binary only.
    battery_mv: Option<i16>,
    /// Height. dm; low by an offset that differs from flight to flight
    height_dm: Option<i16>,
    /// Velocity by its own sensors: two horizontal axes, whose names and signs differ between reports,
    /// and down. dm/s
    #[serde(default)]
    velocity_dm_s: Option<[i16; 3]>,
    /// Heading by its own sensors, from an unknown direction; counter-clockwise from above. rad; missing if it
    /// reports none
    #[serde(default, skip_serializing_if = "Option::is_none")]
    heading_rad: Option<f64>,
    /// 1 landed, 6 flying; others are undocumented. Binary only.
    flight_mode: Option<u8>,
}

impl From<StatusRecord> for DroneStatus {
    fn from(record: StatusRecord) -> Self {
        Self {
            received_at: record.received_at,
            is_flying: record.is_flying,
            is_on_ground: record.is_on_ground,
            takes_sticks: record.takes_sticks,
            is_battery_low: record.is_battery_low,
            is_battery_critical: record.is_battery_critical,
            battery_pct: record.battery_pct,
            battery_v: record.battery_mv.map(|battery_mv| f64::from(battery_mv) * V_PER_MV),
            height_m: record.height_dm.map(from_tenths),
            velocity_mps: record.velocity_dm_s.map(|velocity| velocity.map(from_tenths)),
            heading_rad: record.heading_rad,
            flight_mode: record.flight_mode,
        }
    }
}

impl From<DroneStatus> for StatusRecord {
    fn from(status: DroneStatus) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a cast saturates")]
        let steps = |value: f64, step: f64| (value / step).round() as i16;
        let tenths = |value: f64| steps(value, M_PER_DM);
        Self {
            received_at: status.received_at,
            is_flying: status.is_flying,
            is_on_ground: status.is_on_ground,
            takes_sticks: status.takes_sticks,
            is_battery_low: status.is_battery_low,
            is_battery_critical: status.is_battery_critical,
            battery_pct: status.battery_pct,
            battery_mv: status.battery_v.map(|battery_v| steps(battery_v, V_PER_MV)),
            height_dm: status.height_m.map(tenths),
            velocity_dm_s: status.velocity_mps.map(|velocity| velocity.map(tenths)),
            heading_rad: status.heading_rad,
            flight_mode: status.flight_mode,
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_of_any_status_keeps_its_units_and_every_step() {
        for step in (i16::MIN..=i16::MAX).step_by(7).chain([-1, 0, 1, i16::MAX]) {
            let text = format!(
                r#"{{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"is_battery_low":null,"battery_pct":80,"battery_mv":{step},"height_dm":{step},"velocity_dm_s":[{step},0,3],"flight_mode":6}}"#
            );
            let status: DroneStatus = serde_json::from_str(&text).unwrap();
            assert_eq!(status.height_m, Some(f64::from(step) * 0.1));
            assert_eq!(serde_json::to_string(&status).unwrap(), text);
        }
    }

    #[test]
    fn what_a_protocol_does_not_report_stays_away() {
        let text = r#"{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"is_battery_low":null,"battery_pct":80,"battery_mv":null,"height_dm":null,"velocity_dm_s":null,"flight_mode":null}"#;
        let status: DroneStatus = serde_json::from_str(text).unwrap();
        assert_eq!((status.battery_v, status.height_m, status.velocity_mps), (None, None, None));
        assert_eq!(serde_json::to_string(&status).unwrap(), text);
    }
}
