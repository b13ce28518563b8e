//! The state that explains an observation: nonlinear least squares by Gauss-Newton.

use nalgebra::{Cholesky, SMatrix, SVector};

/// Most iterations; a linear observation takes two.
const ITERATIONS_MAX: u32 = 30;

/// Most halvings of a step.
const HALVINGS_MAX: u32 = 20;

/// Regularization of the normal matrix over its trace: makes the step of a rank-deficient Jacobian the one of
/// minimum norm. Its error vanishes with the iterations.
const REGULARIZATION: f64 = 1e-12;

/// `s` that minimizes `|o - g(s)|^2`, by Gauss-Newton with halved steps from `s = 0`.
///
/// Every step lies in the row space of the Jacobian: for a linear `g` the solution is that of minimum norm.
/// Returns the last finite iterate, zero if `g(0)` is not finite.
pub(crate) fn least_squares<const NS: usize, const NO: usize>(
    g: impl Fn(&SVector<f64, NS>) -> SVector<f64, NO>,
    by_state: impl Fn(&SVector<f64, NS>) -> SMatrix<f64, NO, NS>,
    o: &SVector<f64, NO>,
) -> SVector<f64, NS> {
    let mut s = SVector::zeros();
    let mut r = o - g(&s);
    if !r.norm_squared().is_finite() {
        return s;
    }
    for _ in 0..ITERATIONS_MAX {
        let Some(mut step) = minimum_norm_step(&by_state(&s), &r) else { break };
        let found = (0..HALVINGS_MAX).find_map(|_| {
            let trial = s + step;
            let left = o - g(&trial);
            step *= 0.5;
            // False for a NaN.
            let is_better = left.norm_squared() < r.norm_squared();
            (is_better && trial.norm_squared().is_finite()).then_some((trial, left))
        });
        let Some((trial, left)) = found else { break };
        (s, r) = (trial, left);
    }
    s
}

/// The minimum-norm solution of `min |j step - r|`: by `j j'` or `j' j`, whichever is smaller.
fn minimum_norm_step<const NS: usize, const NO: usize>(
    j: &SMatrix<f64, NO, NS>,
    r: &SVector<f64, NO>,
) -> Option<SVector<f64, NS>> {
    let trace = j.norm_squared();
    if NO <= NS {
        let normal = j * j.transpose() + SMatrix::from_diagonal_element(REGULARIZATION * trace);
        Some(j.tr_mul(&Cholesky::new(normal)?.solve(r)))
    } else {
        let normal = j.tr_mul(j) + SMatrix::from_diagonal_element(REGULARIZATION * trace);
        Some(Cholesky::new(normal)?.solve(&j.tr_mul(r)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::differences::jacobian;

    fn solve<const NS: usize, const NO: usize>(
        g: impl Fn(&SVector<f64, NS>) -> SVector<f64, NO>,
        o: [f64; NO],
    ) -> SVector<f64, NS> {
        least_squares(&g, |s| jacobian(&g, s), &o.into())
    }

    #[test]
    fn rows_that_are_not_observed_stay_zero() {
        let s = solve(|s: &SVector<f64, 3>| SVector::from([s[2], 2.0 * s[0]]), [0.7, 3.0]);
        assert!((s - SVector::from([1.5, 0.0, 0.7])).norm() < 1e-12, "{s}");
    }

    #[test]
    fn an_observation_of_zero_counts() {
        let s = solve(|s: &SVector<f64, 1>| SVector::from([s[0] + 2.0]), [5.0]);
        assert!((s[0] - 3.0).abs() < 1e-9, "{s}");
    }

    #[test]
    fn an_underdetermined_observation_gives_the_minimum_norm() {
        let s = solve(|s: &SVector<f64, 2>| SVector::from([3.0 * s[0] + 4.0 * s[1]]), [5.0]);
        assert!((s - SVector::from([0.6, 0.8])).norm() < 1e-12, "{s}");
    }

    #[test]
    fn a_redundant_observation_gives_the_least_squares() {
        let s = solve(|s: &SVector<f64, 1>| SVector::from([s[0], s[0], s[0]]), [1.0, 2.0, 6.0]);
        assert!((s[0] - 3.0).abs() < 1e-9, "{s}");
        // Two equal rows, and a column that is not observed: rank 1 of 2.
        let s = solve(|s: &SVector<f64, 2>| SVector::from([s[0], s[0]]), [1.0, 3.0]);
        assert!((s - SVector::from([2.0, 0.0])).norm() < 1e-9, "{s}");
    }

    #[test]
    fn a_nonlinear_observation_is_solved_to_rounding() {
        let g = |s: &SVector<f64, 2>| SVector::from([s[0] + s[1].sin(), s[1].exp()]);
        let s = solve(g, [0.4, 3.0]);
        assert!((g(&s) - SVector::from([0.4, 3.0])).norm() < 1e-12, "{s}");
        // Without a step to take, or with an undefined start, the start remains.
        let constant = |_: &SVector<f64, 2>| SVector::from([1.0]);
        assert_eq!(solve(constant, [2.0]), SVector::<f64, 2>::zeros());
        let pole = |s: &SVector<f64, 1>| SVector::from([1.0 / s[0]]);
        assert_eq!(solve(pole, [2.0]), SVector::<f64, 1>::zeros());
    }
}
