//! The elimination of the states by a general sparse factorization: the oracle of `chain.rs`.
//!
//! Owns nothing of the chain's structure: it writes the matrix of all states of a piece entry by entry and leaves
//! it to the sparse Cholesky factorization of nalgebra.

use std::convert::Infallible;

use horizon_model::{Model, Vector};
use nalgebra::DMatrix;
use nalgebra_sparse::factorization::CscCholesky;
use nalgebra_sparse::{CooMatrix, CscMatrix};

use crate::chain::Block;
use crate::cholesky::NotPositive;
use crate::ident::segment::{Segment, Terms};
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate};

/// The solution of the last factorized system.
#[derive(Debug, Clone, Default)]
pub(super) struct Sparse {
    /// Of each piece that counts: `(H + damping I)^-1` times the gradient (first column) and the border, a row per
    /// row of a state.
    solutions: Vec<DMatrix<f64>>,
}

/// Column of the gradient in [`Sparse::solutions`]; those of the border follow.
const GRADIENT: usize = 0;

impl Sparse {
    /// Eliminates every state and returns what is left for the parameter, prior excluded.
    ///
    /// # Errors
    /// The damped matrix of the states is not positive definite.
    pub(super) fn eliminate<
        'a,
        M,
        const NS: usize,
        const NU: usize,
        const NO: usize,
        const NP: usize,
    >(
        &mut self,
        counted: impl Iterator<Item = (&'a Segment<NS, NU, NO, NP>, &'a u32)>,
        terms: &Terms<M, NS, NU, NO, NP>,
        p: &Vector<NP>,
        curvature: Curvature,
        damping: f64,
    ) -> Result<ReducedSystem<NP>, NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut reduced = ReducedSystem::zeros();
        self.solutions.clear();
        for (segment, count) in counted {
            let Segment { s, u, o, s_rest, .. } = segment;
            let mut sum = ReducedSystem::zeros();
            let mut blocks = Vec::with_capacity(s.len());
            let take = |_, block: &mut Block<NS, NP>, _| {
                blocks.push(*block);
                Ok::<_, Infallible>(())
            };
            let Ok(()) = terms.assemble(&Iterate { s, u, o, p }, s_rest, curvature, &mut sum, take);
            let solution = solve(&blocks, damping)?;
            for (at, block) in blocks.iter().enumerate() {
                for i in 0..NS {
                    let row = |column: usize| solution[(at * NS + i, column)];
                    sum.decrease += 0.5 * block.gradient[i] * row(GRADIENT);
                    for j in 0..NP {
                        sum.gradient[j] -= block.border[(i, j)] * row(GRADIENT);
                        for l in 0..NP {
                            sum.hessian[(j, l)] -= block.border[(i, j)] * row(GRADIENT + 1 + l);
                        }
                    }
                }
            }
            reduced += &sum.times(*count);
            self.solutions.push(solution);
        }
        Ok(reduced)
    }

    /// Sets the candidates of the pieces of the last elimination.
    pub(super) fn move_candidates<
        'a,
        const NS: usize,
        const NU: usize,
        const NO: usize,
        const NP: usize,
    >(
        &self,
        counted: impl Iterator<Item = &'a mut Segment<NS, NU, NO, NP>>,
        p_step: &Vector<NP>,
    ) {
        for (Segment { s, s_candidate, .. }, solution) in counted.zip(&self.solutions) {
            for (at, (s, s_candidate)) in s.iter().zip(s_candidate).enumerate() {
                *s_candidate = Vector::from_fn(|i, _| {
                    let row = |column: usize| solution[(at * NS + i, column)];
                    let of_parameter = (0..NP).map(|j| row(GRADIENT + 1 + j) * p_step[j]);
                    s[i] - (row(GRADIENT) + of_parameter.sum::<f64>())
                });
            }
        }
    }
}

/// Gradients and borders of a piece multiplied by the inverse of its damped matrix.
///
/// # Errors
/// The damped matrix is not positive definite.
fn solve<const NS: usize, const NP: usize>(
    blocks: &[Block<NS, NP>],
    damping: f64,
) -> Result<DMatrix<f64>, NotPositive> {
    let size = blocks.len() * NS;
    let mut matrix = CooMatrix::new(size, size);
    for (at, block) in blocks.iter().enumerate() {
        for i in 0..NS {
            let row = at * NS + i;
            for j in 0..NS {
                let damping = if i == j { damping } else { 0.0 };
                matrix.push(row, at * NS + j, block.diagonal[(i, j)] + damping);
                // The first state touches none before it.
                if let Some(before) = at.checked_sub(1) {
                    let column = before * NS + j;
                    matrix.push(row, column, block.before[(i, j)]);
                    matrix.push(column, row, block.before[(i, j)]);
                }
            }
        }
    }
    let factor = CscCholesky::factor(&CscMatrix::from(&matrix)).or(Err(NotPositive))?;
    let mut solution = DMatrix::from_fn(size, GRADIENT + 1 + NP, |row, column| {
        let block = &blocks[row / NS];
        match column {
            GRADIENT => block.gradient[row % NS],
            _ => block.border[(row % NS, column - GRADIENT - 1)],
        }
    });
    factor.solve_mut(&mut solution);
    Ok(solution)
}

#[cfg(test)]
mod tests {
    use horizon_model::Matrix;
    use horizon_model::check::amax;
    use nalgebra::DVector;
    use proptest::strategy::{Strategy, ValueTree};
    use proptest::test_runner::TestRunner;

    use super::*;

    const NS: usize = 3;
    const NP: usize = 2;
    const LEN: usize = 4;
    const SIZE: usize = LEN * NS;

    /// Random blocks and the matrix that they are part of.
    fn random() -> (Vec<Block<NS, NP>>, DMatrix<f64>) {
        let mut runner = TestRunner::deterministic();
        let mut draw = || (-1.0..1.0_f64).new_tree(&mut runner).unwrap().current();
        // Each row touches a state and the one after it.
        let root = DMatrix::from_fn(2 * SIZE, SIZE, |row, column| {
            let (of_row, of_column) = (row / (2 * NS), column / NS);
            if (of_row..of_row + 2).contains(&of_column) { draw() } else { 0.0 }
        });
        let matrix = root.tr_mul(&root);
        let block = |k: usize| Block {
            diagonal: matrix.fixed_view::<NS, NS>(k * NS, k * NS).into(),
            before: match k.checked_sub(1) {
                Some(before) => matrix.fixed_view::<NS, NS>(k * NS, before * NS).into(),
                None => Matrix::zeros(),
            },
            border: Matrix::from_fn(|_, _| draw()),
            gradient: Vector::from_fn(|_, _| draw()),
        };
        ((0..LEN).map(block).collect(), matrix)
    }

    #[test]
    fn the_solution_is_that_of_the_dense_matrix() {
        let (mut blocks, matrix) = random();
        // As documented these are not read.
        blocks[0].before.fill(f64::NAN);
        for block in &mut blocks {
            block.diagonal.fill_upper_triangle(f64::NAN, 1);
        }
        for damping in [0.1, 10.0] {
            let solution = solve(&blocks, damping).unwrap();
            let dense = (&matrix + DMatrix::identity(SIZE, SIZE) * damping).lu();
            let gradient = DVector::from_fn(SIZE, |row, _| blocks[row / NS].gradient[row % NS]);
            let gap = amax(&(solution.column(GRADIENT) - dense.solve(&gradient).unwrap()));
            // The damping bounds the condition number by about 100.
            assert!(gap < 1e-12, "gradient: {gap:e} with damping {damping}");
            let border =
                DMatrix::from_fn(SIZE, NP, |row, j| blocks[row / NS].border[(row % NS, j)]);
            let gap = amax(&(solution.columns(GRADIENT + 1, NP) - dense.solve(&border).unwrap()));
            assert!(gap < 1e-12, "border: {gap:e} with damping {damping}");
        }
    }

    #[test]
    fn a_matrix_that_damping_leaves_indefinite_is_refused() {
        let (mut blocks, _) = random();
        blocks[2].diagonal[(1, 1)] = -1.0;
        assert!(solve(&blocks, 0.5).is_err());
        assert!(solve(&blocks, 100.0).is_ok());
        blocks[2].diagonal[(1, 1)] = f64::NAN;
        assert!(solve(&blocks, 100.0).is_err());
    }
}
