//! Back substitution of a long chain that is eliminated block by block.
//!
//! Owns the rows that the back substitution needs, two thirds of the factors of the elimination. The smaller
//! rows matter for chains of thousands of states, whose rows are written once per read. The elimination itself
//! is `chain.rs`, its division into decoupled subsystems `partition.rs`.

use horizon_model::Model;
use nalgebra::{SMatrix, SVector};

use crate::chain::{Block, Eliminated};
use crate::cholesky::NotPositive;
use crate::partition::Partition;
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
        row.become_after((k > 0).then_some(&*previous), block, damping, reduced)?;
        Ok((row, previous))
    }
}

/// One row of the back substitution: the step of a state from the steps of the parameter and the next state. Names
/// as in [`Eliminated`], letters as in `docs/model.md`, section 4.
#[derive(Debug, Clone, Copy)]
pub(crate) struct BackSubstitution<const NS: usize, const NP: usize> {
    /// `L_k'^-1 y_k`.
    gradient: SVector<f64, NS>,
    /// `(L_k'^-1 B_k)'`.
    border: SMatrix<f64, NP, NS>,
    /// `(L_{k-1}'^-1 A_k)'`.
    before: SMatrix<f64, NS, NS>,
}

impl<const NS: usize, const NP: usize> BackSubstitution<NS, NP> {
    /// The step of the state from the parameter step `p_step` and `taken`, the contribution of the next state. The
    /// contribution to the previous state is returned, too.
    #[inline]
    pub(crate) fn step(
        &self,
        p_step: &SVector<f64, NP>,
        taken: &SVector<f64, NS>,
    ) -> (SVector<f64, NS>, SVector<f64, NS>) {
        let step = -self.gradient - tr_mul(&self.border, p_step) - taken;
        (step, tr_mul(&self.before, &step))
    }
}

/// The rows of the back substitution of a chain that is eliminated block by block, and what is left for the
/// parameter. Their memory is reused.
#[derive(Debug, Clone)]
pub(crate) struct Rows<const NS: usize, const NP: usize> {
    front: EliminationFront<NS, NP>,
    reduced: ReducedSystem<NP>,
    steps: Vec<BackSubstitution<NS, NP>>,
}

impl<const NS: usize, const NP: usize> Rows<NS, NP> {
    /// No rows, with room for `len_max`.
    pub(crate) fn new(len_max: usize) -> Self {
        Self {
            front: EliminationFront::new(),
            reduced: ReducedSystem::zeros(),
            steps: Vec::with_capacity(len_max),
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
        let (row, previous) = self.front.eliminate(k, block, damping, &mut self.reduced)?;
        let step = BackSubstitution {
            gradient: row.factor.backward(row.gradient),
            border: row.factor.backward_rows(row.border),
            before: previous.factor.backward_rows(row.before),
        };
        match self.steps.get_mut(k) {
            Some(place) => *place = step,
            None => self.steps.push(step),
        }
        Ok(())
    }

    /// What the eliminated states leave for the parameter, the parameter block left out.
    pub(crate) fn reduced(&self) -> &ReducedSystem<NP> {
        &self.reduced
    }

    /// Tells `put` the steps of the first `len` states, the last one first.
    #[inline]
    pub(crate) fn back_substitute(
        &self,
        p_step: &SVector<f64, NP>,
        len: usize,
        mut put: impl FnMut(usize, &SVector<f64, NS>),
    ) {
        let mut taken = SVector::zeros();
        for (k, row) in self.steps.iter().enumerate().take(len).rev() {
            let step;
            (step, taken) = row.step(p_step, &taken);
            put(k, &step);
        }
    }
}

/// [`Rows`] of a whole system or of its decoupled subsystems. What couples the subsystems is left out.
#[derive(Debug, Clone)]
pub(crate) enum LongChain<const NS: usize, const NP: usize> {
    Whole(Rows<NS, NP>),
    Partition(Partition<NS, NP>),
}

impl<const NS: usize, const NP: usize> LongChain<NS, NP> {
    /// No rows, with room for `len_max` unless the model `M` has subsystems.
    pub(crate) fn of<M, const NU: usize, const NO: usize>(len_max: usize) -> Self
    where
        M: Model<NS, NU, NO, NP>,
    {
        let whole = || Self::Whole(Rows::new(len_max));
        Partition::of::<M, NU, NO>(0).map_or_else(whole, Self::Partition)
    }

    /// As [`Rows::eliminate`].
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
            Self::Whole(rows) => rows.eliminate(k, block, damping),
            Self::Partition(partition) => partition.eliminate_one(k, block, damping),
        }
    }

    /// What the eliminated states leave for the parameter, `parameter_block` included.
    pub(crate) fn reduced(&self, parameter_block: &ReducedSystem<NP>) -> ReducedSystem<NP> {
        match self {
            Self::Whole(rows) => {
                let mut sum = *rows.reduced();
                sum += parameter_block;
                sum
            }
            Self::Partition(partition) => partition.reduced(parameter_block),
        }
    }

    /// Writes the steps of the first states that belong to the parameter step `p_step`, as many as `steps`.
    pub(crate) fn back_substitute(
        &self,
        p_step: &SVector<f64, NP>,
        steps: &mut [SVector<f64, NS>],
    ) {
        match self {
            Self::Whole(rows) => {
                rows.back_substitute(p_step, steps.len(), |k, step| steps[k] = *step);
            }
            Self::Partition(partition) => partition.back_substitute_long(p_step, steps),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::Chain;

    #[test]
    fn the_back_substitution_is_that_of_the_chain() {
        let entry = |k: usize, i: usize, j: usize| ((7 * k + 3 * i + 5 * j) % 11) as f64 - 5.0;
        let mut chain = Chain::<3, 2>::new(5);
        chain.clear(5);
        for (k, block) in chain.blocks_mut().iter_mut().enumerate() {
            block.diagonal = SMatrix::from_diagonal_element(40.0);
            block.before = SMatrix::from_fn(|i, j| entry(k, i, j));
            block.border = SMatrix::from_fn(|i, j| entry(k + 1, i, j));
            block.gradient = SVector::from_fn(|i, _| entry(k + 2, i, 0));
        }
        let p_step = SVector::from([0.3, -0.7]);
        let mut rows = Rows::new(0);
        // The second time in the places of the first.
        for damping in [1.0, 0.5] {
            for (k, block) in chain.blocks_mut().iter().enumerate() {
                rows.eliminate(k, block, damping).unwrap();
            }
            assert_eq!(chain.eliminate(damping).as_ref(), Ok(rows.reduced()));
            let expected = chain.back_substitute(&p_step);
            rows.back_substitute(&p_step, expected.len(), |k, step| {
                let gap = (step - expected[k]).norm();
                assert!(gap < 1e-13, "gap {gap:e}");
            });
        }
    }
}
