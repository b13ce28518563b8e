//! Settings of the supervisor: as written, and checked.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::geofence::{Room, RoomTable};

/// Longest age of a pose to steer by: a vehicle at 2 m/s flies 2 m in it. s
const STALE_MAX_S: f64 = 1.0;
/// Longest wait for a pose before the landing, with neutral sticks. s
const LOST_MAX_S: f64 = 5.0;
/// Highest rise to wait for: a Tello that takes off climbs to 0.8 to 1 m by itself. m
const AIRBORNE_MAX_M: f64 = 0.7;

/// When the supervisor reacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("required" = [
    "stale_s", "lost_s", "jump_m", "jump_rad", "room", "drone_silent_s", "battery_low_pct",
    "battery_critical_pct", "take_off_timeout_s", "airborne_height_m", "settle_s",
    "landing_timeout_s", "solver_failures_max", "late_periods_max", "finish_hold_s", "failsafe",
]))]
pub struct SupervisorTable {
    /// Neutral sticks when the newest accepted position or heading is older. s, 0.05..=1
    pub stale_s: f64,
    /// Landing when no position, or no heading, was accepted for longer. s, `stale_s`..=5
    pub lost_s: f64,
    /// Landing when a pose is accepted that is so much further away than 2 m/s since the pose before
    /// allow. m, 0.1..=5
    pub jump_m: f64,
    /// A heading that differs by more from the estimated one is rejected. rad, 0.3..=3.15
    pub jump_rad: f64,
    /// Where the vehicle may be; null: anywhere.
    #[serde(deserialize_with = "crate::present")]
    pub room: Option<RoomTable>,
    /// Landing when the drone has not reported for longer. s, 0.2..=10
    pub drone_silent_s: f64,
    /// No take-off with less battery. %, 0..=100
    pub battery_low_pct: u8,
    /// Landing with less battery. %, 0..=`battery_low_pct`
    pub battery_critical_pct: u8,
    /// Landing when the take-off is not confirmed after this time. s, 1..=60
    pub take_off_timeout_s: f64,
    /// Rise above the take-off height that counts as airborne. m, 0.1..=0.7
    pub airborne_height_m: f64,
    /// Hover after the take-off before control starts. s, 0..=30
    pub settle_s: f64,
    /// Time after which a landing that is not confirmed is a fault. s, 1..=120
    pub landing_timeout_s: f64,
    /// Failed solves until landing; a tick without a failure subtracts half. ticks, 0..=1000
    pub solver_failures_max: u32,
    /// Periods without a tick that are tolerated at once, one more means landing; a tenth of a period
    /// is subtracted at each tick. periods, 0..=1000
    pub late_periods_max: u32,
    /// Hover at the last target before landing. s, 0..=3600
    pub finish_hold_s: f64,
    /// Height above the ground to which the controller brings the vehicle down before it lands with neutral sticks;
    /// null or missing: the vehicle lands from any height. m, 0.3..=2
    #[serde(default)]
    pub land_from_m: Option<f64>,
    /// Limits of a flight that goes on without a fault of a part.
    #[serde(default)]
    pub failsafe: FailsafeTable,
}

/// When a flight ends although every part does its work.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FailsafeTable {
    /// Landing when for 0.3 s the vehicle has been further from its reference than this and the least distance since
    /// the reference was chosen. m, 0.3..=5
    pub tracking_m: f64,
    /// Landing when the vehicle has been faster by its estimate for 0.3 s. m/s, 0.5..=10
    pub speed_mps: f64,
    /// Landing when a mission takes so much longer than twice its planned time. s, 5..=3600
    pub overtime_s: f64,
    /// Landing when a command outage lasts longer. s, 1..=60
    pub outage_s: f64,
    /// Landing when a command outage lasts longer during which nothing confirms it. s, 1..=`outage_s`
    pub outage_alone_s: f64,
    /// Landing when inputs in one direction, in seconds of full deflection with a forgetting time of 4 s, have not
    /// moved the vehicle 0.4 m. Those in outages do not count. Null or missing: never. s, 0.5..=4
    #[serde(default)]
    pub pressed_s: Option<f64>,
    /// Landing when the sticks that a person holds have been neutral for longer; null or missing: never.
    /// s, 10..=3600
    #[serde(default)]
    pub person_gone_s: Option<f64>,
}

impl Default for FailsafeTable {
    /// The values of `configs/fly.json`, for logs of flights that had no such limits; of later ones none.
    fn default() -> Self {
        Self {
            tracking_m: 1.2,
            speed_mps: 3.0,
            overtime_s: 30.0,
            outage_s: 20.0,
            outage_alone_s: 6.0,
            pressed_s: None,
            person_gone_s: None,
        }
    }
}

impl FailsafeTable {
    fn check(&self) -> Result<(), SettingError> {
        in_range("tracking_m", self.tracking_m, 0.3..=5.0)?;
        in_range("speed_mps", self.speed_mps, 0.5..=10.0)?;
        in_range("overtime_s", self.overtime_s, 5.0..=3600.0)?;
        in_range("outage_s", self.outage_s, 1.0..=60.0)?;
        in_range("outage_alone_s", self.outage_alone_s, 1.0..=self.outage_s)?;
        if let Some(pressed_s) = self.pressed_s {
            in_range("pressed_s", pressed_s, 0.5..=4.0)?;
        }
        if let Some(gone_s) = self.person_gone_s {
            in_range("person_gone_s", gone_s, 10.0..=3600.0)?;
        }
        Ok(())
    }
}

/// Checked form of [`SupervisorTable`]: the same values, within their rules.
#[derive(Debug, Clone, PartialEq)]
pub struct SupervisorSettings {
    pub(super) table: SupervisorTable,
    pub(super) room: Option<Room>,
}

impl TryFrom<&SupervisorTable> for SupervisorSettings {
    type Error = SettingError;

    fn try_from(table: &SupervisorTable) -> Result<Self, SettingError> {
        in_range("stale_s", table.stale_s, 0.05..=STALE_MAX_S)?;
        in_range("lost_s", table.lost_s, 0.05..=LOST_MAX_S)?;
        if table.lost_s < table.stale_s {
            let rule = format!("at least stale_s = {}", table.stale_s);
            return Err(SettingError::new("lost_s", table.lost_s, rule));
        }
        in_range("jump_m", table.jump_m, 0.1..=5.0)?;
        in_range("jump_rad", table.jump_rad, 0.3..=3.15)?;
        let room = table.room.as_ref().map(Room::try_from).transpose();
        let room = room.map_err(|error| error.under("room"))?;
        in_range("drone_silent_s", table.drone_silent_s, 0.2..=10.0)?;
        in_range("battery_low_pct", table.battery_low_pct, 0..=100)?;
        if table.battery_critical_pct > table.battery_low_pct {
            let rule = format!("at most battery_low_pct = {}", table.battery_low_pct);
            return Err(SettingError::new(
                "battery_critical_pct",
                table.battery_critical_pct,
                rule,
            ));
        }
        in_range("take_off_timeout_s", table.take_off_timeout_s, 1.0..=60.0)?;
        in_range("airborne_height_m", table.airborne_height_m, 0.1..=AIRBORNE_MAX_M)?;
        in_range("settle_s", table.settle_s, 0.0..=30.0)?;
        in_range("landing_timeout_s", table.landing_timeout_s, 1.0..=120.0)?;
        in_range("solver_failures_max", table.solver_failures_max, 0..=1000)?;
        in_range("late_periods_max", table.late_periods_max, 0..=1000)?;
        in_range("finish_hold_s", table.finish_hold_s, 0.0..=3600.0)?;
        if let Some(land_from_m) = table.land_from_m {
            in_range("land_from_m", land_from_m, 0.3..=2.0)?;
        }
        table.failsafe.check().map_err(|error| error.under("failsafe"))?;
        Ok(Self { table: table.clone(), room })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{
        "stale_s": 0.25, "lost_s": 1.0, "jump_m": 1.5, "jump_rad": 2.0, "room": null,
        "drone_silent_s": 2.0,
        "battery_low_pct": 30, "battery_critical_pct": 10,
        "take_off_timeout_s": 8.0, "airborne_height_m": 0.5, "settle_s": 1.5,
        "landing_timeout_s": 10.0, "solver_failures_max": 3, "late_periods_max": 25,
        "finish_hold_s": 2.0
    }"#;

    fn check(text: &str) -> Result<SupervisorSettings, String> {
        let table: SupervisorTable = serde_json::from_str(text).map_err(|e| e.to_string())?;
        SupervisorSettings::try_from(&table).map_err(|e| e.to_string())
    }

    #[test]
    fn a_good_table_is_taken_as_it_is_and_limits_may_touch() {
        let table: SupervisorTable = serde_json::from_str(GOOD).unwrap();
        assert_eq!(check(GOOD).unwrap().table, table);
        let written = serde_json::to_string(&table).unwrap();
        assert_eq!(serde_json::from_str::<SupervisorTable>(&written).unwrap(), table);
        for touching in [
            GOOD.replace("\"lost_s\": 1.0", "\"lost_s\": 0.25"),
            GOOD.replace("\"battery_critical_pct\": 10", "\"battery_critical_pct\": 30"),
            GOOD.replace("\"settle_s\": 1.5", "\"settle_s\": 0"),
            GOOD.replace("\"finish_hold_s\": 2.0", "\"finish_hold_s\": 0"),
            GOOD.replace("\"solver_failures_max\": 3", "\"solver_failures_max\": 0"),
        ] {
            check(&touching).unwrap();
        }
    }

    #[test]
    fn each_bad_value_is_refused_with_key_value_and_rule() {
        for (key, good, bad, rule) in [
            ("stale_s", "0.25", "0", "0.05..=1.0"),
            ("stale_s", "0.25", "1.1", "0.05..=1.0"),
            ("lost_s", "1.0", "0", "0.05..=5.0"),
            ("lost_s", "1.0", "5.5", "0.05..=5.0"),
            ("lost_s", "1.0", "0.2", "at least stale_s = 0.25"),
            ("jump_m", "1.5", "0", "0.1..=5.0"),
            ("jump_rad", "2.0", "-1", "0.3..=3.15"),
            ("drone_silent_s", "2.0", "-1", "0.2..=10.0"),
            ("battery_low_pct", "30", "101", "0..=100"),
            ("battery_critical_pct", "10", "31", "at most battery_low_pct = 30"),
            ("take_off_timeout_s", "8.0", "0", "1.0..=60.0"),
            ("take_off_timeout_s", "8.0", "1000000000", "1.0..=60.0"),
            ("airborne_height_m", "0.5", "0", "0.1..=0.7"),
            ("airborne_height_m", "0.5", "0.8", "0.1..=0.7"),
            ("settle_s", "1.5", "-0.5", "0.0..=30.0"),
            ("settle_s", "1.5", "31", "0.0..=30.0"),
            ("landing_timeout_s", "10.0", "0", "1.0..=120.0"),
            ("landing_timeout_s", "10.0", "1000000000", "1.0..=120.0"),
            ("solver_failures_max", "3", "1001", "0..=1000"),
            ("late_periods_max", "25", "1001", "0..=1000"),
            ("finish_hold_s", "2.0", "-0.5", "0.0..=3600.0"),
        ] {
            let (old, new) = (format!("\"{key}\": {good}"), format!("\"{key}\": {bad}"));
            let text = GOOD.replacen(&old, &new, 1);
            assert_ne!(text, GOOD, "{old} is not in the table");
            assert_eq!(check(&text).unwrap_err(), format!("{key} = {bad}: expected {rule}"));
        }
    }

    #[test]
    fn failsafe_limits_are_checked_under_their_section() {
        let refused = |failsafe: FailsafeTable| {
            let mut table: SupervisorTable = serde_json::from_str(GOOD).unwrap();
            table.failsafe = failsafe;
            SupervisorSettings::try_from(&table).unwrap_err().to_string()
        };
        let good = FailsafeTable::default();
        for (failsafe, message) in [
            (
                FailsafeTable { tracking_m: 1e9, ..good.clone() },
                "failsafe.tracking_m = 1000000000: expected 0.3..=5.0",
            ),
            (
                FailsafeTable { speed_mps: f64::NAN, ..good.clone() },
                "failsafe.speed_mps = NaN: expected 0.5..=10.0",
            ),
            (
                FailsafeTable { overtime_s: 0.0, ..good.clone() },
                "failsafe.overtime_s = 0: expected 5.0..=3600.0",
            ),
            (
                FailsafeTable { outage_s: 61.0, ..good.clone() },
                "failsafe.outage_s = 61: expected 1.0..=60.0",
            ),
            (
                FailsafeTable { outage_alone_s: 20.5, ..good.clone() },
                "failsafe.outage_alone_s = 20.5: expected 1.0..=20.0",
            ),
            (
                FailsafeTable { pressed_s: Some(0.4), ..good.clone() },
                "failsafe.pressed_s = 0.4: expected 0.5..=4.0",
            ),
            (
                FailsafeTable { person_gone_s: Some(5.0), ..good },
                "failsafe.person_gone_s = 5: expected 10.0..=3600.0",
            ),
        ] {
            assert_eq!(refused(failsafe), message);
        }
    }

    #[test]
    fn unknown_and_missing_keys_are_refused() {
        let unknown = GOOD.replacen("\"stale_s\"", "\"colour\": 1, \"stale_s\"", 1);
        assert!(check(&unknown).unwrap_err().starts_with("unknown field `colour`"));
        let missing = GOOD.replacen("\"stale_s\": 0.25,", "", 1);
        assert!(check(&missing).unwrap_err().starts_with("missing field `stale_s`"));
    }
}
