//! Corners of a reference path, and how far a flight goes beyond them.
//!
//! Owns the definition of overshoot. Which targets count as reached is the caller's business.

use horizon_model::rows::Pose;
use nalgebra::Vector2;

use super::reference_path::horizontal;

/// Distance to the next target at which a corner is left behind. m
const CORNER_LEFT_M: f64 = 0.25;

/// Largest cosine of the turn at a corner. From a right angle on the path itself does not lead beyond
/// it; the cosine of a right angle is zero up to rounding.
const CORNER_COS_MAX: f64 = 1e-9;

/// A target at which the way turns by a right angle or more.
#[derive(Debug, Clone, PartialEq)]
pub struct Corner {
    /// Index of the target.
    pub(super) target: usize,
    at_w: Vector2<f64>,
    /// Unit vector along the incoming side.
    way_w: Vector2<f64>,
    next_w: Vector2<f64>,
    overshoot_m: f64,
    is_left: bool,
}

impl Corner {
    /// Whether it is among the first `reached` targets.
    pub fn is_reached(&self, reached: usize) -> bool {
        reached > self.target
    }

    /// The longest way beyond the corner along its incoming side. m, >= 0
    pub fn overshoot_m(&self) -> f64 {
        self.overshoot_m
    }

    /// Notes how far `at_w` lies beyond the corner while it is the next target or just passed.
    pub fn pass(&mut self, at_w: &Vector2<f64>, reached: usize) {
        if self.is_left || reached < self.target {
            return;
        }
        self.overshoot_m = self.overshoot_m.max((at_w - self.at_w).dot(&self.way_w));
        let is_near_next = (at_w - self.next_w).norm() <= CORNER_LEFT_M;
        self.is_left = reached > self.target + 1 || (reached > self.target && is_near_next);
    }
}

/// The corners of the way through `targets`, none of them passed yet.
pub fn corners(targets: &[Pose]) -> Vec<Corner> {
    let corner = |(target, around): (usize, &[Pose])| {
        let [from_w, at_w, next_w] =
            [around.first()?, around.get(1)?, around.get(2)?].map(horizontal);
        let way_w = (at_w - from_w).try_normalize(0.0)?;
        let on_w = (next_w - at_w).try_normalize(0.0)?;
        let corner = Corner { target, at_w, way_w, next_w, overshoot_m: 0.0, is_left: false };
        (way_w.dot(&on_w) <= CORNER_COS_MAX).then_some(corner)
    };
    (1..).zip(targets.windows(3)).filter_map(corner).collect()
}
