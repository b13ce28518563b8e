//! Motion that the drone reports and the poses do not show.
//!
//! Owns the comparison of both speeds, which needs none of the drone's axes. A vehicle that follows its inputs along an
//! axis of which the pose stands still gains speed there, and the drone reports it. A vehicle that does not
//! hear its inputs gains none: that axis of the pose is right.

use horizon_model::rows::{Pose, pose};
use nalgebra::Vector2;

use super::Sample;

/// Time constant of the low-pass filter of the velocity by the poses. s
const FILTER_S: f64 = 0.1;
/// Time constant with which a speed by the poses is forgotten: that of a vehicle that levels, since reports are old.
const FORGET_S: f64 = 0.6;
/// What the drone's speed may exceed the speed by the poses by: both are late, and optical flow has an error of scale.
/// m/s, 1
const TOLERANCE_MPS: f64 = 0.1;
const TOLERANCE: f64 = 0.1;
/// Hidden speed of a vehicle that follows its inputs: more than the resolution of the reports. m/s
const HIDDEN_MPS: f64 = 0.15;
/// Time for which such a speed counts. s
const RECENT_S: f64 = 1.0;

/// Speed by the poses with which the drone's is compared. m/s
const COMPARED_MPS: f64 = 0.2;
/// Way by the poses, at such speeds, that shows whether the drone reports its velocity in m/s. m
const COMPARED_M: f64 = 0.1;
/// Way by the drone over that way if it does. 1
const FIT_MIN: f64 = 0.5;
/// Time within which both ways are forgotten. s
const WAY_FORGET_S: f64 = 15.0;

/// Speed by the drone that exceeds the speed by the poses.
#[derive(Debug, Clone)]
pub(super) struct HiddenMotion {
    dt_s: f64,
    before: Option<Pose>,
    /// Since the newest pose. s
    since_pose_s: f64,
    /// Horizontal velocity by the poses, world frame, low-pass filtered. m/s
    velocity_mps: Vector2<f64>,
    /// Largest speed by the poses of late. m/s
    poses_mps: f64,
    /// Way by the poses, and by the drone, while the poses moved. m
    way_m: f64,
    flown_m: f64,
    /// Whether the drone has reported any motion.
    has_reported: bool,
    /// Newest hidden speed; `None` without a fresh report. m/s
    hidden_mps: Option<f64>,
    /// Since the newest one that counts. s
    since_hidden_s: f64,
}

impl HiddenMotion {
    pub(super) fn new(dt_s: f64) -> Self {
        Self {
            dt_s,
            before: None,
            since_pose_s: 0.0,
            velocity_mps: Vector2::zeros(),
            poses_mps: 0.0,
            way_m: 0.0,
            flown_m: 0.0,
            has_reported: false,
            hidden_mps: None,
            since_hidden_s: f64::INFINITY,
        }
    }

    /// Takes a tick in flight.
    pub(super) fn update(&mut self, sample: &Sample) {
        self.see(sample.pose.as_ref());
        let reported = sample.drone.and_then(|drone| drone.horizontal_mps);
        let drone_mps = reported.map(|[first_mps, second_mps]| first_mps.hypot(second_mps));
        self.has_reported |= drone_mps.is_some_and(|drone_mps| drone_mps > 0.0);
        let shown_mps = (1.0 + TOLERANCE) * self.poses_mps + TOLERANCE_MPS;
        self.hidden_mps = drone_mps.map(|mps| (mps.powi(2) - shown_mps.powi(2)).max(0.0).sqrt());
        self.since_hidden_s += self.dt_s;
        if self.mps() >= HIDDEN_MPS {
            self.since_hidden_s = 0.0;
        }
        let speed_mps = self.velocity_mps.norm();
        if let Some(drone_mps) = drone_mps.filter(|_| speed_mps >= COMPARED_MPS) {
            let keep = (-self.dt_s / WAY_FORGET_S).exp();
            self.way_m = self.way_m * keep + speed_mps * self.dt_s;
            self.flown_m = self.flown_m * keep + drone_mps * self.dt_s;
        }
    }

    /// Newest hidden speed; 0 without a fresh report. m/s
    pub(super) fn mps(&self) -> f64 {
        self.hidden_mps.unwrap_or_default()
    }

    /// Whether the drone denies that it moved along an axis that is still: it reports its velocity in m/s, as far as
    /// known, and no hidden speed of late.
    pub(super) fn is_denied(&self) -> bool {
        let fits = self.way_m < COMPARED_M || self.flown_m >= FIT_MIN * self.way_m;
        let is_witness = self.hidden_mps.is_some() && self.has_reported && fits;
        is_witness && self.since_hidden_s > RECENT_S
    }

    /// Follows the velocity by the poses; without a pose it stays as it was.
    fn see(&mut self, pose: Option<&Pose>) {
        self.since_pose_s += self.dt_s;
        let Some(now) = pose else { return };
        let before = self.before.replace(*now).unwrap_or(*now);
        let moved_m = Vector2::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y]);
        let part = 1.0 - (-self.since_pose_s / FILTER_S).exp();
        self.velocity_mps += (moved_m / self.since_pose_s - self.velocity_mps) * part;
        let kept_mps = self.poses_mps * (-self.since_pose_s / FORGET_S).exp();
        self.poses_mps = kept_mps.max(self.velocity_mps.norm());
        self.since_pose_s = 0.0;
    }
}
