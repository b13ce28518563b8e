//! Motion that the drone reports and the poses do not show.
//!
//! Owns the comparison of both speeds, for which the drone's axes need not be known. If one axis of the pose stands
//! still and the vehicle follows inputs along it, it gains speed there, and the drone reports more speed than the poses
//! show: the axis is wrong. If the vehicle does not receive the inputs, it gains none: the axis is right.

use horizon_model::rows::{Pose, pose};
use nalgebra::Vector2;

use super::Sample;
use crate::forgetting::decay;

/// Time constant of the low-pass filter of the velocity by the poses. s
const FILTER_S: f64 = 0.1;
/// Time constant with which the largest speed by the poses is forgotten: that of a vehicle without inputs, since the
/// drone's reports may be late. s
const FORGET_S: f64 = 0.6;
/// Excess of the drone's speed over the speed by the poses that does not count, a constant and a fraction of the
/// latter: both are late, and optical flow has an error of scale. m/s, 1
const TOLERANCE_MPS: f64 = 0.1;
const TOLERANCE: f64 = 0.1;
/// Least hidden speed of a vehicle that follows its inputs: more than the resolution of the reports. m/s
const HIDDEN_MPS: f64 = 0.15;
/// Time for which a hidden speed counts after it was found. s
const RECENT_S: f64 = 1.0;

/// Least speed by the poses at which the drone's is compared with it. m/s
const COMPARED_MPS: f64 = 0.2;
/// Distance by the poses, at such speeds, that shows whether the drone reports its velocity in m/s. m
const COMPARED_M: f64 = 0.1;
/// Least distance by the drone over that by the poses if it does. 1
const FIT_MIN: f64 = 0.5;
/// Time constant with which both distances are forgotten. s
const DISTANCE_FORGET_S: f64 = 15.0;

/// Speed by the drone that exceeds the speed by the poses.
#[derive(Debug, Clone, Default)]
pub(super) struct HiddenSpeed {
    dt_s: f64,
    before: Option<Pose>,
    /// Time since the newest pose. s
    since_pose_s: f64,
    /// Horizontal velocity by the poses, world frame, low-pass filtered. m/s
    velocity_w_mps: Vector2<f64>,
    /// Largest speed by the poses, forgotten with [`FORGET_S`]. m/s
    poses_mps: f64,
    /// Distances by the poses and by the drone while the poses moved. m
    poses_m: f64,
    drone_m: f64,
    /// Whether the drone has reported any motion.
    has_reported: bool,
    /// Newest hidden speed; `None` without a fresh report. m/s
    hidden_mps: Option<f64>,
    /// Time since the newest hidden speed above [`HIDDEN_MPS`]. s
    since_hidden_s: f64,
}

impl HiddenSpeed {
    pub(super) fn new(dt_s: f64) -> Self {
        Self { dt_s, since_hidden_s: f64::INFINITY, ..Self::default() }
    }

    /// Takes a tick in flight.
    pub(super) fn update(&mut self, sample: &Sample) {
        self.observe(sample.pose.as_ref());
        let reported = sample.drone.and_then(|drone| drone.horizontal_d_mps);
        let drone_mps = reported.map(|[first_mps, second_mps]| first_mps.hypot(second_mps));
        self.has_reported |= drone_mps.is_some_and(|drone_mps| drone_mps > 0.0);
        let shown_mps = (1.0 + TOLERANCE) * self.poses_mps + TOLERANCE_MPS;
        self.hidden_mps = drone_mps.map(|mps| (mps.powi(2) - shown_mps.powi(2)).max(0.0).sqrt());
        self.since_hidden_s += self.dt_s;
        if self.mps() >= HIDDEN_MPS {
            self.since_hidden_s = 0.0;
        }
        let speed_mps = self.velocity_w_mps.norm();
        if let Some(drone_mps) = drone_mps.filter(|_| speed_mps >= COMPARED_MPS) {
            let keep = decay(self.dt_s, DISTANCE_FORGET_S);
            self.poses_m = self.poses_m * keep + speed_mps * self.dt_s;
            self.drone_m = self.drone_m * keep + drone_mps * self.dt_s;
        }
    }

    /// Newest hidden speed; 0 without a fresh report. m/s
    pub(super) fn mps(&self) -> f64 {
        self.hidden_mps.unwrap_or_default()
    }

    /// Whether the drone reports that it did not move along an axis that is still: it reports its velocity in m/s, as
    /// far as known, and no hidden speed within [`RECENT_S`].
    pub(super) fn reports_no_motion(&self) -> bool {
        let fits = self.poses_m < COMPARED_M || self.drone_m >= FIT_MIN * self.poses_m;
        let reports_speed = self.hidden_mps.is_some() && self.has_reported && fits;
        reports_speed && self.since_hidden_s > RECENT_S
    }

    /// Follows the velocity by the poses; without a pose it stays as it was.
    fn observe(&mut self, pose: Option<&Pose>) {
        self.since_pose_s += self.dt_s;
        let Some(now) = pose else { return };
        let before = self.before.replace(*now).unwrap_or(*now);
        let moved_w_m =
            Vector2::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y]);
        let smooth = 1.0 - decay(self.since_pose_s, FILTER_S);
        self.velocity_w_mps += (moved_w_m / self.since_pose_s - self.velocity_w_mps) * smooth;
        let kept_mps = self.poses_mps * decay(self.since_pose_s, FORGET_S);
        self.poses_mps = kept_mps.max(self.velocity_w_mps.norm());
        self.since_pose_s = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Sticks;

    use super::*;
    use crate::monitor::DroneMotion;

    /// A period that sums without rounding. s
    const DT_S: f64 = 0.25;

    fn sample(x_m: Option<f64>, horizontal_d_mps: Option<[f64; 2]>) -> Sample {
        Sample {
            pose: x_m.map(|x_m| Pose::new(x_m, 0.0, 1.0, 0.0)),
            drone: Some(DroneMotion { horizontal_d_mps, height_m: None, heading_rad: None }),
            u_applied: Sticks::zeros(),
            link_is_up: true,
        }
    }

    /// After one tick with a pose that stands still.
    fn beside_a_still_pose(horizontal_d_mps: Option<[f64; 2]>) -> HiddenSpeed {
        let mut hidden = HiddenSpeed::new(DT_S);
        hidden.update(&sample(Some(0.0), horizontal_d_mps));
        hidden
    }

    #[test]
    fn speed_above_the_tolerance_is_hidden_whatever_the_axes_of_the_drone() {
        for (reported, expected_mps) in [
            (Some([0.3, -0.4]), f64::sqrt(0.24)),
            (Some([-0.5, 0.0]), f64::sqrt(0.24)),
            (Some([TOLERANCE_MPS, 0.0]), 0.0),
            (Some([0.0, 0.0]), 0.0),
            (None, 0.0),
        ] {
            let found_mps = beside_a_still_pose(reported).mps();
            assert!((found_mps - expected_mps).abs() < 1e-12, "{reported:?}: {found_mps} m/s");
        }
    }

    #[test]
    fn a_drone_reports_no_motion_by_a_small_speed_and_not_by_none_or_by_silence() {
        for (reported, is_at_rest) in [
            (None, false),
            (Some([0.0, 0.0]), false),
            (Some([0.0, -0.1]), true),
            // Hidden: 0.1497 m/s, and 0.1509 m/s.
            (Some([0.18, 0.0]), true),
            (Some([0.181, 0.0]), false),
        ] {
            assert_eq!(
                beside_a_still_pose(reported).reports_no_motion(),
                is_at_rest,
                "{reported:?}"
            );
        }
        let mut silent = beside_a_still_pose(Some([0.1, 0.0]));
        silent.update(&sample(Some(0.0), None));
        assert!(!silent.reports_no_motion(), "no fresh report");
    }

    #[test]
    fn a_hidden_speed_counts_for_a_second() {
        let mut hidden = beside_a_still_pose(Some([0.5, 0.0]));
        let mut is_at_rest = || {
            hidden.update(&sample(Some(0.0), Some([0.1, 0.0])));
            hidden.reports_no_motion()
        };
        assert_eq!([is_at_rest(), is_at_rest(), is_at_rest(), is_at_rest()], [false; 4], "1.0 s");
        assert!(is_at_rest(), "1.25 s");
    }

    #[test]
    fn poses_that_come_now_and_then_show_their_speed() {
        let mut hidden = HiddenSpeed::new(0.02);
        for k in 0..=100_u32 {
            let x_m = k.is_multiple_of(5).then_some(0.02 * f64::from(k));
            hidden.update(&sample(x_m, Some([1.5, 0.0])));
        }
        // At 1 m/s, with the tolerance 1.2 m/s are shown.
        assert!((hidden.mps() - f64::sqrt(1.5 * 1.5 - 1.2 * 1.2)).abs() < 1e-3, "{hidden:?}");
    }

    #[test]
    fn a_drone_that_reports_less_than_half_of_the_speed_does_not_count() {
        for (reported_mps, is_at_rest) in [(0.24, false), (0.26, true)] {
            let mut hidden = HiddenSpeed::new(0.02);
            for k in 0..100_u32 {
                let x_m = 0.5 * 0.02 * f64::from(k);
                hidden.update(&sample(Some(x_m), Some([0.0, reported_mps])));
            }
            assert_eq!(hidden.reports_no_motion(), is_at_rest, "{reported_mps} m/s beside 0.5 m/s");
        }
    }

    #[test]
    fn the_speed_by_the_poses_follows_within_0_1_s_and_is_forgotten_within_0_6_s() {
        let hidden_mps = |shown_mps: f64| (2.25 - (1.1 * shown_mps + 0.1).powi(2)).sqrt();
        let mut hidden = beside_a_still_pose(Some([1.5, 0.0]));
        hidden.update(&sample(Some(DT_S), Some([1.5, 0.0])));
        // 1 m/s: 1 - exp(-0.25 / 0.1).
        assert!((hidden.mps() - hidden_mps(0.917_915)).abs() < 1e-5, "{hidden:?}");
        hidden.update(&sample(Some(DT_S), Some([1.5, 0.0])));
        // exp(-0.25 / 0.6).
        assert!((hidden.mps() - hidden_mps(0.917_915 * 0.659_241)).abs() < 1e-5, "{hidden:?}");
    }

    #[test]
    fn a_short_distance_does_not_show_that_the_drone_reports_too_little() {
        for (ticks, is_at_rest) in [(12, true), (20, false)] {
            let mut hidden = HiddenSpeed::new(0.02);
            for k in 0..ticks {
                hidden.update(&sample(Some(0.01 * f64::from(k)), Some([0.05, 0.0])));
            }
            assert_eq!(hidden.reports_no_motion(), is_at_rest, "{hidden:?}");
        }
    }

    #[test]
    fn distances_are_forgotten_within_a_quarter_of_a_minute() {
        // 10 s at 0.5 m/s with a tenth of it reported, then all of it: distances that are kept fit again after 8 s,
        // those that are forgotten in 15 s after 4.9 s.
        for (again_ticks, is_at_rest) in [(225, false), (275, true)] {
            let mut hidden = HiddenSpeed::new(0.02);
            for k in 0..500 + again_ticks {
                let reported_mps = if k < 500 { 0.05 } else { 0.5 };
                hidden.update(&sample(Some(0.01 * f64::from(k)), Some([reported_mps, 0.0])));
            }
            assert_eq!(hidden.reports_no_motion(), is_at_rest, "{again_ticks}: {hidden:?}");
        }
    }
}
