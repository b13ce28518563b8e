//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both. The drone's horizontal axes are not known: firmware,
//! protocol and libraries differ in names and signs, and whether they turn with the body. All kinds of axes that
//! fit the motion so far are followed, since a heading that stays or a motion along a line leaves several; the
//! least difference counts. None is known before one fits: a drone that reports no velocity is no witness. Axes that
//! were found stay while too little motion shows any, as in a hover.

use horizon_model::rows::{Pose, pose};
use nalgebra::Complex;

use super::displacement::Displacements;
use super::typical_vehicle::velocity_mps;
use super::{Agreement, Doubt, FORGET_S, Sample};

/// Time within which motion that showed the axes is forgotten. s
const AXES_FORGET_S: f64 = 30.0;
/// Motion that shows the axes: integral of the squared deviation of the drone's velocity from its mean. m^2/s
const MOTION_MIN: f64 = 0.15;
/// Motion of which the axes are well known, over that.
const WELL_KNOWN: f64 = 4.0;
/// Speed by the poses over speed by the drone if the axes fit.
const FIT: std::ops::RangeInclusive<f64> = 0.6..=1.6;
/// Least fraction of the variance of the poses' velocity that the drone's explains if the axes fit (R^2).
const DETERMINATION_MIN: f64 = 0.7;

/// Displacement of poses beyond that of a vehicle which is faster by so much than the drone reports: another body's, or
/// an outlier. One of 0.2 m in a period outweighs the motion of a flight. m/s
const STEP_MPS: f64 = 1.0;
/// The same of the noise of two poses. m
const STEP_M: f64 = 0.03;

/// Kinds of axes that the drone's may be: fixed, or turning with the body; each of either hand.
pub(super) const FRAMES: usize = 4;
pub(super) const FIXED: usize = 0;
pub(super) const TURNING: usize = 2;

/// Poses and velocity reports so far.
#[derive(Debug, Clone)]
pub(super) struct VelocityMonitor {
    limit_m: f64,
    dt_s: f64,
    before: Option<Pose>,
    /// Since the newest pose. s
    since_pose_s: f64,
    /// Whether the drone was silent since then: what it flew meanwhile is not known.
    was_silent: bool,
    sums: Sums,
    /// The same with the inputs of a typical vehicle in place of the poses.
    sums_by_inputs: Sums,
    /// Rotation of each frame's axes from those of the world, as motion showed it last.
    axes: [Option<Complex<f64>>; FRAMES],
    displacements: Displacements,
    /// Newest speed by the drone; `None` before the first that was not zero. m/s
    speed_mps: Option<f64>,
    /// Of each frame: displacement by the poses less that by the drone. m
    error_m: [Complex<f64>; FRAMES],
    doubt: Doubt,
}

/// One period of the motion.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Displacement by the poses. m
    moved_w_m: Complex<f64>,
    /// Time that it took. s
    moved_in_s: f64,
    /// Velocity by the drone in each frame. m/s
    seen: [Complex<f64>; FRAMES],
}

impl Motion {
    /// Whether the poses have moved further than any vehicle.
    fn is_step(&self) -> bool {
        let most_mps = self.seen[FIXED].norm() + STEP_MPS;
        self.moved_w_m.norm() > most_mps * self.moved_in_s + STEP_M
    }
}

impl VelocityMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        Self {
            axes: [None; FRAMES],
            limit_m,
            dt_s,
            before: None,
            since_pose_s: 0.0,
            was_silent: false,
            sums: Sums::default(),
            sums_by_inputs: Sums::default(),
            displacements: Displacements::default(),
            speed_mps: None,
            error_m: [Complex::default(); FRAMES],
            doubt: Doubt::default(),
        }
    }

    /// On the ground nothing differs.
    pub(super) fn rest(&mut self, sample: &Sample) {
        self.displacement(sample);
        self.error_m = [Complex::default(); FRAMES];
        self.displacements = Displacements::default();
        self.doubt = Doubt::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let (moved_w_m, moved_in_s) = self.displacement(sample);
        let keep = (-self.dt_s / FORGET_S).exp();
        for error_m in &mut self.error_m {
            *error_m *= keep;
        }
        let Some([first_mps, second_mps]) = sample.drone.and_then(|drone| drone.horizontal_mps)
        else {
            self.speed_mps = None;
            self.was_silent = sample.pose.is_none();
            return (Agreement::Unknown, 0.0);
        };
        let speed_mps = first_mps.hypot(second_mps);
        self.speed_mps = (self.speed_mps.is_some() || speed_mps > 0.0).then_some(speed_mps);
        if self.was_silent {
            // From this pose on, if there is one, both are known again.
            self.was_silent = sample.pose.is_none();
            return (Agreement::Unknown, 0.0);
        }
        let seen = frames(Complex::new(first_mps, second_mps), self.before);
        self.displacements.add(moved_w_m, &seen, asked(sample, self.before), self.dt_s);
        let error_m = self.compare(moved_w_m, &seen);
        self.learn(&Motion { moved_w_m, moved_in_s, seen }, error_m);
        let asked_m = self.displacements.asked_w_mps * self.dt_s;
        let by_inputs = Motion { moved_w_m: asked_m, moved_in_s: self.dt_s, seen };
        self.sums_by_inputs.add(&by_inputs, self.dt_s);
        if sample.pose.is_none() {
            // What the drone flew since is in the next pose.
            return (Agreement::Unknown, error_m.unwrap_or_default());
        }
        match error_m.or_else(|| self.difference_m()) {
            Some(error_m) => (self.doubt.judge(error_m, self.limit_m, self.dt_s), error_m),
            None => (Agreement::Unknown, 0.0),
        }
    }

    /// Displacement since the newest pose before, and the time that it took; without a pose it is part of a
    /// later tick's. m, s
    fn displacement(&mut self, sample: &Sample) -> (Complex<f64>, f64) {
        let moved_in_s = self.since_pose_s + self.dt_s;
        let before = self.before;
        self.before = sample.pose.or(before);
        self.since_pose_s = if sample.pose.is_some() { 0.0 } else { moved_in_s };
        let moved_w_m = match (sample.pose, before) {
            (Some(now), Some(before)) => {
                Complex::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y])
            }
            _ => Complex::default(),
        };
        (moved_w_m, moved_in_s)
    }

    /// Learns the axes from a motion that does not contradict them, also not by its speed once they are well known: a
    /// drone that fitted a short motion by accident must be found out.
    fn learn(&mut self, motion: &Motion, error_m: Option<f64>) {
        let is_well_known = self.sums.variance(FIXED) >= WELL_KNOWN * MOTION_MIN;
        let agrees = |error_m| {
            error_m <= 0.5 * self.limit_m && (!is_well_known || self.displacements.speeds_agree())
        };
        if motion.is_step() || !error_m.is_none_or(agrees) {
            return;
        }
        self.sums.add(motion, self.dt_s);
        for (frame, axes) in self.axes.iter_mut().enumerate() {
            if self.sums.variance(frame) >= MOTION_MIN {
                *axes = self.sums.axes(frame);
            }
        }
    }

    /// Integrates the difference in each frame that fits; the least one, `None` before a frame fits. m
    fn compare(&mut self, moved_w_m: Complex<f64>, seen: &[Complex<f64>; FRAMES]) -> Option<f64> {
        let mut least_m = None;
        for (frame, error_m) in self.error_m.iter_mut().enumerate() {
            let Some(axes) = self.axes[frame] else { continue };
            *error_m += moved_w_m - axes * seen[frame] * self.dt_s;
            least_m = Some(error_m.norm().min(least_m.unwrap_or(f64::INFINITY)));
        }
        least_m
    }

    /// By how much the poses differ from drone and inputs while their motion shows no axes: by lengths, and by
    /// directions if drone and inputs show axes. m
    fn difference_m(&self) -> Option<f64> {
        let by_length_m = self.displacements.difference_m();
        let by_vector_m = (0..FRAMES)
            .filter(|&frame| self.sums_by_inputs.variance(frame) >= MOTION_MIN)
            .filter_map(|frame| {
                let axes = self.sums_by_inputs.axes(frame)?;
                self.displacements.vector_difference_m(axes * self.displacements.flown_m[frame])
            })
            .reduce(f64::min);
        [by_length_m, by_vector_m].into_iter().flatten().reduce(f64::max)
    }

    /// Newest speed by the drone; `None` if it reports none. m/s
    pub(super) fn speed_mps(&self) -> Option<f64> {
        self.speed_mps
    }
}

/// Exponentially weighted sums over poses and reports. Deviations from the means are compared: a constant drift
/// of the poses does not change the axes.
#[derive(Debug, Clone, Default)]
struct Sums {
    time_s: f64,
    /// Displacement by the poses. m
    moved_w_m: Complex<f64>,
    /// Of each frame: the displacement by the drone. m
    flown_m: [Complex<f64>; FRAMES],
    /// Of each frame: displacement by the poses times conjugate velocity by the drone. m^2/s
    products: [Complex<f64>; FRAMES],
    /// Squared speed by the drone. m^2/s
    squares: f64,
    /// Squared speed by the poses. m^2/s
    moved_squares: f64,
}

impl Sums {
    fn add(&mut self, motion: &Motion, dt_s: f64) {
        let Motion { moved_w_m, moved_in_s, ref seen } = *motion;
        let keep = (-dt_s / AXES_FORGET_S).exp();
        self.time_s = self.time_s * keep + dt_s;
        self.moved_w_m = self.moved_w_m * keep + moved_w_m;
        self.moved_squares = self.moved_squares * keep + moved_w_m.norm_sqr() / moved_in_s;
        self.squares = self.squares * keep + seen[FIXED].norm_sqr() * dt_s;
        let sums = self.flown_m.iter_mut().zip(&mut self.products);
        for ((flown_m, product), seen) in sums.zip(seen) {
            *flown_m = *flown_m * keep + seen * dt_s;
            *product = *product * keep + moved_w_m * seen.conj();
        }
    }

    /// Integral of the squared deviation of the drone's velocity from its mean. m^2/s
    fn variance(&self, frame: usize) -> f64 {
        self.squares - self.flown_m[frame].norm_sqr() / self.time_s.max(f64::MIN_POSITIVE)
    }

    /// Rotation of the axes of `frame` from those of the world; `None` if they do not fit the motion.
    fn axes(&self, frame: usize) -> Option<Complex<f64>> {
        let time_s = self.time_s.max(f64::MIN_POSITIVE);
        let flown_m = self.flown_m[frame];
        let covariance = self.products[frame] - self.moved_w_m * flown_m.conj() / time_s;
        let variance = self.variance(frame);
        let moved_variance = self.moved_squares - self.moved_w_m.norm_sqr() / time_s;
        let fits = FIT.contains(&(covariance.norm() / variance))
            && covariance.norm_sqr() >= DETERMINATION_MIN * variance * moved_variance;
        fits.then(|| covariance / covariance.norm())
    }
}

/// Velocity that the inputs ask of a typical vehicle.
fn asked(sample: &Sample, at: Option<Pose>) -> Complex<f64> {
    velocity_mps(&sample.u_applied, at.map_or(0.0, |at| at[pose::THETA]))
}

/// A velocity of the drone in each of the frames: fixed or turning with the body, right- or left-handed.
fn frames(velocity_mps: Complex<f64>, at: Option<Pose>) -> [Complex<f64>; FRAMES] {
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_mps, velocity_mps.conj(), velocity_mps * turn, velocity_mps.conj() * turn]
}

#[cfg(test)]
mod tests;
