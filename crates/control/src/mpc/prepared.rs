//! The model of a horizon whose stages differ in length.
//!
//! Owns when a model is prepared again; the model owns what that means.

use horizon_model::{Model, Vector};

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
        p: &Vector<NP>,
        stage_s: f64,
    ) -> &M
    where
        M: Model<NS, NU, NO, NP>,
    {
        // A horizon has one parameter. With another one the prepared model gives the same result, at a higher cost.
        if stage_s.to_bits() != self.stage_s.to_bits() {
            *self = Self { model: self.model.prepared(p, stage_s), stage_s };
        }
        &self.model
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use horizon_model::Vector;

    /// Counts how often it was prepared, and remembers for what.
    #[derive(Debug, Clone, Copy)]
    struct Counting {
        count: u32,
        stage_s: f64,
    }

    impl Model<1, 1, 1, 1> for Counting {
        fn step(&self, s: &Vector<1>, _u: &Vector<1>, _p: &Vector<1>, _dt_s: f64) -> Vector<1> {
            *s
        }

        fn observe(&self, s: &Vector<1>) -> Vector<1> {
            *s
        }

        fn prepared(&self, _p: &Vector<1>, dt_s: f64) -> Self {
            Self { count: self.count + 1, stage_s: dt_s }
        }
    }

    #[test]
    fn a_model_is_prepared_once_for_stages_of_one_length() {
        let mut prepared = Prepared::new(Counting { count: 0, stage_s: 0.0 });
        for (stage_s, count) in [(0.02, 1), (0.02, 1), (0.06, 2), (0.06, 2), (0.02, 3)] {
            let model = *prepared.over(&Vector::from([1.0]), stage_s);
            assert_eq!(model.count, count, "{stage_s} s");
            assert!((model.stage_s - stage_s).abs() <= 0.0, "{model:?}");
        }
    }
}
