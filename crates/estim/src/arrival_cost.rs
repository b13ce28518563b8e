//! Arrival cost: the information of the steps that left the window on its oldest state and the parameter.
//!
//! Owns the quadratic that stands for those steps, the marginalization of one more of them and forgetting.
//! When a step leaves the window is decided in `mhe.rs`; the elimination is that of `chain.rs`.
//! Derivation: `docs/model.md`, section 4, "Arrival cost".

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use horizon_model::setting::{SettingError, positive, vector, weight};
use horizon_model::{Matrix, Model, Vector};

use crate::back_substitution::BackSubstitute;
use crate::chain::{Block, Eliminated, NeighbourBlocks};
use crate::cholesky::{Cholesky, NotPositive};
use crate::partition::Partition;
use crate::product::{mul, tr_mul};
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate, Residuals};
use crate::window_problem::Prior;

/// Treatment of a step that leaves the window, as written in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum ArrivalTable {
    /// Nothing of it remains but the estimate of the state after it, which is kept as it is, as in
    /// the thesis.
    Fixed,
    /// The step's information on the next state and the parameter is kept. `C_p` must be positive.
    Carried {
        /// Weights of the first state against rest at its first observation, one per state row.
        /// 1 / unit of the row, 1e-6..=1e6
        #[serde(rename = "C_0")]
        c_0: Vec<f64>,
        /// Time in which all but a fraction `1/e` of the information is forgotten in favour of the
        /// prior on the parameter. s, > 0
        forget_s: f64,
    },
}

/// Checked [`ArrivalTable`] for a model with `NS` states.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum ArrivalSettings<const NS: usize> {
    /// The oldest state of the window is fixed.
    Fixed,
    /// The oldest state is free under an arrival cost.
    Carried {
        /// Weights of the first state against rest, 1e-6..=1e6. Unit: 1 / unit of the row.
        c_0: Vector<NS>,
        /// Time constant of forgetting. s, > 0
        forget_s: f64,
    },
}

impl ArrivalTable {
    /// The settings for a state with the rows of `M`.
    ///
    /// # Errors
    /// The first key that breaks its rule.
    pub(crate) fn check<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &self,
    ) -> Result<ArrivalSettings<NS>, SettingError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        Ok(match self {
            Self::Fixed => ArrivalSettings::Fixed,
            Self::Carried { c_0, forget_s } => ArrivalSettings::Carried {
                c_0: vector("C_0", c_0, &M::STATE, weight)?,
                forget_s: positive("forget_s", *forget_s)?,
            },
        })
    }
}

/// `Gamma(s, p) = 1/2 |(s, p) - mean|^2_H`: never negative, and zero at the mean.
#[derive(Debug, Clone)]
pub(crate) struct ArrivalCost<const NS: usize, const NP: usize> {
    partition: Option<Partition<NS, NP>>,
    c_0: Vector<NS>,
    /// Fraction of the information that is left after one step. 1, in (0, 1]
    forgetting_factor: f64,
    s_mean: Vector<NS>,
    p_mean: Vector<NP>,
    /// `D` of `docs/model.md`, section 4: `H[s, s]`, symmetric.
    hessian_ss: Matrix<NS, NS>,
    /// `B`: `H[s, p]`.
    hessian_sp: Matrix<NS, NP>,
    /// `C`: `H[p, p]`, symmetric.
    hessian_pp: Matrix<NP, NP>,
}

impl<const NS: usize, const NP: usize> ArrivalCost<NS, NP> {
    /// An arrival cost without information; [`ArrivalCost::start`] comes before all else.
    ///
    /// It takes the subsystems of `partition` one by one.
    pub(crate) fn new(
        c_0: Vector<NS>,
        forget_s: f64,
        dt_s: f64,
        partition: Option<Partition<NS, NP>>,
    ) -> Self {
        Self {
            partition,
            c_0,
            forgetting_factor: (-dt_s / forget_s).exp(),
            s_mean: Vector::zeros(),
            p_mean: Vector::zeros(),
            hessian_ss: Matrix::zeros(),
            hessian_sp: Matrix::zeros(),
            hessian_pp: Matrix::zeros(),
        }
    }

    /// Begins with the priors before any step: `|C_0 (s - s_0)|^2 / 2` and the prior.
    pub(crate) fn start(&mut self, s_0: &Vector<NS>, prior: &Prior<NP>) {
        self.s_mean = *s_0;
        self.p_mean = prior.p_prior;
        self.hessian_ss = Matrix::from_diagonal(&self.c_0.component_mul(&self.c_0));
        self.hessian_sp = Matrix::zeros();
        self.hessian_pp = prior.information();
    }

    /// `Gamma` at `(s, p)`.
    pub(crate) fn cost(&self, s: &Vector<NS>, p: &Vector<NP>) -> f64 {
        let (by_s, by_p) = self.gradient(s, p);
        0.5 * (by_s.dot(&(s - self.s_mean)) + by_p.dot(&(p - self.p_mean)))
    }

    /// Gradient of `Gamma` at `(s, p)`, by the state and by the parameter.
    fn gradient(&self, s: &Vector<NS>, p: &Vector<NP>) -> (Vector<NS>, Vector<NP>) {
        let (ds, dp) = (s - self.s_mean, p - self.p_mean);
        (
            mul(&self.hessian_ss, &ds) + mul(&self.hessian_sp, &dp),
            tr_mul(&self.hessian_sp, &ds) + mul(&self.hessian_pp, &dp),
        )
    }

    /// Information on the parameter with the state eliminated: `H[p, p] - H[p, s] H[s, s]^-1 H[s, p]`.
    ///
    /// # Errors
    /// `H[s, s]` is not positive definite.
    pub(crate) fn information(&self) -> Result<Matrix<NP, NP>, NotPositive> {
        let root = Cholesky::new(self.hessian_ss)?.forward(self.hessian_sp);
        Ok(self.hessian_pp - root.transpose() * root)
    }

    /// Adds gradient and curvature at `(s, p)` to the block of the oldest state and to the parameter block.
    pub(crate) fn add_to(
        &self,
        block: &mut Block<NS, NP>,
        parameter_block: &mut ReducedSystem<NP>,
        s: &Vector<NS>,
        p: &Vector<NP>,
    ) {
        let (by_s, by_p) = self.gradient(s, p);
        block.diagonal += self.hessian_ss;
        block.border += self.hessian_sp;
        block.gradient += by_s;
        parameter_block.hessian += self.hessian_pp;
        parameter_block.gradient += by_p;
    }

    /// Takes up the oldest step of `iterate` and becomes a cost of the state after it.
    ///
    /// The oldest state is eliminated exactly from the arrival cost, its observation and its
    /// transition, all linearized at `iterate`, robust weights included. Then the result is forgotten in favour of
    /// the prior on the parameter, by one step. While the parameter is held its information stays constant:
    /// the step is taken up as if the parameter were known, and the arrival cost keeps its marginal.
    ///
    /// Where nothing determines the state after the step (its transition refused by a redescending
    /// loss, for example) the arrival cost begins again there.
    pub(crate) fn absorb_oldest_step<M, const NU: usize, const NO: usize>(
        &mut self,
        residuals: &Residuals<M, NS, NU, NO, NP>,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        prior: &Prior<NP>,
        parameter_is_held: bool,
    ) where
        M: Model<NS, NU, NO, NP>,
    {
        if self.try_absorb_oldest_step(residuals, iterate, prior, parameter_is_held).is_err() {
            self.start(&iterate.s[1], prior);
        }
    }

    fn try_absorb_oldest_step<M, const NU: usize, const NO: usize>(
        &mut self,
        residuals: &Residuals<M, NS, NU, NO, NP>,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        prior: &Prior<NP>,
        parameter_is_held: bool,
    ) -> Result<(), NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let mut oldest = OldestStep::zeros();
        let OldestStep { block, next, parameter_block, .. } = &mut oldest;
        self.add_to(block, parameter_block, &iterate.s[0], iterate.p);
        residuals.add_observation(iterate, 0, Curvature::Reweighted, block);
        let neighbours = NeighbourBlocks { block, next, parameter_block };
        residuals.add_transition(iterate, 0, Curvature::Reweighted, neighbours);
        if parameter_is_held {
            oldest.block.border = Matrix::zeros();
            oldest.next.border = Matrix::zeros();
            oldest.parameter_block = self.marginal_of_parameter(&iterate.s[0], iterate.p)?;
        } else {
            let mut prior_system = ReducedSystem::zeros();
            prior.add_to(&mut prior_system, iterate.p);
            oldest.forgetting =
                Some(Forgetting { factor: self.forgetting_factor, prior: prior_system });
        }
        let marginal = match &self.partition {
            Some(partition) => partition.marginalize(&oldest)?,
            None => marginalize(oldest)?,
        };
        self.s_mean = iterate.s[1] + marginal.s_step;
        self.p_mean = iterate.p + marginal.p_step;
        self.hessian_ss = marginal.block.diagonal;
        self.hessian_sp = marginal.block.border;
        self.hessian_pp = marginal.parameter_block.hessian;
        Ok(())
    }

    /// `Gamma` at `(s, p)` with the state eliminated.
    ///
    /// # Errors
    /// `H[s, s]` is not positive definite.
    fn marginal_of_parameter(
        &self,
        s: &Vector<NS>,
        p: &Vector<NP>,
    ) -> Result<ReducedSystem<NP>, NotPositive> {
        let (mut block, mut marginal) = (Block::zeros(), ReducedSystem::zeros());
        self.add_to(&mut block, &mut marginal, s, p);
        Eliminated::zeros().eliminate_after(None, &block, 0.0, &mut marginal)?;
        Ok(marginal)
    }
}

#[cfg(test)]
impl<const NS: usize, const NP: usize> ArrivalCost<NS, NP> {
    pub(crate) fn undivided(self) -> Self {
        Self { partition: None, ..self }
    }
}

/// Normal equations of a step that leaves the window.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OldestStep<const NS: usize, const NP: usize> {
    /// Rows of the oldest state, which is eliminated.
    pub(crate) block: Block<NS, NP>,
    /// Rows of the state after it.
    pub(crate) next: Block<NS, NP>,
    /// Rows of the parameter.
    pub(crate) parameter_block: ReducedSystem<NP>,
    /// `None`: nothing is forgotten.
    pub(crate) forgetting: Option<Forgetting<NP>>,
}

impl<const NS: usize, const NP: usize> OldestStep<NS, NP> {
    fn zeros() -> Self {
        Self {
            block: Block::zeros(),
            next: Block::zeros(),
            parameter_block: ReducedSystem::zeros(),
            forgetting: None,
        }
    }
}

/// Exponential forgetting of information in favour of the prior on the parameter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Forgetting<const NP: usize> {
    /// Fraction of the information that is left after one step. 1, in (0, 1]
    pub(crate) factor: f64,
    /// Gradient and Hessian of the prior.
    pub(crate) prior: ReducedSystem<NP>,
}

/// Quadratic in the steps of a state and of the parameter, the state before eliminated, and its minimum.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Marginal<const NS: usize, const NP: usize> {
    /// Rows of the state; the block before it is not part of it.
    pub(crate) block: Block<NS, NP>,
    /// Rows of the parameter.
    pub(crate) parameter_block: ReducedSystem<NP>,
    /// Step of the state to the minimum. Unit of each row
    pub(crate) s_step: Vector<NS>,
    /// Step of the parameter to the minimum. Unit of each row
    pub(crate) p_step: Vector<NP>,
}

impl<const NS: usize, const NP: usize> Marginal<NS, NP> {
    pub(crate) fn zeros() -> Self {
        Self {
            block: Block::zeros(),
            parameter_block: ReducedSystem::zeros(),
            s_step: Vector::zeros(),
            p_step: Vector::zeros(),
        }
    }
}

/// Eliminates the oldest state, then forgets: `L L' = H^_00`, then `D`, `B`, `C`, `g_s` and `g_p` of `docs/model.md`,
/// section 4.
///
/// # Errors
/// The matrix is not positive definite.
pub(crate) fn marginalize<const NS: usize, const NP: usize>(
    oldest: OldestStep<NS, NP>,
) -> Result<Marginal<NS, NP>, NotPositive> {
    let OldestStep { block, mut next, mut parameter_block, forgetting } = oldest;
    let mut state = Eliminated::zeros();
    // `L`, `B_0` and `y`; the parameter's block loses `B_0' B_0` and `B_0' y`.
    state.eliminate_after(None, &block, 0.0, &mut parameter_block)?;
    // `A`, and `A' A`, `A' B_0` and `A' y` of the next state.
    state.eliminate_from(&mut next);
    if let Some(Forgetting { factor, prior }) = forgetting {
        next.diagonal *= factor;
        next.border *= factor;
        next.gradient *= factor;
        parameter_block.hessian += (prior.hessian - parameter_block.hessian) * (1.0 - factor);
        parameter_block.gradient += (prior.gradient - parameter_block.gradient) * (1.0 - factor);
    }
    // The elimination is exact in the lower triangles only: mirrored, rounding does not accumulate above.
    next.diagonal.fill_upper_triangle_with_lower_triangle();
    parameter_block.hessian.fill_upper_triangle_with_lower_triangle();
    let mut reduced = parameter_block;
    state.eliminate_after(None, &next, 0.0, &mut reduced)?;
    let p_step = Cholesky::new(reduced.hessian)?.solve(-reduced.gradient);
    let (s_step, _) = state.step(&p_step, &Vector::zeros());
    Ok(Marginal { block: next, parameter_block, s_step, p_step })
}

#[cfg(test)]
mod tests;
