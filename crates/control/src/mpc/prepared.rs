//! The model of a horizon whose stages differ in length.
//!
//! Owns when a model is prepared anew; what is prepared it knows itself.

use nalgebra::SVector;
use tello_model::Model;

/// A model that is prepared anew where the stages become longer.
#[derive(Debug)]
pub(super) struct Prepared<M> {
    model: M,
    stage_s: f64,
}

impl<M> Prepared<M> {
    pub(super) fn new(model: M) -> Self {
        Self { model, stage_s: f64::NAN }
    }

    /// The model for stages of `stage_s` under the parameter `p`, which is the same every time.
    pub(super) fn step<const NS: usize, const NU: usize, const NO: usize, const NP: usize>(
        &mut self,
        p: &SVector<f64, NP>,
        stage_s: f64,
    ) -> &M
    where
        M: Model<NS, NU, NO, NP>,
    {
        if stage_s.to_bits() != self.stage_s.to_bits() {
            *self = Self { model: self.model.prepared(p, stage_s), stage_s };
        }
        &self.model
    }
}
