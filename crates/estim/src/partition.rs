//! Block-diagonal partition of the normal equations into two decoupled subsystems.
//!
//! Owns which rows belong to which subsystem. No entry couples the subsystems, so their solutions together are the
//! solution. The cost of an elimination grows with the cube of its rows.

use horizon_model::Group;
use horizon_model::group::{cut, pick, put};
use nalgebra::SVector;

use crate::arrival::{Fading, Folded, fold};
use crate::chain::{Block, Eliminated, back_substitute, eliminate};
use crate::cholesky::NotPositive;
use crate::reduced_system::ReducedSystem;

/// The partition of the lagged vehicle. Block sizes known at compile time make an elimination fast, so every pair of
/// sizes is a type of its own.
pub(crate) type LaggedPartition = Partition<8, 8, 3, 3>;

/// Two subsystems of `S` states and `P` parameters each, with their eliminated rows.
#[derive(Debug, Clone)]
pub(crate) struct Partition<const S1: usize, const P1: usize, const S2: usize, const P2: usize> {
    first: Subsystem<S1, P1>,
    second: Subsystem<S2, P2>,
}

impl<const S1: usize, const P1: usize, const S2: usize, const P2: usize> Partition<S1, P1, S2, P2> {
    /// Room for `len_max` states; `None` if `groups` are not two of this size that hold all of `NS` states and
    /// `NP` parameters.
    pub(crate) fn new<const NS: usize, const NP: usize>(
        groups: &[Group],
        len_max: usize,
    ) -> Option<Self> {
        let [first, second] = groups else { return None };
        let partition = Self {
            first: Subsystem::new(first, len_max)?,
            second: Subsystem::new(second, len_max)?,
        };
        (S1 + S2 == NS && P1 + P2 == NP).then_some(partition)
    }

    /// As [`eliminate`].
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(crate) fn eliminate<const NS: usize, const NP: usize>(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive> {
        self.first.eliminate(blocks, damping, reduced)?;
        self.second.eliminate(blocks, damping, reduced)
    }

    /// As [`back_substitute`].
    pub(crate) fn back_substitute<const NS: usize, const NP: usize>(
        &self,
        p_step: &SVector<f64, NP>,
        steps: &mut [SVector<f64, NS>],
    ) {
        self.first.back_substitute(p_step, steps);
        self.second.back_substitute(p_step, steps);
    }

    /// As [`fold`].
    ///
    /// # Errors
    /// The matrix is not positive definite.
    pub(crate) fn fold<const NS: usize, const NP: usize>(
        &self,
        block: &Block<NS, NP>,
        next: &Block<NS, NP>,
        parameter_block: &ReducedSystem<NP>,
        fading: Option<&Fading<NP>>,
    ) -> Result<Folded<NS, NP>, NotPositive> {
        let mut folded = Folded::zeros();
        self.first.fold((block, next, parameter_block, fading), &mut folded)?;
        self.second.fold((block, next, parameter_block, fading), &mut folded)?;
        Ok(folded)
    }
}

/// Arguments of [`fold`].
type ToFold<'a, const NS: usize, const NP: usize> =
    (&'a Block<NS, NP>, &'a Block<NS, NP>, &'a ReducedSystem<NP>, Option<&'a Fading<NP>>);

/// One decoupled subsystem.
#[derive(Debug, Clone)]
struct Subsystem<const S: usize, const P: usize> {
    states: [usize; S],
    parameters: [usize; P],
    rows: Vec<Eliminated<S, P>>,
}

impl<const S: usize, const P: usize> Subsystem<S, P> {
    fn new(group: &Group, len_max: usize) -> Option<Self> {
        Some(Self {
            states: group.states.try_into().ok()?,
            parameters: group.parameters.try_into().ok()?,
            rows: Vec::with_capacity(len_max),
        })
    }

    fn eliminate<const NS: usize, const NP: usize>(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut ReducedSystem<NP>,
    ) -> Result<(), NotPositive> {
        let mut parameter_block = self.reduced_system(reduced);
        let Self { states, parameters, rows } = self;
        let own = blocks.iter().map(|block| of_block(block, states, parameters));
        eliminate(rows, own, damping, &mut parameter_block)?;
        self.put_reduced_system(&parameter_block, reduced);
        Ok(())
    }

    fn back_substitute<const NS: usize, const NP: usize>(
        &self,
        p_step: &SVector<f64, NP>,
        steps: &mut [SVector<f64, NS>],
    ) {
        let len = steps.len();
        let put = |k: usize, step: SVector<f64, S>| put(&step, &self.states, &[0], &mut steps[k]);
        back_substitute(&self.rows, &pick(p_step, &self.parameters), put, len);
    }

    fn fold<const NS: usize, const NP: usize>(
        &self,
        (block, next, parameter_block, fading): ToFold<'_, NS, NP>,
        whole: &mut Folded<NS, NP>,
    ) -> Result<(), NotPositive> {
        let Self { states, parameters, .. } = self;
        let own = |block| of_block(block, states, parameters);
        let fading = fading.map(|fading| Fading {
            keep: fading.keep,
            believed: self.reduced_system(&fading.believed),
        });
        let folded =
            fold(&own(block), own(next), self.reduced_system(parameter_block), fading.as_ref())?;
        put(&folded.block.diagonal, states, states, &mut whole.block.diagonal);
        put(&folded.block.border, states, parameters, &mut whole.block.border);
        self.put_reduced_system(&folded.parameter_block, &mut whole.parameter_block);
        put(&folded.s_step, states, &[0], &mut whole.s_step);
        put(&folded.p_step, parameters, &[0], &mut whole.p_step);
        Ok(())
    }

    /// The rows of `whole` that belong to this subsystem, with zero decrease.
    fn reduced_system<const NP: usize>(&self, whole: &ReducedSystem<NP>) -> ReducedSystem<P> {
        ReducedSystem {
            hessian: cut(&whole.hessian, &self.parameters, &self.parameters),
            gradient: pick(&whole.gradient, &self.parameters),
            decrease: 0.0,
        }
    }

    /// Writes the rows back and adds the decrease.
    fn put_reduced_system<const NP: usize>(
        &self,
        parameter_block: &ReducedSystem<P>,
        whole: &mut ReducedSystem<NP>,
    ) {
        put(&parameter_block.hessian, &self.parameters, &self.parameters, &mut whole.hessian);
        put(&parameter_block.gradient, &self.parameters, &[0], &mut whole.gradient);
        whole.decrease += parameter_block.decrease;
    }
}

/// The rows of `whole` that belong to a subsystem.
#[inline]
fn of_block<const NS: usize, const NP: usize, const S: usize, const P: usize>(
    whole: &Block<NS, NP>,
    states: &[usize; S],
    parameters: &[usize; P],
) -> Block<S, P> {
    Block {
        diagonal: cut(&whole.diagonal, states, states),
        before: cut(&whole.before, states, states),
        border: cut(&whole.border, states, parameters),
        gradient: pick(&whole.gradient, states),
    }
}

#[cfg(test)]
mod tests;
