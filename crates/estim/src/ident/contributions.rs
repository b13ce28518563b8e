//! The contribution of each piece to cost, gradient and information at the common iterate.

use horizon_model::Model;
use nalgebra::{SMatrix, SVector};
use rayon::prelude::*;

use super::Ident;
use super::segment::Segment;
use crate::cholesky::NotPositive;
use crate::product::tr_mul;
use crate::reduced_system::ReducedSystem;
use crate::residual::{Iterate, Residuals};

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Gradient and curvature of the cost of each piece by the parameter at the iterate, its states
    /// following, and the cost; each piece counted once, prior and bounds left out.
    ///
    /// # Errors
    /// The matrix of the states of a piece is not positive definite.
    pub fn piece_reduced_systems(&self) -> Result<Vec<(ReducedSystem<NP>, f64)>, NotPositive> {
        let Self { terms, p, curvature, segments, .. } = self;
        segments.par_iter().map(|segment| segment.reduced_system(terms, p, *curvature)).collect()
    }

    /// [`Ident::information`] from the reduced systems of all pieces at the iterate.
    pub(crate) fn information_of(
        &self,
        reduced_systems: &[(ReducedSystem<NP>, f64)],
    ) -> SMatrix<f64, NP, NP> {
        let mut sum = ReducedSystem::zeros();
        self.prior.add_to(&mut sum, &self.p);
        for ((parameter_block, _), count) in reduced_systems.iter().zip(&self.multiplicities) {
            sum.hessian += parameter_block.hessian * f64::from(*count);
        }
        sum.hessian
    }

    /// Cost of each piece at the iterate, counted once, without prior. 1
    pub fn piece_costs(&self) -> Vec<f64> {
        let cost = |Segment { s, u, o, s_rest, .. }: &Segment<NS, NU, NO, NP>| {
            self.terms.cost(&Iterate { s, u, o, p: &self.p }, s_rest)
        };
        self.segments.par_iter().map(cost).collect()
    }

    /// Derivative of the cost of a piece, counted once, by the input of each of its steps. States and
    /// parameter are held; at a minimum it makes no difference whether they follow.
    pub fn input_gradient(&self, piece: usize) -> Vec<SVector<f64, NU>> {
        let Segment { s, u, .. } = &self.segments[piece];
        let Residuals { model, dt_s, transition_loss, .. } = &self.terms.residuals;
        let weight = self.terms.residuals.transition_weight();
        let residuals = self.transition_residuals(piece);
        let steps = s.iter().zip(u).zip(&residuals);
        let gradient =
            |((s, u), r): ((&SVector<f64, NS>, &SVector<f64, NU>), &SVector<f64, NS>)| {
                let by_next =
                    r.component_mul(&weight) * transition_loss.at(r.norm_squared()).derivative;
                tr_mul(&model.step_by_input(s, u, &self.p, *dt_s), &by_next)
            };
        steps.map(gradient).collect()
    }

    /// How often each piece counts in the cost, by piece: 1 without a resample, else the number of its draws.
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
