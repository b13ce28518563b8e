//! Settings of an identification.

use horizon_model::setting::{SettingError, vector, weight, weight_or_zero};
use horizon_model::{Model, Vector};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::levenberg::{LmSettings, LmTable};
use crate::loss::{Loss, LossTable};
use crate::residual::Curvature;
use crate::window_problem::Prior;

/// Identification, as written in a file. Weights multiply residuals: the thesis' appendix prints
/// their squares.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct IdentTable {
    /// Weights of the observation residuals, one per observation row. 1 / unit of the row, 0 or 1e-6..=1e6
    #[serde(rename = "C_o")]
    pub c_o: Vec<f64>,
    /// Weights of the transition residuals, which are divided by the period, one per state row.
    /// s / unit of the row, 1e-6..=1e6
    #[serde(rename = "C_s")]
    pub c_s: Vec<f64>,
    /// Weights of the prior on the parameter, one per parameter row. 1 / unit of the row, 0 or 1e-6..=1e6
    #[serde(rename = "C_p")]
    pub c_p: Vec<f64>,
    /// Weights of each piece's first state against rest at its first observation, one per state row;
    /// 0 leaves a row free. 1 / unit of the row, 0 or 1e-6..=1e6
    #[serde(rename = "C_0")]
    pub c_0: Vec<f64>,
    /// Expected parameter, where identification starts. Between `p_lb` and `p_ub`. Unit of each row
    pub p_prior: Vec<f64>,
    /// Lower bounds of the parameter. Unit of each row
    pub p_lb: Vec<f64>,
    /// Upper bounds of the parameter, at least `p_lb`. Unit of each row
    pub p_ub: Vec<f64>,
    /// Loss of each observation.
    pub observation_loss: LossTable,
    /// Loss of each transition.
    pub transition_loss: LossTable,
    /// Which second derivatives of the cost are used.
    pub curvature: Curvature,
    /// Levenberg-Marquardt.
    pub solver: LmTable,
}

/// Checked [`IdentTable`] for a model with `NS` states, `NO` observations and `NP` parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentSettings<const NS: usize, const NO: usize, const NP: usize> {
    /// Weights of the observations. 1 / unit of the row
    pub(super) c_o: Vector<NO>,
    /// Weights of the transitions. s / unit of the row
    pub(super) c_s: Vector<NS>,
    /// Weights of the first state of a piece. 1 / unit of the row
    pub(super) c_0: Vector<NS>,
    pub(super) prior: Prior<NP>,
    pub(super) observation_loss: Loss,
    pub(super) transition_loss: Loss,
    pub(super) curvature: Curvature,
    pub(super) solver: LmSettings,
}

impl IdentTable {
    /// The settings of an identification of the model `M`.
    ///
    /// # Errors
    /// The first key that breaks its rule.
    pub fn check<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &self,
    ) -> Result<IdentSettings<NS, NO, NP>, SettingError>
    where
        M: Model<NS, NU, NO, NP>,
    {
        let Self { c_p, p_prior, p_lb, p_ub, .. } = self;
        let prior = Prior::check(&M::PARAMETER, c_p, p_prior, p_lb, p_ub)?;
        Ok(IdentSettings {
            c_o: vector("C_o", &self.c_o, &M::OBSERVATION, weight_or_zero)?,
            c_s: vector("C_s", &self.c_s, &M::STATE, weight)?,
            c_0: vector("C_0", &self.c_0, &M::STATE, weight_or_zero)?,
            prior,
            observation_loss: self.observation_loss.check("observation_loss")?,
            transition_loss: self.transition_loss.check("transition_loss")?,
            curvature: self.curvature,
            solver: LmSettings::try_from(&self.solver).map_err(|error| error.under("solver"))?,
        })
    }
}

#[cfg(test)]
mod tests;
