//! What happened: from observations and sent inputs to states and parameters.
//!
//! Owns the outlier filter of the motion capture, the residual blocks of thesis equation 3.42, their
//! solution by Levenberg-Marquardt and the moving horizon estimator. It refuses clocks, files and
//! sockets; whether it is late is asked of the caller. It knows no vehicle except in the filter, which
//! is about poses.

mod arrival;
mod bootstrap;
mod chain;
mod cholesky;
mod corner;
mod delay;
mod filter;
mod forecast;
mod ident;
mod levenberg;
mod link;
mod loss;
mod mhe;
mod outage;
mod parted;
mod product;
mod recording;
mod residual;
mod smooth;
mod trajectory;
mod way_back;

pub use arrival::{ArrivalSettings, ArrivalTable};
pub use bootstrap::{
    Calibration, Claim, Coverage, Laplace, Resample, Spread, Trial, TrialError, bootstrap,
    calibrate, multiplicities,
};
pub use chain::{Block, Chain};
pub use cholesky::NotPositive;
pub use corner::{Bounds, Corner};
pub use delay::{DelayError, DelayProfile, DelaySettings, DelaySpread, DelayTable, Flights, Span};
pub use filter::{FilterSettings, FilterTable, Filtered, PoseFilter, Verdict};
pub use forecast::{
    ConstantVelocity, Driven, ErrorSummary, Forecast, ForecastErrors, Hold, HorizonErrors, judge,
};
pub use ident::{Ident, IdentSettings, IdentTable, LinearSolver, Piece, PieceError};
pub use levenberg::{
    Linearization, LmSettings, LmTable, Problem, Report, SolveError, Step, Stop, solve,
};
pub use link::{LinkMonitor, LinkSettings, LinkState, LinkTable, LinkVerdict};
pub use loss::{Loss, LossTable, Rho};
pub use mhe::{Mhe, MheSettings, MheTable};
pub use outage::{OutageSettings, OutageTable, lost_commands};
pub use recording::{Recording, cut};
pub use residual::{Curvature, Observed, Path, Residuals};
pub use smooth::{Track, smooth, track};
pub use trajectory::{Prior, Trajectory};
