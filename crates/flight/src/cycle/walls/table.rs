//! Settings of the soft constraints that keep a plan away from walls and obstacles.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How the plan keeps away from walls and obstacles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallTable {
    /// Weight of each metre that is missing from the margin, per step, beside `C_s`. 1/m, 1..=10000
    pub weight: f64,
    /// Distance of the planned pose from walls and obstacles. m, 0..=1
    pub margin_m: f64,
    /// Radius of the vehicle, which the plan adds to the margin of obstacles that do not move: their surface is given.
    /// m, 0..=0.5; 0 in older settings and logs
    #[serde(default)]
    pub vehicle_radius_m: f64,
    /// By how much the margin grows over the horizon: the error of the prediction. m/s, 0..=0.5
    pub growth_mps: f64,
    /// Acceleration that the moving obstacle may have: its margin also grows by `1/2 a t^2`, t from its newest position
    /// on. More, up to 1, if it has shown more. m/s^2, 0..=5; 0 in older settings and logs: none
    #[serde(default)]
    pub obstacle_accel_mps2: f64,
    /// Standard deviations of the predicted position, by the estimate's covariance over the committed time, that the
    /// margin grows by. 1, 0..=5; 0 in older settings and logs
    #[serde(default)]
    pub margin_sd: f64,
    /// Fraction of the displacement to rest with neutral sticks, by the identified lags, at whose end the plan keeps
    /// away from walls, too. 1, 0..=1; 0 in older settings and logs
    #[serde(default)]
    pub coasting: f64,
}

impl WallTable {
    /// Refuses values that break their rules.
    ///
    /// # Errors
    /// The first of them.
    pub(super) fn check(&self) -> Result<(), SettingError> {
        in_range("weight", self.weight, 1.0..=10_000.0)?;
        in_range("margin_m", self.margin_m, 0.0..=1.0)?;
        in_range("vehicle_radius_m", self.vehicle_radius_m, 0.0..=0.5)?;
        in_range("growth_mps", self.growth_mps, 0.0..=0.5)?;
        in_range("obstacle_accel_mps2", self.obstacle_accel_mps2, 0.0..=5.0)?;
        in_range("margin_sd", self.margin_sd, 0.0..=5.0)?;
        in_range("coasting", self.coasting, 0.0..=1.0)?;
        Ok(())
    }
}
