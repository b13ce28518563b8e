//! Cholesky factor of one small dense block.
//!
//! Owns the pivots: a pivot that is not positive, NaN included, refuses the matrix. What follows from
//! a refusal is decided in [`crate::levenberg`].

use horizon_model::{Matrix, Vector};
use thiserror::Error;

/// A matrix is not positive definite, or not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
#[error("the matrix is not positive definite")]
pub struct NotPositive;

/// Lower factor `L` of `A = L L'`, thesis equation 3.72.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cholesky<const N: usize> {
    /// Below the diagonal as it is; the diagonal holds its reciprocal, so that solving multiplies.
    l: Matrix<N, N>,
}

impl<const N: usize> Cholesky<N> {
    /// The factor of nothing, to be replaced.
    pub(crate) fn zeros() -> Self {
        Self { l: Matrix::zeros() }
    }

    /// The factor of `l`, of which only the lower triangle is read.
    #[inline]
    pub(crate) fn new(mut l: Matrix<N, N>) -> Result<Self, NotPositive> {
        for j in 0..N {
            let mut pivot = l[(j, j)];
            for k in 0..j {
                pivot -= l[(j, k)] * l[(j, k)];
            }
            // False for a NaN.
            let is_positive = pivot > 0.0 && pivot < f64::INFINITY;
            if !is_positive {
                return Err(NotPositive);
            }
            let reciprocal = 1.0 / pivot.sqrt();
            l[(j, j)] = reciprocal;
            for i in j + 1..N {
                let mut entry = l[(i, j)];
                for k in 0..j {
                    entry -= l[(i, k)] * l[(j, k)];
                }
                l[(i, j)] = entry * reciprocal;
            }
        }
        Ok(Self { l })
    }

    /// `L^-1 b`.
    #[inline]
    pub(crate) fn forward<const C: usize>(&self, mut b: Matrix<N, C>) -> Matrix<N, C> {
        for col in 0..C {
            for i in 0..N {
                let mut entry = b[(i, col)];
                for k in 0..i {
                    entry -= self.l[(i, k)] * b[(k, col)];
                }
                b[(i, col)] = entry * self.l[(i, i)];
            }
        }
        b
    }

    /// `b L'^-1`, the transpose of [`Cholesky::forward`]: whole columns at once, which vectorizes.
    #[inline]
    pub(crate) fn forward_rows<const R: usize>(&self, mut b: Matrix<R, N>) -> Matrix<R, N> {
        for i in 0..N {
            let mut column = b.data.0[i];
            for k in 0..i {
                for (entry, known) in column.iter_mut().zip(&b.data.0[k]) {
                    *entry -= self.l[(i, k)] * known;
                }
            }
            for entry in &mut column {
                *entry *= self.l[(i, i)];
            }
            b.data.0[i] = column;
        }
        b
    }

    /// `b L^-1`, the transpose of [`Cholesky::backward`].
    #[inline]
    pub(crate) fn backward_rows<const R: usize>(&self, mut b: Matrix<R, N>) -> Matrix<R, N> {
        for i in (0..N).rev() {
            let mut column = b.data.0[i];
            for k in i + 1..N {
                for (entry, known) in column.iter_mut().zip(&b.data.0[k]) {
                    *entry -= self.l[(k, i)] * known;
                }
            }
            for entry in &mut column {
                *entry *= self.l[(i, i)];
            }
            b.data.0[i] = column;
        }
        b
    }

    /// `L'^-1 b`.
    #[inline]
    pub(crate) fn backward(&self, mut b: Vector<N>) -> Vector<N> {
        for i in (0..N).rev() {
            let mut entry = b[i];
            for k in i + 1..N {
                entry -= self.l[(k, i)] * b[k];
            }
            b[i] = entry * self.l[(i, i)];
        }
        b
    }

    /// `A^-1 b`.
    #[inline]
    pub(crate) fn solve(&self, b: Vector<N>) -> Vector<N> {
        self.backward(self.forward(b))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::{Matrix, Vector};

    #[test]
    fn a_solution_satisfies_its_equations() {
        let a = Matrix::<3, 3>::new(4.0, 1.0, -2.0, 1.0, 5.0, 0.5, -2.0, 0.5, 6.0);
        let b = Vector::from([1.0, -2.0, 3.0]);
        let factor = Cholesky::new(a).unwrap();
        let gap = (a * factor.solve(b) - b).norm();
        assert!(gap < 1e-14, "gap {gap:e}");
        assert_eq!(factor.forward_rows(b.transpose()), factor.forward(b).transpose());
        assert_eq!(factor.backward_rows(b.transpose()), factor.backward(b).transpose());
    }

    #[test]
    fn a_bad_pivot_is_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            for row in 0..3 {
                let mut a = Matrix::<3, 3>::identity();
                a[(row, row)] = bad;
                assert_eq!(Cholesky::new(a), Err(NotPositive), "{bad} in row {row}");
            }
        }
    }
}
