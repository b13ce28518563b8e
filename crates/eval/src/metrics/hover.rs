//! How still a vehicle stands.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Time that the vehicle gets to settle before it counts. s
const SETTLE_S: f64 = 2.0;

/// Gathers the errors of a hover, tick by tick.
#[derive(Debug, Clone)]
pub struct Hover {
    target: Pose,
    lasts_s: f64,
    arrived_s: Option<f64>,
    errors: Vec<Pose>,
    is_done: bool,
}

/// Figures of a hover, from 2 s after the arrival on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct HoverScore {
    /// Root mean square of the position error. m
    pub position_rms_m: f64,
    /// Its horizontal part. m
    pub horizontal_rms_m: f64,
    /// Mean height above the target. m
    pub height_mean_m: f64,
    /// Root mean square of the height above the target. m
    pub height_rms_m: f64,
    /// Root mean square of the heading error. rad
    pub heading_rms_rad: f64,
}

impl Hover {
    /// A hover at `target` (world frame; m, rad) that is measured for `lasts_s` (s, > 0), after 2 s to settle that are
    /// not measured. Allocates; not for the tick.
    pub fn new(target: &Pose, lasts_s: f64) -> Self {
        let target = *target;
        Self { target, lasts_s, arrived_s: None, errors: Vec::new(), is_done: false }
    }

    /// How long a hover of `lasts_s` must be held after the arrival. s
    pub fn hold_s(lasts_s: f64) -> f64 {
        lasts_s + SETTLE_S
    }

    /// Adds the tick at `now_s` with the pose `at` (world frame; m, rad). `has_arrived`: whether the target
    /// was reached, now or before.
    pub fn add(&mut self, now_s: f64, at: &Pose, has_arrived: bool) {
        if !has_arrived || self.is_done {
            return;
        }
        let held_s = now_s - *self.arrived_s.get_or_insert(now_s);
        if held_s >= SETTLE_S {
            let mut error = at - self.target;
            error[pose::THETA] = wrap(error[pose::THETA]);
            self.errors.push(error);
        }
        self.is_done = held_s >= Self::hold_s(self.lasts_s);
    }

    /// Whether it lasted as long as asked.
    pub fn is_done(&self) -> bool {
        self.is_done
    }

    /// The figures of a whole hover; `None` if it did not last as long as asked.
    pub fn score(&self) -> Option<HoverScore> {
        if !self.is_done {
            return None;
        }
        let count = self.errors.len() as f64;
        let mean_square =
            |row: usize| self.errors.iter().map(|error| error[row].powi(2)).sum::<f64>() / count;
        let [x, y, z, theta] = [pose::X, pose::Y, pose::Z, pose::THETA].map(mean_square);
        Some(HoverScore {
            position_rms_m: (x + y + z).sqrt(),
            horizontal_rms_m: (x + y).sqrt(),
            height_mean_m: self.errors.iter().map(|error| error[pose::Z]).sum::<f64>() / count,
            height_rms_m: z.sqrt(),
            heading_rms_rad: theta.sqrt(),
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    #[test]
    fn a_known_wobble_has_its_figures() {
        let target = Pose::new(1.0, 2.0, 1.3, 0.5);
        let mut hover = Hover::new(&target, 10.0);
        for k in 0..=700_u32 {
            // Far off before the arrival and while settling.
            let wobble = match k {
                0..=199 => Pose::new(1.0, 1.0, 1.0, 1.0),
                _ if k % 2 == 0 => Pose::new(0.03, 0.04, -0.01, TAU + 0.1),
                _ => Pose::new(-0.03, 0.04, -0.03, -0.1),
            };
            assert!(!hover.is_done(), "over after {k} ticks");
            hover.add(f64::from(k) * 0.02, &(target + wobble), k >= 100);
        }
        let score = hover.score().unwrap();
        for (got, expected) in [
            (score.horizontal_rms_m, 0.05),
            (score.height_mean_m, -0.02),
            (score.height_rms_m, (5e-4_f64).sqrt()),
            (score.position_rms_m, (0.0025_f64 + 5e-4).sqrt()),
            (score.heading_rms_rad, 0.1),
        ] {
            // 501 ticks are one more of the even kind than of the odd.
            assert!((got - expected).abs() < 5e-5, "{score:?}: {got} instead of {expected}");
        }
    }

    #[test]
    fn a_hover_cut_short_has_no_figures() {
        let mut hover = Hover::new(&Pose::zeros(), 1.0);
        for k in 0..100_u32 {
            hover.add(f64::from(k) * 0.02, &Pose::zeros(), true);
        }
        assert_eq!(hover.score(), None);
    }
}
