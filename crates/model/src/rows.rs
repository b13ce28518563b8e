//! Row names of the vehicle's vectors. A bare index into a vector of ours is a defect.
//!
//! The orders are the thesis' (equations 4.6-4.8); the wire orders of the Tello differ and live in
//! `io::tello::protocol`.

use nalgebra::SVector;

/// Pose of the vehicle in the world frame: x, y, z in metres, theta in radians.
///
/// `theta` is the measured yaw, counter-clockwise from above, continuous over time.
pub type Pose = SVector<f64, { pose::COUNT }>;

/// Stick positions, each in [-1, 1]: roll right, pitch forward, yaw counter-clockwise, throttle up.
pub type Sticks = SVector<f64, { stick::COUNT }>;

/// Rows of a [`Pose`].
pub mod pose {
    /// World x. m.
    pub const X: usize = 0;
    /// World y. m.
    pub const Y: usize = 1;
    /// World z, up. m.
    pub const Z: usize = 2;
    /// Measured yaw. rad.
    pub const THETA: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}

/// Rows of [`Sticks`].
pub mod stick {
    /// To the right. 1.
    pub const ROLL: usize = 0;
    /// Forward. 1.
    pub const PITCH: usize = 1;
    /// Counter-clockwise from above. 1.
    pub const YAW: usize = 2;
    /// Up. 1.
    pub const THROTTLE: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}

/// Rows of the parameter of [`crate::Kinematic`], thesis equation 4.8.
pub mod gain {
    /// Horizontal velocity per stick. m/s.
    pub const LAMBDA_H: usize = 0;
    /// Vertical velocity per stick. m/s.
    pub const LAMBDA_V: usize = 1;
    /// Yaw rate per stick. rad/s.
    pub const LAMBDA_A: usize = 2;
    /// Direction of flight minus measured yaw. rad.
    pub const THETA_0: usize = 3;
    /// Number of rows.
    pub const COUNT: usize = 4;
}
