//! Products and cuts of small dense blocks.
//!
//! Owns nothing but the loops: over columns of known length they unroll and vectorize, where the
//! general product of the matrix library is a call.

use horizon_model::{Matrix, Vector};
use nalgebra::ArrayStorage;

/// `a b`, the quicker the more entries of `b` are zero.
#[inline]
pub(crate) fn mul_sparse<const R: usize, const K: usize, const C: usize>(
    a: &Matrix<R, K>,
    b: &Matrix<K, C>,
) -> Matrix<R, C> {
    let mut product = Matrix::zeros();
    add_mul(&mut product, a, b);
    product
}

/// Adds `a b` to `sum`, the quicker the more entries of `b` are zero: dynamics are mostly zeros.
#[inline]
pub(super) fn add_mul<const R: usize, const K: usize, const C: usize>(
    sum: &mut Matrix<R, C>,
    a: &Matrix<R, K>,
    b: &Matrix<K, C>,
) {
    for (column, b) in sum.data.0.iter_mut().zip(&b.data.0) {
        let mut entries = *column;
        for (a, b) in a.data.0.iter().zip(b) {
            if *b != 0.0 {
                add_scaled(&mut entries, *b, a);
            }
        }
        *column = entries;
    }
}

/// Adds `scale b` to `a`.
#[inline]
pub(super) fn add_scaled<const N: usize>(a: &mut [f64; N], scale: f64, b: &[f64; N]) {
    for (a, b) in a.iter_mut().zip(b) {
        *a += scale * b;
    }
}

/// `a' v`.
#[inline]
pub(crate) fn tr_mul_vector<const R: usize, const C: usize>(
    a: &Matrix<R, C>,
    v: &Vector<R>,
) -> Vector<C> {
    Vector::from_fn(|i, _| a.data.0[i].iter().zip(v).map(|(a, v)| a * v).sum())
}

/// The entries of `a` that fit, zeros elsewhere.
#[inline]
pub(crate) fn resized<const R: usize, const C: usize, const TO_R: usize, const TO_C: usize>(
    a: &Matrix<R, C>,
) -> Matrix<TO_R, TO_C> {
    let mut block = [[0.0; TO_R]; TO_C];
    for (to, from) in block.iter_mut().zip(&a.data.0) {
        for (to, from) in to.iter_mut().zip(from) {
            *to = *from;
        }
    }
    Matrix::from_data(ArrayStorage(block))
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::{Matrix, Vector};

    #[test]
    fn products_are_those_of_the_matrix_library() {
        let a = Matrix::<3, 2>::from_fn(|i, j| (2 * i + j) as f64 - 1.0);
        let b = Matrix::<2, 4>::from_fn(|i, j| (i * j) as f64 - 0.5);
        let v = Vector::from([2.0, -3.0, 0.5]);
        let mut sum = Matrix::<3, 4>::from_fn(|i, j| (i + j * j) as f64 - 0.5);
        // Small multiples of 1/8, some of them zero: every sum is exact.
        assert_eq!(mul_sparse(&a, &b), a * b);
        assert_eq!(mul_sparse(&b.transpose(), &a.transpose()), (a * b).transpose());
        assert_eq!(tr_mul_vector(&a, &v), a.transpose() * v);
        let expected = sum + a * b;
        add_mul(&mut sum, &a, &b);
        assert_eq!(sum, expected);
    }

    #[test]
    fn what_does_not_fit_is_cut_and_what_lacks_is_zero() {
        let a = Matrix::<2, 3>::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
        let resized: Matrix<3, 2> = resized(&a);
        assert_eq!(resized, Matrix::<3, 2>::new(1.0, 2.0, 4.0, 5.0, 0.0, 0.0));
    }

    #[test]
    fn what_is_not_finite_is_no_zero() {
        let a = Matrix::<1, 1>::new(2.0);
        assert!(mul_sparse(&a, &Matrix::<1, 1>::new(f64::NAN))[0].is_nan());
    }
}
