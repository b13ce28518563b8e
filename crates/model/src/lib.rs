//! A system as equations.
//!
//! Owns the [`Model`] trait, the vehicles that implement it with the named rows of their vectors, angles,
//! the FIFO of sent inputs, the numeric check of hand-written derivatives and the shape of a refused
//! setting. It refuses clocks, files, sockets and anything random: every function here is a function
//! of its arguments.
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.

pub mod angle;
pub mod check;
mod fifo;
pub mod group;
mod model;
pub mod setting;
mod vehicles;

pub use fifo::InputFifo;
pub use group::Group;
pub use model::{Bend, Curvature, Domain, DriveCurvature, Driven, Linearized, Model, Row};
pub use vehicles::{Kinematic, KinematicPublished, Lagged, LaggedShape, rows};
