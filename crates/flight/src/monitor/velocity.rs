//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both, less the usual error of the drone's velocity: the drone holds
//! its position by that velocity, and real flights drift. The drone's horizontal axes are not known: firmware, protocol
//! and libraries differ in names, in signs and in whether the axes turn with the body. All kinds of axes that fit the
//! motion so far are followed, since a constant heading or a motion along a line fits several; the least difference
//! counts. Before one kind fits, the drone's velocity is not compared along axes: the drone may report none. Reports
//! may be late (a Tello's by 0.2 to 0.9 s beside its accelerometer, by others' reports) and of another scale: the age
//! that explains the motion best is used, and kept once the motion has shown it well.
//!
//! Names here and in `displacement.rs`: `poses_*` is by the poses, `drone_*` by the drone, `inputs_*` by the inputs
//! of a typical vehicle; `_w` is in the world frame, `_d` in each of the kinds of axes that the drone's may be.

mod report_age;

use horizon_model::rows::{Pose, pose};
use horizon_model::steps;
use nalgebra::Complex;

use self::report_age::{MOTION_MIN, ReportAge, Sums};
use super::displacement::Displacements;
use super::typical_vehicle::velocity_w_mps;
use super::{Agreement, Doubt, FORGET_S, Sample};
use crate::forgetting::decay;
use crate::ring::Ring;

/// Ages that reports may have, ascending, and the index of the least one. s
const AGES_S: [f64; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
const NEWEST: usize = 0;

/// Error of the drone's velocity that is not counted. Real flights drift by 0.07 to 0.08 m/s (standard deviation per
/// axis, for 1.2 s): with this allowance, drifts of that size, or of 0.05 m/s for 8 s, land at most 1 of 100
/// simulated flights of 60 s. m/s
const VELOCITY_DRIFT_MPS: f64 = 0.08;

/// Speed by which the poses may exceed the drone's: a faster displacement is that of another object or an outlier, and
/// does not show the axes. One of 0.2 m in a period would outweigh the motion of a flight. m/s
const JUMP_MPS: f64 = 1.0;
/// Displacement of the poses that noise explains. m
const JUMP_M: f64 = 0.03;

/// Number of kinds of axes that the drone's may be: fixed or turning with the body, each right- or left-handed. Of both
/// kinds the right-handed one comes first, at these indices.
pub(super) const AXES_KINDS: usize = 4;
pub(super) const FIXED: usize = 0;
pub(super) const TURNING: usize = 2;

/// Comparison of the displacement by the poses with the drone's velocity.
#[derive(Debug, Clone, Default)]
pub(super) struct VelocityMonitor {
    /// Largest displacement error that is plausible. m
    limit_m: f64,
    /// Period. s
    dt_s: f64,
    /// The newest pose.
    before: Option<Pose>,
    /// Time since the newest pose. s
    since_pose_s: f64,
    /// The newest displacements, as long as the largest age.
    moved: Ring<PoseDisplacement>,
    /// Comparison with the drone's reports of each of [`AGES_S`].
    ages: [ReportAge; AGES_S.len()],
    /// Index of the age that explains the motion best, and whether the motion has shown it well.
    best_age: usize,
    is_age_known: bool,
    /// As the sums of a [`ReportAge`], with the motion of a typical vehicle under the inputs in place of the poses.
    sums_by_inputs: Sums,
    displacements: Displacements,
    /// Newest speed by the drone; `None` without a report, and before the first speed that was not zero. m/s
    speed_mps: Option<f64>,
    /// Whether the drone has reported a speed that was not zero. A silence does not take that back.
    has_shown_speed: bool,
    doubt: Doubt,
}

/// Displacement by the poses in one period.
#[derive(Debug, Clone, Copy, Default)]
struct PoseDisplacement {
    /// `m`: displacement since the newest pose before; zero without a pose. m
    poses_w_m: Complex<f64>,
    /// `T`: time that it took. s
    in_s: f64,
    /// Heading of the newest pose. rad
    theta_rad: f64,
    is_pose: bool,
}

/// Motion of one period by poses and drone.
#[derive(Debug, Clone, Copy)]
struct MotionSample {
    /// `m`: displacement by the poses. m
    poses_w_m: Complex<f64>,
    /// `T`: time that it took. s
    in_s: f64,
    /// `w`: velocity by the drone in each kind of axes. m/s
    drone_d_mps: [Complex<f64>; AXES_KINDS],
    /// Whether there is a pose at the end of the period.
    is_pose: bool,
}

impl MotionSample {
    /// Whether the poses have moved further than any vehicle.
    fn is_jump(&self) -> bool {
        let most_mps = self.drone_d_mps[FIXED].norm() + JUMP_MPS;
        self.poses_w_m.norm() > most_mps * self.in_s + JUMP_M
    }
}

/// `displacement_m`, shortened by `by_m`, an error of the drone's velocity that is not counted; not below zero length.
/// m
pub(super) fn shortened(displacement_m: Complex<f64>, by_m: f64) -> Complex<f64> {
    let length_m = displacement_m.norm();
    displacement_m * ((length_m - by_m).max(0.0) / length_m.max(f64::MIN_POSITIVE))
}

impl VelocityMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        let at_rest = PoseDisplacement { in_s: dt_s, ..PoseDisplacement::default() };
        Self {
            limit_m,
            dt_s,
            moved: Ring::new(at_rest, steps(AGES_S[AGES_S.len() - 1], dt_s) + 1),
            ..Self::default()
        }
    }

    /// Takes a tick on the ground: the differences are zero.
    pub(super) fn reset_on_ground(&mut self, sample: &Sample) {
        self.displace(sample);
        for hypothesis in &mut self.ages {
            hypothesis.reset_on_ground();
        }
        self.displacements = Displacements::default();
        self.doubt = Doubt::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        self.displace(sample);
        let reported_mps = sample.drone.and_then(|drone| drone.horizontal_d_mps);
        let speed_mps = reported_mps.map(|[first_mps, second_mps]| first_mps.hypot(second_mps));
        self.has_shown_speed |= speed_mps.is_some_and(|speed_mps| speed_mps > 0.0);
        self.speed_mps = speed_mps.filter(|_| self.has_shown_speed);
        let moved = AGES_S.map(|age_s| self.moved.back(steps(age_s, self.dt_s)));
        let motions = self.compare(&moved, reported_mps);
        self.add_displacements(sample, &motions, moved[NEWEST].theta_rad);
        self.learn(&motions);
        for (hypothesis, motion) in self.ages.iter_mut().zip(&motions) {
            if motion.is_some_and(|motion| motion.is_pose) {
                hypothesis.begin_motion();
            }
        }
        self.agreement(moved[self.best_age].is_pose, motions[self.best_age].is_some())
    }

    /// Compares the displacement by the poses with the drone's velocity for each age of the reports; the motions, of
    /// which each is `None` if the drone's displacement is not known.
    fn compare(
        &mut self,
        moved: &[PoseDisplacement; AGES_S.len()],
        reported_mps: Option<[f64; 2]>,
    ) -> [Option<MotionSample>; AGES_S.len()] {
        let keep = decay(self.dt_s, FORGET_S);
        let mut motions = [None; AGES_S.len()];
        for ((hypothesis, moved), motion) in self.ages.iter_mut().zip(moved).zip(&mut motions) {
            hypothesis.forget(keep);
            let is_known = hypothesis.note_report(reported_mps.is_some(), moved.is_pose);
            *motion =
                reported_mps.filter(|_| is_known).map(|by_drone_mps| moved.beside(by_drone_mps));
            if let Some(motion) = motion {
                hypothesis.compare(motion, self.dt_s);
            }
        }
        motions
    }

    /// Adds a period to the displacements by poses, drone and inputs, the latter at the heading `theta_rad`.
    fn add_displacements(
        &mut self,
        sample: &Sample,
        motions: &[Option<MotionSample>; AGES_S.len()],
        theta_rad: f64,
    ) {
        if let Some(MotionSample { poses_w_m, drone_d_mps, .. }) = motions[self.best_age] {
            let scale = self.ages[self.best_age].scale();
            let commanded_w_mps = velocity_w_mps(&sample.u_applied, theta_rad);
            let scaled_d_mps = drone_d_mps.map(|v| v * scale);
            self.displacements.add(poses_w_m, &scaled_d_mps, commanded_w_mps, self.dt_s);
        }
        if let Some(motion) = motions[NEWEST] {
            let by_inputs = MotionSample {
                poses_w_m: self.displacements.inputs_w_mps * self.dt_s,
                in_s: self.dt_s,
                is_pose: true,
                ..motion
            };
            self.sums_by_inputs.add(&by_inputs, self.dt_s);
        }
    }

    /// The agreement, and the difference at the best age of the reports, at which this period `is_pose` and the drone's
    /// displacement `is_known`. m
    fn agreement(&mut self, is_pose: bool, is_known: bool) -> (Agreement, f64) {
        if !is_pose {
            self.doubt.wait(self.dt_s);
        }
        let error_m = self.ages[self.best_age].error_m();
        match (is_known, is_pose) {
            (false, _) => (Agreement::Unknown, 0.0),
            // The next pose includes the displacement since the one before.
            (true, false) => (Agreement::Unknown, error_m.unwrap_or_default()),
            (true, true) => match error_m.or_else(|| self.difference_m()) {
                Some(error_m) => (self.doubt.update(error_m, self.limit_m, self.dt_s), error_m),
                None => (Agreement::Unknown, 0.0),
            },
        }
    }

    /// Enters the displacement since the newest pose before into the ring. Without a pose it is zero, and part of that
    /// of a later tick.
    fn displace(&mut self, sample: &Sample) {
        let in_s = self.since_pose_s + self.dt_s;
        let before = self.before;
        self.before = sample.pose.or(before);
        self.since_pose_s = if sample.pose.is_some() { 0.0 } else { in_s };
        let poses_w_m = match (sample.pose, before) {
            (Some(now), Some(before)) => {
                Complex::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y])
            }
            _ => Complex::default(),
        };
        let theta_rad = self.before.map_or(0.0, |at| at[pose::THETA]);
        let is_pose = sample.pose.is_some();
        self.moved.push(PoseDisplacement { poses_w_m, in_s, theta_rad, is_pose });
    }

    /// Learns the axes, and the age of the reports, from a motion that does not contradict those found so far. Once
    /// they are well known, the speeds must agree, too: axes may have fitted a short motion by accident.
    fn learn(&mut self, motions: &[Option<MotionSample>; AGES_S.len()]) {
        let known = &self.ages[self.best_age];
        let error_m = if self.is_age_known {
            known.error_m()
        } else {
            self.ages.iter().filter_map(ReportAge::error_m).min_by(f64::total_cmp)
        };
        let is_well_known = known.is_well_known();
        let agrees = |error_m| {
            error_m <= 0.5 * self.limit_m && (!is_well_known || self.displacements.speeds_agree())
        };
        if !error_m.is_none_or(agrees) {
            return;
        }
        for (hypothesis, motion) in self.ages.iter_mut().zip(motions) {
            if let Some(motion) =
                motion.as_ref().filter(|motion| motion.is_pose && !motion.is_jump())
            {
                hypothesis.learn(motion);
            }
        }
        if !self.is_age_known {
            for (index, hypothesis) in self.ages.iter().enumerate() {
                if hypothesis.determination() > self.ages[self.best_age].determination() {
                    self.best_age = index;
                }
            }
            self.is_age_known = self.ages[self.best_age].is_well_known();
        }
    }

    /// By how much the poses differ from drone and inputs while poses and drone show no axes: by lengths, and by
    /// vectors along the axes that drone and inputs show; `None` if neither can be compared. m
    fn difference_m(&self) -> Option<f64> {
        let by_length_m = self.displacements.difference_m();
        let by_vector_m = (0..AXES_KINDS)
            .filter(|&kind| self.sums_by_inputs.variance(kind) >= MOTION_MIN)
            .filter_map(|kind| {
                let axes = self.sums_by_inputs.rotation(kind)?;
                self.displacements.vector_difference_m(axes * self.displacements.drone_d_m[kind])
            })
            .min_by(f64::total_cmp);
        [by_length_m, by_vector_m].into_iter().flatten().max_by(f64::total_cmp)
    }

    /// Newest speed by the drone; `None` if it reports none. m/s
    pub(super) fn speed_mps(&self) -> Option<f64> {
        self.speed_mps
    }
}

impl PoseDisplacement {
    /// The motion of the period, with the velocity that the drone reports. m/s
    fn beside(&self, [first_mps, second_mps]: [f64; 2]) -> MotionSample {
        let drone_d_mps = in_axes_kinds(Complex::new(first_mps, second_mps), self.theta_rad);
        MotionSample {
            poses_w_m: self.poses_w_m,
            in_s: self.in_s,
            drone_d_mps,
            is_pose: self.is_pose,
        }
    }
}

/// A velocity of the drone by each kind of axes: fixed or turning with the body, right- or left-handed.
fn in_axes_kinds(velocity_d_mps: Complex<f64>, theta_rad: f64) -> [Complex<f64>; AXES_KINDS] {
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_d_mps, velocity_d_mps.conj(), velocity_d_mps * turn, velocity_d_mps.conj() * turn]
}

#[cfg(test)]
mod tests;
