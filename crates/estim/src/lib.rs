//! Estimation for any model: states and parameters from observations and sent inputs.
//!
//! Owns the residual blocks of thesis equation 3.42, their solution by Levenberg-Marquardt, the moving
//! horizon estimator and identification. It refuses clocks, files and sockets; whether it is late is asked
//! of the caller. It knows no vehicle.
//!
//! Cost: functions for a tick have a line *Real time* with their cost. A function without that line may allocate.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod arrival_cost;
mod back_substitution;
mod bootstrap;
mod builder;
mod chain;
mod cholesky;
mod delay;
mod ident;
mod levenberg;
mod loss;
mod mhe;
mod partition;
mod product;
mod recording;
mod reduced_system;
mod residual;
mod window_problem;

pub use arrival_cost::{ArrivalSettings, ArrivalTable};
pub use bootstrap::{
    Laplace, NORMAL_HALF_WIDTH, Resample, Spread, bootstrap, group_deviations, multiplicities,
    standard_deviations,
};
pub use cholesky::NotPositive;
pub use delay::{
    DelayError, DelayInfluence, DelayProfile, DelaySettings, DelaySpread, DelayTable, DelayVerdict,
    Flights, ProfilePoint, Span, UndecidedDelay,
};
pub use ident::{Ident, IdentBuilder, IdentSettings, IdentTable, Piece, PieceError};
pub use levenberg::{LmError, LmSettings, LmStop, LmTable, SolveReport};
pub use loss::{Loss, LossTable};
pub use mhe::{Mhe, MheBuilder, MheError, MheSettings, MheTable};
pub use recording::{Recording, cut};
pub use residual::{Curvature, Observed, Residuals};
pub use window_problem::{Prior, WindowProblem};
