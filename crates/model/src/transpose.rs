//! The transpose of a small dense matrix.
//!
//! Owns nothing but the loop. Products are written where they are needed: which entries are zero decides how.

use crate::Matrix;
use nalgebra::ArrayStorage;

/// `a'`, by loops of known length that unroll, where that of the matrix library is a call.
///
/// Real time: no allocation, `R C` copies.
#[inline]
pub fn transpose<const R: usize, const C: usize>(a: &Matrix<R, C>) -> Matrix<C, R> {
    let mut transposed = [[0.0; C]; R];
    for (col, column) in a.data.0.iter().enumerate() {
        for (row, entry) in column.iter().enumerate() {
            transposed[row][col] = *entry;
        }
    }
    Matrix::from_data(ArrayStorage(transposed))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Matrix;

    #[test]
    fn it_is_the_transpose_of_the_matrix_library() {
        let a = Matrix::<3, 2>::from_fn(|i, j| (2 * i + j) as f64 - 1.5);
        assert_eq!(transpose(&a), a.transpose());
    }
}
