//! Point that leads the vehicle on the straight line to a pose (carrot, path following).
//!
//! Owns the motion along that line: from rest to rest, within the limits of a path. When it begins,
//! and what happens at its end, is `follower.rs`.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose};

use super::Reference;
use crate::path::Limits;

/// Distance that counts as zero. m and rad
const ARRIVED: f64 = 1e-6;

/// A reference on its path to a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Carrot {
    goal_w: Pose,
    /// From where it began to the goal, theta the short way.
    displacement_w: Pose,
    /// Fraction of the path that is left. 1, 0..=1
    left: f64,
    /// How fast that fraction falls. 1/s
    pace: f64,
    /// Largest `pace`. 1/s
    pace_limit: f64,
    /// Largest change of `pace`. 1/s^2
    growth: f64,
    /// Fraction of the pace that the lag of the vehicle allows. 1, 0..=1
    allowed: f64,
}

impl Carrot {
    /// A reference at rest at `from`, on its path to `goal_w`.
    ///
    /// Speed, climb and yaw rate are within `limits`; the acceleration limit holds for the norm over x, y,
    /// z and theta. Both poses are finite.
    pub(super) fn new(from: &Pose, goal_w: &Pose, limits: &Limits) -> Self {
        let mut displacement_w = goal_w - from;
        displacement_w[pose::THETA] = unwrap_near(displacement_w[pose::THETA], 0.0);
        let length = displacement_w.norm();
        let length_m = displacement_w.fixed_rows::<3>(pose::X).norm();
        let pace_limit = (limits.speed_mps / length_m)
            .min(limits.climb_mps / displacement_w[pose::Z].abs())
            .min(limits.turn_radps / displacement_w[pose::THETA].abs());
        Self {
            goal_w: *goal_w,
            displacement_w,
            left: if length > ARRIVED { 1.0 } else { 0.0 },
            pace: 0.0,
            pace_limit,
            growth: limits.accel_mps2 / length,
            allowed: 1.0,
        }
    }

    /// The reference with the fraction `allowed` of its pace, 0..=1, from the next period on.
    pub(super) fn with_allowed_pace(self, allowed: f64) -> Self {
        Self { allowed, ..self }
    }

    /// The reference one period later, with the pace that is allowed now.
    ///
    /// A `pace` can be reduced to zero by `growth` in what is left after the period if
    /// `pace dt + pace^2 / (2 growth) <= left`.
    pub(super) fn after(self, dt_s: f64) -> Self {
        if self.is_arrived() {
            return self;
        }
        let step = self.growth * dt_s;
        let braking = (step * step + 2.0 * self.growth * self.left).sqrt() - step;
        let pace = (self.pace + step).min(self.pace_limit * self.allowed).min(braking);
        let left = self.left - dt_s * pace;
        if left * self.displacement_w.norm() > ARRIVED {
            Self { left, pace, ..self }
        } else {
            Self { left: 0.0, pace: 0.0, ..self }
        }
    }

    /// The references at the ends of `stages`, which have so many periods each and begin `first_ahead` periods from
    /// now.
    pub(super) fn fill(
        mut self,
        first_ahead: usize,
        stages: &[u32],
        dt_s: f64,
        refs: &mut [Reference],
    ) {
        for _ in 0..first_ahead {
            self = self.after(dt_s);
        }
        for (entry, steps) in refs.iter_mut().zip(stages) {
            for _ in 0..*steps {
                self = self.after(dt_s);
            }
            *entry = self.reference();
        }
    }

    /// Distance by which a vehicle at `pose_hat` is behind, along the line. m
    pub(super) fn lag_m(&self, pose_hat: &Pose) -> f64 {
        let displacement_w = self.displacement_w.fixed_rows::<3>(pose::X);
        let behind_w = self.reference().pose - pose_hat;
        behind_w.fixed_rows::<3>(pose::X).dot(&displacement_w)
            / displacement_w.norm().max(f64::MIN_POSITIVE)
    }

    /// Pose and rate of the reference now.
    pub(super) fn reference(&self) -> Reference {
        Reference {
            pose: self.goal_w - self.left * self.displacement_w,
            rate: self.pace * self.displacement_w,
        }
    }

    /// Whether it stands at its goal.
    pub(super) fn is_arrived(&self) -> bool {
        self.left <= 0.0
    }
}

#[cfg(test)]
mod tests;
