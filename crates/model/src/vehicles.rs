//! The vehicles: models of the flying drone, and the rows of their vectors.
//!
//! The rest of the crate, and the crates for estimation and control, know none of them.

mod kinematic;
mod kinematic_published;
mod lagged;
pub mod rows;

pub use kinematic::Kinematic;
pub use kinematic_published::KinematicPublished;
pub use lagged::{Lagged, LaggedShape};
