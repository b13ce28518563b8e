//! How far the vehicle is from its reference, and how long the mission takes.

use tello_control::Mission;
use tello_model::rows::{Pose, pose};

/// The mission may take so many times as long as planned before its overtime counts.
const PLANNED_MAX: f64 = 2.0;

/// What is remembered of the mission to judge its progress.
#[derive(Debug, Clone, Default)]
pub(super) struct Progress {
    /// Time that the mission was flown. s
    flown_s: f64,
    /// Number of targets reached, and the least distance to the present one. m
    target: Option<(usize, f64)>,
}

impl Progress {
    /// One period of `dt_s` passed in which the controller flew the mission.
    pub(super) fn fly(&mut self, dt_s: f64) {
        self.flown_s += dt_s;
    }

    /// By how much the mission takes longer than it may; negative before, and at its end. s
    pub(super) fn overtime_s(&self, mission: &Mission) -> f64 {
        if mission.is_finished() {
            return f64::NEG_INFINITY;
        }
        self.flown_s - PLANNED_MAX * mission.planned_s()
    }

    /// Distance of the vehicle at `pose_hat` to its reference. m
    ///
    /// A constant target may be far away: there it is the distance by which the vehicle has gone away again.
    pub(super) fn tracking_m(&mut self, mission: &Mission, pose_hat: &Pose) -> f64 {
        let distance_m = |to: &Pose| (to - pose_hat).fixed_rows::<3>(pose::X).norm();
        if let Some(reference) = mission.reference() {
            return distance_m(&reference);
        }
        let (reached, now_m) = (mission.targets_reached(), distance_m(mission.target()));
        let least_m = match self.target {
            Some((before, least_m)) if before == reached => least_m.min(now_m),
            _ => now_m,
        };
        self.target = Some((reached, least_m));
        now_m - least_m
    }
}
