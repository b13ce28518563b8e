//! The model of a horizon whose stages differ in length.
//!
//! Owns when a model is prepared anew; what is prepared it knows itself.

use horizon_model::Model;
use nalgebra::SVector;

/// A model that is prepared anew where the length of the stages changes.
#[derive(Debug)]
pub(super) struct Prepared<M> {
    model: M,
    stage_s: f64,
}

impl<M> Prepared<M> {
    pub(super) fn new(model: M) -> Self {
        Self { model, stage_s: f64::NAN }
    }

    /// The model for a stage that lasts `stage_s` under the parameter `p`.
    pub(super) fn over<const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &mut self,
        p: &SVector<f64, NP>,
        stage_s: f64,
    ) -> &M
    where
        M: Model<NS, NU, NO, NP>,
    {
        // A horizon has one parameter; with another one the model is as right, and slower.
        if stage_s.to_bits() != self.stage_s.to_bits() {
            *self = Self { model: self.model.prepared(p, stage_s), stage_s };
        }
        &self.model
    }
}
