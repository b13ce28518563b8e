//! Estimate and sent sticks, from which a plan follows.

use horizon_model::rows::{Sticks, pose, stick};
use horizon_model::{InputFifo, Model};
use nalgebra::{Matrix3, SMatrix, SVector};

/// Estimate and sent sticks, from which the plan follows.
#[derive(Debug, Clone, Copy)]
pub(in crate::cycle) struct Known<'a, const NS: usize, const NP: usize> {
    /// Newest estimate. In the units of the model's rows
    pub(in crate::cycle) s_hat: &'a SVector<f64, NS>,
    /// Parameter estimate. In the units of its rows
    pub(in crate::cycle) p_hat: &'a SVector<f64, NP>,
    /// Covariance of `s_hat`; `None`: unknown. Units of its rows, squared
    pub(in crate::cycle) covariance: Option<SMatrix<f64, NS, NS>>,
    /// Sticks that were sent.
    pub(in crate::cycle) fifo: &'a InputFifo<{ stick::COUNT }>,
    /// Sticks that act in place of the sent ones in an outage; `None`: there is no outage. 1
    pub(in crate::cycle) instead: Option<Sticks>,
    /// First period after the estimate, seen from the coming step.
    pub(in crate::cycle) from_ahead: isize,
}

impl<const NS: usize, const NP: usize> Known<'_, NS, NP> {
    /// First step of the plan, seen from the coming step.
    pub(super) fn begin_ahead(&self) -> isize {
        self.fifo.known_steps().cast_signed()
    }

    /// The sticks that act in the step `ahead` of the coming one.
    pub(super) fn applied(&self, ahead: isize) -> Sticks {
        self.instead.unwrap_or_else(|| self.fifo.applied(ahead))
    }

    /// Covariance of the position `after_s` after the estimate, which does not depend on the sticks until then; zero if
    /// that of the estimate is unknown. World frame. m^2
    pub(super) fn covariance_after<M>(&self, model: &M, after_s: f64) -> Matrix3<f64>
    where
        M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
    {
        let Some(covariance) = self.covariance else { return Matrix3::zeros() };
        let step = model.step_by_state(self.s_hat, &Sticks::zeros(), self.p_hat, after_s);
        let pose_by_state = model.observe_by_state(self.s_hat) * step;
        let pos_by_state = pose_by_state.fixed_rows::<3>(pose::X);
        pos_by_state * covariance * pos_by_state.transpose()
    }
}
