//! What differs between vehicles and between flights.
//!
//! Owns the plant's numbers, their validity and their spread over flights. The equations are one file
//! up.

use horizon_model::DEAD_TIME_MAX_S;
use horizon_model::rows::stick;
use horizon_model::setting::{SettingError, finite, in_range, not_negative, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::RigidBodyTable;
use crate::random::Random;

/// One control axis of the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AxisTable {
    /// Velocity per stick excess over the dead zone. m/s (yaw: rad/s), > 0.
    pub gain: f64,
    /// Time from sending a stick until it acts. s, 0..=2.
    pub dead_time_s: f64,
    /// Time constant of the velocity. s, > 0
    pub tau_s: f64,
    /// Stick that does nothing yet. 1, 0..=0.5.
    pub dead_zone: f64,
}

/// Nominal vehicle of the simulator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlantTable {
    /// Roll and pitch.
    pub horizontal: AxisTable,
    /// Throttle.
    pub vertical: AxisTable,
    /// Yaw.
    pub yaw: AxisTable,
    /// Direction of flight minus measured yaw. rad
    pub theta_0: f64,
    /// Largest horizontal acceleration. m/s^2, > 0
    pub accel_max_mps2: f64,
    /// Standard deviation of the horizontal disturbance velocity, per axis. m/s, >= 0
    pub disturbance_h_mps: f64,
    /// Standard deviation of the vertical disturbance velocity. m/s, >= 0
    pub disturbance_v_mps: f64,
    /// A rigid body with attitude and velocity loops in place of the first-order lags and of the
    /// disturbance velocity. Missing: none.
    #[serde(default)]
    pub rigid_body: Option<RigidBodyTable>,
}

/// The vehicle of the thesis' flights, fitted to their recordings.
pub const NOMINAL: PlantTable = PlantTable {
    horizontal: AxisTable { gain: 1.9, dead_time_s: 0.32, tau_s: 0.64, dead_zone: 0.07 },
    vertical: AxisTable { gain: 0.89, dead_time_s: 0.19, tau_s: 0.25, dead_zone: 0.12 },
    yaw: AxisTable { gain: 1.4, dead_time_s: 0.04, tau_s: 0.12, dead_zone: 0.08 },
    theta_0: -0.06,
    accel_max_mps2: 1.1,
    disturbance_h_mps: 0.05,
    disturbance_v_mps: 0.02,
    rigid_body: None,
};

/// Checked numbers of one vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlantParams(pub(super) PlantTable);

impl AxisTable {
    /// Velocity that a constant stick leads to. m/s or rad/s.
    pub(super) fn answer(&self, u: f64) -> f64 {
        self.gain * (u.abs() - self.dead_zone).max(0.0).copysign(u)
    }

    fn check(&self) -> Result<(), SettingError> {
        positive("gain", self.gain)?;
        in_range("dead_time_s", self.dead_time_s, 0.0..=DEAD_TIME_MAX_S)?;
        positive("tau_s", self.tau_s)?;
        in_range("dead_zone", self.dead_zone, 0.0..=0.5)?;
        Ok(())
    }
}

impl TryFrom<PlantTable> for PlantParams {
    type Error = SettingError;

    fn try_from(table: PlantTable) -> Result<Self, SettingError> {
        table.horizontal.check().map_err(|error| error.under("horizontal"))?;
        table.vertical.check().map_err(|error| error.under("vertical"))?;
        table.yaw.check().map_err(|error| error.under("yaw"))?;
        finite("theta_0", table.theta_0)?;
        positive("accel_max_mps2", table.accel_max_mps2)?;
        not_negative("disturbance_h_mps", table.disturbance_h_mps)?;
        not_negative("disturbance_v_mps", table.disturbance_v_mps)?;
        if let Some(body) = &table.rigid_body {
            body.check().map_err(|error| error.under("rigid_body"))?;
        }
        Ok(Self(table))
    }
}

impl PlantParams {
    /// The vehicle of one flight: these parameters with their spread over flights.
    ///
    /// Normal and clipped as fitted to 23 flights. The vertical axis is too weakly excited in them to
    /// tell its spread: 10 % either way. The dead time is constant within a flight, since its measured
    /// jitter is below what the estimate can resolve.
    #[must_use]
    pub fn draw(&self, random: &mut Random) -> Self {
        let Self(nominal) = *self;
        let mut p = nominal;
        p.horizontal.gain = spread(random, nominal.horizontal.gain, 0.15, (1.3, 2.6));
        p.theta_0 = spread(random, nominal.theta_0, 0.04, (f64::NEG_INFINITY, f64::INFINITY));
        p.horizontal.dead_time_s =
            spread(random, nominal.horizontal.dead_time_s, 0.02, (0.2, DEAD_TIME_MAX_S));
        p.horizontal.tau_s = spread(random, nominal.horizontal.tau_s, 0.05, (0.45, 0.85));
        p.horizontal.dead_zone = spread(random, nominal.horizontal.dead_zone, 0.01, (0.0, 0.5));
        // No range is published for these two; half and twice the nominal value keep them physical.
        let accel_range = (0.5 * nominal.accel_max_mps2, 2.0 * nominal.accel_max_mps2);
        p.accel_max_mps2 = spread(random, nominal.accel_max_mps2, 0.08, accel_range);
        let yaw_range = (0.5 * nominal.yaw.gain, 2.0 * nominal.yaw.gain);
        p.yaw.gain = spread(random, nominal.yaw.gain, 0.1, yaw_range);
        p.vertical.gain *= random.between(0.9, 1.1);
        p.vertical.dead_time_s =
            (p.vertical.dead_time_s * random.between(0.9, 1.1)).min(DEAD_TIME_MAX_S);
        p.vertical.tau_s *= random.between(0.9, 1.1);
        p.vertical.dead_zone *= random.between(0.9, 1.1);
        Self(p)
    }

    /// The checked numbers, in the units of [`PlantTable`].
    pub fn table(&self) -> &PlantTable {
        &self.0
    }

    /// Dead time of each stick. s
    pub(super) fn dead_times_s(&self) -> [f64; stick::COUNT] {
        let mut dead_times_s = [0.0; stick::COUNT];
        dead_times_s[stick::ROLL] = self.0.horizontal.dead_time_s;
        dead_times_s[stick::PITCH] = self.0.horizontal.dead_time_s;
        dead_times_s[stick::YAW] = self.0.yaw.dead_time_s;
        dead_times_s[stick::THROTTLE] = self.0.vertical.dead_time_s;
        dead_times_s
    }
}

/// `nominal` with a normal spread, clipped to `range`, which is widened to contain `nominal`: a vehicle
/// set outside the range of the fitted ones stays where it was set.
fn spread(random: &mut Random, nominal: f64, sd: f64, (lo, hi): (f64, f64)) -> f64 {
    (nominal + sd * random.normal()).clamp(lo.min(nominal), hi.max(nominal))
}
