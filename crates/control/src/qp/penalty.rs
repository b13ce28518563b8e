//! Soft constraints of the quadratic subproblem.
//!
//! Owns the one-sided quadratic penalty `1/2 weight max(0, c + g' ds)^2` of a linearized constraint `c + g' ds <= 0`. It is
//! what a slack variable leaves: `min 1/2 weight sigma^2` subject to `sigma >= c + g' ds`.

use nalgebra::SVector;

/// Penalty on the state after a stage: `1/2 weight max(0, excess + gradient' ds_{k+1})^2`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Penalty<const NS: usize> {
    /// The stage `k`.
    pub stage: usize,
    /// `w^2 n_k` of `docs/model.md`: the squared weight of a step times the steps of the stage. 1 / squared unit of `c`, > 0
    pub weight: f64,
    /// `c`: positive where the constraint is violated. In the unit of the constraint
    pub excess: f64,
    /// `g`. Unit of `c` / unit of the row
    pub gradient: SVector<f64, NS>,
}

impl<const NS: usize> Penalty<NS> {
    /// The linearized constraint at `ds`, in the unit of the constraint.
    #[inline]
    pub fn excess_at(&self, ds: &SVector<f64, NS>) -> f64 {
        self.excess + self.gradient.dot(ds)
    }

    /// The penalty of an excess, which is in the unit of the constraint. 1
    #[inline]
    pub fn cost(&self, excess: f64) -> f64 {
        one_sided(self.weight, excess)
    }

    /// Derivative of the penalty at `ds = 0`.
    #[inline]
    pub(crate) fn gradient_at_zero(&self) -> SVector<f64, NS> {
        self.gradient * (self.weight * if self.excess <= 0.0 { 0.0 } else { self.excess })
    }

    /// What the penalty at `ds` has more than its tangent at `ds = 0`; not negative.
    #[inline]
    pub(crate) fn above_tangent(&self, ds: &SVector<f64, NS>) -> f64 {
        let excess = self.excess_at(ds);
        self.cost(excess) - self.cost(self.excess) - self.gradient_at_zero().dot(ds)
    }
}

/// `1/2 weight max(0, excess)^2`; NaN if the excess is.
#[inline]
pub(crate) fn one_sided(weight: f64, excess: f64) -> f64 {
    if excess <= 0.0 { 0.0 } else { 0.5 * weight * excess * excess }
}

/// Indices of the penalties of stage `k`; `penalties` are in the order of their stages.
#[inline]
pub(crate) fn of_stage<const NS: usize>(
    penalties: &[Penalty<NS>],
    k: usize,
) -> std::ops::Range<usize> {
    if penalties.is_empty() {
        return 0..0;
    }
    let begin = penalties.partition_point(|penalty| penalty.stage < k);
    begin..begin + penalties[begin..].partition_point(|penalty| penalty.stage == k)
}
