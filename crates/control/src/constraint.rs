//! Soft constraints on the states of a plan, beside the box of the inputs.
//!
//! Owns what a constraint has to tell. What is constrained, a wall or a temperature, is not known here.

use nalgebra::SVector;

/// A constraint `c(s) <= 0` at one state, and its weight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Excess<const NS: usize> {
    /// `c(s)`: positive where the constraint is violated. Unit of the constraint
    pub value: f64,
    /// Derivative of `c` by `s`.
    pub gradient: SVector<f64, NS>,
    /// Weight of the violation in one step, which is not squared. 1/unit, > 0
    pub weight: f64,
}

/// Constraints `c_i(s_k) <= 0` on the states after each stage, with the penalty `1/2 |w_i max(0, c_i(s_k))|^2` for each step.
///
/// The constraints may be nonlinear and change over the horizon. Functions are pure and do not allocate. The derivative is
/// exact where `c` is smooth; the curvature of `c` is left out (Gauss-Newton).
pub trait SoftConstraints<const NS: usize> {
    /// Number of constraints, at most that of [`MpcSettings::with_constraints`](crate::MpcSettings::with_constraints).
    fn count(&self) -> usize;

    /// Constraint `i` at the state `s`, `ahead_s` after the beginning of the plan; `None` far inside of what is allowed, where no
    /// step of a solve can violate it.
    fn excess(&self, i: usize, s: &SVector<f64, NS>, ahead_s: f64) -> Option<Excess<NS>>;
}
