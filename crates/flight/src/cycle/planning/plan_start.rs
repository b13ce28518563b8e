//! What a plan starts from.
//!
//! Owns which inputs act between the newest estimate and the first free input of a plan.

use horizon_model::InputFifo;
use horizon_model::rows::{Sticks, pose, stick};
use nalgebra::{Matrix3, SMatrix, SVector};

use crate::cycle::Vehicle;

/// Newest estimate, and the sent sticks that act until the first free ones of the plan.
#[derive(Debug, Clone, Copy)]
pub(in crate::cycle) struct PlanStart<'a, const NS: usize, const NP: usize> {
    /// Newest estimate. In the units of the model's rows
    pub(in crate::cycle) s_hat: &'a SVector<f64, NS>,
    /// Parameter estimate. In the units of its rows
    pub(in crate::cycle) p_hat: &'a SVector<f64, NP>,
    /// Covariance of `s_hat`; `None`: unknown. Units of its rows, squared
    pub(in crate::cycle) covariance: Option<SMatrix<f64, NS, NS>>,
    /// Sticks that were sent.
    pub(in crate::cycle) fifo: &'a InputFifo<{ stick::COUNT }>,
    /// Sticks that act in place of the sent ones in an outage; `None`: there is no outage. 1
    pub(in crate::cycle) outage_input: Option<Sticks>,
    /// First period after the estimate, relative to the coming one.
    pub(in crate::cycle) first_period: isize,
}

impl<const NS: usize, const NP: usize> PlanStart<'_, NS, NP> {
    /// First step of the plan, seen from the coming step.
    pub(super) fn begin_ahead(&self) -> isize {
        self.fifo.known_steps().cast_signed()
    }

    /// Periods from the estimate, at which the mission is, to the coming one: 0, or more for a plan of the next tick.
    pub(super) fn periods_since_estimate(&self) -> usize {
        usize::try_from(-self.first_period).unwrap_or(0)
    }

    /// The sticks that act in the step `ahead` of the coming one.
    pub(super) fn applied(&self, ahead: isize) -> Sticks {
        self.outage_input.unwrap_or_else(|| self.fifo.applied(ahead))
    }

    /// Covariance of the position `after_s` after the estimate, which does not depend on the sticks until then; zero if
    /// that of the estimate is unknown. World frame. m^2
    pub(super) fn covariance_after(
        &self,
        model: &impl Vehicle<NS, NP>,
        after_s: f64,
    ) -> Matrix3<f64> {
        let Some(covariance) = self.covariance else { return Matrix3::zeros() };
        let step = model.step_by_state(self.s_hat, &Sticks::zeros(), self.p_hat, after_s);
        let pose_by_state = model.observe_by_state(self.s_hat) * step;
        let pos_by_state = pose_by_state.fixed_rows::<3>(pose::X);
        pos_by_state * covariance * pos_by_state.transpose()
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::{Kinematic, Model};

    use super::*;

    #[test]
    fn the_sticks_of_an_outage_act_in_place_of_all_that_were_sent() {
        let mut fifo = InputFifo::new(&[0.0; stick::COUNT], &Kinematic::INPUT, 0.02).unwrap();
        fifo.push(&Sticks::repeat(0.3));
        let (s_hat, p_hat) = (SVector::<f64, 4>::zeros(), SVector::<f64, 4>::zeros());
        let start = |outage_input, first_period| PlanStart {
            s_hat: &s_hat,
            p_hat: &p_hat,
            covariance: None,
            fifo: &fifo,
            outage_input,
            first_period,
        };
        assert_eq!(start(None, 0).applied(-1), Sticks::repeat(0.3));
        assert_eq!(start(Some(Sticks::repeat(-0.1)), 0).applied(-1), Sticks::repeat(-0.1));
        assert_eq!(
            [0, -2].map(|first_period| start(None, first_period).periods_since_estimate()),
            [0, 2]
        );
        assert_eq!(start(None, 0).covariance_after(&Kinematic, 0.3), Matrix3::zeros());
    }
}
