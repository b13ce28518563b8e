//! Normal equations whose rows fall into two groups, taken apart.
//!
//! Owns which rows go where. Nothing in the equations joins the groups, so the two solutions together are the
//! solution; what an elimination costs grows with the cube of its rows.

use horizon_model::Group;
use horizon_model::group::{cut, pick, put};
use nalgebra::SVector;

use crate::arrival::{Fading, Folded, fold};
use crate::chain::{Block, Eliminated, back_substitute, eliminate};
use crate::cholesky::NotPositive;
use crate::corner::Corner;

/// Groups of the lagged vehicle. Blocks whose size is known to the compiler are what makes an elimination quick, so
/// every pair of groups needs a type of its own.
pub(crate) type LevelAndHeight = Parted<8, 8, 3, 3>;

/// Two groups of `S` states and `P` parameters each, with their eliminated rows.
#[derive(Debug, Clone)]
pub(crate) struct Parted<const S1: usize, const P1: usize, const S2: usize, const P2: usize> {
    first: Part<S1, P1>,
    second: Part<S2, P2>,
}

impl<const S1: usize, const P1: usize, const S2: usize, const P2: usize> Parted<S1, P1, S2, P2> {
    /// Room for `len_max` states; `None` if `groups` are not two of this size that hold all of `NS` states and
    /// `NP` parameters.
    pub(crate) fn new<const NS: usize, const NP: usize>(
        groups: &[Group],
        len_max: usize,
    ) -> Option<Self> {
        let [first, second] = groups else { return None };
        let parted =
            Self { first: Part::new(first, len_max)?, second: Part::new(second, len_max)? };
        (S1 + S2 == NS && P1 + P2 == NP).then_some(parted)
    }

    /// As [`eliminate`].
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(crate) fn eliminate<const NS: usize, const NP: usize>(
        &mut self,
        blocks: &[Block<NS, NP>],
        damping: f64,
        reduced: &mut Corner<NP>,
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
        corner: &Corner<NP>,
        fading: Option<&Fading<NP>>,
    ) -> Result<Folded<NS, NP>, NotPositive> {
        let mut folded = Folded::zeros();
        self.first.fold((block, next, corner, fading), &mut folded)?;
        self.second.fold((block, next, corner, fading), &mut folded)?;
        Ok(folded)
    }
}

/// What [`fold`] is given.
type ToFold<'a, const NS: usize, const NP: usize> =
    (&'a Block<NS, NP>, &'a Block<NS, NP>, &'a Corner<NP>, Option<&'a Fading<NP>>);

/// One group.
#[derive(Debug, Clone)]
struct Part<const S: usize, const P: usize> {
    states: [usize; S],
    parameters: [usize; P],
    rows: Vec<Eliminated<S, P>>,
}

impl<const S: usize, const P: usize> Part<S, P> {
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
        reduced: &mut Corner<NP>,
    ) -> Result<(), NotPositive> {
        let mut corner = self.corner(reduced);
        let Self { states, parameters, rows } = self;
        let own = blocks.iter().map(|block| of_block(block, states, parameters));
        eliminate(rows, own, damping, &mut corner)?;
        self.put_corner(&corner, reduced);
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
        (block, next, corner, fading): ToFold<'_, NS, NP>,
        whole: &mut Folded<NS, NP>,
    ) -> Result<(), NotPositive> {
        let Self { states, parameters, .. } = self;
        let own = |block| of_block(block, states, parameters);
        let fading = fading
            .map(|fading| Fading { keep: fading.keep, believed: self.corner(&fading.believed) });
        let folded = fold(&own(block), own(next), self.corner(corner), fading.as_ref())?;
        put(&folded.block.diagonal, states, states, &mut whole.block.diagonal);
        put(&folded.block.border, states, parameters, &mut whole.block.border);
        self.put_corner(&folded.corner, &mut whole.corner);
        put(&folded.s_step, states, &[0], &mut whole.s_step);
        put(&folded.p_step, parameters, &[0], &mut whole.p_step);
        Ok(())
    }

    /// The rows of `whole` that are this group's, nothing gained yet.
    fn corner<const NP: usize>(&self, whole: &Corner<NP>) -> Corner<P> {
        Corner {
            hessian: cut(&whole.hessian, &self.parameters, &self.parameters),
            gradient: pick(&whole.gradient, &self.parameters),
            decrease: 0.0,
        }
    }

    /// Puts the rows back, and adds what was gained.
    fn put_corner<const NP: usize>(&self, corner: &Corner<P>, whole: &mut Corner<NP>) {
        put(&corner.hessian, &self.parameters, &self.parameters, &mut whole.hessian);
        put(&corner.gradient, &self.parameters, &[0], &mut whole.gradient);
        whole.decrease += corner.decrease;
    }
}

/// The rows of `whole` that are a group's.
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
