//! The elimination of a long chain of which only the way back is kept.
//!
//! Owns what of an eliminated state its step needs: two thirds of what its elimination makes, which
//! counts where a chain has thousands of states and is written once for each reading. The elimination
//! itself is `chain.rs`.

use nalgebra::{SMatrix, SVector};

use crate::chain::{Block, Eliminated};
use crate::cholesky::NotPositive;
use crate::corner::Corner;
use crate::product::tr_mul;

/// The states that were eliminated last, each in the place of the one before the one before it.
#[derive(Debug, Clone)]
pub(crate) struct Front<const NS: usize, const NP: usize> {
    even: Eliminated<NS, NP>,
    odd: Eliminated<NS, NP>,
}

impl<const NS: usize, const NP: usize> Front<NS, NP> {
    /// No state yet.
    pub(crate) fn new() -> Self {
        Self { even: Eliminated::zeros(), odd: Eliminated::zeros() }
    }

    /// Eliminates the state of `block`, which is block `k`, those before it being eliminated, and takes
    /// its share from `reduced`. Returns it with the one before it, which is any where there is none.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
        reduced: &mut Corner<NP>,
    ) -> Result<(&Eliminated<NS, NP>, &Eliminated<NS, NP>), NotPositive> {
        let Self { even, odd } = self;
        let (row, previous) = if k.is_multiple_of(2) { (even, odd) } else { (odd, even) };
        row.become_after((k > 0).then_some(&*previous), block, damping, reduced)?;
        Ok((row, previous))
    }
}

/// The step of a state over those of the parameter and of the state after it, in the names of
/// [`Eliminated`].
#[derive(Debug, Clone, Copy)]
pub(crate) struct WayBack<const NS: usize, const NP: usize> {
    /// `L_k'^-1` times the gradient's.
    gradient: SVector<f64, NS>,
    /// The border's times `L_k^-1`.
    border: SMatrix<f64, NP, NS>,
    /// `before` times `L_{k-1}^-1`.
    before: SMatrix<f64, NS, NS>,
}

impl<const NS: usize, const NP: usize> WayBack<NS, NP> {
    /// The step of the state that belongs to the parameter step `p_step` and to `taken`, what the state
    /// after it takes from it, and what it takes from the one before.
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

/// The ways back of a chain that is eliminated a block at a time; their memory is used again.
#[derive(Debug, Clone)]
pub(crate) struct Rows<const NS: usize, const NP: usize> {
    front: Front<NS, NP>,
    ways: Vec<WayBack<NS, NP>>,
}

impl<const NS: usize, const NP: usize> Rows<NS, NP> {
    /// No rows, with room for `len_max`.
    pub(crate) fn new(len_max: usize) -> Self {
        Self { front: Front::new(), ways: Vec::with_capacity(len_max) }
    }

    /// [`Front::eliminate`], keeping the way back.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    #[inline]
    pub(crate) fn eliminate(
        &mut self,
        k: usize,
        block: &Block<NS, NP>,
        damping: f64,
        reduced: &mut Corner<NP>,
    ) -> Result<(), NotPositive> {
        let (row, previous) = self.front.eliminate(k, block, damping, reduced)?;
        let way = WayBack {
            gradient: row.factor.backward(row.gradient),
            border: row.factor.backward_rows(row.border),
            before: previous.factor.backward_rows(row.before),
        };
        match self.ways.get_mut(k) {
            Some(place) => *place = way,
            None => self.ways.push(way),
        }
        Ok(())
    }

    /// The rows, the first ones as they were eliminated last.
    pub(crate) fn as_slice(&self) -> &[WayBack<NS, NP>] {
        &self.ways
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::chain::Chain;

    #[test]
    fn the_way_back_is_that_of_the_chain() {
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
            let mut reduced = chain.corner;
            for (k, block) in chain.blocks_mut().iter().enumerate() {
                rows.eliminate(k, block, damping, &mut reduced).unwrap();
            }
            assert_eq!(chain.eliminate(damping), Ok(reduced));
            let mut taken = SVector::zeros();
            let expected = chain.back_substitute(&p_step).iter().zip(rows.as_slice()).rev();
            for (expected, row) in expected {
                let step;
                (step, taken) = row.step(&p_step, &taken);
                let gap = (step - expected).norm();
                assert!(gap < 1e-13, "gap {gap:e}");
            }
        }
    }
}
