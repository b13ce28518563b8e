//! Row names of the vehicle's vectors. A bare index into a vector of ours is a defect.
//!
//! The orders are the thesis' (equations 4.6-4.8); the wire orders of the Tello differ and live in
//! `io::tello::protocol`.

use crate::Vector;
use nalgebra::Vector3;

/// Pose of the vehicle in the world frame: x, y, z in metres, theta in radians.
///
/// `theta` is the measured yaw, counter-clockwise from above, continuous over time.
pub type Pose = Vector<{ pose::COUNT }>;

/// Rate of a [`Pose`] by time. m/s, rad/s
pub type PoseRate = Pose;

/// Position of a pose, world frame. m
#[inline]
pub fn pos_w(o: &Pose) -> Vector3<f64> {
    o.fixed_rows::<3>(pose::X).into()
}

/// Stick positions, each in [-1, 1]: roll right, pitch forward, yaw counter-clockwise, throttle up.
pub type Sticks = Vector<{ stick::COUNT }>;

/// Rows of a [`Pose`].
pub mod pose {
    /// World x. m
    pub const X: usize = 0;
    /// World y. m
    pub const Y: usize = 1;
    /// World z, up. m
    pub const Z: usize = 2;
    /// Measured yaw. rad
    pub const THETA: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}

/// Rows of [`Sticks`].
pub mod stick {
    /// To the right. 1
    pub const ROLL: usize = 0;
    /// Forward. 1
    pub const PITCH: usize = 1;
    /// Counter-clockwise from above. 1
    pub const YAW: usize = 2;
    /// Up. 1
    pub const THROTTLE: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}

/// Rows of the parameter of [`crate::Kinematic`], thesis equation 4.8.
pub mod gain {
    /// Horizontal velocity per stick. m/s
    pub const LAMBDA_H: usize = 0;
    /// Vertical velocity per stick. m/s
    pub const LAMBDA_V: usize = 1;
    /// Yaw rate per stick. rad/s
    pub const LAMBDA_A: usize = 2;
    /// Direction of flight minus measured yaw. rad
    pub const THETA_0: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}

/// Pose, velocity driven by the sticks and disturbance velocity, all in the world frame.
pub type Motion = Vector<{ motion::COUNT }>;

/// Rows of a [`Motion`], the state of [`crate::Lagged`]. The first four are those of [`pose`].
pub mod motion {
    use super::pose;

    /// World x. m
    pub const X: usize = pose::X;
    /// World y. m
    pub const Y: usize = pose::Y;
    /// World z, up. m
    pub const Z: usize = pose::Z;
    /// Measured yaw. rad
    pub const THETA: usize = pose::THETA;
    /// Velocity along x that the sticks drive. m/s
    pub const V_X: usize = 4;
    /// Velocity along y that the sticks drive. m/s
    pub const V_Y: usize = 5;
    /// Velocity upwards that the sticks drive. m/s
    pub const V_Z: usize = 6;
    /// Yaw rate that the sticks drive. rad/s
    pub const OMEGA: usize = 7;
    /// Number of controllable rows; what follows is disturbance.
    pub const CONTROLLABLE: usize = 8;
    /// Disturbance velocity along x. m/s
    pub const D_X: usize = 8;
    /// Disturbance velocity along y. m/s
    pub const D_Y: usize = 9;
    /// Disturbance velocity upwards. m/s
    pub const D_Z: usize = 10;
    /// Number of rows.
    pub const COUNT: usize = 11;
}

/// Rows of the parameter of [`crate::Lagged`]. The first four are those of [`gain`].
pub mod lag {
    use super::gain;

    /// Horizontal velocity per stick excess over the dead zone. m/s
    pub const LAMBDA_H: usize = gain::LAMBDA_H;
    /// Vertical velocity per stick excess over the dead zone. m/s
    pub const LAMBDA_V: usize = gain::LAMBDA_V;
    /// Yaw rate per stick excess over the dead zone. rad/s
    pub const LAMBDA_A: usize = gain::LAMBDA_A;
    /// Direction of flight minus measured yaw. rad
    pub const THETA_0: usize = gain::THETA_0;
    /// Time constant of the horizontal velocity. s, > 0
    pub const TAU_H: usize = 4;
    /// Time constant of the vertical velocity. s, > 0
    pub const TAU_V: usize = 5;
    /// Time constant of the yaw rate. s, > 0
    pub const TAU_A: usize = 6;
    /// Roll or pitch that does nothing yet. 1, >= 0
    pub const DEAD_H: usize = 7;
    /// Throttle that does nothing yet. 1, >= 0
    pub const DEAD_V: usize = 8;
    /// Yaw that does nothing yet. 1, >= 0
    pub const DEAD_A: usize = 9;
    /// Largest horizontal acceleration. m/s^2, > 0
    pub const A_MAX: usize = 10;
    /// Number of rows.
    pub const COUNT: usize = 11;
}

#[cfg(test)]
mod tests;
