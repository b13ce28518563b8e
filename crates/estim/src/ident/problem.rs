//! What Levenberg-Marquardt asks of an identification: elimination of the states, steps, costs.
//!
//! Owns the sums over pieces, always in the order of the pieces, and the choice between the exact
//! curvature and Gauss-Newton's. One piece is `segment.rs`, its back substitution and roll-out after a step
//! `settle.rs`.

use horizon_model::Model;
use nalgebra::SVector;
use rayon::prelude::*;

use super::segment::{Contribution, Segment, Terms};
use super::settle::{Scratch, Start, TOLERANCE_MIN};
use super::{Ident, LinearSolver};
use crate::cholesky::NotPositive;
use crate::levenberg::{Linearization, Problem, SolveError, Step};
use crate::reduced_system::ReducedSystem;
use crate::residual::Curvature;

/// The iterate counts as near a minimum when a step has lowered the cost by less than this part of it.
///
/// Farther off the exact curvature is often indefinite and leads astray, where Gauss-Newton's does not. With
/// 1e-3 the thesis' pieces take an iteration more.
const NEAR: f64 = 0.05;

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Eliminates the states of every piece that counts.
    ///
    /// # Errors
    /// The damped matrix of the states is not positive definite.
    pub(super) fn eliminate(
        &mut self,
        curvature: Curvature,
        damping: f64,
    ) -> Result<ReducedSystem<NP>, NotPositive> {
        match self.linear_solver {
            LinearSolver::Chain => self
                .eliminate_by(|segment, terms, p| segment.eliminate(terms, p, curvature, damping)),
            LinearSolver::Sparse => {
                let Self { sparse, segments, multiplicities, terms, p, .. } = self;
                let counted =
                    segments.iter().zip(&*multiplicities).filter(|(_, count)| **count > 0);
                let mut sum = sparse.eliminate(counted, terms, p, curvature, damping)?;
                self.prior.add_to(&mut sum, &self.p);
                Ok(sum)
            }
        }
    }

    /// Eliminates each piece that counts by `eliminate`.
    fn eliminate_by(
        &mut self,
        eliminate: impl Fn(
            &mut Segment<NS, NU, NO, NP>,
            &Terms<M, NS, NU, NO, NP>,
            &SVector<f64, NP>,
        ) -> Result<ReducedSystem<NP>, NotPositive>
        + Sync,
    ) -> Result<ReducedSystem<NP>, NotPositive> {
        let Self { terms, p, segments, multiplicities, .. } = self;
        let reduced_systems: Vec<_> = segments
            .par_iter_mut()
            .zip(&*multiplicities)
            .map(|(segment, count)| match count {
                0 => Ok(ReducedSystem::zeros()),
                _ => eliminate(segment, terms, p)
                    .map(|parameter_block| parameter_block.times(*count)),
            })
            .collect();
        let mut sum = ReducedSystem::zeros();
        self.prior.add_to(&mut sum, &self.p);
        for parameter_block in reduced_systems {
            sum += &parameter_block?;
        }
        Ok(sum)
    }

    /// The parameter that minimizes the damped quadratic model inside the box, and the decrease.
    ///
    /// Where the exact model has no minimum, Gauss-Newton's is taken: for single pieces if it is their
    /// states', else for all.
    fn minimize(&mut self, damping: f64) -> Result<(SVector<f64, NP>, f64), NotPositive> {
        let (p, bounds) = (self.p, self.prior.bounds);
        if self.curvature == Curvature::Exact && self.is_near {
            let exact = match self.linear_solver {
                LinearSolver::Chain => self.eliminate_by(|segment, terms, p| {
                    segment
                        .eliminate(terms, p, Curvature::Exact, damping)
                        .or_else(|_| segment.eliminate(terms, p, Curvature::GaussNewton, damping))
                }),
                LinearSolver::Sparse => self.eliminate(Curvature::Exact, damping),
            };
            if let Ok(minimum) =
                exact.and_then(|parameter_block| parameter_block.solve(damping, &p, &bounds))
            {
                return Ok(minimum);
            }
        }
        self.eliminate(Curvature::GaussNewton, damping)?.solve(damping, &p, &bounds)
    }

    /// Sets the candidate of each piece that counts and returns their contributions: the steps as the damped
    /// model has them, the costs with the states led back to their minimum.
    fn follow(&mut self, p_candidate: &SVector<f64, NP>, damping: f64) -> Vec<Contribution> {
        let p_step = p_candidate - self.p;
        if self.linear_solver == LinearSolver::Sparse {
            let pieces = self.segments.iter_mut().zip(&self.multiplicities);
            let counted = pieces.filter(|(_, count)| **count > 0).map(|(segment, _)| segment);
            self.sparse.move_candidates(counted, &p_step);
        }
        let tolerance = self.solver.cost_tolerance().max(TOLERANCE_MIN);
        let Self { terms, curvature, segments, multiplicities, linear_solver, .. } = self;
        let contribution =
            |scratch: &mut Scratch<NS>, (segment, count): (&mut Segment<NS, NU, NO, NP>, &u32)| {
                if *count == 0 {
                    return Contribution::default();
                }
                let expected = match linear_solver {
                    LinearSolver::Chain => segment.back_substitute(&p_step),
                    LinearSolver::Sparse => f64::NAN,
                };
                let mut contribution = segment.contribution(terms, p_candidate);
                let start = Start { cost: contribution.cost, expected, damping, tolerance };
                contribution.cost = segment.settle(terms, p_candidate, *curvature, start, scratch);
                contribution
            };
        let len_max = segments.iter().map(|segment| segment.s.len()).max().unwrap_or(0);
        let scratch = || Scratch::of::<M, NU, NO, NP>(len_max);
        segments.par_iter_mut().zip(&*multiplicities).map_init(scratch, contribution).collect()
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Problem
    for Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    fn linearize(&mut self) -> Result<Linearization, SolveError> {
        if let Some(known) = self.known {
            return Ok(known);
        }
        let mut sum = Linearization { cost: self.prior.cost(&self.p), diagonal_max: 0.0 };
        let measure = |(segment, count): (&Segment<NS, NU, NO, NP>, &u32)| match count {
            0 => Ok((0.0, 0.0)),
            _ => segment.measure(&self.terms, &self.p),
        };
        let measured: Vec<_> =
            self.segments.par_iter().zip(&self.multiplicities).map(measure).collect();
        for (measured, count) in measured.into_iter().zip(&self.multiplicities) {
            let (cost, diagonal_max) = measured?;
            sum.cost += f64::from(*count) * cost;
            sum.diagonal_max = sum.diagonal_max.max(diagonal_max);
        }
        self.known = Some(sum);
        self.is_tried = false;
        Ok(sum)
    }

    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive> {
        // A candidate that is still there was rejected.
        self.is_near &= !self.is_tried;
        self.is_tried = true;
        let (p_candidate, decrease) = self.minimize(damping)?;
        self.p_candidate = p_candidate;
        let contributions = self.follow(&p_candidate, damping);
        self.cost_candidate = self.prior.cost(&p_candidate);
        let mut step_squared = (p_candidate - self.p).norm_squared();
        let mut iterate_squared = self.p.norm_squared();
        for (contribution, count) in contributions.iter().zip(&self.multiplicities) {
            let count = f64::from(*count);
            self.cost_candidate += count * contribution.cost;
            step_squared += count * contribution.step_squared;
            iterate_squared += count * contribution.iterate_squared;
        }
        Ok(Step {
            // The reduced model counts the damping as a cost.
            decrease: decrease + 0.5 * damping * step_squared,
            norm: step_squared.sqrt(),
            iterate_norm: iterate_squared.sqrt(),
        })
    }

    fn candidate_cost(&mut self) -> f64 {
        self.cost_candidate
    }

    fn accept(&mut self) {
        for (segment, count) in self.segments.iter_mut().zip(&self.multiplicities) {
            if *count > 0 {
                segment.accept();
            }
        }
        self.p = self.p_candidate;
        self.is_tried = false;
        if let Some(known) = &mut self.known {
            self.is_near |= known.cost - self.cost_candidate < NEAR * self.cost_candidate;
            known.cost = self.cost_candidate;
        }
    }
}
