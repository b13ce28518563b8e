//! One piece of a recording: its states, what they cost, and how they follow the parameter.
//!
//! Owns the pass along a piece that forms the normal equations and eliminates the states at once: a
//! block lives on the stack, only the rows of the back substitution are kept. How pieces are weighed and what
//! the parameter does is `ident.rs`.

use horizon_model::{Matrix, Model, Vector};

use crate::back_substitution::{EliminationFront, LongChain};
use crate::chain::{Block, NeighbourBlocks};
use crate::cholesky::NotPositive;
use crate::levenberg::LmError;
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate, Observed, Residuals, finite};

/// The terms that all pieces of a problem have in common.
#[derive(Debug, Clone)]
pub(super) struct Terms<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    pub(super) residuals: Residuals<M, NS, NU, NO, NP>,
    /// Weight of the first state's residual against rest. 1 / unit of the row, 0 or 1e-6..=1e6
    pub(super) c_0: Vector<NS>,
}

/// A piece at its current iterate and its candidate.
#[derive(Debug, Clone)]
pub(super) struct Segment<const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    /// `u[k]` acts from `s[k]` to `s[k + 1]`. Unit of each row
    pub(super) u: Vec<Vector<NU>>,
    /// `o[k]` observes `s[k]`.
    pub(super) o: Vec<Observed<NO>>,
    /// States of the iterate. Unit of each row
    pub(super) s: Vec<Vector<NS>>,
    /// States of the candidate. Unit of each row
    pub(super) s_candidate: Vec<Vector<NS>>,
    /// The state at rest at the first observation. Unit of each row
    pub(super) s_rest: Vector<NS>,
    chain: LongChain<NS, NP>,
    /// The quadratic model of the cost after the last elimination.
    quadratic_model: QuadraticModel<NP>,
}

/// The damped quadratic model of a piece's cost over steps of the parameter, the states following.
#[derive(Debug, Clone, Copy)]
struct QuadraticModel<const NP: usize> {
    /// Without a step. 1
    cost: f64,
    /// Added to every diagonal entry, of states and parameter. Mixed, by its row
    damping: f64,
    reduced: ReducedSystem<NP>,
}

impl<const NP: usize> QuadraticModel<NP> {
    /// Cost, without the damping's part, after the step `p_step` of the parameter. `step_squared` is the squared length
    /// of the step of the states that goes with it. 1
    fn cost_after(&self, p_step: &Vector<NP>, step_squared: f64) -> f64 {
        let ReducedSystem { hessian, gradient, decrease } = &self.reduced;
        let gain = decrease - gradient.dot(p_step) - 0.5 * p_step.dot(&(hessian * p_step));
        self.cost - gain - 0.5 * self.damping * step_squared
    }
}

/// A piece's contribution in the sums over all pieces.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Contribution {
    /// True cost of the candidate. 1
    pub(super) cost: f64,
    /// Squared length of the step of the states. Mixed, over all rows
    pub(super) step_squared: f64,
    /// Squared length of the states of the iterate. Mixed, over all rows
    pub(super) iterate_squared: f64,
}

impl<const NS: usize, const NU: usize, const NO: usize, const NP: usize> Segment<NS, NU, NO, NP> {
    /// A piece of `o.len() >= 1` states at rest and as many inputs less one.
    pub(super) fn new<M: Model<NS, NU, NO, NP>>(
        model: &M,
        u: Vec<Vector<NU>>,
        o: Vec<Observed<NO>>,
    ) -> Self {
        let first_seen =
            |row: usize| o.iter().find(|observed| observed.is_present[row]).map(|seen| seen.o[row]);
        let s_rest = model.at_rest(&Vector::from_fn(|row, _| first_seen(row).unwrap_or(0.0)));
        let s = vec![s_rest; o.len()];
        let chain = LongChain::of::<M, NU, NO>(o.len());
        let quadratic_model =
            QuadraticModel { cost: f64::NAN, damping: 0.0, reduced: ReducedSystem::zeros() };
        Self { u, o, s_candidate: s.clone(), s, s_rest, chain, quadratic_model }
    }

    /// Puts the observed rows of the states where they were observed and lets the model roll out the
    /// others.
    pub(super) fn start<M>(&mut self, model: &M, p: &Vector<NP>, dt_s: f64)
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut s = self.s_rest;
        for (k, observed) in self.o.iter().enumerate() {
            if k > 0 {
                s = model.step(&s, &self.u[k - 1], p, dt_s);
            }
            let o_pred = model.observe(&s);
            let o = Vector::from_fn(|row, _| {
                if observed.is_present[row] { observed.o[row] } else { o_pred[row] }
            });
            // Rest has the same hidden rows wherever it is: they cancel.
            s += model.at_rest(&o) - model.at_rest(&o_pred);
            self.s[k] = s;
        }
    }

    /// Cost (1) and largest diagonal entry of the normal matrix (mixed, by its row) at the iterate.
    ///
    /// # Errors
    /// A residual or a derivative is not finite.
    pub(super) fn measure<M>(
        &self,
        terms: &Terms<M, NS, NU, NO, NP>,
        p: &Vector<NP>,
    ) -> Result<(f64, f64), LmError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let (mut cost, mut diagonal_max) = (0.0, 0.0_f64);
        let mut parameter_block = ReducedSystem::zeros();
        let iterate = Iterate { s: &self.s, u: &self.u, o: &self.o, p };
        terms.assemble(
            &iterate,
            &self.s_rest,
            Curvature::GaussNewton,
            &mut parameter_block,
            |k, block, cost_k| {
                cost += finite(cost_k, "residual", k)?;
                finite(block.diagonal.sum() + block.border.sum(), "derivative", k)?;
                diagonal_max = diagonal_max.max(block.diagonal.diagonal().max());
                Ok(())
            },
        )?;
        let by_parameter = parameter_block.hessian.diagonal();
        // Of the whole piece: no step of it is to blame. `max` would drop a NaN.
        finite(by_parameter.sum(), "derivative", 0)?;
        Ok((cost, diagonal_max.max(by_parameter.max())))
    }

    /// Linearizes at the iterate, eliminates every state and returns what is left for the parameter.
    ///
    /// # Errors
    /// The damped matrix is not positive definite.
    pub(super) fn eliminate<M>(
        &mut self,
        terms: &Terms<M, NS, NU, NO, NP>,
        p: &Vector<NP>,
        curvature: Curvature,
        damping: f64,
    ) -> Result<ReducedSystem<NP>, NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut parameter_block = ReducedSystem::zeros();
        let iterate = Iterate { s: &self.s, u: &self.u, o: &self.o, p };
        let mut cost = 0.0;
        terms.assemble(
            &iterate,
            &self.s_rest,
            curvature,
            &mut parameter_block,
            |k, block, cost_k| {
                cost += cost_k;
                self.chain.eliminate(k, block, damping)
            },
        )?;
        let reduced = self.chain.reduced(&parameter_block);
        self.quadratic_model = QuadraticModel { cost, damping, reduced };
        Ok(reduced)
    }

    /// What is left for the parameter when every state is eliminated at the iterate, without damping and
    /// without rows for the back substitution; and the cost of the piece there.
    ///
    /// # Errors
    /// The matrix of the states is not positive definite.
    pub(super) fn reduced_system<M>(
        &self,
        terms: &Terms<M, NS, NU, NO, NP>,
        p: &Vector<NP>,
        curvature: Curvature,
    ) -> Result<(ReducedSystem<NP>, f64), NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let (mut parameter_block, mut reduced) = (ReducedSystem::zeros(), ReducedSystem::zeros());
        let iterate = Iterate { s: &self.s, u: &self.u, o: &self.o, p };
        let mut front = EliminationFront::new();
        let mut cost = 0.0;
        terms.assemble(
            &iterate,
            &self.s_rest,
            curvature,
            &mut parameter_block,
            |k, block, cost_k| {
                cost += cost_k;
                front.eliminate(k, block, 0.0, &mut reduced).map(|_| ())
            },
        )?;
        reduced += &parameter_block;
        Ok((reduced, cost))
    }

    /// Sets the candidate to what the states do when the parameter takes the step `p_step`, and returns
    /// what it is expected to cost.
    ///
    /// Valid after [`Segment::eliminate`].
    pub(super) fn back_substitute(&mut self, p_step: &Vector<NP>) -> f64 {
        self.chain.back_substitute(p_step, &mut self.s_candidate);
        let mut step_squared = 0.0;
        for (s, s_candidate) in self.s.iter().zip(&mut self.s_candidate) {
            step_squared += s_candidate.norm_squared();
            *s_candidate += s;
        }
        self.quadratic_model.cost_after(p_step, step_squared)
    }

    /// What the candidate with `p_candidate` contributes to the sums over pieces.
    pub(super) fn contribution<M>(
        &self,
        terms: &Terms<M, NS, NU, NO, NP>,
        p_candidate: &Vector<NP>,
    ) -> Contribution
    where
        M: Model<NS, NU, NO, NP>,
    {
        let iterate = Iterate { s: &self.s_candidate, u: &self.u, o: &self.o, p: p_candidate };
        let pairs = self.s.iter().zip(&self.s_candidate);
        Contribution {
            cost: terms.cost(&iterate, &self.s_rest),
            step_squared: pairs.map(|(s, s_candidate)| (s_candidate - s).norm_squared()).sum(),
            iterate_squared: self.s.iter().map(Vector::norm_squared).sum(),
        }
    }

    /// Makes the candidate the iterate.
    pub(super) fn accept(&mut self) {
        std::mem::swap(&mut self.s, &mut self.s_candidate);
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> Terms<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// Half the sum of `rho` over the residual blocks of a piece.
    pub(super) fn cost(&self, iterate: &Iterate<'_, NS, NU, NO, NP>, s_rest: &Vector<NS>) -> f64 {
        let first = iterate.s.first().map_or(0.0, |s| self.first(s, s_rest).norm_squared());
        0.5 * first + self.residuals.cost(iterate)
    }

    /// `C_0 (s - s_rest)`: the first state against rest.
    fn first(&self, s: &Vector<NS>, s_rest: &Vector<NS>) -> Vector<NS> {
        self.c_0.component_mul(&(s - s_rest))
    }

    /// Forms the normal equations of a piece block by block, adds the parameter's contribution to `parameter_block`,
    /// and gives each block away when nothing more will be added to it, with the cost that entered.
    pub(super) fn assemble<E>(
        &self,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        s_rest: &Vector<NS>,
        curvature: Curvature,
        parameter_block: &mut ReducedSystem<NP>,
        mut take: impl FnMut(usize, &mut Block<NS, NP>, f64) -> Result<(), E>,
    ) -> Result<(), E> {
        // They change places instead of being copied.
        let (mut block, mut next) = (&mut Block::zeros(), &mut Block::zeros());
        let mut cost = 0.0;
        if let Some(s) = iterate.s.first() {
            let r_first = self.first(s, s_rest);
            cost = 0.5 * r_first.norm_squared();
            block.gradient += self.c_0.component_mul(&r_first);
            block.diagonal += Matrix::from_diagonal(&self.c_0.component_mul(&self.c_0));
        }
        for k in 0..iterate.s.len() {
            cost += self.residuals.add_observation(iterate, k, curvature, block);
            if k < iterate.u.len() {
                let neighbours = NeighbourBlocks {
                    block: &mut *block,
                    next: &mut *next,
                    parameter_block: &mut *parameter_block,
                };
                cost += self.residuals.add_transition(iterate, k, curvature, neighbours);
            }
            take(k, block, cost)?;
            std::mem::swap(&mut block, &mut next);
            next.clear();
            cost = 0.0;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
