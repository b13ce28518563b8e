//! The optimal states of one piece at a given parameter p.
//!
//! Owns the minimization over the states alone, the inner problem of variable projection (Golub and Pereyra 1973, here
//! with a nonlinear inner problem). With a large weight on the transitions the optimal states depend strongly and
//! nonlinearly on p. A joint Gauss-Newton step of states and p is then accurate only if it is short: longer ones are
//! rejected. After the states are re-optimized for p, the cost as a function of p alone is nearly quadratic.

use horizon_model::{Linearized, Matrix, Model, ParameterHessian, Row, Vector, VisitSubsystems};

use super::segment::{Segment, Terms};
use crate::back_substitution::LongChain;
use crate::cholesky::NotPositive;
use crate::levenberg::{self, IterateScale, LeastSquares, LmError, LmSettings, Step};
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate, Residuals};

/// Memory for [`Segment::reoptimize_states`], for one piece after the other.
#[derive(Debug)]
pub(super) struct Scratch<const NS: usize> {
    s: Vec<Vector<NS>>,
    chain: LongChain<NS, 0>,
}

impl<const NS: usize> Scratch<NS> {
    /// Memory for pieces of up to `len_max` states of the model `M`.
    pub(super) fn of<M, const NU: usize, const NO: usize, const NP: usize>(len_max: usize) -> Self
    where
        M: Model<NS, NU, NO, NP>,
    {
        let chain = LongChain::of::<FixedParameter<'_, M, NP>, NU, NO>(len_max);
        Self { s: Vec::with_capacity(len_max), chain }
    }
}

/// A candidate before its states are re-optimized.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    /// Cost of the candidate. 1
    pub(super) cost: f64,
    /// Cost that the linear step predicted; NaN if that is not known. 1
    pub(super) expected: f64,
    /// Damping of the step that led to it. 1
    pub(super) damping: f64,
    /// Cost tolerance of the inner problem, and largest error of `expected` at which the states are not re-optimized.
    /// Both are relative to the cost. 1
    pub(super) tolerance: f64,
}

/// Smallest [`Start::tolerance`] that is of use. 1
pub(super) const TOLERANCE_MIN: f64 = 1e-4;

/// Most steps: the next step of the parameter goes on from here anyway.
const STEPS_MAX: u32 = 8;

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Segment<NS, NU, NO, NP> {
    /// Moves the candidate to the minimum over the states at `p` and returns its cost. 1
    ///
    /// A candidate whose cost is not finite stays as it is, and so does one whose cost is as expected: its states are
    /// near enough to the optimal ones.
    pub(super) fn reoptimize_states<M>(
        &mut self,
        terms: &Terms<M, NS, NU, NO, NP>,
        p: &Vector<NP>,
        curvature: Curvature,
        Start { cost, expected, damping, tolerance }: Start,
        scratch: &mut Scratch<NS>,
    ) -> f64
    where
        M: Model<NS, NU, NO, NP>,
    {
        if !cost.is_finite() || (cost - expected).abs() <= tolerance * cost {
            return cost;
        }
        let Residuals { model, dt_s, c_o, c_s, observation_loss, transition_loss } =
            &terms.residuals;
        let residuals = Residuals {
            model: FixedParameter { model: model.prepared(p, *dt_s), p },
            dt_s: *dt_s,
            c_o: *c_o,
            c_s: *c_s,
            observation_loss: *observation_loss,
            transition_loss: *transition_loss,
        };
        scratch.s.clone_from(&self.s_candidate);
        let mut inner = InnerProblem {
            terms: Terms { residuals, c_0: terms.c_0 },
            segment: self,
            scratch,
            curvature,
            cost,
        };
        let solver = LmSettings::of_part(damping, tolerance, STEPS_MAX);
        levenberg::solve(&mut inner, &solver, &mut || false).map_or(cost, |report| report.cost)
    }
}

/// The inner problem: a piece's candidate as a function of its states alone.
struct InnerProblem<'a, M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    terms: Terms<FixedParameter<'a, M, NP>, NS, NU, NO, 0>,
    segment: &'a mut Segment<NS, NU, NO, NP>,
    scratch: &'a mut Scratch<NS>,
    curvature: Curvature,
    /// Of `segment.s_candidate`.
    cost: f64,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    InnerProblem<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// Eliminates the states. Returns the predicted decrease of the cost. 1
    fn eliminate(&mut self, curvature: Curvature, damping: f64) -> Result<f64, NotPositive> {
        let Segment { s_candidate: s, u, o, s_rest, .. } = &*self.segment;
        let iterate = Iterate { s, u, o, p: &Vector::zeros() };
        let chain = &mut self.scratch.chain;
        let mut parameter_block = ReducedSystem::zeros();
        self.terms.assemble(&iterate, s_rest, curvature, &mut parameter_block, |k, block, _| {
            chain.eliminate(k, block, damping)
        })?;
        Ok(chain.reduced(&parameter_block).decrease)
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> LeastSquares
    for InnerProblem<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    const REMAINING_DECREASE_MIN: f64 = 0.0;

    fn linearize(&mut self) -> Result<IterateScale, LmError> {
        // Derivatives are formed where they are eliminated, and the damping is absolute.
        Ok(IterateScale { cost: self.cost, diagonal_max: 1.0 })
    }

    fn try_step(&mut self, damping: f64) -> Result<Step, NotPositive> {
        let gain = match self.curvature {
            Curvature::Exact => self
                .eliminate(Curvature::Exact, damping)
                .or_else(|_| self.eliminate(Curvature::GaussNewton, damping)),
            curvature => self.eliminate(curvature, damping),
        }?;
        let Scratch { s: s_next, chain } = &mut *self.scratch;
        chain.back_substitute(&Vector::zeros(), s_next);
        let (mut step_squared, mut iterate_squared) = (0.0, 0.0);
        for (s, s_next) in self.segment.s_candidate.iter().zip(s_next) {
            step_squared += s_next.norm_squared();
            iterate_squared += s.norm_squared();
            *s_next += s;
        }
        Ok(Step {
            decrease: gain + 0.5 * damping * step_squared,
            norm: step_squared.sqrt(),
            iterate_norm: iterate_squared.sqrt(),
        })
    }

    fn candidate_cost(&mut self) -> f64 {
        let Segment { u, o, s_rest, .. } = &*self.segment;
        self.terms.cost(&Iterate { s: &self.scratch.s, u, o, p: &Vector::zeros() }, s_rest)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.segment.s_candidate, &mut self.scratch.s);
    }
}

/// Passes subsystems on without their parameters.
struct WithoutParameters<'a, V>(&'a mut V);

impl<V: VisitSubsystems> VisitSubsystems for WithoutParameters<'_, V> {
    fn visit<const S: usize, const P: usize>(
        &mut self,
        states: &'static [usize; S],
        inputs: &'static [usize],
        _parameters: &'static [usize; P],
    ) {
        self.0.visit(states, inputs, &[]);
    }
}

/// A model at one fixed parameter, with no parameter of its own.
#[derive(Debug, Clone, Copy)]
struct FixedParameter<'a, M, const NP: usize> {
    model: M,
    p: &'a Vector<NP>,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Model<NS, NU, NO, 0>
    for FixedParameter<'_, M, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    const NAME: &'static str = M::NAME;
    const STATE: [Row; NS] = M::STATE;
    const INPUT: [Row; NU] = M::INPUT;
    const OBSERVATION: [Row; NO] = M::OBSERVATION;
    const PARAMETER: [Row; 0] = [];

    fn subsystems(visit: &mut impl VisitSubsystems) {
        M::subsystems(&mut WithoutParameters(visit));
    }

    #[inline]
    fn step(&self, s: &Vector<NS>, u: &Vector<NU>, _p: &Vector<0>, dt_s: f64) -> Vector<NS> {
        self.model.step(s, u, self.p, dt_s)
    }

    #[inline]
    fn step_by_state(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Matrix<NS, NS> {
        self.model.step_by_state(s, u, self.p, dt_s)
    }

    #[inline]
    fn step_by_input(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Matrix<NS, NU> {
        self.model.step_by_input(s, u, self.p, dt_s)
    }

    #[inline]
    fn step_by_parameter(
        &self,
        _s: &Vector<NS>,
        _u: &Vector<NU>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Matrix<NS, 0> {
        Matrix::zeros()
    }

    #[inline]
    fn linearize(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Linearized<NS, 0> {
        let Linearized { s_next, by_state, .. } = self.model.linearize(s, u, self.p, dt_s);
        Linearized { s_next, by_state, by_parameter: Matrix::zeros() }
    }

    #[inline]
    fn hessian_by_parameter(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        _p: &Vector<0>,
        dt_s: f64,
        w: &Vector<NS>,
    ) -> Option<ParameterHessian<NS, 0>> {
        let ParameterHessian { by_state, .. } =
            self.model.hessian_by_parameter(s, u, self.p, dt_s, w)?;
        Some(ParameterHessian {
            by_state,
            by_state_parameter: Matrix::zeros(),
            by_parameter: Matrix::zeros(),
        })
    }

    #[inline]
    fn observe(&self, s: &Vector<NS>) -> Vector<NO> {
        self.model.observe(s)
    }

    #[inline]
    fn observe_by_state(&self, s: &Vector<NS>) -> Matrix<NO, NS> {
        self.model.observe_by_state(s)
    }

    #[inline]
    fn at_rest(&self, o: &Vector<NO>) -> Vector<NS> {
        self.model.at_rest(o)
    }
}

#[cfg(test)]
mod tests;
