//! A mission flown slower or faster than it is written: from a fifth of the pace to the limit of the vehicle.
//!
//! Owns what a vehicle is asked for at its limit. The numbers are fractions of its identified parameters.

use horizon_model::rows::lag;
use horizon_model::setting::{SettingError, in_range};

use super::table::{CircleTable, LimitTable, MissionTable, SplineTable, WaypointTable};
use crate::cycle::{FlightTable, ModelKind};

/// The speed at which a mission is flown as it is written. 1
pub const SPEED_AS_WRITTEN: f64 = 0.5;

/// Fraction of the acceleration limit used on straight sides and in their corners; the rest is for corrections. 1
const ACCEL_FRACTION: f64 = 0.946;

/// Fraction of the acceleration limit used on curves, where it is needed all the time. 1
const CURVE_FRACTION: f64 = 0.654;

/// Acceleration where the speed rises over the acceleration limit. A vehicle that cannot keep up there is late, but
/// not off the path. 1
const SPEED_UP_RATIO: f64 = 3.0;

/// Distance of the path from an inner waypoint over the reach; the rest is for the vehicle's error. 1
const CORNER_FRACTION: f64 = 0.6;

/// Where a reference slows down and stands for a vehicle that is late: early, since it may be late because it
/// is weaker than its parameters, and has yet to brake for the corner. m
const WAIT_BEGIN_M: f64 = 0.03;
const WAIT_STOP_M: f64 = 0.3;

/// On a curve: how far beside it the reference slows down and stands. A vehicle that is weaker than its parameters
/// is carried out of a curve; the slower reference asks for less.
const ASIDE_M: [f64; 2] = [0.05, 0.25];

/// Largest speed and acceleration of a vehicle, by its identified parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Fastest {
    speed_mps: f64,
    accel_mps2: f64,
}

impl FlightTable {
    /// The flight with its mission at `speed`: at 0.5 as it is written; below, speeds in proportion and
    /// accelerations by the square of it, the same curves in a longer time; above, limits, corners and the lag at which
    /// the reference waits on the straight line to those of the vehicle, which 1 has.
    ///
    /// # Errors
    /// A speed outside of 0.1..=1, constant targets or a timed trajectory, which have no limits, or a vehicle
    /// model without a limit of the acceleration.
    pub fn at_speed(mut self, speed: f64) -> Result<Self, SettingError> {
        in_range("speed", speed, 0.1..=1.0)?;
        let fastest = self.fastest(speed)?;
        let pace = (speed / SPEED_AS_WRITTEN).min(1.0);
        let rise = ((speed - SPEED_AS_WRITTEN) / (1.0 - SPEED_AS_WRITTEN)).max(0.0);
        let toward = |written: f64, most: f64| written + rise * (most - written);
        let (limits, wait, fraction) = match &mut self.mission {
            MissionTable::Waypoints(WaypointTable { corner_m, follow, limits, .. }) => {
                *corner_m = toward(*corner_m, CORNER_FRACTION * follow.reach);
                (limits, &mut follow.wait, ACCEL_FRACTION)
            }
            MissionTable::Spline(SplineTable { limits, follow, .. })
            | MissionTable::Circle(CircleTable { limits, follow, .. }) => {
                if rise > 0.0 {
                    follow.wait.aside_m.get_or_insert(ASIDE_M);
                }
                (limits, &mut follow.wait, CURVE_FRACTION)
            }
            MissionTable::Targets(_) | MissionTable::Trajectory(_) => {
                let rule = "0.5 for targets and timed trajectories, which have no limits to change";
                return if fastest.is_none() && speed >= SPEED_AS_WRITTEN {
                    Ok(self)
                } else {
                    Err(SettingError::new("speed", speed, rule))
                };
            }
        };
        let LimitTable { speed_max_mps, accel_max_mps2, speed_up_max_mps2, .. } = limits;
        if let Some(fastest) = fastest {
            let speed_up_mps2 = speed_up_max_mps2.unwrap_or(*accel_max_mps2);
            *speed_up_max_mps2 = Some(toward(speed_up_mps2, SPEED_UP_RATIO * fastest.accel_mps2));
            *speed_max_mps = toward(*speed_max_mps, fastest.speed_mps);
            *accel_max_mps2 = toward(*accel_max_mps2, fraction * fastest.accel_mps2);
            wait.begin_m = toward(wait.begin_m, WAIT_BEGIN_M);
            wait.stop_m = toward(wait.stop_m, WAIT_STOP_M);
        }
        *accel_max_mps2 *= pace * pace;
        *speed_up_max_mps2 = speed_up_max_mps2.map(|accel_mps2| accel_mps2 * pace * pace);
        for limit in [speed_max_mps, &mut limits.climb_max_mps, &mut limits.turn_max_radps] {
            *limit *= pace;
        }
        Ok(self)
    }

    /// Limits of the identified vehicle; `None` where `speed` does not ask for them.
    fn fastest(&self, speed: f64) -> Result<Option<Fastest>, SettingError> {
        if speed <= SPEED_AS_WRITTEN {
            return Ok(None);
        }
        let row = |row: usize| self.cycle.mhe.p_prior.get(row).copied();
        let rows = row(lag::A_MAX).zip(row(lag::LAMBDA_H)).zip(row(lag::DEAD_H));
        let (ModelKind::Lagged, Some(((accel_mps2, gain), dead))) = (self.cycle.model, rows) else {
            let rule = "at most 0.5 for a model without a limit of the acceleration";
            return Err(SettingError::new("speed", speed, rule));
        };
        Ok(Some(Fastest { speed_mps: gain * (1.0 - dead), accel_mps2 }))
    }
}

#[cfg(test)]
mod tests;
