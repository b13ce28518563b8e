//! Products of small dense blocks.
//!
//! Owns nothing but the loops: written over columns of known length they unroll and vectorize, where
//! the general product of the matrix library is a call.

use horizon_model::{Matrix, Vector, transpose};
use nalgebra::ArrayStorage;

/// `a b`.
#[inline]
pub(crate) fn mul<const R: usize, const K: usize, const C: usize>(
    a: &Matrix<R, K>,
    b: &Matrix<K, C>,
) -> Matrix<R, C> {
    let mut product = [[0.0; R]; C];
    for (column, b) in product.iter_mut().zip(&b.data.0) {
        for (a, b) in a.data.0.iter().zip(b) {
            for (entry, a) in column.iter_mut().zip(a) {
                *entry += a * b;
            }
        }
    }
    Matrix::from_data(ArrayStorage(product))
}

/// Size from which whole columns are quicker than a choice of their entries: fixed lengths vectorize.
const WHOLE_FROM: usize = 8;

/// Adds `a diag(weight) b` to `sum`, the quicker the more entries of `b` are zero: derivatives are
/// mostly zeros.
///
/// Of small ones the zeros of `a` are skipped too. Where they are constants of a model, nothing of them
/// is left in the program: what varies belongs into `weight`.
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
pub(crate) fn add_mul_sparse<const R: usize, const K: usize, const C: usize>(
    sum: &mut Matrix<R, C>,
    a: &Matrix<R, K>,
    weight: &Vector<K>,
    b: &Matrix<K, C>,
) {
    let mut columns = sum.data.0.iter_mut().zip(&b.data.0);
    // Unrolled by hand: in a loop the compiler does not fold the columns of `b` that are constants of the model.
    add_column(columns.next(), a, weight);
    add_column(columns.next(), a, weight);
    add_column(columns.next(), a, weight);
    add_column(columns.next(), a, weight);
    for column in columns {
        add_column(Some(column), a, weight);
    }
}

/// Adds `a diag(weight) b` to a column, if there is one, `b` being a column too.
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
fn add_column<const R: usize, const K: usize>(
    column: Option<(&mut [f64; R], &[f64; K])>,
    a: &Matrix<R, K>,
    weight: &Vector<K>,
) {
    let Some((column, b)) = column else { return };
    let mut entries = *column;
    // As an array, whose length is known to the iterator.
    let [weight] = &weight.data.0;
    for ((a, b), weight) in a.data.0.iter().zip(b).zip(weight) {
        if *b != 0.0 {
            let scaled = weight * b;
            for (entry, a) in entries.iter_mut().zip(a) {
                if R >= WHOLE_FROM || *a != 0.0 {
                    *entry += a * scaled;
                }
            }
        }
    }
    *column = entries;
}

/// Adds `a` to `sum`; zeros as in [`add_mul_sparse`].
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
pub(crate) fn add_sparse<const R: usize, const C: usize>(sum: &mut Matrix<R, C>, a: &Matrix<R, C>) {
    for (column, a) in sum.data.0.iter_mut().zip(&a.data.0) {
        for (entry, a) in column.iter_mut().zip(a) {
            if R >= WHOLE_FROM || *a != 0.0 {
                *entry += a;
            }
        }
    }
}

/// Subtracts `diag(weight) a` from `sum`; zeros as in [`add_mul_sparse`].
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
pub(crate) fn sub_scaled_sparse<const R: usize, const C: usize>(
    sum: &mut Matrix<R, C>,
    weight: &Vector<R>,
    a: &Matrix<R, C>,
) {
    let [weight] = &weight.data.0;
    for (column, a) in sum.data.0.iter_mut().zip(&a.data.0) {
        for ((entry, a), weight) in column.iter_mut().zip(a).zip(weight) {
            if R >= WHOLE_FROM || *a != 0.0 {
                *entry -= weight * a;
            }
        }
    }
}

/// Subtracts `a b` from `sum`.
#[inline]
pub(crate) fn sub_mul<const R: usize, const K: usize>(
    sum: &mut Vector<R>,
    a: &Matrix<R, K>,
    b: &Vector<K>,
) {
    for (a, b) in a.data.0.iter().zip(b) {
        for (entry, a) in sum.iter_mut().zip(a) {
            *entry -= a * b;
        }
    }
}

/// Subtracts `a b'` from `sum`.
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
pub(crate) fn sub_outer<const R: usize, const K: usize, const C: usize>(
    sum: &mut Matrix<R, C>,
    a: &Matrix<R, K>,
    b: &Matrix<C, K>,
) {
    for (col, column) in sum.data.0.iter_mut().enumerate() {
        let mut entries = *column;
        for (a, b) in a.data.0.iter().zip(&b.data.0) {
            for (entry, a) in entries.iter_mut().zip(a) {
                *entry -= a * b[col];
            }
        }
        *column = entries;
    }
}

/// Subtracts `a a'` from `sum`: of small ones little more than the lower triangle.
#[inline(always)]
#[expect(clippy::inline_always, reason = "only the caller knows which entries are constants")]
pub(crate) fn sub_square_lower<const N: usize, const K: usize>(
    sum: &mut Matrix<N, N>,
    a: &Matrix<N, K>,
) {
    if N >= WHOLE_FROM {
        return sub_outer(sum, a, a);
    }
    for (col, column) in sum.data.0.iter_mut().enumerate() {
        // From an even row on: pairs of entries fill a vector register.
        let first = col - col % 2;
        for a in &a.data.0 {
            for (entry, below) in column[first..].iter_mut().zip(&a[first..]) {
                *entry -= below * a[col];
            }
        }
    }
}

/// `a' b`.
#[inline]
pub(crate) fn tr_mul<const K: usize, const R: usize, const C: usize>(
    a: &Matrix<K, R>,
    b: &Matrix<K, C>,
) -> Matrix<R, C> {
    mul(&transpose(a), b)
}

/// `a b'`.
#[inline]
pub(crate) fn outer<const R: usize, const K: usize, const C: usize>(
    a: &Matrix<R, K>,
    b: &Matrix<C, K>,
) -> Matrix<R, C> {
    mul(a, &transpose(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::{Matrix, Vector};

    #[test]
    fn products_are_those_of_the_matrix_library() {
        let a = Matrix::<3, 2>::from_fn(|i, j| (2 * i + j) as f64 - 1.5);
        let b = Matrix::<2, 4>::from_fn(|i, j| (i * j) as f64 + 0.25);
        let c = Matrix::<3, 4>::from_fn(|i, j| (i + j * j) as f64 - 0.5);
        let scale = Vector::from([2.0, -3.0, 0.5]);
        // Small multiples of 1/8: every sum is exact.
        assert_eq!(mul(&a, &b), a * b);
        assert_eq!(tr_mul(&a, &c), a.transpose() * c);
        assert_eq!(outer(&scale, &a.column(0).into()), scale * a.column(0).transpose());
        let mut sum = a * b;
        sub_outer(&mut sum, &a, &transpose(&b));
        assert_eq!(sum, Matrix::<3, 4>::zeros());
        let (mut sum, by) = (scale, Vector::from([0.5, -2.0]));
        sub_mul(&mut sum, &a, &by);
        assert_eq!(sum, scale - a * by);
        let mut sum = Matrix::<3, 3>::repeat(1.0);
        sub_square_lower(&mut sum, &a);
        let whole = Matrix::<3, 3>::repeat(1.0) - a * a.transpose();
        assert_eq!(sum.lower_triangle(), whole.lower_triangle());
    }

    #[test]
    fn skipped_zeros_make_no_difference() {
        // More columns than are written out, and more rows than are chosen from.
        compare::<5, 6>();
        compare::<9, 3>();
    }

    fn compare<const R: usize, const C: usize>() {
        let entry = |i: usize, j: usize| {
            if (i + j).is_multiple_of(3) { 0.0 } else { (2 * i + j) as f64 - 2.5 }
        };
        let (a, b) = (Matrix::<R, 4>::from_fn(entry), Matrix::<4, C>::from_fn(entry));
        let weight = Vector::from([0.5, 0.0, -2.0, 1.0]);
        let start = Matrix::<R, C>::from_fn(|i, j| (i * j) as f64);
        let mut sum = start;
        add_mul_sparse(&mut sum, &a, &weight, &b);
        assert_eq!(sum, start + a * Matrix::from_diagonal(&weight) * b);
        let (scale, sparse) = (Vector::repeat(0.5), Matrix::from_fn(entry));
        let mut sum = start;
        sub_scaled_sparse(&mut sum, &scale, &sparse);
        assert_eq!(sum, start - sparse * 0.5);
        add_sparse(&mut sum, &sparse);
        assert_eq!(sum, start + sparse * 0.5);
    }
}
