//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both, less what the drone's own velocity may be wrong by: it holds
//! its place by that velocity, and real flights drift. The drone's horizontal axes are not known: firmware,
//! protocol and libraries differ in names and signs, and whether they turn with the body. All kinds of axes that
//! fit the motion so far are followed, since a heading that stays or a motion along a line leaves several; the
//! least difference counts. None is known before one fits: a drone that reports no velocity is no witness. Reports may
//! be late (a Tello's by 0.2 to 0.9 s beside its accelerometer, by others' reports) and their scale may be another: the
//! age that explains the motion best is used, and kept once the motion has shown it well.

mod report_age;

use horizon_model::rows::{Pose, pose};
use horizon_model::steps;
use nalgebra::Complex;

use self::report_age::{MOTION_MIN, ReportAge, Sums};
use super::displacement::Displacements;
use super::typical_vehicle::velocity_w_mps;
use super::{Agreement, Doubt, FORGET_S, Sample};

/// Ages that reports may have, ascending, and the first of them. s
const AGES_S: [f64; 9] = [0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8];
const NEWEST: usize = 0;

/// Error of the drone's velocity that shows nothing. Real flights drift by 0.07 to 0.08 m/s (standard deviation per
/// axis, for 1.2 s): an error of that size, or of 0.05 m/s for 8 s, lands one simulated flight of 60 s in a hundred at
/// most. m/s
const VELOCITY_DRIFT_MPS: f64 = 0.08;

/// Displacement of poses beyond that of a vehicle which is faster by so much than the drone reports: another body's, or
/// an outlier. One of 0.2 m in a period outweighs the motion of a flight. m/s
const JUMP_MPS: f64 = 1.0;
/// Displacement of poses that their noise explains. m
const JUMP_M: f64 = 0.03;

/// Kinds of axes that the drone's may be: fixed, or turning with the body; each of either hand.
pub(super) const FRAMES: usize = 4;
pub(super) const FIXED: usize = 0;
pub(super) const TURNING: usize = 2;

/// Poses and velocity reports so far.
#[derive(Debug, Clone, Default)]
pub(super) struct VelocityMonitor {
    /// Largest displacement error that is plausible. m
    limit_m: f64,
    /// Period. s
    dt_s: f64,
    /// The newest pose.
    before: Option<Pose>,
    /// Since the newest pose. s
    since_pose_s: f64,
    /// Ring of the newest displacements, as long as the largest age.
    moved: Vec<PoseDisplacement>,
    newest: usize,
    /// Comparison with the drone's reports of each of [`AGES_S`].
    ages: [ReportAge; AGES_S.len()],
    /// Index of the age that explains the motion best, and whether the motion has shown it well.
    best_age: usize,
    is_age_known: bool,
    /// The inputs of a typical vehicle, in place of the poses, beside the drone.
    sums_by_inputs: Sums,
    displacements: Displacements,
    /// Newest speed by the drone; `None` without a report, and before the first speed that was not zero. m/s
    speed_mps: Option<f64>,
    /// Whether the drone has reported a speed that was not zero. A silence does not take that back.
    has_shown_speed: bool,
    doubt: Doubt,
}

/// Displacement by the poses in one tick.
#[derive(Debug, Clone, Copy, Default)]
struct PoseDisplacement {
    /// `m`: displacement since the newest pose before; zero without a pose. m
    moved_w_m: Complex<f64>,
    /// `T`: time that it took. s
    in_s: f64,
    /// Heading of the newest pose. rad
    theta_rad: f64,
    is_pose: bool,
}

/// One period of the motion.
#[derive(Debug, Clone, Copy)]
struct MotionSample {
    /// `m`: displacement by the poses. m
    moved_w_m: Complex<f64>,
    /// `T`: time that it took. s
    moved_in_s: f64,
    /// `w`: velocity by the drone in each frame. m/s
    seen_d_mps: [Complex<f64>; FRAMES],
    /// Whether it ends with a pose.
    is_pose: bool,
}

impl MotionSample {
    /// Whether the poses have moved further than any vehicle.
    fn is_jump(&self) -> bool {
        let most_mps = self.seen_d_mps[FIXED].norm() + JUMP_MPS;
        self.moved_w_m.norm() > most_mps * self.moved_in_s + JUMP_M
    }
}

/// `displacement_m`, shorter by `by_m`: by what the drone's own velocity may have been wrong by. m
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
            moved: vec![at_rest; steps(AGES_S[AGES_S.len() - 1], dt_s) + 1],
            ..Self::default()
        }
    }

    /// On the ground nothing differs.
    pub(super) fn rest(&mut self, sample: &Sample) {
        self.displace(sample);
        for hypothesis in &mut self.ages {
            hypothesis.rest();
        }
        self.displacements = Displacements::default();
        self.doubt = Doubt::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        self.displace(sample);
        let reported_mps = sample.drone.and_then(|drone| drone.horizontal_d_mps);
        let moved: [PoseDisplacement; AGES_S.len()] = AGES_S.map(|age_s| self.moved_ago(age_s));
        let keep = (-self.dt_s / FORGET_S).exp();
        let mut motions = [None; AGES_S.len()];
        for ((hypothesis, moved), motion) in self.ages.iter_mut().zip(&moved).zip(&mut motions) {
            hypothesis.forget(keep);
            let is_known = hypothesis.note_report(reported_mps.is_some(), moved.is_pose);
            *motion =
                reported_mps.filter(|_| is_known).map(|by_drone_mps| moved.beside(by_drone_mps));
            if let Some(motion) = motion {
                hypothesis.compare(motion, self.dt_s);
            }
        }
        let speed_mps = reported_mps.map(|[first_mps, second_mps]| first_mps.hypot(second_mps));
        self.has_shown_speed |= speed_mps.is_some_and(|speed_mps| speed_mps > 0.0);
        self.speed_mps = speed_mps.filter(|_| self.has_shown_speed);
        if let Some(MotionSample { moved_w_m, seen_d_mps, .. }) = motions[self.best_age] {
            let scale = self.ages[self.best_age].scale();
            let asked_w_mps = asked_w_mps(sample, moved[NEWEST].theta_rad);
            self.displacements.add(
                moved_w_m,
                &seen_d_mps.map(|v| v * scale),
                asked_w_mps,
                self.dt_s,
            );
        }
        if let Some(MotionSample { seen_d_mps, .. }) = motions[NEWEST] {
            let followed_w_m = self.displacements.followed_w_mps * self.dt_s;
            let by_inputs = MotionSample {
                moved_w_m: followed_w_m,
                moved_in_s: self.dt_s,
                seen_d_mps,
                is_pose: true,
            };
            self.sums_by_inputs.add(&by_inputs, self.dt_s);
        }
        self.learn(&motions);
        for (hypothesis, motion) in self.ages.iter_mut().zip(&motions) {
            if motion.as_ref().is_some_and(|motion| motion.is_pose) {
                hypothesis.begin_motion();
            }
        }
        let error_m = self.ages[self.best_age].error_m();
        if !moved[self.best_age].is_pose {
            self.doubt.wait(self.dt_s);
        }
        if motions[self.best_age].is_none() {
            return (Agreement::Unknown, 0.0);
        }
        if !moved[self.best_age].is_pose {
            // What the drone flew since is in the next pose.
            return (Agreement::Unknown, error_m.unwrap_or_default());
        }
        match error_m.or_else(|| self.difference_m()) {
            Some(error_m) => (self.doubt.judge(error_m, self.limit_m, self.dt_s), error_m),
            None => (Agreement::Unknown, 0.0),
        }
    }

    /// Enters the displacement since the newest pose before; without a pose it is part of a later tick's.
    fn displace(&mut self, sample: &Sample) {
        let in_s = self.since_pose_s + self.dt_s;
        let before = self.before;
        self.before = sample.pose.or(before);
        self.since_pose_s = if sample.pose.is_some() { 0.0 } else { in_s };
        let moved_w_m = match (sample.pose, before) {
            (Some(now), Some(before)) => {
                Complex::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y])
            }
            _ => Complex::default(),
        };
        let theta_rad = self.before.map_or(0.0, |at| at[pose::THETA]);
        self.newest = (self.newest + 1) % self.moved.len();
        self.moved[self.newest] =
            PoseDisplacement { moved_w_m, in_s, theta_rad, is_pose: sample.pose.is_some() };
    }

    fn moved_ago(&self, age_s: f64) -> PoseDisplacement {
        let count = self.moved.len();
        self.moved[(self.newest + count - steps(age_s, self.dt_s)) % count]
    }

    /// Learns axes, and the age of the reports, from a motion that does not contradict them, also not by its speed once
    /// they are well known: a drone that fitted a short motion by accident must be found out.
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

    /// By how much the poses differ from drone and inputs while their motion shows no axes: by lengths, and by
    /// directions if drone and inputs show axes. m
    fn difference_m(&self) -> Option<f64> {
        let by_length_m = self.displacements.difference_m();
        let by_vector_m = (0..FRAMES)
            .filter(|&frame| self.sums_by_inputs.variance(frame) >= MOTION_MIN)
            .filter_map(|frame| {
                let axes = self.sums_by_inputs.rotation(frame)?;
                self.displacements.vector_difference_m(axes * self.displacements.flown_d_m[frame])
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
    /// The motion with the velocity that the drone reports of it.
    fn beside(&self, [first_mps, second_mps]: [f64; 2]) -> MotionSample {
        let seen_d_mps = frames(Complex::new(first_mps, second_mps), self.theta_rad);
        MotionSample {
            moved_w_m: self.moved_w_m,
            moved_in_s: self.in_s,
            seen_d_mps,
            is_pose: self.is_pose,
        }
    }
}

/// Velocity that the inputs ask of a typical vehicle.
fn asked_w_mps(sample: &Sample, theta_rad: f64) -> Complex<f64> {
    velocity_w_mps(&sample.u_applied, theta_rad)
}

/// A velocity of the drone in each of the frames: fixed or turning with the body, right- or left-handed.
fn frames(velocity_d_mps: Complex<f64>, theta_rad: f64) -> [Complex<f64>; FRAMES] {
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_d_mps, velocity_d_mps.conj(), velocity_d_mps * turn, velocity_d_mps.conj() * turn]
}

#[cfg(test)]
mod tests;
