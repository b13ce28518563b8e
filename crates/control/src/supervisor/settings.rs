//! Settings of the supervisor: as written, and checked.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_model::setting::{SettingError, in_range, not_negative, positive};

/// When the supervisor reacts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SupervisorTable {
    /// Neutral sticks when the newest accepted position is older. s, > 0
    pub stale_s: f64,
    /// Landing when no position was accepted for longer. s, >= `stale_s`
    pub lost_s: f64,
    /// Landing when the drone has not reported for longer. s, > 0
    pub drone_silent_s: f64,
    /// No take-off with less battery. %, 0..=100
    pub battery_low_pct: u8,
    /// Landing with less battery. %, 0..=`battery_low_pct`
    pub battery_critical_pct: u8,
    /// Landing when the take-off is not confirmed after this time. s, > 0
    pub take_off_timeout_s: f64,
    /// Rise above the take-off height that counts as airborne. m, > 0
    pub airborne_height_m: f64,
    /// Hover after the take-off before control starts. s, >= 0
    pub settle_s: f64,
    /// Time after which a landing that is not confirmed is a fault. s, > 0
    pub landing_timeout_s: f64,
    /// Ticks in a row in which estimator or controller may fail; one more means landing.
    /// ticks, 0..=1000
    pub solver_failures_max: u32,
    /// Hover at the last target before landing. s, >= 0
    pub finish_hold_s: f64,
}

/// Checked form of [`SupervisorTable`]: the same values, within their rules.
#[derive(Debug, Clone, PartialEq)]
pub struct SupervisorSettings {
    pub(super) table: SupervisorTable,
}

impl TryFrom<&SupervisorTable> for SupervisorSettings {
    type Error = SettingError;

    fn try_from(table: &SupervisorTable) -> Result<Self, SettingError> {
        positive("stale_s", table.stale_s)?;
        positive("lost_s", table.lost_s)?;
        if table.lost_s < table.stale_s {
            let rule = format!("at least stale_s = {}", table.stale_s);
            return Err(SettingError::new("lost_s", table.lost_s, rule));
        }
        positive("drone_silent_s", table.drone_silent_s)?;
        in_range("battery_low_pct", table.battery_low_pct, 0..=100)?;
        in_range("battery_critical_pct", table.battery_critical_pct, 0..=table.battery_low_pct)?;
        positive("take_off_timeout_s", table.take_off_timeout_s)?;
        positive("airborne_height_m", table.airborne_height_m)?;
        not_negative("settle_s", table.settle_s)?;
        positive("landing_timeout_s", table.landing_timeout_s)?;
        in_range("solver_failures_max", table.solver_failures_max, 0..=1000)?;
        not_negative("finish_hold_s", table.finish_hold_s)?;
        Ok(Self { table: table.clone() })
    }
}
