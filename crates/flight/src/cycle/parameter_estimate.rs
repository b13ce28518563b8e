//! The parameter of the vehicle by the estimator, with its covariance.

use horizon_estim::Mhe;
use horizon_model::rows::{Sticks, pose, stick};

use super::{DeadTimeChange, Vehicle};

/// Estimate of the parameter of the model at the end of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterEstimate {
    /// Estimate, in the rows of the parameter. Unit of each row
    pub p: Vec<f64>,
    /// Covariance of `p` by the prior and the steps before the window, in the units of the estimator's weights, row
    /// by row.
    pub covariance: Vec<Vec<f64>>,
    /// Correction of the dead time of each stick, plus its remaining error; `None` if no motion showed it. s
    pub dead_time_change_s: Option<Sticks>,
}

impl ParameterEstimate {
    /// By the estimator and the correction of the dead times; `None` before the first estimate and with a fixed
    /// arrival.
    pub(super) fn of<M: Vehicle<NS, NP>, const NS: usize, const NP: usize>(
        mhe: &Mhe<M, NS, { stick::COUNT }, { pose::COUNT }, NP>,
        change: Option<DeadTimeChange>,
    ) -> Option<Self> {
        let covariance = mhe.is_started().then(|| mhe.parameter_covariance())??;
        let rows = covariance.row_iter().map(|row| row.iter().copied().collect()).collect();
        Some(Self {
            p: mhe.p_hat().as_slice().to_vec(),
            covariance: rows,
            dead_time_change_s: change.and_then(|change| change.found_s()),
        })
    }
}

#[cfg(test)]
mod tests;
