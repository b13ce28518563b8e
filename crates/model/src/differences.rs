//! Central differences: the numeric derivative of a function of a vector.
//!
//! A [`Model`](crate::Model) without derivatives gets them from here; the check of the derivatives of a
//! model compares with the same function.

use nalgebra::{SMatrix, SVector};

/// Jacobian of `f` at `x` by central differences, `2 N` evaluations.
///
/// The increment is `eps^(1/3) max(1, |x_i|)`, about 6e-6, which balances truncation, `h^2 f''' / 6`,
/// and rounding, `eps |f| / h` (Nocedal and Wright, Numerical Optimization, 2006, section 8.1). With values
/// and third derivatives of order 1 the error is about 1e-10; where `f` is large or nearly kinked it is larger
/// in proportion. A second difference of a Jacobian from here has an error of about 1e-5.
///
/// ```
/// use nalgebra::SVector;
/// let square = |x: &SVector<f64, 1>| SVector::from([x[0] * x[0]]);
/// let derivative = horizon_model::differences::jacobian(square, &SVector::from([3.0]));
/// assert!((derivative[0] - 6.0).abs() < 1e-9);
/// ```
#[inline]
pub fn jacobian<const M: usize, const N: usize>(
    f: impl Fn(&SVector<f64, N>) -> SVector<f64, M>,
    x: &SVector<f64, N>,
) -> SMatrix<f64, M, N> {
    let mut jacobian = SMatrix::<f64, M, N>::zeros();
    for col in 0..N {
        let h = f64::EPSILON.cbrt() * x[col].abs().max(1.0);
        let (mut right, mut left) = (*x, *x);
        right[col] += h;
        left[col] -= h;
        // The difference actually taken: x +- h is rounded.
        let derivative = (f(&right) - f(&left)) / (right[col] - left[col]);
        jacobian.set_column(col, &derivative);
    }
    jacobian
}
