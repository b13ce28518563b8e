//! A box of vectors.
//!
//! Owns what follows from the bounds of each row alone. Where bounds come from and which of them are active is
//! known to the solvers.

use crate::Vector;

/// The box `lo <= x <= hi` of a vector `x` with `N` rows: inputs or parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds<const N: usize> {
    /// Lower bounds, finite or minus infinity. Unit of each row
    pub lo: Vector<N>,
    /// Upper bounds, finite or infinity, not below `lo`. Where one equals `lo` the row is given. Unit of each row
    pub hi: Vector<N>,
}

impl<const N: usize> Bounds<N> {
    /// Whether row `i` has no choice.
    #[inline]
    pub fn is_given(&self, i: usize) -> bool {
        self.lo[i] >= self.hi[i]
    }

    /// The projected gradient: rows whose descent direction leaves the box at `x` are 0. 1 / unit of the row
    ///
    /// Real time: no allocation, one pass over the rows.
    #[inline]
    pub fn projected_gradient(&self, gradient: &Vector<N>, x: &Vector<N>) -> Vector<N> {
        Vector::from_fn(|i, _| {
            let is_open = if gradient[i] > 0.0 { x[i] > self.lo[i] } else { x[i] < self.hi[i] };
            if is_open { gradient[i] } else { 0.0 }
        })
    }

    /// The vector of the box that is nearest to `x`, row by row, in its units. A row of `x` that is NaN becomes its
    /// lower bound.
    ///
    /// Real time: no allocation, one pass over the rows.
    #[inline]
    pub fn clamp(&self, x: &Vector<N>) -> Vector<N> {
        x.sup(&self.lo).inf(&self.hi)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    const INF: f64 = f64::INFINITY;

    fn bounds() -> Bounds<3> {
        Bounds { lo: Vector::from([-1.0, 0.5, -INF]), hi: Vector::from([1.0, 0.5, INF]) }
    }

    #[test]
    fn only_a_row_with_equal_bounds_is_given() {
        assert_eq!([0, 1, 2].map(|i| bounds().is_given(i)), [false, true, false]);
    }

    #[test]
    fn what_leads_out_of_the_box_is_not_open() {
        let gradient = Vector::from([2.0, 2.0, -2.0]);
        let projected =
            |x: [f64; 3], sign: f64| bounds().projected_gradient(&(gradient * sign), &x.into());
        assert_eq!(projected([-1.0, 0.5, 9.0], 1.0), Vector::from([0.0, 0.0, -2.0]));
        assert_eq!(projected([-1.0, 0.5, 9.0], -1.0), Vector::from([-2.0, 0.0, 2.0]));
        assert_eq!(projected([0.0, 0.5, 9.0], 1.0), Vector::from([2.0, 0.0, -2.0]));
    }

    #[test]
    fn the_nearest_vector_of_the_box_keeps_rows_that_are_inside() {
        let clamp = |x: [f64; 3]| bounds().clamp(&x.into());
        assert_eq!(clamp([-3.0, 0.0, 1e9]), Vector::from([-1.0, 0.5, 1e9]));
        assert_eq!(clamp([0.25, 0.7, -1e9]), Vector::from([0.25, 0.5, -1e9]));
        assert_eq!(clamp([f64::NAN, f64::NAN, f64::NAN]), Vector::from([-1.0, 0.5, -INF]));
    }
}
