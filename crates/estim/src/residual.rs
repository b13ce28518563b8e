//! Residual blocks of a sequence of states and their derivatives.
//!
//! Owns what an observation and a transition cost and how they enter a [`Chain`]. Weights multiply
//! residuals; a cost is half the sum of `rho`. The prior on the parameter and the iteration live in
//! `window_problem.rs`.

use horizon_model::{Linearized, Model, transpose};
use nalgebra::SVector;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::chain::{Block, Chain, NeighbourBlocks};
use crate::levenberg::LmError;
use crate::loss::Loss;
use crate::product::{add_mul_sparse, add_sparse, outer, sub_scaled_sparse, tr_mul};

/// An observation of which any row may be absent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observed<const NO: usize> {
    /// Observed values; the value of an absent row is never read. Unit of each row
    pub o: SVector<f64, NO>,
    /// Whether the row was observed.
    pub is_present: [bool; NO],
}

impl<const NO: usize> Observed<NO> {
    /// An observation with every row present; `o` in the unit of each row.
    pub fn full(o: SVector<f64, NO>) -> Self {
        Self { o, is_present: [true; NO] }
    }

    /// An observation with no row present.
    pub fn missing() -> Self {
        Self { o: SVector::zeros(), is_present: [false; NO] }
    }

    /// Whether every present row is finite.
    pub fn is_finite(&self) -> bool {
        self.is_present.iter().zip(&self.o).all(|(is_present, o)| !is_present || o.is_finite())
    }
}

/// The variables of a problem, states and parameter, with the inputs and observations of their trajectory.
///
/// `s` and `o` have one entry more than `u`: `u[k]` acts from `s[k]` to `s[k + 1]`, and `o[k]`
/// observes `s[k]`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Iterate<'a, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    /// States. Unit of each row
    pub(crate) s: &'a [SVector<f64, NS>],
    /// Applied inputs. Unit of each row
    pub(crate) u: &'a [SVector<f64, NU>],
    /// Observations.
    pub(crate) o: &'a [Observed<NO>],
    /// Parameter. Unit of each row
    pub(crate) p: &'a SVector<f64, NP>,
}

/// Which second derivatives of the cost enter the normal equations.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Curvature {
    /// Products of first derivatives. Never negative; slow where residuals are large.
    GaussNewton,
    /// Second derivatives of the step too, if the model has them: a few iterations where the start is good.
    Exact,
    /// Products of first derivatives, in which a robust loss only scales its block. Never below the
    /// curvature of such a block, so that a block whose state little else holds is not overshot; slow
    /// where outliers are many.
    Reweighted,
}

/// The residual blocks of a model with their weights and losses.
#[derive(Debug, Clone)]
pub struct Residuals<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize> {
    /// The model.
    pub model: M,
    /// Period. s, > 0
    pub dt_s: f64,
    /// Weight of an observation residual, 0 or 1e-6..=1e6. Unit: 1 / unit of the row.
    pub c_o: SVector<f64, NO>,
    /// Weight of a transition residual, 1e-6..=1e6. Unit: s / unit of the row.
    pub c_s: SVector<f64, NS>,
    /// Loss of each observation.
    pub observation_loss: Loss,
    /// Loss of each transition.
    pub transition_loss: Loss,
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Residuals<M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP>,
{
    /// `C_o (o - g(s))`, thesis equation 3.44; zero in absent rows. Its Jacobian by `s` is equation 3.76.
    ///
    /// Real time: no allocation of ours, one call of [`Model::observe`].
    #[inline]
    pub fn observation(&self, s: &SVector<f64, NS>, observed: &Observed<NO>) -> SVector<f64, NO> {
        let o_pred = self.model.observe(s);
        SVector::from_fn(|i, _| {
            if observed.is_present[i] { self.c_o[i] * (observed.o[i] - o_pred[i]) } else { 0.0 }
        })
    }

    /// `C_s (f(s, u, p) - s_next) / dt`, thesis equation 3.45 divided by the period (section 4.3.7).
    /// Its Jacobians by `s` and `p` are equations 3.78 and 3.79.
    ///
    /// Real time: no allocation of ours, one call of [`Model::step`].
    #[inline]
    pub fn transition(
        &self,
        s: &SVector<f64, NS>,
        s_next: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
    ) -> SVector<f64, NS> {
        (self.model.step(s, u, p, self.dt_s) - s_next).component_mul(&self.transition_weight())
    }

    /// `C_s / dt`, NS rows. 1 / (unit of the row of [`Model::STATE`] and second). Minus this is the diagonal of the
    /// Jacobian of [`Residuals::transition`] by `s_next`, thesis equation 3.77; the other entries are zero.
    ///
    /// Real time: no allocation, constant cost.
    #[inline]
    pub(crate) fn transition_weight(&self) -> SVector<f64, NS> {
        self.c_s / self.dt_s
    }

    /// Half the sum of `rho` over the blocks of `iterate`. 1
    ///
    /// Real time: no allocation of ours; one call of [`Model::observe`] and [`Model::step`] for each step.
    pub(crate) fn cost(&self, iterate: &Iterate<'_, NS, NU, NO, NP>) -> f64 {
        let prepared = Self { model: self.model.prepared(iterate.p, self.dt_s), ..*self };
        let observations = iterate.s.iter().zip(iterate.o).map(|(s, observed)| {
            0.5 * self.observation_loss.at(self.observation(s, observed).norm_squared()).value
        });
        let transitions = iterate.s.windows(2).zip(iterate.u).map(|(pair, u)| {
            let r = prepared.transition(&pair[0], &pair[1], u, iterate.p);
            0.5 * self.transition_loss.at(r.norm_squared()).value
        });
        observations.sum::<f64>() + transitions.sum::<f64>()
    }

    /// Adds gradient and curvature of every block of `iterate` to `chain`, whose block `k` is `s[k]`,
    /// and returns the cost.
    ///
    /// Real time: no allocation of ours; linear in the length, one linearization of the model for each step.
    ///
    /// # Errors
    /// A residual is not finite.
    pub(crate) fn accumulate(
        &self,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        curvature: Curvature,
        chain: &mut Chain<NS, NP>,
    ) -> Result<f64, LmError> {
        let prepared = Self { model: self.model.prepared(iterate.p, self.dt_s), ..*self };
        let mut cost = 0.0;
        for (k, block) in chain.blocks_mut().iter_mut().enumerate() {
            cost += finite(self.add_observation(iterate, k, curvature, block), "r_obs", k)?;
        }
        let (blocks, parameter_block) = chain.parts_mut();
        let mut blocks = blocks.iter_mut();
        let Some(mut block) = blocks.next() else { return Ok(cost) };
        for (k, next) in blocks.enumerate() {
            let neighbours =
                NeighbourBlocks { block, next: &mut *next, parameter_block: &mut *parameter_block };
            cost +=
                finite(prepared.add_transition(iterate, k, curvature, neighbours), "r_dyn", k + 1)?;
            block = next;
        }
        Ok(cost)
    }

    /// Adds the contribution of observation `k` to the block of its state; returns its cost.
    #[inline]
    pub(crate) fn add_observation(
        &self,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        k: usize,
        curvature: Curvature,
        block: &mut Block<NS, NP>,
    ) -> f64 {
        let (s, observed) = (&iterate.s[k], &iterate.o[k]);
        let r = self.observation(s, observed);
        let (weight, cost) = self.observation_loss.weigh(&r);
        let j = self.model.observe_by_state(s);
        let by_observed = transpose(&j);
        let c = SVector::from_fn(|i, _| if observed.is_present[i] { self.c_o[i] } else { 0.0 });
        let by_o_pred = -r.component_mul(&c);
        let gradient = by_o_pred * weight.derivative;
        let information = c.component_mul(&c) * weight.derivative;
        add_mul_sparse(&mut block.gradient, &by_observed, &gradient, &SVector::repeat(1.0));
        add_mul_sparse(&mut block.diagonal, &by_observed, &information, &j);
        if weight.along < 0.0 && curvature != Curvature::Reweighted {
            let along = tr_mul(&j, &by_o_pred);
            block.diagonal += outer(&(along * weight.along), &along);
        }
        cost
    }

    /// Adds the contribution of the transition from state `k` to the next to their blocks; returns its
    /// cost.
    #[inline]
    pub(crate) fn add_transition(
        &self,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        k: usize,
        curvature: Curvature,
        neighbours: NeighbourBlocks<'_, NS, NP>,
    ) -> f64 {
        let NeighbourBlocks { block, next, parameter_block } = neighbours;
        // Copied: nothing that is written below can change what the model computes twice.
        let (s, u, p) = (&{ iterate.s[k] }, &{ iterate.u[k] }, &{ *iterate.p });
        let Linearized { s_next, by_state, by_parameter } =
            self.model.linearize(s, u, p, self.dt_s);
        let c = self.transition_weight();
        let r = (s_next - iterate.s[k + 1]).component_mul(&c);
        let (weight, cost) = self.transition_loss.weigh(&r);

        // By the predicted next state; by the next state itself it is the opposite.
        let gradient = r.component_mul(&c) * weight.derivative;
        let information = c.component_mul(&c) * weight.derivative;
        let (from_state, from_parameter) = (transpose(&by_state), transpose(&by_parameter));
        let one = SVector::repeat(1.0);
        add_mul_sparse(&mut parameter_block.hessian, &from_parameter, &information, &by_parameter);
        add_mul_sparse(&mut parameter_block.gradient, &from_parameter, &gradient, &one);
        add_mul_sparse(&mut block.diagonal, &from_state, &information, &by_state);
        add_mul_sparse(&mut block.border, &from_state, &information, &by_parameter);
        add_mul_sparse(&mut block.gradient, &from_state, &gradient, &one);
        for row in 0..NS {
            next.diagonal[(row, row)] += information[row];
        }
        sub_scaled_sparse(&mut next.before, &information, &by_state);
        sub_scaled_sparse(&mut next.border, &information, &by_parameter);
        next.gradient -= gradient;
        if weight.along < 0.0 && curvature != Curvature::Reweighted {
            let by_next = r.component_mul(&c);
            let along_state = tr_mul(&by_state, &by_next);
            let along_parameter = tr_mul(&by_parameter, &by_next);
            let scaled_parameter = along_parameter * weight.along;
            parameter_block.hessian += outer(&scaled_parameter, &along_parameter);
            block.diagonal += outer(&(along_state * weight.along), &along_state);
            block.border += outer(&along_state, &scaled_parameter);
            let scaled_next = by_next * weight.along;
            next.diagonal += outer(&scaled_next, &by_next);
            next.before -= outer(&scaled_next, &along_state);
            next.border -= outer(&scaled_next, &along_parameter);
        }
        if curvature == Curvature::Exact
            && let Some(second) = self.model.hessian_by_parameter(s, u, p, self.dt_s, &gradient)
        {
            add_sparse(&mut block.diagonal, &second.by_state);
            add_sparse(&mut block.border, &second.by_state_parameter);
            add_sparse(&mut parameter_block.hessian, &second.by_parameter);
        }
        cost
    }
}

/// `cost`, unless the residual block behind it is not finite.
#[inline]
pub(crate) fn finite(cost: f64, block: &'static str, k: usize) -> Result<f64, LmError> {
    if cost.is_finite() { Ok(cost) } else { Err(LmError::NonFinite { block, k }) }
}

#[cfg(test)]
mod tests;
