//! How a status is read from logs, of this revision and of older ones.
//!
//! Owns the drone's own units in older logs: `battery_mv`, `height_dm` and `velocity_dm_s`, whole numbers all. Logs of
//! this revision have SI units and are read as they are. Nothing writes the older keys.

use serde::{Deserialize, Deserializer};

use super::{DroneStatus, M_PER_DM, V_PER_MV};
use crate::time::TimeNs;

/// A [`DroneStatus`] with the keys of any revision.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct StatusRecord {
    received_at: TimeNs,
    is_flying: bool,
    is_on_ground: bool,
    takes_sticks: bool,
    is_battery_low: Option<bool>,
    is_battery_critical: Option<bool>,
    battery_pct: u8,
    battery_v: Option<f64>,
    battery_mv: Option<i16>,
    height_m: Option<f64>,
    height_dm: Option<i16>,
    #[serde(rename = "velocity_mps")]
    velocity_d_mps: Option<[f64; 3]>,
    velocity_dm_s: Option<[i16; 3]>,
    heading_rad: Option<f64>,
    flight_mode: Option<u8>,
}

impl<'de> Deserialize<'de> for DroneStatus {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let record = StatusRecord::deserialize(deserializer)?;
        let of_tenths = |tenths: i16| f64::from(tenths) * M_PER_DM;
        let older_v = record.battery_mv.map(|battery_mv| f64::from(battery_mv) * V_PER_MV);
        let older_mps = record.velocity_dm_s.map(|velocity| velocity.map(of_tenths));
        Ok(Self {
            received_at: record.received_at,
            is_flying: record.is_flying,
            is_on_ground: record.is_on_ground,
            takes_sticks: record.takes_sticks,
            is_battery_low: record.is_battery_low,
            is_battery_critical: record.is_battery_critical,
            battery_pct: record.battery_pct,
            battery_v: record.battery_v.or(older_v),
            height_m: record.height_m.or(record.height_dm.map(of_tenths)),
            velocity_d_mps: record.velocity_d_mps.or(older_mps),
            heading_rad: record.heading_rad,
            flight_mode: record.flight_mode,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_status_of_an_older_log_has_the_values_that_the_flight_had() {
        for step in (i16::MIN..=i16::MAX).step_by(7).chain([-1, 0, 1, i16::MAX]) {
            let text = format!(
                r#"{{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"is_battery_low":null,"battery_pct":80,"battery_mv":{step},"height_dm":{step},"velocity_dm_s":[{step},0,3],"flight_mode":6}}"#
            );
            let status: DroneStatus = serde_json::from_str(&text).unwrap();
            let tenths = f64::from(step) * 0.1;
            assert_eq!(status.battery_v, Some(f64::from(step) * 1e-3));
            assert_eq!(status.height_m, Some(tenths));
            assert_eq!(status.velocity_d_mps, Some([tenths, 0.0, f64::from(3_i16) * 0.1]));
            // Written again in SI, the bits stay.
            let now = serde_json::to_string(&status).unwrap();
            assert!(!now.contains("_mv") && !now.contains("_dm"), "{now}");
            assert_eq!(serde_json::from_str::<DroneStatus>(&now).unwrap(), status);
        }
    }
}
