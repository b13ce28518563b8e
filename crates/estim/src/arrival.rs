//! Arrival cost: the information of the steps that left the window on its oldest state and the parameter.
//!
//! Owns the quadratic that stands for those steps, how it takes up one more of them and how it forgets.
//! When a step leaves the window is decided in `mhe.rs`; the elimination is that of `chain.rs`.
//! Derivation: `docs/model.md`, section 4, "Arrival cost".

use horizon_model::Model;
use horizon_model::setting::{SettingError, positive, vector, weight};
use horizon_model::{Matrix, Vector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::back_substitution::BackSubstitute;
use crate::chain::{Block, Eliminated, NeighbourBlocks};
use crate::cholesky::{Cholesky, NotPositive};
use crate::partition::Partition;
use crate::product::{mul, tr_mul};
use crate::reduced_system::ReducedSystem;
use crate::residual::{Curvature, Iterate, Residuals};
use crate::trajectory::Prior;

/// What becomes of a step that leaves the window, as written in a file.
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
        /// Time in which all but a part `1/e` of the information is forgotten in favour of the
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
pub(crate) struct Arrival<const NS: usize, const NP: usize> {
    partition: Option<Partition<NS, NP>>,
    c_0: Vector<NS>,
    /// What one step leaves of the information, in (0, 1].
    keep: f64,
    s_mean: Vector<NS>,
    p_mean: Vector<NP>,
    /// `D` of `docs/model.md`, section 4: `H[s, s]`, symmetric.
    by_state: Matrix<NS, NS>,
    /// `B`: `H[s, p]`.
    by_state_parameter: Matrix<NS, NP>,
    /// `C`: `H[p, p]`, symmetric.
    by_parameter: Matrix<NP, NP>,
}

impl<const NS: usize, const NP: usize> Arrival<NS, NP> {
    /// An arrival cost that knows nothing; [`Arrival::start`] comes before all else.
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
            keep: (-dt_s / forget_s).exp(),
            s_mean: Vector::zeros(),
            p_mean: Vector::zeros(),
            by_state: Matrix::zeros(),
            by_state_parameter: Matrix::zeros(),
            by_parameter: Matrix::zeros(),
        }
    }

    /// Begins with the priors before any step: `|C_0 (s - s_0)|^2 / 2` and the prior.
    pub(crate) fn start(&mut self, s_0: &Vector<NS>, prior: &Prior<NP>) {
        self.s_mean = *s_0;
        self.p_mean = prior.p_prior;
        self.by_state = Matrix::from_diagonal(&self.c_0.component_mul(&self.c_0));
        self.by_state_parameter = Matrix::zeros();
        self.by_parameter = prior.information();
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
            mul(&self.by_state, &ds) + mul(&self.by_state_parameter, &dp),
            tr_mul(&self.by_state_parameter, &ds) + mul(&self.by_parameter, &dp),
        )
    }

    /// Information on the parameter with the state eliminated: `H[p, p] - H[p, s] H[s, s]^-1 H[s, p]`.
    ///
    /// # Errors
    /// `H[s, s]` is not positive definite.
    pub(crate) fn information(&self) -> Result<Matrix<NP, NP>, NotPositive> {
        let root = Cholesky::new(self.by_state)?.forward(self.by_state_parameter);
        Ok(self.by_parameter - root.transpose() * root)
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
        block.diagonal += self.by_state;
        block.border += self.by_state_parameter;
        block.gradient += by_s;
        parameter_block.hessian += self.by_parameter;
        parameter_block.gradient += by_p;
    }

    /// Takes up the oldest step of `iterate` and becomes a cost of the state after it.
    ///
    /// The oldest state is eliminated exactly from the arrival cost, its observation and its
    /// transition, all linearized at `iterate`, robust weights included. Then the result fades towards
    /// the prior on the parameter. While the parameter is held its information neither grows nor fades:
    /// the step is taken up as if the parameter were known, and the arrival cost keeps its marginal.
    ///
    /// Where nothing determines the state after the step (its transition refused by a redescending
    /// loss, for example) the arrival cost begins again there.
    pub(crate) fn carry<M, const NU: usize, const NO: usize>(
        &mut self,
        residuals: &Residuals<M, NS, NU, NO, NP>,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        prior: &Prior<NP>,
        parameter_is_held: bool,
    ) where
        M: Model<NS, NU, NO, NP>,
    {
        if self.try_carry(residuals, iterate, prior, parameter_is_held).is_err() {
            self.start(&iterate.s[1], prior);
        }
    }

    fn try_carry<M, const NU: usize, const NO: usize>(
        &mut self,
        residuals: &Residuals<M, NS, NU, NO, NP>,
        iterate: &Iterate<'_, NS, NU, NO, NP>,
        prior: &Prior<NP>,
        parameter_is_held: bool,
    ) -> Result<(), NotPositive>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let (mut block, mut next, mut parameter_block) =
            (Block::zeros(), Block::zeros(), ReducedSystem::zeros());
        self.add_to(&mut block, &mut parameter_block, &iterate.s[0], iterate.p);
        let mut marginal = parameter_block;
        if parameter_is_held {
            Eliminated::zeros().eliminate_after(None, &block, 0.0, &mut marginal)?;
        }
        residuals.add_observation(iterate, 0, Curvature::Reweighted, &mut block);
        let neighbours = NeighbourBlocks {
            block: &mut block,
            next: &mut next,
            parameter_block: &mut parameter_block,
        };
        residuals.add_transition(iterate, 0, Curvature::Reweighted, neighbours);
        if parameter_is_held {
            block.border = Matrix::zeros();
            next.border = Matrix::zeros();
            parameter_block = marginal;
        }
        let fading = (!parameter_is_held).then(|| {
            let mut prior_system = ReducedSystem::zeros();
            prior.add_to(&mut prior_system, iterate.p);
            Fading { keep: self.keep, prior: prior_system }
        });
        let folded = match &self.partition {
            Some(partition) => partition.fold(&block, &next, &parameter_block, fading.as_ref())?,
            None => fold(&block, next, parameter_block, fading.as_ref())?,
        };
        self.s_mean = iterate.s[1] + folded.s_step;
        self.p_mean = iterate.p + folded.p_step;
        self.by_state = folded.block.diagonal;
        self.by_state_parameter = folded.block.border;
        self.by_parameter = folded.parameter_block.hessian;
        Ok(())
    }
}

#[cfg(test)]
impl<const NS: usize, const NP: usize> Arrival<NS, NP> {
    pub(crate) fn undivided(self) -> Self {
        Self { partition: None, ..self }
    }
}

/// How information on the parameter fades towards its prior.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Fading<const NP: usize> {
    /// Part of the information that a step leaves, in (0, 1].
    pub(crate) keep: f64,
    /// Gradient and curvature of the prior.
    pub(crate) prior: ReducedSystem<NP>,
}

/// A quadratic in the steps of a state and of the parameter, and where it is least.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Folded<const NS: usize, const NP: usize> {
    /// Rows of the state; the block before it is not part of it.
    pub(crate) block: Block<NS, NP>,
    /// Rows of the parameter.
    pub(crate) parameter_block: ReducedSystem<NP>,
    pub(crate) s_step: Vector<NS>,
    pub(crate) p_step: Vector<NP>,
}

impl<const NS: usize, const NP: usize> Folded<NS, NP> {
    pub(crate) fn zeros() -> Self {
        Self {
            block: Block::zeros(),
            parameter_block: ReducedSystem::zeros(),
            s_step: Vector::zeros(),
            p_step: Vector::zeros(),
        }
    }
}

/// Eliminates the state of `block` from the equations of two neighbours, and fades: `L L' = H^_00`, then `D`, `B`, `C`,
/// `g_s` and `g_p` of `docs/model.md`, section 4.
///
/// # Errors
/// The matrix is not positive definite.
pub(crate) fn fold<const NS: usize, const NP: usize>(
    block: &Block<NS, NP>,
    mut next: Block<NS, NP>,
    mut parameter_block: ReducedSystem<NP>,
    fading: Option<&Fading<NP>>,
) -> Result<Folded<NS, NP>, NotPositive> {
    let mut state = Eliminated::zeros();
    // `L`, `B_0` and `y`; the parameter's block loses `B_0' B_0` and `B_0' y`.
    state.eliminate_after(None, block, 0.0, &mut parameter_block)?;
    // `A`, and `A' A`, `A' B_0` and `A' y` of the next state.
    state.take_from(&mut next);
    if let Some(Fading { keep, prior }) = fading {
        next.diagonal *= *keep;
        next.border *= *keep;
        next.gradient *= *keep;
        parameter_block.hessian += (prior.hessian - parameter_block.hessian) * (1.0 - keep);
        parameter_block.gradient += (prior.gradient - parameter_block.gradient) * (1.0 - keep);
    }
    // Only the lower triangles were computed as they should be: rounding must not add up above.
    next.diagonal.fill_upper_triangle_with_lower_triangle();
    parameter_block.hessian.fill_upper_triangle_with_lower_triangle();
    let mut reduced = parameter_block;
    state.eliminate_after(None, &next, 0.0, &mut reduced)?;
    let p_step = Cholesky::new(reduced.hessian)?.solve(-reduced.gradient);
    let (s_step, _) = state.step(&p_step, &Vector::zeros());
    Ok(Folded { block: next, parameter_block, s_step, p_step })
}

#[cfg(test)]
mod tests;
