//! Control of any model: model predictive control, and prediction over the dead time of the inputs.
//!
//! Owns the quadratic subproblem and its solvers, and nothing of their surroundings: no vehicle, clock,
//! socket, file, environment, thread or randomness. Equal arguments give equal bits. Time limits come in
//! as a question that is asked once per iteration and before a fall-back, so that a replay can repeat the answers.
//!
//! Cost: functions for a tick have a line *Real time* with their cost. A function without that line may allocate.
//!
//! | file            | owns                                                                |
//! |-----------------|---------------------------------------------------------------------|
//! | `horizon.rs`    | inputs and states of a plan                                         |
//! | `predictor.rs`  | state after the inputs that are already sent (4.26)                 |
//! | `mpc.rs`        | inputs over the horizon (3.46-3.49) by sequential quadratic programming |
//! | `constraint.rs` | soft constraints on the states of a plan                            |
//! | `qp.rs`         | the quadratic subproblem, stage by stage or by Clarabel             |
//!
//! Letters and units: `docs/notation.md`. Derivations: `docs/model.md`.

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod constraint;
mod horizon;
mod mpc;
mod predictor;
pub mod qp;

pub use constraint::{Excess, SoftConstraints, StateBounds};
pub use mpc::{
    InputCost, Mpc, MpcBuilder, MpcProblem, MpcReport, MpcSettings, MpcTable, QpKind, SolverTable,
    SqpError, SqpStop,
};
pub use predictor::predict;
