//! Central differences: the numeric derivative of a function of a vector.
//!
//! A [`Model`](crate::Model) without derivatives gets them from here; the check of the derivatives of a
//! model compares with the same function.

use crate::row::{Domain, Row};
use crate::{Matrix, Vector};

/// Jacobian of `f` at `x` by central differences, `2 N` evaluations.
///
/// The increment is `h = eps^(1/3) max(1, |x_i|)`, about 6e-6, which balances truncation, `h^2 f''' / 6`,
/// and rounding, `eps |f| / h` (Nocedal and Wright, Numerical Optimization, 2006, section 8.1). With variables, values
/// and third derivatives of order 1 the error is about 1e-10; where `f` is large or nearly kinked it is larger
/// in proportion. A second difference of a Jacobian from here has an error of about 1e-5.
///
/// Two limits follow. Variables far below 1 on which `f` depends nonlinearly need the relative increments of
/// [`jacobian_of_rows`]: `1 / x` at `x = 1e-5` has no derivative over `h`. Variables far above 1 need an origin nearby:
/// at a position of 5e6 m `h` is 30 m, and a distance of 3 m is not linear over it.
///
/// ```
/// use nalgebra::SVector;
/// let square = |x: &SVector<f64, 1>| SVector::from([x[0] * x[0]]);
/// let derivative = horizon_model::differences::jacobian(square, &SVector::from([3.0]));
/// assert!((derivative[0] - 6.0).abs() < 1e-9);
/// ```
#[inline]
pub fn jacobian<const M: usize, const N: usize>(
    f: impl Fn(&Vector<N>) -> Vector<M>,
    x: &Vector<N>,
) -> Matrix<M, N> {
    jacobian_of_rows(f, x, &[Row::UNNAMED; N])
}

/// [`jacobian`] by variables with these rows.
///
/// The increment of a positive row ([`Domain::Positive`]) above zero is relative, `h = eps^(1/3) x_i`: the value is the
/// scale of such a quantity, and `x_i - h` stays positive. The rounding error, `eps |f| / h`, is small if `f` changes
/// in proportion to the quantity, as with a parameter; not with a nearly empty reservoir that is filled.
///
/// ```
/// use horizon_model::{Row, differences::jacobian_of_rows};
/// use nalgebra::SVector;
///
/// // An inertia in kg m^2.
/// let inverse = |x: &SVector<f64, 1>| SVector::from([1.0 / x[0]]);
/// let derivative = jacobian_of_rows(inverse, &[1e-5].into(), &[Row::positive("inertia", "kg m^2")]);
/// assert!((derivative[0] + 1e10).abs() < 1.0);
/// ```
#[inline]
pub fn jacobian_of_rows<const M: usize, const N: usize>(
    f: impl Fn(&Vector<N>) -> Vector<M>,
    x: &Vector<N>,
    rows: &[Row; N],
) -> Matrix<M, N> {
    let mut jacobian = Matrix::<M, N>::zeros();
    for col in 0..N {
        let is_relative = rows[col].domain == Domain::Positive && x[col] > 0.0;
        let scale = if is_relative { x[col] } else { x[col].abs().max(1.0) };
        let h = f64::EPSILON.cbrt() * scale;
        let (mut right, mut left) = (*x, *x);
        right[col] += h;
        left[col] -= h;
        // The difference actually taken: x +- h is rounded.
        let derivative = (f(&right) - f(&left)) / (right[col] - left[col]);
        jacobian.set_column(col, &derivative);
    }
    jacobian
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::amax;

    #[test]
    fn a_jacobian_has_a_row_by_value_and_a_column_by_variable() {
        let f = |x: &Vector<3>| Vector::from([x[0] * x[1], x[2].sin()]);
        let x = Vector::from([2.0, -3.0, 0.4]);
        let exact = Matrix::<2, 3>::new(x[1], x[0], 0.0, 0.0, 0.0, x[2].cos());
        let gap = amax(&(jacobian(f, &x) - exact));
        assert!(gap < 1e-9, "{gap:e}");
    }

    #[test]
    fn the_increment_is_relative_for_a_positive_row_above_zero_alone() {
        let increment = |row: Row, at: f64| {
            let ends = std::cell::RefCell::new(Vec::new());
            let note = |x: &Vector<1>| {
                ends.borrow_mut().push(x[0]);
                *x
            };
            jacobian_of_rows(note, &[at].into(), &[row]);
            let ends = ends.into_inner();
            0.5 * (ends[0] - ends[1])
        };
        let (positive, any) = (Row::positive("mass", "kg"), Row::linear("x", "m"));
        for (row, at, scale) in [
            (positive, 1e-5, 1e-5),
            (positive, 1e3, 1e3),
            (positive, 0.0, 1.0),
            (any, 1e-5, 1.0),
            (any, -1e3, 1e3),
        ] {
            let ratio = increment(row, at) / (f64::EPSILON.cbrt() * scale);
            assert!((ratio - 1.0).abs() < 1e-5, "{at}: {ratio}");
        }
    }
}
