//! Parameters of the plant and their spread.
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
    /// Time from sending a stick until it acts. s, 0..=2
    pub dead_time_s: f64,
    /// Time constant of the velocity. s, > 0
    pub tau_s: f64,
    /// Stick that does nothing yet. 1, 0..=0.5
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
    /// disturbance velocity. Null: none.
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
    /// show its spread: 10 % either way. The dead time is constant within a flight, since its measured
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
        p.vertical.dead_zone = (p.vertical.dead_zone * random.between(0.9, 1.1)).min(0.5);
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

/// `nominal` with a normal spread, clipped to `lo..=hi`, which is widened to contain `nominal`: a vehicle
/// set outside the range of the fitted ones stays where it was set.
fn spread(random: &mut Random, nominal: f64, sd: f64, (lo, hi): (f64, f64)) -> f64 {
    (nominal + sd * random.normal()).clamp(lo.min(nominal), hi.max(nominal))
}

#[cfg(test)]
mod tests {
    use super::super::tests::still;
    use super::*;
    use crate::random::Purpose;

    #[test]
    fn drawn_vehicles_spread_as_the_flights_do() {
        let nominal = PlantParams::try_from(still()).unwrap();
        let mut random = Random::new(9, Purpose::Vehicle);
        let drawn: Vec<_> = (0..20_000).map(|_| nominal.draw(&mut random).0).collect();
        let moments = |value: &dyn Fn(&PlantTable) -> f64| {
            let mean = drawn.iter().map(value).sum::<f64>() / drawn.len() as f64;
            let square = drawn.iter().map(|p| (value(p) - mean).powi(2)).sum::<f64>();
            (mean, (square / drawn.len() as f64).sqrt())
        };
        for (name, (mean, sd), expected_mean, expected_sd) in [
            ("lambda_h", moments(&|p| p.horizontal.gain), 1.9, 0.15),
            ("theta_0", moments(&|p| p.theta_0), -0.06, 0.04),
            ("dead time", moments(&|p| p.horizontal.dead_time_s), 0.32, 0.02),
            ("tau_h", moments(&|p| p.horizontal.tau_s), 0.64, 0.05),
            ("accel_max", moments(&|p| p.accel_max_mps2), 1.1, 0.08),
            ("lambda_a", moments(&|p| p.yaw.gain), 1.4, 0.1),
        ] {
            // Three standard errors: 3 / sqrt(20 000) of a deviation, 3 / sqrt(40 000) of its estimate.
            let gap = (mean - expected_mean).abs() / expected_sd;
            assert!(gap < 0.022, "{name}: mean {mean}");
            assert!((sd / expected_sd - 1.0).abs() < 0.016, "{name}: deviation {sd}");
        }
        let lambda_h = drawn.iter().map(|p| p.horizontal.gain);
        assert!(lambda_h.clone().all(|gain| (1.3..=2.6).contains(&gain)));
        assert!(drawn.iter().all(|p| PlantParams::try_from(*p).is_ok()));
    }

    #[test]
    fn a_nominal_vehicle_outside_the_fitted_range_stays_there() {
        let mut table = still();
        table.horizontal.gain = 4.0;
        let nominal = PlantParams::try_from(table).unwrap();
        let mut random = Random::new(9, Purpose::Vehicle);
        for _ in 0..1000 {
            let gain = nominal.draw(&mut random).0.horizontal.gain;
            assert!((3.3..=4.0).contains(&gain), "{gain}");
        }
    }

    #[test]
    fn a_plant_with_a_value_outside_of_its_range_is_refused_with_key_value_and_rule() {
        let refusal = |change: &dyn Fn(&mut PlantTable)| {
            let mut table = still();
            change(&mut table);
            PlantParams::try_from(table).unwrap_err().to_string()
        };
        assert_eq!(
            refusal(&|t| t.horizontal.gain = f64::NAN),
            "horizontal.gain = NaN: expected finite and > 0"
        );
        assert_eq!(
            refusal(&|t| t.yaw.dead_time_s = -0.1),
            "yaw.dead_time_s = -0.1: expected 0.0..=2.0"
        );
        assert_eq!(
            refusal(&|t| t.accel_max_mps2 = 0.0),
            "accel_max_mps2 = 0: expected finite and > 0"
        );
    }

    #[test]
    fn every_number_is_checked_at_both_ends_of_its_range() {
        type Change = fn(&mut PlantTable);
        let check = |change: Change| {
            let mut table = NOMINAL;
            change(&mut table);
            PlantParams::try_from(table).map_err(|error| error.key)
        };
        let refused: [(Change, &str); 7] = [
            (|t| t.horizontal.dead_time_s = 2.1, "horizontal.dead_time_s"),
            (|t| t.vertical.tau_s = 0.0, "vertical.tau_s"),
            (|t| t.yaw.dead_zone = 0.51, "yaw.dead_zone"),
            (|t| t.yaw.dead_zone = -0.01, "yaw.dead_zone"),
            (|t| t.theta_0 = f64::INFINITY, "theta_0"),
            (|t| t.disturbance_h_mps = -0.1, "disturbance_h_mps"),
            (|t| t.disturbance_v_mps = f64::NAN, "disturbance_v_mps"),
        ];
        for (change, key) in refused {
            assert_eq!(check(change).unwrap_err(), key);
        }
        assert!(check(|t| t.horizontal.dead_time_s = 2.0).is_ok());
        assert!(check(|t| (t.yaw.dead_zone, t.disturbance_h_mps) = (0.5, 0.0)).is_ok());
    }

    #[test]
    fn a_stick_inside_the_dead_zone_asks_for_nothing_and_signs_are_kept() {
        let axis = AxisTable { gain: 2.0, dead_zone: 0.1, ..NOMINAL.yaw };
        for (u, expected) in [(0.0, 0.0), (0.1, 0.0), (-0.05, 0.0), (0.35, 0.5), (-1.0, -1.8)] {
            assert!((axis.answer(u) - expected).abs() < 1e-15, "{} of {u}", axis.answer(u));
        }
    }

    #[test]
    fn each_stick_has_the_dead_time_of_its_axis() {
        let params = PlantParams::try_from(NOMINAL).unwrap();
        let mut expected_s = [0.32; stick::COUNT];
        (expected_s[stick::YAW], expected_s[stick::THROTTLE]) = (0.04, 0.19);
        assert_eq!(params.dead_times_s().map(f64::to_bits), expected_s.map(f64::to_bits));
    }

    #[test]
    fn the_vertical_axis_spreads_by_a_tenth_and_the_yaw_axis_keeps_its_dead_time() {
        let nominal = PlantParams::try_from(NOMINAL).unwrap();
        let mut random = Random::new(3, Purpose::Vehicle);
        let drawn: Vec<_> = (0..2000).map(|_| nominal.draw(&mut random).0).collect();
        for (name, of) in [
            ("gain", (|axis| axis.gain) as fn(&AxisTable) -> f64),
            ("dead time", |axis| axis.dead_time_s),
            ("tau", |axis| axis.tau_s),
            ("dead zone", |axis| axis.dead_zone),
        ] {
            let ratios = drawn.iter().map(|p| of(&p.vertical) / of(&NOMINAL.vertical));
            let (least, most) = ratios
                .fold((f64::INFINITY, 0.0), |(least, most): (f64, f64), ratio| {
                    (least.min(ratio), most.max(ratio))
                });
            // Of 2000 uniform draws the outermost are within 1 % of the ends.
            assert!(
                (0.9..0.902).contains(&least) && (1.098..1.1).contains(&most),
                "{name}: {least}, {most}"
            );
        }
        assert!(drawn.iter().all(|p| p.yaw.dead_time_s.to_bits() == 0.04_f64.to_bits()));
    }
}
