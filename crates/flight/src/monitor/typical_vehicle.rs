//! A typical vehicle: what the monitors expect of any Tello.
//!
//! Owns one first-order model per direction. Learnt parameters do not enter it: the monitors must judge as well when these
//! are wrong.

/// Velocity per input, after the dead zone. m/s
pub(super) const GAIN_MPS: f64 = 1.9;
/// Lag of the velocity in x and y. s
pub(super) const LAG_S: f64 = 0.6;
/// Yaw rate per input, after the dead zone. rad/s
pub(super) const YAW_GAIN_RADPS: f64 = 1.4;
/// Lag of the yaw rate. s
pub(super) const YAW_LAG_S: f64 = 0.12;
/// Dead zone of each input. 1
pub(super) const DEAD_ZONE: f64 = 0.07;

/// Excess of an input over the dead zone, with the input's sign. 1
pub(super) fn excess(u: f64) -> f64 {
    (u.abs() - DEAD_ZONE).max(0.0).copysign(u)
}

/// What is left of a deviation of the velocity in x and y after `dt_s`. 1
pub(super) fn decay(dt_s: f64) -> f64 {
    (-dt_s / LAG_S).exp()
}
