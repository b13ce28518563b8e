//! The state that explains an observation: nonlinear least squares by Gauss-Newton.

use crate::{Matrix, Vector};
use nalgebra::Cholesky;

/// Most iterations; a linear observation takes two.
const ITERATIONS_MAX: u32 = 30;

/// Most halvings of a step.
const HALVINGS_MAX: u32 = 20;

/// Regularization of the normal matrix over its trace: makes the step of a rank-deficient Jacobian the one of
/// minimum norm. Its error vanishes with the iterations. 1
const REGULARIZATION: f64 = 1e-12;

/// Squared residual over that of `s = 0`, or over the squared norm of `o`, below which `o` is explained. 1
const EXPLAINED: f64 = 1e-12;

/// `s` that minimizes `|o - g(s)|^2`, by Gauss-Newton with halved steps from `s = 0`; if that leaves a residual,
/// from `s = (0.1, 0.2, ..)`, since zero may be a stationary or a singular point of `g`, as of a distance. The second
/// solution must halve the squared residual.
///
/// Every step lies in the row space of the Jacobian: for a linear `g` the solution is that of minimum norm.
/// Returns the last finite iterate, zero if `g` is finite at neither start.
pub(crate) fn least_squares<const NS: usize, const NO: usize>(
    g: impl Fn(&Vector<NS>) -> Vector<NO>,
    by_state: impl Fn(&Vector<NS>) -> Matrix<NO, NS>,
    o: &Vector<NO>,
) -> Vector<NS> {
    let residual = |s: &Vector<NS>| (o - g(s)).norm_squared();
    let first = gauss_newton(&g, &by_state, o, Vector::zeros());
    let left = residual(&first);
    let at_zero = Some(residual(&Vector::zeros())).filter(|at_zero| at_zero.is_finite());
    if left <= EXPLAINED * at_zero.unwrap_or(0.0).max(o.norm_squared()) {
        return first;
    }
    let mut second = Vector::from_fn(|row, _| 0.1 * (row + 1) as f64);
    // No step would bring a row that is not observed back to zero.
    for (row, column) in by_state(&second).column_iter().enumerate() {
        if column.iter().all(|entry| entry.abs() <= 0.0) {
            second[row] = 0.0;
        }
    }
    let second = gauss_newton(&g, &by_state, o, second);
    let left_by_second = residual(&second);
    // The first residual may be NaN: the comparison is false then.
    if left <= 2.0 * left_by_second || !left_by_second.is_finite() { first } else { second }
}

/// The last finite iterate from the start `s`.
fn gauss_newton<const NS: usize, const NO: usize>(
    g: impl Fn(&Vector<NS>) -> Vector<NO>,
    by_state: impl Fn(&Vector<NS>) -> Matrix<NO, NS>,
    o: &Vector<NO>,
    mut s: Vector<NS>,
) -> Vector<NS> {
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
    j: &Matrix<NO, NS>,
    r: &Vector<NO>,
) -> Option<Vector<NS>> {
    let trace = j.norm_squared();
    if NO <= NS {
        let normal = j * j.transpose() + Matrix::from_diagonal_element(REGULARIZATION * trace);
        Some(j.tr_mul(&Cholesky::new(normal)?.solve(r)))
    } else {
        let normal = j.tr_mul(j) + Matrix::from_diagonal_element(REGULARIZATION * trace);
        Some(Cholesky::new(normal)?.solve(&j.tr_mul(r)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;
    use crate::differences::jacobian;

    fn solve<const NS: usize, const NO: usize>(
        g: impl Fn(&Vector<NS>) -> Vector<NO>,
        o: [f64; NO],
    ) -> Vector<NS> {
        least_squares(&g, |s| jacobian(&g, s), &o.into())
    }

    #[test]
    fn rows_that_are_not_observed_stay_zero() {
        let s = solve(|s: &Vector<3>| Vector::from([s[2], 2.0 * s[0]]), [0.7, 3.0]);
        assert!((s - Vector::from([1.5, 0.0, 0.7])).norm() < 1e-12, "{s}");
    }

    #[test]
    fn an_observation_of_zero_counts() {
        let s = solve(|s: &Vector<1>| Vector::from([s[0] + 2.0]), [5.0]);
        assert!((s[0] - 3.0).abs() < 1e-9, "{s}");
    }

    #[test]
    fn an_underdetermined_observation_gives_the_minimum_norm() {
        let s = solve(|s: &Vector<2>| Vector::from([3.0 * s[0] + 4.0 * s[1]]), [5.0]);
        assert!((s - Vector::from([0.6, 0.8])).norm() < 1e-12, "{s}");
    }

    #[test]
    fn a_redundant_observation_gives_the_least_squares() {
        let s = solve(|s: &Vector<1>| Vector::from([s[0], s[0], s[0]]), [1.0, 2.0, 6.0]);
        assert!((s[0] - 3.0).abs() < 1e-9, "{s}");
        // Two equal rows, and a column that is not observed: rank 1 of 2.
        let s = solve(|s: &Vector<2>| Vector::from([s[0], s[0]]), [1.0, 3.0]);
        assert!((s - Vector::from([2.0, 0.0])).norm() < 1e-9, "{s}");
    }

    #[test]
    fn a_nonlinear_observation_is_solved_to_rounding() {
        let g = |s: &Vector<2>| Vector::from([s[0] + s[1].sin(), s[1].exp()]);
        let s = solve(g, [0.4, 3.0]);
        assert!((g(&s) - Vector::from([0.4, 3.0])).norm() < 1e-12, "{s}");
        // Without a step to take the start remains.
        let constant = |_: &Vector<2>| Vector::from([1.0]);
        assert_eq!(solve(constant, [2.0]), Vector::<2>::zeros());
        let undefined = |_: &Vector<1>| Vector::from([f64::NAN]);
        assert_eq!(solve(undefined, [2.0]), Vector::<1>::zeros());
    }

    #[test]
    fn a_singular_point_at_zero_is_left() {
        let pole = |s: &Vector<1>| Vector::from([1.0 / s[0]]);
        assert!((solve(pole, [2.0])[0] - 0.5).abs() < 1e-9);
        let distance = |s: &Vector<3>| Vector::from([s.xy().norm()]);
        let s = solve(distance, [2.0]);
        assert!((s.norm() - 2.0).abs() < 1e-9 && s[2].abs() <= 0.0, "{s}");
        let polar = |s: &Vector<2>| Vector::from([s.norm(), s[1].atan2(s[0])]);
        let s = solve(polar, [2.0, 0.7]);
        assert!((polar(&s) - Vector::from([2.0, 0.7])).norm() < 1e-9, "{s}");
    }

    #[test]
    fn what_nothing_explains_does_not_leave_the_minimum_norm() {
        // Two different observations of one row: a residual from each start.
        let s = solve(|s: &Vector<3>| Vector::from([s[1], s[1]]), [0.0, 2.0]);
        assert!((s - Vector::from([0.0, 1.0, 0.0])).norm() < 1e-9, "{s}");
    }
}
