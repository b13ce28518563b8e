//! A typical vehicle: the motion that the monitors expect of any Tello under its inputs.
//!
//! Owns one first-order model per direction. Estimated parameters do not enter it: the monitors must work as well if
//! the estimate is wrong.

use horizon_model::rows::{Sticks, stick};
use nalgebra::Complex;

use crate::commanded::{commanded_w_mps, excess};
use crate::forgetting::decay;

/// Velocity per input, after the dead zone. m/s
const GAIN_MPS: f64 = 1.9;
/// Lag of the velocity in x and y. s
const LAG_S: f64 = 0.6;
/// Yaw rate per input, after the dead zone. rad/s
pub(super) const YAW_GAIN_RADPS: f64 = 1.4;
/// Lag of the yaw rate. s
pub(super) const YAW_LAG_S: f64 = 0.12;
/// Dead zone of roll, pitch and yaw. 1
pub(super) const DEAD_ZONE: f64 = 0.07;
/// Dead zone of the throttle, across which a controller that holds its height jumps. 1
pub(super) const DEAD_THROTTLE: f64 = 0.12;

/// Commanded velocity along the floor by `u` at the heading `theta_rad`, world frame. m/s
pub(super) fn velocity_w_mps(u: &Sticks, theta_rad: f64) -> Complex<f64> {
    let [x_mps, y_mps] = commanded_w_mps(u, theta_rad, GAIN_MPS, DEAD_ZONE).into();
    Complex::new(x_mps, y_mps)
}

/// Yaw rate that `u` asks for. rad/s
pub(super) fn yaw_rate_radps(u: &Sticks) -> f64 {
    YAW_GAIN_RADPS * excess(u[stick::YAW], DEAD_ZONE)
}

/// Fraction of a deviation of the velocity in x and y that remains after `dt_s`. 1
pub(super) fn lag_decay(dt_s: f64) -> f64 {
    decay(dt_s, LAG_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inputs_act_beyond_their_dead_zone_along_the_heading() {
        let mut u = Sticks::zeros();
        (u[stick::PITCH], u[stick::ROLL], u[stick::YAW]) =
            (DEAD_ZONE + 0.5, -0.9 * DEAD_ZONE, -0.57);
        let along = GAIN_MPS * 0.5 * Complex::from_polar(1.0, 2.0);
        assert!((velocity_w_mps(&u, 2.0) - along).norm() < 1e-12, "{}", velocity_w_mps(&u, 2.0));
        assert!(
            (yaw_rate_radps(&u) + 0.5 * YAW_GAIN_RADPS).abs() < 1e-12,
            "{}",
            yaw_rate_radps(&u)
        );
    }
}
