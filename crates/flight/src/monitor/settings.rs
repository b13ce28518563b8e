//! Settings of the monitors: as written, and checked.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// From which difference on two sources of the motion contradict each other.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(extend("required" = ["still_m", "displacement_m", "height_m", "direction_rad"]))]
pub struct MonitorTable {
    /// A pose is still if no axis moves by more in 0.8 s (means of 0.2 s), or by 2.5 times it in 2.4 s.
    /// m, 0.0005..=0.01
    pub still_m: f64,
    /// Difference between the displacement by the poses and by the drone's velocity, forgotten within
    /// 15 s, from which on it is in doubt; doubt of 1.5 s in sum, or of 0.3 s while the difference is twice as large
    /// for 0.11 s, ends the flight. `null`: the drone's velocity is not looked at. m, 0.2..=5
    #[serde(deserialize_with = "crate::present")]
    pub displacement_m: Option<f64>,
    /// Difference between the heights by the poses and by the drone, compared as `displacement_m`. m, 0.2..=5
    #[serde(deserialize_with = "crate::present")]
    pub height_m: Option<f64>,
    /// Difference between the turns by the poses and by the drone, forgotten within 15 s, compared likewise; missing:
    /// 0.6; `null`: not compared. rad, 0.2..=1.5
    #[serde(default = "usual_heading_rad")]
    pub heading_rad: Option<f64>,
    /// Angle between the motion and the inputs from which on the heading is wrong. rad, 0.5..=1.5
    pub direction_rad: f64,
}

impl Default for MonitorTable {
    /// The values of `configs/fly.json`, for logs of flights that had no monitors.
    fn default() -> Self {
        Self {
            still_m: 0.0015,
            displacement_m: Some(0.6),
            height_m: Some(0.6),
            heading_rad: usual_heading_rad(),
            direction_rad: 0.785,
        }
    }
}

/// Limit of settings that were written before there was this key. rad
#[expect(clippy::unnecessary_wraps, reason = "the signature that serde calls")]
fn usual_heading_rad() -> Option<f64> {
    Some(0.6)
}

/// Checked [`MonitorTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct MonitorSettings(pub(super) MonitorTable);

impl TryFrom<&MonitorTable> for MonitorSettings {
    type Error = SettingError;

    fn try_from(table: &MonitorTable) -> Result<Self, SettingError> {
        in_range("still_m", table.still_m, 0.0005..=0.01)?;
        for (key, limit_m) in
            [("displacement_m", table.displacement_m), ("height_m", table.height_m)]
        {
            limit_m.map(|limit_m| in_range(key, limit_m, 0.2..=5.0)).transpose()?;
        }
        let check = |limit_rad| in_range("heading_rad", limit_rad, 0.2..=1.5);
        table.heading_rad.map(check).transpose()?;
        in_range("direction_rad", table.direction_rad, 0.5..=1.5)?;
        Ok(Self(table.clone()))
    }
}

#[cfg(test)]
mod tests;
