//! Back substitution, and the long chain that is eliminated block by block.
//!
//! Owns the loop of the back substitution, and the rows that a long chain keeps for it: two thirds of the memory of the
//! factors, which matters for chains of thousands of states, whose rows are written once and read once. The elimination
//! itself is `chain.rs`, its partition into decoupled subsystems `partition.rs`.

use horizon_model::{Matrix, Model, Vector};

use crate::chain::{Block, Eliminated};
use crate::cholesky::NotPositive;
use crate::partition::{Partition, WholeOrPartition};
use crate::product::tr_mul;
use crate::reduced_system::ReducedSystem;

/// The elimination front: ring buffer of the last two eliminated blocks.
#[derive(Debug, Clone)]
pub(crate) struct EliminationFront<const NS: usize, const NP: usize> {
    even: Eliminated<NS, NP>,
    odd: Eliminated<NS, NP>,
}

impl<const NS: usize, const NP: usize> EliminationFront<NS, NP> {
    /// No state yet.
    pub(crate) fn new() -> Self {
        Self { even: Eliminated::zeros(), odd: Eliminated::zeros() }
    }

    /// Eliminates the state of block `k` after the blocks before it, and subtracts its contribution from
    /// `reduced`. Returns the eliminated block and the previous one; at `k = 0` the previous one has no meaning.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(&Eliminated<NS, NP>, &Eliminated<NS, NP>), NotPositive> {
        let Self { even, odd } = self;
        let (row, previous) = if k.is_multiple_of(2) { (even, odd) } else { (odd, even) };
        row.eliminate_after((k > 0).then_some(&*previous), block, damping, reduced)?;
        Ok((row, previous))
    }
}

/// A row of the back substitution.
pub(crate) trait BackSubstitute<const NS: usize, const NP: usize> {
    /// The step of the state from the parameter step `p_step` and `taken`, the contribution of the next state, and the
    /// contribution of this state to the previous one.
    fn step(&self, p_step: &Vector<NP>, taken: &Vector<NS>) -> (Vector<NS>, Vector<NS>);
}

/// Passes the steps of the first `len` states to `put`, the last one first.
#[inline]
pub(crate) fn back_substitute<const NS: usize, const NP: usize>(
    rows: &[impl BackSubstitute<NS, NP>],
    p_step: &Vector<NP>,
    len: usize,
    mut put: impl FnMut(usize, Vector<NS>),
) {
    let mut taken = Vector::zeros();
    for (k, row) in rows.iter().enumerate().take(len).rev() {
        let step;
        (step, taken) = row.step(p_step, &taken);
        put(k, step);
    }
}

/// A row of the back substitution whose factor is divided out. Names as in [`Eliminated`], letters as in
/// `docs/model.md`, section 4.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SolvedRow<const NS: usize, const NP: usize> {
    /// `L_k'^-1 y_k`.
    gradient: Vector<NS>,
    /// `(L_k'^-1 B_k)'`.
    border: Matrix<NP, NS>,
    /// `(L_{k-1}'^-1 A_k)'`.
    before: Matrix<NS, NS>,
}

impl<const NS: usize, const NP: usize> BackSubstitute<NS, NP> for SolvedRow<NS, NP> {
    #[inline]
    fn step(&self, p_step: &Vector<NP>, taken: &Vector<NS>) -> (Vector<NS>, Vector<NS>) {
        let step = -self.gradient - tr_mul(&self.border, p_step) - taken;
        (step, tr_mul(&self.before, &step))
    }
}

/// Elimination of a long chain block by block: the rows of its back substitution, and the reduced system without the
/// parameter block. Their memory is reused.
#[derive(Debug, Clone)]
pub(crate) struct LongElimination<const NS: usize, const NP: usize> {
    front: EliminationFront<NS, NP>,
    reduced: ReducedSystem<NP>,
    rows: Vec<SolvedRow<NS, NP>>,
}

impl<const NS: usize, const NP: usize> LongElimination<NS, NP> {
    /// No rows, with room for `len_max`.
    pub(crate) fn new(len_max: usize) -> Self {
        Self {
            front: EliminationFront::new(),
            reduced: ReducedSystem::zeros(),
            rows: Vec::with_capacity(len_max),
        }
    }

    /// [`EliminationFront::eliminate`], keeping the row of the back substitution.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
    ) -> Result<(), NotPositive> {
        if k == 0 {
            self.reduced = ReducedSystem::zeros();
        }
        let (eliminated, previous) = self.front.eliminate(k, block, damping, &mut self.reduced)?;
        let row = SolvedRow {
            gradient: eliminated.factor.backward(eliminated.gradient),
            border: eliminated.factor.backward_rows(eliminated.border),
            before: previous.factor.backward_rows(eliminated.before),
        };
        match self.rows.get_mut(k) {
            Some(place) => *place = row,
            None => self.rows.push(row),
        }
        Ok(())
    }

    /// What the eliminated states leave for the parameter, the parameter block left out.
    pub(crate) fn reduced(&self) -> &ReducedSystem<NP> {
        &self.reduced
    }

    /// The rows of the back substitution, in the order of `k`.
    pub(crate) fn rows(&self) -> &[SolvedRow<NS, NP>] {
        &self.rows
    }
}

/// A chain that is eliminated block by block. What couples its decoupled subsystems is left out.
pub(crate) type LongChain<const NS: usize, const NP: usize> =
    WholeOrPartition<LongElimination<NS, NP>, NS, NP>;

impl<const NS: usize, const NP: usize> LongChain<NS, NP> {
    /// No rows, with room for `len_max` unless the model `M` has subsystems.
    pub(crate) fn of<M, const NU: usize, const NO: usize>(len_max: usize) -> Self
    where
        M: Model<NS, NU, NO, NP>,
    {
        let whole = || Self::Whole(LongElimination::new(len_max));
        Partition::of::<M, NU, NO>(0).map_or_else(whole, Self::Partition)
    }

    /// Eliminates `block`, the next of the chain, as [`LongElimination::eliminate`] does.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
    ) -> Result<(), NotPositive> {
        match self {
            Self::Whole(whole) => whole.eliminate(k, block, damping),
            Self::Partition(partition) => partition.eliminate_state(k, block, damping),
        }
    }

    /// What the eliminated states leave for the parameter, `parameter_block` included.
    pub(crate) fn reduced(&self, parameter_block: &ReducedSystem<NP>) -> ReducedSystem<NP> {
        match self {
            Self::Whole(whole) => {
                let mut sum = *whole.reduced();
                sum += parameter_block;
                sum
            }
            Self::Partition(partition) => partition.reduced(parameter_block),
        }
    }

    /// Writes the steps of the first states that belong to the parameter step `p_step`, as many as `steps`.
    pub(crate) fn back_substitute(&self, p_step: &Vector<NP>, steps: &mut [Vector<NS>]) {
        match self {
            Self::Whole(whole) => {
                back_substitute(whole.rows(), p_step, steps.len(), |k, step| steps[k] = step);
            }
            Self::Partition(partition) => partition.back_substitute_states(p_step, steps),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::Chain;
    use horizon_model::{Matrix, Vector};

    #[test]
    fn the_back_substitution_is_that_of_the_chain() {
        let entry = |k: usize, i: usize, j: usize| ((7 * k + 3 * i + 5 * j) % 11) as f64 - 5.0;
        let mut chain = Chain::<3, 2>::new(5);
        chain.clear(5);
        for (k, block) in chain.blocks_mut().iter_mut().enumerate() {
            block.diagonal = Matrix::from_diagonal_element(40.0);
            block.before = Matrix::from_fn(|i, j| entry(k, i, j));
            block.border = Matrix::from_fn(|i, j| entry(k + 1, i, j));
            block.gradient = Vector::from_fn(|i, _| entry(k + 2, i, 0));
        }
        let p_step = Vector::from([0.3, -0.7]);
        let mut long = LongElimination::new(0);
        // The second time in the places of the first.
        for damping in [1.0, 0.5] {
            for (k, block) in chain.blocks_mut().iter().enumerate() {
                long.eliminate(k, block, damping).unwrap();
            }
            assert_eq!(chain.eliminate(damping).as_ref(), Ok(long.reduced()));
            let expected = chain.back_substitute(&p_step);
            back_substitute(long.rows(), &p_step, expected.len(), |k, step| {
                let gap = (step - expected[k]).norm();
                assert!(gap < 1e-13, "gap {gap:e}");
            });
        }
    }
}
