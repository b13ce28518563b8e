//! Normal equations whose rows fall into two groups, as two chains.
//!
//! Owns which rows go where. Nothing in the equations joins the groups, so the two solutions together are the
//! solution. The cost of an elimination grows with the cube of its rows.

use nalgebra::SVector;
use tello_model::Group;
use tello_model::group::{cut, pick};

use crate::chain::{Block, Eliminated, back_substitute, eliminate};
use crate::cholesky::NotPositive;
use crate::corner::Corner;

/// Groups of the lagged vehicle. Blocks whose size is known to the compiler are what makes an elimination quick, so
/// every pair of groups needs a type of its own.
pub(crate) type LevelAndHeight = Parted<8, 8, 3, 3>;

/// Eliminated rows of two groups: `S` states and `P` parameters each.
#[derive(Debug, Clone)]
pub(crate) struct Parted<const S1: usize, const P1: usize, const S2: usize, const P2: usize> {
    first: Part<S1, P1>,
    second: Part<S2, P2>,
}

impl<const S1: usize, const P1: usize, const S2: usize, const P2: usize> Parted<S1, P1, S2, P2> {
    /// No rows, with room for `len_max` states; `None` if `groups` are not two of this size that hold all of
    /// `NS` states and `NP` parameters.
    pub(crate) fn new<const NS: usize, const NP: usize>(
        groups: &[Group],
        len_max: usize,
    ) -> Option<Self> {
        let [first, second] = groups else { return None };
        let parted =
            Self { first: Part::new(first, len_max)?, second: Part::new(second, len_max)? };
        (S1 + S2 == NS && P1 + P2 == NP).then_some(parted)
    }

    /// Eliminates the states of `blocks`; `reduced` loses their shares.
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

    /// Fills the steps of the states that belong to the parameter step `p_step`.
    pub(crate) fn back_substitute<const NS: usize, const NP: usize>(
        &self,
        p_step: &SVector<f64, NP>,
        steps: &mut [SVector<f64, NS>],
    ) {
        self.first.back_substitute(p_step, steps);
        self.second.back_substitute(p_step, steps);
    }
}

/// Eliminated rows of one group.
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
        let Self { states, parameters, rows } = self;
        let own = blocks.iter().map(|block| Block {
            diagonal: cut(&block.diagonal, states, states),
            before: cut(&block.before, states, states),
            border: cut(&block.border, states, parameters),
            gradient: pick(&block.gradient, states),
        });
        let mut corner = Corner {
            hessian: cut(&reduced.hessian, parameters, parameters),
            gradient: pick(&reduced.gradient, parameters),
            decrease: 0.0,
        };
        eliminate(rows, own, damping, &mut corner)?;
        for (col, to_col) in parameters.iter().enumerate() {
            for (row, to_row) in parameters.iter().enumerate() {
                reduced.hessian[(*to_row, *to_col)] = corner.hessian[(row, col)];
            }
            reduced.gradient[*to_col] = corner.gradient[col];
        }
        reduced.decrease += corner.decrease;
        Ok(())
    }

    fn back_substitute<const NS: usize, const NP: usize>(
        &self,
        p_step: &SVector<f64, NP>,
        steps: &mut [SVector<f64, NS>],
    ) {
        let len = steps.len();
        let put = |k: usize, step: SVector<f64, S>| {
            for (row, step) in self.states.iter().zip(&step) {
                steps[k][*row] = *step;
            }
        };
        back_substitute(&self.rows, &pick(p_step, &self.parameters), put, len);
    }
}
