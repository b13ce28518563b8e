//! Decoupled subsystems of a model, and their rows in vectors and matrices.
//!
//! Owns no solver: elimination by subsystems belongs to the estimator.

use std::array;

use crate::{Matrix, Vector};

/// Rows that are decoupled from the others: their values after a step depend on these rows alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Subsystem {
    /// Rows of the state, ascending.
    pub states: &'static [usize],
    /// Rows of the input, ascending.
    pub inputs: &'static [usize],
    /// Rows of the parameter, ascending.
    pub parameters: &'static [usize],
}

/// Visitor of the decoupled subsystems of a model. Their sizes are part of the type, so that a solver can have blocks
/// of exactly these sizes.
pub trait VisitSubsystems {
    /// A subsystem of `S` states and `P` parameters; rows as in [`Subsystem`].
    fn visit<const S: usize, const P: usize>(
        &mut self,
        states: &'static [usize; S],
        inputs: &'static [usize],
        parameters: &'static [usize; P],
    );
}

impl VisitSubsystems for Vec<Subsystem> {
    fn visit<const S: usize, const P: usize>(
        &mut self,
        states: &'static [usize; S],
        inputs: &'static [usize],
        parameters: &'static [usize; P],
    ) {
        self.push(Subsystem { states, inputs, parameters });
    }
}

/// The entries of `v` at `rows`, in their order: R of N, in the unit of each row. Each index is below N.
///
/// Real time: no allocation, R copies.
#[inline]
pub fn select_rows<const N: usize, const R: usize>(v: &Vector<N>, rows: &[usize; R]) -> Vector<R> {
    Vector::from_fn(|row, _| v[rows[row]])
}

/// Writes `part`, R x C, to the entries of `whole`, M x N, at `rows` and `columns`: the inverse of [`submatrix`]. The
/// other entries stay. Each index is below M or N.
///
/// Real time: no allocation, `R C` copies.
#[inline]
pub fn scatter<const M: usize, const N: usize, const R: usize, const C: usize>(
    part: &Matrix<R, C>,
    rows: &[usize; R],
    columns: &[usize; C],
    whole: &mut Matrix<M, N>,
) {
    for (column, part) in columns.iter().zip(&part.data.0) {
        let whole = &mut whole.data.0[*column];
        for (row, entry) in rows.iter().zip(part) {
            whole[*row] = *entry;
        }
    }
}

/// The entries of `m`, M x N, at `rows` and `columns`, in their order: R x C. Each index is below M or N.
///
/// Real time: no allocation, `R C` copies.
#[inline]
pub fn submatrix<const M: usize, const N: usize, const R: usize, const C: usize>(
    m: &Matrix<M, N>,
    rows: &[usize; R],
    columns: &[usize; C],
) -> Matrix<R, C> {
    Matrix::from(array::from_fn::<[f64; R], C, _>(|col| {
        let column = &m.data.0[columns[col]];
        array::from_fn(|row| column[rows[row]])
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_submatrix_is_scattered_back_to_its_rows_and_nothing_else_moves() {
        let whole = Matrix::<4, 3>::from_fn(|i, j| (10 * i + j) as f64);
        let (rows, columns) = ([1, 3], [0, 2]);
        let part = submatrix(&whole, &rows, &columns);
        assert_eq!(part, Matrix::<2, 2>::new(10.0, 12.0, 30.0, 32.0));
        let mut changed = whole;
        scatter(&-part, &rows, &columns, &mut changed);
        for (i, j) in (0..4).flat_map(|i| (0..3).map(move |j| (i, j))) {
            let sign = if rows.contains(&i) && columns.contains(&j) { -1.0 } else { 1.0 };
            assert!((changed[(i, j)] - sign * whole[(i, j)]).abs() < 1e-15, "{i}, {j}");
        }
        let column = whole.column(2).into_owned();
        assert_eq!(select_rows(&column, &rows), Vector::from([12.0, 32.0]));
    }

    #[test]
    fn subsystems_are_collected_in_their_order() {
        let mut subsystems = Vec::new();
        subsystems.visit(&[0, 2], &[1], &[3]);
        subsystems.visit(&[1], &[], &[]);
        let second = Subsystem { states: &[1], inputs: &[], parameters: &[] };
        assert_eq!(
            subsystems,
            [Subsystem { states: &[0, 2], inputs: &[1], parameters: &[3] }, second]
        );
    }
}
