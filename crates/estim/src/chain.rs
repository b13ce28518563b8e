//! Normal equations of a chain of states with one common parameter.
//!
//! Owns the sparse structure of moving horizon estimation and identification: a block-tridiagonal matrix of the
//! states, a border that couples each state with the parameter, and a parameter block. Elimination runs along the
//! chain once, so the cost is linear in its length. The entries of the blocks are computed in `residual.rs`; the
//! parameter's box is `reduced_system.rs`.

use std::borrow::Borrow;

use horizon_model::{Matrix, Vector, transpose};

use crate::back_substitution::{BackSubstitute, back_substitute};
use crate::cholesky::{Cholesky, NotPositive};
use crate::partition::{Partition, WholeOrPartition};
use crate::product::{mul, sub_mul, sub_outer, sub_square_lower, tr_mul};
use crate::reduced_system::ReducedSystem;

/// Row block `k` of the normal equations.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Block<const NS: usize, const NP: usize> {
    /// `H[k, k]`; only the lower triangle is read. 1 / (unit of the row, unit of the column)
    pub(crate) diagonal: Matrix<NS, NS>,
    /// `H[k, k-1]`; of block 0 it is not read. 1 / (unit of the row, unit of the column)
    pub(crate) before: Matrix<NS, NS>,
    /// `H[k, p]`. 1 / (unit of the row, unit of the column)
    pub(crate) border: Matrix<NS, NP>,
    /// Gradient by `s_k`. 1 / unit of the row
    pub(crate) gradient: Vector<NS>,
}

impl<const NS: usize, const NP: usize> Block<NS, NP> {
    pub(crate) fn zeros() -> Self {
        Self {
            diagonal: Matrix::zeros(),
            before: Matrix::zeros(),
            border: Matrix::zeros(),
            gradient: Vector::zeros(),
        }
    }

    /// Sets all entries to zero in place.
    #[inline]
    pub(crate) fn clear(&mut self) {
        self.diagonal.fill(0.0);
        self.before.fill(0.0);
        self.border.fill(0.0);
        self.gradient.fill(0.0);
    }
}

/// The blocks to which a transition adds: those of its two states and the parameter block.
#[derive(Debug)]
pub(crate) struct NeighbourBlocks<'a, const NS: usize, const NP: usize> {
    pub(crate) block: &'a mut Block<NS, NP>,
    pub(crate) next: &'a mut Block<NS, NP>,
    pub(crate) parameter_block: &'a mut ReducedSystem<NP>,
}

/// Row block `k` after elimination, in the letters of `docs/model.md`, section 4.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Eliminated<const NS: usize, const NP: usize> {
    /// `L_k`. 1 / unit of the row
    pub(crate) factor: Cholesky<NS>,
    /// `A_k'`. 1 / unit of the row
    pub(crate) before: Matrix<NS, NS>,
    /// `B_k'`. 1 / unit of the row
    pub(crate) border: Matrix<NP, NS>,
    /// `y_k`. 1
    pub(crate) gradient: Vector<NS>,
}

impl<const NS: usize, const NP: usize> Eliminated<NS, NP> {
    /// Zeros, to be overwritten by an elimination.
    pub(crate) fn zeros() -> Self {
        Self {
            factor: Cholesky::zeros(),
            before: Matrix::zeros(),
            border: Matrix::zeros(),
            gradient: Vector::zeros(),
        }
    }

    /// Eliminates the state of `block`, which follows that of `previous`, and overwrites `self` with the result;
    /// subtracts the contribution of the state from `reduced`.
    ///
    /// With `A_k = L_{k-1}^-1 H[k-1,k]` and `L_k L_k' = H[k,k] + damping I - A_k' A_k` the border becomes
    /// `B_k = L_k^-1 (H[k,p] - A_k' B_{k-1})`, the gradient `y_k = L_k^-1 (g_k - A_k' y_{k-1})`, and the parameter
    /// block loses `B_k' B_k` and `B_k' y_k`.
    ///
    /// # Errors
    /// The damped matrix is not positive definite; nothing is changed.
    #[inline]
    pub(crate) fn eliminate_after(
        &mut self,
        previous: Option<&Self>,
        block: &Block<NS, NP>,
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive> {
        let mut diagonal = block.diagonal;
        for row in 0..NS {
            diagonal[(row, row)] += damping;
        }
        let mut before = Matrix::zeros();
        let mut border = transpose(&block.border);
        let mut gradient = block.gradient;
        if let Some(previous) = previous {
            before = previous.factor.forward_rows(block.before);
            sub_square_lower(&mut diagonal, &before);
            sub_outer(&mut border, &previous.border, &before);
            sub_mul(&mut gradient, &before, &previous.gradient);
        }
        let factor = Cholesky::new(diagonal)?;
        let border = factor.forward_rows(border);
        let gradient = factor.forward(gradient);
        sub_outer(&mut reduced.hessian, &border, &border);
        sub_mul(&mut reduced.gradient, &border, &gradient);
        reduced.decrease += 0.5 * gradient.norm_squared();
        *self = Self { factor, before, border, gradient };
        Ok(())
    }

    /// Eliminates this state from the block of the next one: subtracts `A' A`, `A' B` and `A' y`.
    #[inline]
    pub(crate) fn eliminate_from(&self, next: &mut Block<NS, NP>) {
        let before = self.factor.forward_rows(next.before);
        sub_square_lower(&mut next.diagonal, &before);
        sub_outer(&mut next.border, &before, &self.border);
        sub_mul(&mut next.gradient, &before, &self.gradient);
    }

    /// Covariance of this state, the last one of its chain; `reduced` is the reduced Hessian of the parameter after the
    /// elimination of all states.
    ///
    /// The inverse of `[L L', L B; B' L', S + B' B]` has `L'^-1 (I + B S^-1 B') L^-1` in place of the state.
    ///
    /// # Errors
    /// `S`, that is `reduced`, is not positive definite.
    pub(crate) fn covariance(
        &self,
        reduced: &Matrix<NP, NP>,
    ) -> Result<Matrix<NS, NS>, NotPositive> {
        let root = self.factor.forward(Matrix::<NS, NS>::identity());
        let by_parameter = mul(&Cholesky::new(*reduced)?.forward(self.border), &root);
        Ok(tr_mul(&root, &root) + tr_mul(&by_parameter, &by_parameter))
    }
}

impl<const NS: usize, const NP: usize> BackSubstitute<NS, NP> for Eliminated<NS, NP> {
    #[inline]
    fn step(&self, p_step: &Vector<NP>, taken: &Vector<NS>) -> (Vector<NS>, Vector<NS>) {
        let right = -self.gradient - tr_mul(&self.border, p_step) - taken;
        let step = self.factor.backward(right);
        (step, tr_mul(&self.before, &step))
    }
}

/// The normal equations `(H + damping I) d = -gradient` of `NS`-blocks in a row and an `NP`-block of the parameter.
///
/// The buffers are allocated once for the longest chain expected; [`Chain::clear`] sets the length.
#[derive(Debug, Clone)]
pub(crate) struct Chain<const NS: usize, const NP: usize> {
    blocks: Vec<Block<NS, NP>>,
    /// `H[p, p]` and the gradient by `p`.
    pub(crate) parameter_block: ReducedSystem<NP>,
    /// The row blocks after elimination.
    eliminated: WholeOrPartition<Vec<Eliminated<NS, NP>>, NS, NP>,
    steps: Vec<Vector<NS>>,
}

impl<const NS: usize, const NP: usize> Chain<NS, NP> {
    /// An empty chain with room for `len_max` blocks.
    pub(crate) fn new(len_max: usize) -> Self {
        Self {
            blocks: Vec::with_capacity(len_max),
            parameter_block: ReducedSystem::zeros(),
            eliminated: WholeOrPartition::Whole(Vec::with_capacity(len_max)),
            steps: Vec::with_capacity(len_max),
        }
    }

    /// The chain, eliminated by the decoupled subsystems of `partition` if there is one. No accumulated entry may
    /// couple them.
    #[must_use]
    pub(crate) fn partitioned(self, partition: Option<Partition<NS, NP>>) -> Self {
        match partition {
            Some(partition) => Self { eliminated: WholeOrPartition::Partition(partition), ..self },
            None => self,
        }
    }

    /// Makes the chain `len` blocks of zero.
    ///
    /// Real time: no allocation up to `len_max` blocks; linear in their number.
    pub(crate) fn clear(&mut self, len: usize) {
        self.blocks.clear();
        self.blocks.resize(len, Block::zeros());
        self.parameter_block = ReducedSystem::zeros();
    }

    /// The row blocks, to accumulate into.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn blocks_mut(&mut self) -> &mut [Block<NS, NP>] {
        &mut self.blocks
    }

    /// The row blocks and the parameter block, to accumulate into.
    pub(crate) fn parts_mut(&mut self) -> (&mut [Block<NS, NP>], &mut ReducedSystem<NP>) {
        (&mut self.blocks, &mut self.parameter_block)
    }

    /// Keeps state `k` where it is: its step will be zero, whatever was accumulated for it.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn pin(&mut self, k: usize) {
        self.blocks[k] = Block { diagonal: Matrix::identity(), ..Block::zeros() };
        if let Some(next) = self.blocks.get_mut(k + 1) {
            next.before = Matrix::zeros();
        }
    }

    /// Largest diagonal entry of `H`, whatever its unit; NaN if any is.
    ///
    /// Real time: no allocation; linear in the number of blocks.
    pub(crate) fn diagonal_max(&self) -> f64 {
        // f64::max would drop a NaN.
        let larger = |max: f64, entry| if max.is_nan() || max >= entry { max } else { entry };
        let mut max = (0..NP).map(|i| self.parameter_block.hessian[(i, i)]).fold(0.0, larger);
        for block in &self.blocks {
            max = (0..NS).map(|i| block.diagonal[(i, i)]).fold(max, larger);
        }
        max
    }

    /// Eliminates every state and returns the reduced system in the parameter, the parameter block included. `damping`
    /// is added to every diagonal entry of the states, in the unit of the entry.
    ///
    /// Real time: no allocation up to `len_max` states; linear in their number, about `(NS + NP)^3` each.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(crate) fn eliminate(&mut self, damping: f64) -> Result<ReducedSystem<NP>, NotPositive> {
        let mut reduced = self.parameter_block;
        match &mut self.eliminated {
            WholeOrPartition::Whole(rows) => {
                eliminate(rows, self.blocks.iter(), damping, &mut reduced)?;
            }
            WholeOrPartition::Partition(partition) => {
                partition.eliminate(&self.blocks, damping, &mut reduced)?;
            }
        }
        Ok(reduced)
    }

    /// The steps of the states that belong to the parameter step `p_step`, in the order of `k`: NS rows each, in the
    /// units of the state.
    ///
    /// Valid after [`Chain::eliminate`].
    ///
    /// Real time: no allocation up to `len_max` states; linear in their number, about `NS (NS + NP)` each.
    pub(crate) fn back_substitute(&mut self, p_step: &Vector<NP>) -> &[Vector<NS>] {
        self.steps.resize(self.blocks.len(), Vector::zeros());
        match &self.eliminated {
            WholeOrPartition::Whole(rows) => {
                back_substitute(rows, p_step, self.blocks.len(), |k, step| self.steps[k] = step);
            }
            WholeOrPartition::Partition(partition) => {
                partition.back_substitute(p_step, &mut self.steps);
            }
        }
        &self.steps
    }

    /// Covariance of the last state, the other states and the parameter unknown, by the curvature of the last
    /// linearization: NS x NS, in the units of its rows.
    ///
    /// Valid after [`Chain::eliminate`] without damping, whose result `reduced` is.
    ///
    /// Real time: no allocation, constant cost: one factorization and two triangular solves per decoupled subsystem.
    ///
    /// # Errors
    /// The reduced system is not positive definite, or the chain is empty.
    pub(crate) fn last_covariance(
        &self,
        reduced: &ReducedSystem<NP>,
    ) -> Result<Matrix<NS, NS>, NotPositive> {
        let last = self.blocks.len().checked_sub(1).ok_or(NotPositive)?;
        match &self.eliminated {
            WholeOrPartition::Whole(rows) => {
                rows.get(last).ok_or(NotPositive)?.covariance(&reduced.hessian)
            }
            WholeOrPartition::Partition(partition) => partition.covariance(last, reduced),
        }
    }
}

/// Eliminates the states of `blocks` into `rows`; `reduced` loses their contributions.
///
/// # Errors
/// The damped matrix is not positive definite.
#[inline]
pub(crate) fn eliminate<const NS: usize, const NP: usize>(
    rows: &mut Vec<Eliminated<NS, NP>>,
    blocks: impl Iterator<Item = impl Borrow<Block<NS, NP>>>,
    damping: f64,
    reduced: &mut ReducedSystem<NP>,
) -> Result<(), NotPositive> {
    for (k, block) in blocks.enumerate() {
        if rows.len() == k {
            rows.push(Eliminated::zeros());
        }
        let (done, rest) = rows.split_at_mut(k);
        let row = rest.first_mut().ok_or(NotPositive)?;
        row.eliminate_after(done.last(), block.borrow(), damping, reduced)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests;
