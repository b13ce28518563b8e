//! The drone's own height beside that of the poses.
//!
//! Owns the difference of both since the take-off. The drone measures from a level of its own, by air pressure
//! and by the distance to what is below it: slow drift is forgotten. A drone whose height did not
//! rise is no witness.

use horizon_model::check::maximum;
use horizon_model::rows::pose;

use super::{Agreement, Sample, Verdict};

/// Time within which a difference is forgotten. s
const FORGET_S: f64 = 30.0;
/// Limit of the difference since the take-off over that of what is not forgotten.
const WHOLE_FLIGHT: f64 = 1.5;
/// Rise that shows that the drone reports its height. m
const RISE_MIN_M: f64 = 0.3;

/// Heights on the ground and in flight.
#[derive(Debug, Clone)]
pub(super) struct HeightMonitor {
    limit_m: f64,
    dt_s: f64,
    /// Height by the poses less the drone's, on the ground, then slowly followed. m
    level_m: Option<f64>,
    /// The same, as it was on the ground. m
    ground_level_m: f64,
    /// Height by the drone on the ground. m
    ground_m: Option<f64>,
    is_witness: bool,
    error_m: f64,
    verdict: Verdict,
}

impl HeightMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        Self {
            limit_m,
            dt_s,
            level_m: None,
            ground_level_m: 0.0,
            ground_m: None,
            is_witness: false,
            error_m: 0.0,
            verdict: Verdict::default(),
        }
    }

    /// Learns the level on the ground.
    pub(super) fn rest(&mut self, sample: &Sample) {
        if let Some((z_m, height_m)) = heights(sample) {
            self.level_m = Some(z_m - height_m);
            self.ground_level_m = z_m - height_m;
            self.ground_m = Some(height_m);
        }
        self.is_witness = false;
        self.error_m = 0.0;
        self.verdict = Verdict::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let (Some((z_m, height_m)), Some(level_m), Some(ground_m)) =
            (heights(sample), self.level_m, self.ground_m)
        else {
            return (Agreement::Unknown, self.error_m);
        };
        let error_m = z_m - height_m - level_m;
        self.is_witness |= height_m - ground_m >= RISE_MIN_M;
        if !self.is_witness {
            return (Agreement::Unknown, 0.0);
        }
        self.error_m = error_m.abs();
        self.level_m = Some(level_m + error_m * (1.0 - (-self.dt_s / FORGET_S).exp()));
        let of_flight_m = (z_m - height_m - self.ground_level_m).abs() / WHOLE_FLIGHT;
        let judged_m = maximum(of_flight_m, self.error_m);
        (self.verdict.on(judged_m, self.limit_m, self.dt_s), self.error_m)
    }
}

fn heights(sample: &Sample) -> Option<(f64, f64)> {
    Some((sample.pose?[pose::Z], sample.drone?.height_m?))
}
