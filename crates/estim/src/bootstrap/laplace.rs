//! Covariance of the parameter from the curvature of the cost at its minimum.
//!
//! Owns answers from one factorization that differ in what they assume of the residuals. The
//! bootstrap, which assumes least and costs most, is one file up.

use horizon_model::{Matrix, Model, Vector};

use super::{Spread, interval_variance};
use crate::cholesky::{Cholesky, NotPositive};
use crate::delay::DelayInfluence;
use crate::ident::Ident;
use crate::reduced_system::ReducedSystem;

/// Covariances of an estimate by Laplace's approximation. Bounds are ignored.
///
/// `H` is the Hessian of the cost of all `n` pieces and the prior by the parameter, states following, `g_i` the
/// gradient of the cost of piece `i`, less the mean over the pieces. That mean is zero but for the prior's part.
/// Estimated dead times add to all of them but the prior's part ([`Laplace::with_dead_times`]).
///
/// None of them, nor the bootstrap, holds the bias of an estimate of states and parameter together: where the Hessian
/// by the states depends on the parameter, as where a pole is estimated, the estimate is wrong by an amount that more
/// pieces do not reduce (incidental parameters, Neyman and Scott 1948). With `x' = a x + u + w` and `o = x + v`, equal
/// standard deviations of `w` and `v` and `a = 0.9` it is 0.03; with a third of `w` 0.009. The smaller the
/// disturbances of a step beside the errors of an observation, the smaller it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Laplace<const NP: usize> {
    /// `H^-1`. Right if residuals are independent and every weight is the inverse of a standard deviation.
    /// Product of the units of row and column
    pub plain: Matrix<NP, NP>,
    /// [`Laplace::plain`] times [`Laplace::residual_variance`]. Right if residuals are independent and the weights
    /// have the right ratios. Product of the units of row and column
    pub scaled: Matrix<NP, NP>,
    /// `n / (n - 1) H^-1 (sum of g_i g_i') H^-1`, the sandwich of Huber 1967 over pieces. Right if the pieces are
    /// independent, whatever the residuals inside are and however they are weighted; what the bootstrap
    /// over pieces tends to. Needs more pieces than parameters. Product of the units of row and column
    pub clustered: Matrix<NP, NP>,
    /// `H^-1 diag(C_p)^2 H^-1`: what the deviation of the prior adds to [`Laplace::clustered`], in which a parameter
    /// that no piece determines has none. Product of the units of row and column
    pub by_prior: Matrix<NP, NP>,
    /// Twice the cost over the degrees of freedom: 1 if every weight is the inverse of a standard deviation. 1
    pub residual_variance: f64,
}

impl<const NP: usize> Laplace<NP> {
    /// The covariances at the iterate of `ident`, which is solved, at given dead times. Costs as much as an
    /// iteration.
    ///
    /// # Errors
    /// A parameter that neither data nor prior determine.
    pub fn of<M, const NS: usize, const NU: usize, const NO: usize>(
        ident: &Ident<M, NS, NU, NO, NP>,
    ) -> Result<Self, NotPositive>
    where
        M: Model<NS, NU, NO, NP> + Sync,
    {
        Self::with_dead_times(ident, &[])
    }

    /// The approximation of [`Laplace::of`] with dead times that were estimated from the same pieces. Correlations of
    /// dead times with one another are left out.
    ///
    /// With `p_D` the derivative of the parameter by a dead time `D`, `D_i` the influence of piece `i` on that dead
    /// time and `J''` its information, piece `i` moves the parameter by `p_D D_i - H^-1 g_i` to first order, and
    /// [`Laplace::plain`] increases by `p_D p_D' / J''`. Costs as much as an iteration.
    ///
    /// # Errors
    /// As [`Laplace::of`].
    pub fn with_dead_times<M, const NS: usize, const NU: usize, const NO: usize>(
        ident: &Ident<M, NS, NU, NO, NP>,
        dead_times: &[DelayInfluence<NP>],
    ) -> Result<Self, NotPositive>
    where
        M: Model<NS, NU, NO, NP> + Sync,
    {
        let reduced_systems = ident.piece_reduced_systems()?;
        let plain = inverse(&ident.information_of(&reduced_systems))?;
        let counts = || ident.multiplicities().iter().map(|count| f64::from(*count));
        let pieces: f64 = counts().sum();
        // The gradients of the pieces and of the prior add up to zero: the prior's shifts their mean.
        let sum: Vector<NP> =
            reduced_systems.iter().zip(counts()).map(|((c, _), n)| c.gradient * n).sum();
        let mean = sum / pieces;
        let moved =
            |(piece, ((parameter_block, _), count)): (usize, (&(ReducedSystem<NP>, f64), f64))| {
                let at_dead_times = plain * (mean - parameter_block.gradient);
                let by = dead_times.iter().map(|influence| {
                    influence.parameter_by_dead_time
                        * influence.by_piece_s.get(piece).copied().unwrap_or(0.0)
                });
                let moved = by.fold(at_dead_times, |sum, by| sum + by);
                moved * moved.transpose() * count
            };
        let scatter: Matrix<NP, NP> =
            reduced_systems.iter().zip(counts()).enumerate().map(moved).sum();
        let by_prior = plain * ident.prior_information() * plain;
        let cost: f64 = reduced_systems.iter().zip(counts()).map(|((_, cost), n)| cost * n).sum();
        let residual_variance = 2.0 * cost / ident.degrees_of_freedom();
        let by_dead_times = dead_times.iter().map(|influence| {
            let by = influence.parameter_by_dead_time;
            by * by.transpose() / influence.information
        });
        let plain = by_dead_times.fold(plain, |sum, by| sum + by);
        Ok(Self {
            plain,
            scaled: plain * residual_variance,
            clustered: scatter * (pieces / (pieces - 1.0).max(1.0)),
            by_prior,
            residual_variance,
        })
    }

    /// The normal distribution around the estimate `p` with [`Laplace::clustered`] and [`Laplace::by_prior`].
    pub fn spread(&self, p: &Vector<NP>) -> Spread<NP> {
        Spread::normal(p, &(self.clustered + self.by_prior))
    }

    /// The normal distribution around the estimate `p` with [`Laplace::plain`], widened by a residual variance above 1:
    /// for fewer pieces than [`Laplace::clustered`] needs.
    pub fn plain_spread(&self, p: &Vector<NP>) -> Spread<NP> {
        Spread::normal(p, &(self.plain * interval_variance(self.residual_variance)))
    }
}

/// Inverse of a positive definite matrix.
pub(super) fn inverse<const N: usize>(matrix: &Matrix<N, N>) -> Result<Matrix<N, N>, NotPositive> {
    let root = Cholesky::new(*matrix)?.forward(Matrix::identity());
    Ok(root.transpose() * root)
}

/// Standard deviation of each parameter, the square root of the diagonal of the inverse of `information`, as of
/// [`Laplace::plain`]; NaN for a parameter that the information does not determine.
///
/// `1 / variance` is the information on a parameter after the others are eliminated. A parameter counts as determined
/// if this is more than a rounding of the information on the parameter alone. Unlike [`Laplace::of`] it tells the
/// parameters that are determined from the others.
pub fn standard_deviations<const NP: usize>(information: &Matrix<NP, NP>) -> Vector<NP> {
    Vector::from_fn(|row, _| remaining_information(information, row).sqrt().recip())
}

/// A smaller fraction of the information on a parameter is rounding of what others take away: the entries are sums
/// over thousands of steps, with a relative error far above that of one operation. 1
const FRACTION_MIN: f64 = 1e-10;

/// Information on the parameter `last` after all others are eliminated; NaN if it is none, or if the matrix is not
/// positive semidefinite.
fn remaining_information<const NP: usize>(information: &Matrix<NP, NP>, last: usize) -> f64 {
    let mut left = *information;
    let floor = |row: usize| FRACTION_MIN * information[(row, row)];
    for k in (0..NP).filter(|k| *k != last) {
        let pivot = left[(k, k)];
        // False for a NaN.
        let is_semidefinite = pivot >= -floor(k);
        if !is_semidefinite {
            return f64::NAN;
        }
        // What others determine already takes nothing away.
        if pivot > floor(k) {
            let column = left.column(k).clone_owned();
            left -= column * column.transpose() / pivot;
        }
        left.row_mut(k).fill(0.0);
        left.column_mut(k).fill(0.0);
    }
    let pivot = left[(last, last)];
    if pivot > floor(last) { pivot } else { f64::NAN }
}

#[cfg(test)]
mod tests;
