//! The vehicle as equations.
//!
//! Owns the [`Model`] trait and its implementations, the named rows of every vector, angle handling,
//! the FIFO of sent inputs, the numeric check of hand-written derivatives and the shape of a refused
//! setting. It refuses clocks, files, sockets and anything random: every function here is a function
//! of its arguments.
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.

pub mod angle;
pub mod check;
mod fifo;
pub mod group;
mod kinematic;
mod kinematic_published;
mod lagged;
mod model;
pub mod rows;
pub mod setting;

pub use fifo::InputFifo;
pub use group::Group;
pub use kinematic::Kinematic;
pub use kinematic_published::KinematicPublished;
pub use lagged::{Lagged, LaggedShape};
pub use model::{Bend, Curvature, Domain, DriveCurvature, Driven, Linearized, Model, Row};
