//! A fitted model as a forecast, whatever its size.

use horizon_model::rows::{Sticks, pose, stick};
use horizon_model::{LaggedShape, Model, Vector};
use nalgebra::SVector;
use tello_flight::cycle::ModelKind;

use super::compare::{Tally, ValidationFlight};
use crate::forecast::Driven;

/// A fitted model as a forecast.
pub(super) trait AddErrors: Sync {
    /// Adds its errors on `flight` to `tally`.
    fn add_errors_to(&self, flight: &ValidationFlight, tally: &mut Tally, horizon_steps: usize);
}

/// A model with what was identified of it.
pub(super) struct Identified<M, const NS: usize, const NP: usize> {
    /// The model.
    pub(super) model: M,
    /// Parameter. In the units of its rows
    pub(super) p: SVector<f64, NP>,
    /// Dead times. s
    pub(super) dead_time_s: Sticks,
    /// As [`residual_decay_s`]. s
    pub(super) residual_decay_s: Vector<{ pose::COUNT }>,
    /// Period. s
    pub(super) dt_s: f64,
}

impl<M, const NS: usize, const NP: usize> AddErrors for Identified<M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Sync,
{
    fn add_errors_to(&self, flight: &ValidationFlight, tally: &mut Tally, horizon_steps: usize) {
        let applied = flight.recording.applied(&self.dead_time_s, self.dt_s);
        tally.add(flight, horizon_steps, |known| {
            let Self { model, p, residual_decay_s, dt_s, .. } = self;
            Driven::<M, NS, NP>::new(*model, p, residual_decay_s, &applied, known, *dt_s)
        });
    }
}

/// Time in which the velocity that the sticks do not explain decays in a forecast: as in the model
/// if it knows such a velocity, at once if it does not, by row of the pose. s
pub(super) fn residual_decay_s(model: ModelKind) -> Vector<{ pose::COUNT }> {
    let mut decay_s = Vector::zeros();
    if model == ModelKind::Lagged {
        let shape = LaggedShape::default();
        decay_s[pose::X] = shape.decay_h_s;
        decay_s[pose::Y] = shape.decay_h_s;
        decay_s[pose::Z] = shape.decay_v_s;
    }
    decay_s
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;

    use super::*;

    #[test]
    fn only_a_model_with_a_disturbance_lets_it_decay() {
        for model in ModelKind::ALL {
            let decay_s = residual_decay_s(model);
            let LaggedShape { decay_h_s, decay_v_s, .. } = LaggedShape::default();
            let expected = if model == ModelKind::Lagged {
                Pose::new(decay_h_s, decay_h_s, decay_v_s, 0.0)
            } else {
                Pose::zeros()
            };
            assert_eq!(decay_s, expected, "{model:?}");
        }
        assert!(residual_decay_s(ModelKind::Lagged)[pose::X] > 0.0);
    }
}
