//! The functions that Levenberg-Marquardt needs of an identification: elimination of the states, steps, costs.
//!
//! Owns the sums over pieces, always in the order of the pieces, and the choice between the exact
//! curvature and Gauss-Newton's. One piece is `segment.rs`, the re-optimization of its states after a step
//! `variable_projection.rs`.

use rayon::prelude::*;

use horizon_model::{Model, Vector};

use super::Ident;
use super::segment::{Contribution, Segment, Terms};
use super::variable_projection::{Scratch, Start, TOLERANCE_MIN};
use crate::cholesky::NotPositive;
use crate::levenberg::{IterateScale, LeastSquares, LmError, Step};
use crate::reduced_system::ReducedSystem;
use crate::residual::Curvature;

/// The iterate counts as near a minimum when a step has lowered the cost by less than this fraction of it.
///
/// Farther off the exact Hessian may be indefinite; Gauss-Newton's is not. 1
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
        self.eliminate_by(|segment, terms, p| segment.eliminate(terms, p, curvature, damping))
    }

    /// Eliminates each piece that counts by `eliminate`.
    fn eliminate_by(
        &mut self,
        eliminate: impl Fn(
            &mut Segment<NS, NU, NO, NP>,
            &Terms<M, NS, NU, NO, NP>,
            &Vector<NP>,
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
    fn minimize(&mut self, damping: f64) -> Result<(Vector<NP>, f64), NotPositive> {
        let (p, bounds) = (self.p, self.prior.bounds);
        if self.curvature == Curvature::Exact && self.is_near {
            let exact = self.eliminate_by(|segment, terms, p| {
                segment
                    .eliminate(terms, p, Curvature::Exact, damping)
                    .or_else(|_| segment.eliminate(terms, p, Curvature::GaussNewton, damping))
            });
            if let Ok(minimum) =
                exact.and_then(|parameter_block| parameter_block.solve(damping, &p, &bounds))
            {
                return Ok(minimum);
            }
        }
        self.eliminate(Curvature::GaussNewton, damping)?.solve(damping, &p, &bounds)
    }

    /// Moves the states of each piece that counts to their minimum at the present parameter: from states as noisy as
    /// their observations, the first step of the parameter may end far away.
    pub(super) fn reoptimize_states(&mut self) {
        let (p, tolerance) = (self.p, self.inner_tolerance());
        self.map_counted(|terms, curvature, segment, scratch| {
            segment.s_candidate.clone_from(&segment.s);
            let cost = segment.contribution(terms, &p).cost;
            let start = Start { cost, expected: f64::NAN, damping: 0.0, tolerance };
            if segment.reoptimize_states(terms, &p, curvature, start, scratch) < cost {
                segment.accept();
            }
        });
    }

    /// Sets the candidate of each piece that counts to the damped step for `p_candidate` and returns their
    /// contributions: the step lengths of the damped step, the costs after its states are re-optimized.
    fn set_candidates(&mut self, p_candidate: &Vector<NP>, damping: f64) -> Vec<Contribution> {
        let (p_step, tolerance) = (p_candidate - self.p, self.inner_tolerance());
        self.map_counted(|terms, curvature, segment, scratch| {
            let expected = segment.back_substitute(&p_step);
            let mut contribution = segment.contribution(terms, p_candidate);
            let start = Start { cost: contribution.cost, expected, damping, tolerance };
            contribution.cost =
                segment.reoptimize_states(terms, p_candidate, curvature, start, scratch);
            contribution
        })
    }

    fn inner_tolerance(&self) -> f64 {
        self.solver.cost_tolerance().max(TOLERANCE_MIN)
    }

    /// The results of `visit` for the pieces that count, in parallel, and `T::default()` for the others.
    fn map_counted<T: Default + Send>(
        &mut self,
        visit: impl Fn(
            &Terms<M, NS, NU, NO, NP>,
            Curvature,
            &mut Segment<NS, NU, NO, NP>,
            &mut Scratch<NS>,
        ) -> T
        + Sync,
    ) -> Vec<T> {
        let len_max = self.segments.iter().map(|segment| segment.s.len()).max().unwrap_or(0);
        let Self { terms, curvature, segments, multiplicities, .. } = self;
        let scratch = || Scratch::of::<M, NU, NO, NP>(len_max);
        let visit = |scratch: &mut Scratch<NS>,
                     (segment, count): (&mut Segment<NS, NU, NO, NP>, &u32)| {
            if *count > 0 { visit(terms, *curvature, segment, scratch) } else { T::default() }
        };
        segments.par_iter_mut().zip(&*multiplicities).map_init(scratch, visit).collect()
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> LeastSquares
    for Ident<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    fn linearize(&mut self) -> Result<IterateScale, LmError> {
        if let Some(known) = self.known {
            return Ok(known);
        }
        let mut sum = IterateScale { cost: self.prior.cost(&self.p), diagonal_max: 0.0 };
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
        let contributions = self.set_candidates(&p_candidate, damping);
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

#[cfg(test)]
mod tests {
    use horizon_model::Kinematic;
    use horizon_model::rows::{Pose, Sticks, stick};

    use super::*;
    use crate::ident::{IdentSettings, Piece};
    use crate::residual::Observed;

    /// Two pieces of a vehicle that yaw and throttle move: linear in states and parameter.
    fn linear() -> Ident<Kinematic, 4, 4, 4, 4> {
        let wave = |k: usize, at: f64| (1.3 * k as f64 + at).sin();
        let piece = |number: usize| {
            let sticks = |k: usize| {
                let mut u = Sticks::zeros();
                (u[stick::YAW], u[stick::THROTTLE]) = (wave(k, number as f64), wave(k, 2.0));
                u
            };
            let seen = |k: usize| Pose::from_fn(|row, _| wave(k + 5 * number, row as f64));
            Piece {
                u: (0..8).map(sticks).collect(),
                o: (0..9).map(|k| Observed::full(seen(k))).collect(),
            }
        };
        let settings = IdentSettings::builder([1.0, 0.6, 0.8, 0.1])
            .c_o([30.0; 4])
            .c_s([2.0; 4])
            .c_p([3.0; 4])
            .bounds([-9.0; 4], [9.0; 4]);
        let settings = settings.build(&Kinematic).unwrap();
        Ident::new(Kinematic, &settings, 0.02, vec![piece(0), piece(1)]).unwrap()
    }

    #[test]
    fn a_linear_problem_gains_what_a_step_expects() {
        for (damping, multiplicities) in
            [(0.0, [1, 1]), (200.0, [1, 1]), (200.0, [3, 1]), (50.0, [0, 2])]
        {
            let mut ident = linear();
            ident.set_multiplicities(&multiplicities);
            let start = ident.linearize().unwrap();
            let step = ident.try_step(damping).unwrap();
            let gained = start.cost - ident.candidate_cost();
            assert!((step.decrease / gained - 1.0).abs() < 1e-9, "{step:?} gains {gained}");
            let p_squared = (ident.p_candidate - ident.p).norm_squared();
            let moved = ident.segments.iter().zip(multiplicities).map(|(segment, count)| {
                let pairs = segment.s.iter().zip(&segment.s_candidate);
                let squared: f64 = pairs.map(|(s, next)| (next - s).norm_squared()).sum();
                f64::from(count) * squared
            });
            let norm = (p_squared + moved.sum::<f64>()).sqrt();
            assert!((step.norm / norm - 1.0).abs() < 1e-12, "{step:?} beside {norm}");
            ident.accept();
            ident.known = None;
            let cost = ident.linearize().unwrap().cost;
            assert!((start.cost - gained - cost).abs() < 1e-9 * cost, "{cost} is left");
        }
    }

    #[test]
    fn a_step_that_gains_little_is_near_the_minimum_and_a_rejected_one_is_not() {
        for (gained, is_near) in [(0.04, true), (0.06, false)] {
            let mut ident = linear();
            ident.known = Some(IterateScale { cost: 1.0 + gained, diagonal_max: 1.0 });
            ident.cost_candidate = 1.0;
            ident.accept();
            assert_eq!(ident.is_near, is_near, "{gained} of 1");
            assert!((ident.linearize().unwrap().cost - 1.0).abs() <= 0.0, "the cost is known");
        }
        let mut ident = linear();
        ident.is_near = true;
        ident.linearize().unwrap();
        ident.try_step(1.0).unwrap();
        assert!(ident.is_near, "the first try");
        ident.try_step(2.0).unwrap();
        assert!(!ident.is_near, "the first one was rejected");
    }

    #[test]
    fn a_piece_that_does_not_count_does_not_matter() {
        let mut ident = linear();
        ident.segments[1].u[3] = Sticks::repeat(f64::NAN);
        assert!(ident.linearize().is_err());
        ident.set_multiplicities(&[1, 0]);
        let before = ident.segments[1].s_candidate.clone();
        ident.known = None;
        ident.linearize().unwrap();
        assert!(ident.try_step(1.0).unwrap().decrease > 0.0);
        ident.accept();
        assert_eq!(ident.segments[1].s_candidate, before);
    }
}
