//! The same elimination by a general sparse factorization: the check of `chain.rs`.
//!
//! Owns nothing of the structure: it writes the matrix of all states entry by entry and leaves it to
//! the sparse Cholesky factorization of faer. Several times slower than the chain.

use std::convert::Infallible;

use faer::Mat;
use faer::linalg::solvers::SolveCore;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{SparseColMat, Triplet};
use faer::{Conj, Side};
use horizon_model::Model;
use nalgebra::SVector;

use super::segment::{Segment, Terms};
use crate::chain::Block;
use crate::cholesky::NotPositive;
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate};

/// The solution of the last factorized system.
#[derive(Debug, Clone)]
pub(super) struct Sparse {
    /// `(H + damping I)^-1` times the gradient (first column) and the border, a row per row of a state
    /// of a piece that counts.
    solution: Mat<f64>,
}

impl Default for Sparse {
    fn default() -> Self {
        Self { solution: Mat::new() }
    }
}

/// Column of the gradient in [`Sparse::solution`]; those of the border follow.
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
        p: &SVector<f64, NP>,
        curvature: Curvature,
        damping: f64,
    ) -> Result<ReducedSystem<NP>, NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut reduced = ReducedSystem::zeros();
        let mut blocks = Vec::new();
        for (segment, count) in counted {
            let Segment { s, u, o, s_rest, .. } = segment;
            let mut parameter_block = ReducedSystem::zeros();
            let take = |k: usize, block: &mut Block<NS, NP>, _| {
                blocks.push((*count, k > 0, *block));
                Ok::<_, Infallible>(())
            };
            let Ok(()) = terms.assemble(
                &Iterate { s, u, o, p },
                s_rest,
                curvature,
                &mut parameter_block,
                take,
            );
            reduced += &parameter_block.times(*count);
        }
        self.solution = solve(&blocks, damping)?;
        for (at, (count, _, block)) in blocks.iter().enumerate() {
            let mut contribution = ReducedSystem::zeros();
            for i in 0..NS {
                let row = |column: usize| self.solution[(at * NS + i, column)];
                contribution.decrease += 0.5 * block.gradient[i] * row(GRADIENT);
                for j in 0..NP {
                    contribution.gradient[j] -= block.border[(i, j)] * row(GRADIENT);
                    for l in 0..NP {
                        contribution.hessian[(j, l)] -=
                            block.border[(i, j)] * row(GRADIENT + 1 + l);
                    }
                }
            }
            reduced += &contribution.times(*count);
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
        p_step: &SVector<f64, NP>,
    ) {
        let mut row = 0;
        for Segment { s, s_candidate, .. } in counted {
            for (s, s_candidate) in s.iter().zip(s_candidate) {
                *s_candidate = SVector::from_fn(|i, _| {
                    let of_parameter =
                        |j: usize| self.solution[(row + i, GRADIENT + 1 + j)] * p_step[j];
                    let step =
                        self.solution[(row + i, GRADIENT)] + (0..NP).map(of_parameter).sum::<f64>();
                    s[i] - step
                });
                row += NS;
            }
        }
    }
}

/// Gradients and borders multiplied by the inverse of the damped matrix. Each block comes with its
/// count and whether it touches the one before.
fn solve<const NS: usize, const NP: usize>(
    blocks: &[(u32, bool, Block<NS, NP>)],
    damping: f64,
) -> Result<Mat<f64>, NotPositive> {
    let size = blocks.len() * NS;
    let mut lower = Vec::new();
    for (at, (_, touches_before, block)) in blocks.iter().enumerate() {
        for i in 0..NS {
            let row = at * NS + i;
            for j in 0..=i {
                let damping = if i == j { damping } else { 0.0 };
                lower.push(Triplet::new(row, at * NS + j, block.diagonal[(i, j)] + damping));
            }
            let before = (0..NS).filter(|_| *touches_before);
            lower
                .extend(before.map(|j| Triplet::new(row, (at - 1) * NS + j, block.before[(i, j)])));
        }
    }
    let matrix = SparseColMat::try_new_from_triplets(size, size, &lower).or(Err(NotPositive))?;
    let symbolic = SymbolicLlt::try_new(matrix.symbolic(), Side::Lower).or(Err(NotPositive))?;
    let factor =
        Llt::try_new_with_symbolic(symbolic, matrix.as_ref(), Side::Lower).or(Err(NotPositive))?;
    let mut solution = Mat::from_fn(size, GRADIENT + 1 + NP, |row, column| {
        let (_, _, block) = &blocks[row / NS];
        match column {
            GRADIENT => block.gradient[row % NS],
            _ => block.border[(row % NS, column - GRADIENT - 1)],
        }
    });
    factor.solve_in_place_with_conj(Conj::No, solution.as_mut());
    Ok(solution)
}
