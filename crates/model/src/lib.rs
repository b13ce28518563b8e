//! A system as equations.
//!
//! Owns the [`Model`] trait, the vehicles that implement it with the named rows of their vectors, angles,
//! the FIFO of sent inputs, the numeric check of hand-written derivatives and the shape of a refused
//! setting. It refuses clocks, files, sockets and anything random: every function here is a function
//! of its arguments.
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.
//!
//! Cost: functions for a tick have a line *Real time* with their cost. A function without that line may allocate.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

pub mod angle;
mod bounds;
pub mod check;
pub mod differences;
#[cfg(feature = "dual")]
mod dual;
pub mod expression;
mod input_delay;
mod least_squares;
mod model;
mod rounding;
mod row;
pub mod setting;
pub mod subsystem;
mod transpose;
mod vehicles;

/// Linear algebra of all types here: its version is the one to use with them.
pub use nalgebra;

/// Column vector of `N` numbers.
pub type Vector<const N: usize> = nalgebra::SVector<f64, N>;
/// Matrix of `R` rows and `C` columns.
pub type Matrix<const R: usize, const C: usize> = nalgebra::SMatrix<f64, R, C>;

pub use bounds::Bounds;
#[cfg(feature = "dual")]
pub use dual::{Dual, DualModel, Scalar};
pub use input_delay::{DEAD_TIME_MAX_S, InputFifo};
pub use model::{
    HessianKind, HessianRequest, InputHessian, Linearized, LinearizedByInput, Model,
    ParameterHessian,
};
pub use rounding::{steps, whole};
pub use row::{Domain, Row};
pub use subsystem::{Subsystem, VisitSubsystems};
pub use transpose::transpose;
pub use vehicles::*;
