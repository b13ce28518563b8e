//! What each piece says by itself, at the iterate of all.

use rayon::prelude::*;
use tello_model::Model;

use super::Ident;
use super::segment::Segment;
use crate::cholesky::NotPositive;
use crate::corner::Corner;
use crate::residual::Path;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Gradient and curvature of the cost of each piece by the parameter at the iterate, its states
    /// following; each piece counted once, prior and bounds left out.
    ///
    /// # Errors
    /// The matrix of the states of a piece is not positive definite.
    pub fn piece_corners(&mut self) -> Result<Vec<Corner<NP>>, NotPositive> {
        let Self { terms, p, curvature, segments, .. } = self;
        let eliminate =
            |segment: &mut Segment<NS, NU, NO, NP>| segment.eliminate(terms, p, *curvature, 0.0);
        segments.par_iter_mut().map(eliminate).collect()
    }

    /// Cost of each piece at the iterate, counted once, without prior.
    pub fn piece_costs(&self) -> Vec<f64> {
        let cost = |Segment { s, u, o, s_rest, .. }: &Segment<NS, NU, NO, NP>| {
            self.terms.cost(&Path { s, u, o, p: &self.p }, s_rest)
        };
        self.segments.iter().map(cost).collect()
    }

    /// How often each piece counts.
    pub fn multiplicities(&self) -> &[u32] {
        &self.multiplicities
    }

    /// Residuals less unknowns, pieces by their multiplicity, the prior on the parameter not counted.
    ///
    /// Twice the cost over this is the mean square of what a residual would be with nothing fitted:
    /// 1 where weights are inverse deviations of independent residuals.
    pub fn degrees_of_freedom(&self) -> f64 {
        // Transitions are as many as the states less one: what is left are the observations, the
        // first states held by a weight, and the states that these have to pay for.
        let held = self.terms.c_0.iter().filter(|weight| **weight > 0.0).count() as f64;
        let of_piece = |(segment, count): (&Segment<NS, NU, NO, NP>, &u32)| {
            let present = |observed: &crate::residual::Observed<NO>| {
                observed.is_present.iter().filter(|is_present| **is_present).count()
            };
            let observations = segment.o.iter().map(present).sum::<usize>() as f64;
            f64::from(*count) * (observations + held - NS as f64)
        };
        let pieces = self.segments.iter().zip(&self.multiplicities);
        pieces.map(of_piece).sum::<f64>() - NP as f64
    }
}
