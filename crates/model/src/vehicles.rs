//! The vehicles: models of the flying drone, and the rows of their vectors.
//!
//! The rest of the crate, and the crates for estimation and control, know none of them.

mod kinematic;
mod kinematic_published;
mod lagged;
pub mod rows;

use nalgebra::Vector2;

pub use kinematic::Kinematic;
pub use kinematic_published::KinematicPublished;
pub use lagged::{Lagged, LaggedShape};

/// Horizontal vector, world frame, with the components `forward` and `right` of the vehicle, in their unit; of the
/// direction of flight `psi` the sine and cosine. Thesis equations 4.17 and 4.18.
#[inline]
pub fn world_from_sticks((sin, cos): (f64, f64), forward: f64, right: f64) -> Vector2<f64> {
    Vector2::new(cos * forward + sin * right, sin * forward - cos * right)
}
