//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both. The drone's horizontal axes are not known: firmware,
//! protocol and libraries differ in names and signs, and whether they turn with the body. All kinds of axes that
//! fit the motion so far are followed, since a heading that stays or a motion along a line leaves several; the
//! least difference counts. None is known before one fits: a drone that reports no velocity is no witness. Axes that
//! were found stay while too little motion shows any, as in a hover.

use horizon_model::rows::{Pose, pose, stick};
use nalgebra::Complex;

use super::typical_vehicle::{GAIN_MPS, decay, excess};
use super::{Agreement, Sample, Verdict};

/// Time within which a difference is forgotten. s
const FORGET_S: f64 = 15.0;
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

/// Time within which a way is forgotten while the axes are not known, and a difference between speeds. s
const WAY_FORGET_S: f64 = 15.0;
const SPEED_FORGET_S: f64 = 4.0;
/// Way of the drone that counts. m
const WAY_MIN_M: f64 = 0.6;
/// Way of the drone over that of the inputs if the drone is a witness.
const WAY_FIT: std::ops::RangeInclusive<f64> = 0.4..=2.5;
/// Turn of the inputs' axes that does not count: that of the vehicle's own axes in the body of the mocap. rad
const TURN: f64 = 0.785;
/// Difference between ways or speeds by poses and by drone that does not count: a fraction of the larger one,
/// and of the speeds at least so much. 1, m/s
const TOLERANCE: f64 = 0.25;
const TOLERANCE_MPS: f64 = 0.1;
/// Time constant of the low-pass filter of both velocities before their speeds are compared: longer than the
/// age of a report. s
const SPEED_TAU_S: f64 = 0.4;

/// Ways in which the drone's axes may lie: fixed, or turning with the body; each of either hand.
const FRAMES: usize = 4;
const FIXED: usize = 0;
const TURNING: usize = 2;

/// Poses and velocity reports so far.
#[derive(Debug, Clone)]
pub(super) struct VelocityMonitor {
    limit_m: f64,
    dt_s: f64,
    before: Option<Pose>,
    /// Since the newest pose. s
    since_pose_s: f64,
    sums: Sums,
    /// The same with the inputs of a typical vehicle in place of the poses.
    sums_by_inputs: Sums,
    /// Rotation of each frame's axes from those of the world, as motion showed it last.
    axes: [Option<Complex<f64>>; FRAMES],
    ways: Ways,
    /// Newest speed by the drone; `None` before the first that was not zero. m/s
    speed_mps: Option<f64>,
    /// Of each frame: displacement by the poses less that by the drone. m
    error_m: [Complex<f64>; FRAMES],
    verdict: Verdict,
}

/// One period of the motion.
#[derive(Debug, Clone, Copy)]
struct Motion {
    /// Displacement by the poses. m
    moved_m: Complex<f64>,
    /// Time that it took. s
    moved_in_s: f64,
    /// Velocity by the drone in each frame. m/s
    seen: [Complex<f64>; FRAMES],
}

impl VelocityMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        Self {
            axes: [None; FRAMES],
            limit_m,
            dt_s,
            before: None,
            since_pose_s: 0.0,
            sums: Sums::default(),
            sums_by_inputs: Sums::default(),
            ways: Ways::default(),
            speed_mps: None,
            error_m: [Complex::default(); FRAMES],
            verdict: Verdict::default(),
        }
    }

    /// On the ground nothing differs.
    pub(super) fn rest(&mut self, sample: &Sample) {
        self.displacement(sample);
        self.error_m = [Complex::default(); FRAMES];
        self.ways = Ways::default();
        self.verdict = Verdict::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let (moved_m, moved_in_s) = self.displacement(sample);
        let keep = (-self.dt_s / FORGET_S).exp();
        for error_m in &mut self.error_m {
            *error_m *= keep;
        }
        let Some([first_mps, second_mps]) = sample.drone.and_then(|drone| drone.horizontal_mps)
        else {
            self.speed_mps = None;
            return (Agreement::Unknown, 0.0);
        };
        let speed_mps = first_mps.hypot(second_mps);
        self.speed_mps = (self.speed_mps.is_some() || speed_mps > 0.0).then_some(speed_mps);
        let seen = frames(Complex::new(first_mps, second_mps), self.before);
        self.ways.add(moved_m, &seen, asked(sample, self.before), self.dt_s);
        let error_m = self.compare(moved_m, &seen);
        self.learn(&Motion { moved_m, moved_in_s, seen }, error_m);
        let asked_m = self.ways.asked_mps * self.dt_s;
        let by_inputs = Motion { moved_m: asked_m, moved_in_s: self.dt_s, seen };
        self.sums_by_inputs.add(&by_inputs, self.dt_s);
        if sample.pose.is_none() {
            // What the drone flew since is in the next pose.
            return (Agreement::Unknown, error_m.unwrap_or_default());
        }
        match error_m.or_else(|| self.difference_m()) {
            Some(error_m) => (self.verdict.on(error_m, self.limit_m, self.dt_s), error_m),
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
        let moved_m = match (sample.pose, before) {
            (Some(now), Some(before)) => {
                Complex::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y])
            }
            _ => Complex::default(),
        };
        (moved_m, moved_in_s)
    }

    /// Learns the axes from a motion that does not contradict them, also not by its speed once they are well known: a
    /// drone that fitted a short motion by accident must be found out.
    fn learn(&mut self, motion: &Motion, error_m: Option<f64>) {
        let is_well_known = self.sums.variance(FIXED) >= WELL_KNOWN * MOTION_MIN;
        let agrees =
            |error_m| error_m <= 0.5 * self.limit_m && (!is_well_known || self.ways.speeds_agree());
        if !error_m.is_none_or(agrees) {
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
    fn compare(&mut self, moved_m: Complex<f64>, seen: &[Complex<f64>; FRAMES]) -> Option<f64> {
        let mut least_m = None;
        for (frame, error_m) in self.error_m.iter_mut().enumerate() {
            let Some(axes) = self.axes[frame] else { continue };
            *error_m += moved_m - axes * seen[frame] * self.dt_s;
            least_m = Some(error_m.norm().min(least_m.unwrap_or(f64::INFINITY)));
        }
        least_m
    }

    /// By how much the poses differ from drone and inputs while their motion shows no axes: by lengths, and by
    /// directions if drone and inputs show axes. m
    fn difference_m(&self) -> Option<f64> {
        let by_length_m = self.ways.difference_m();
        let by_vector_m = (0..FRAMES)
            .filter(|&frame| self.sums_by_inputs.variance(frame) >= MOTION_MIN)
            .filter_map(|frame| {
                let axes = self.sums_by_inputs.axes(frame)?;
                self.ways.vector_difference_m(axes * self.ways.flown_m[frame])
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
    moved_m: Complex<f64>,
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
        let Motion { moved_m, moved_in_s, ref seen } = *motion;
        let keep = (-dt_s / AXES_FORGET_S).exp();
        self.time_s = self.time_s * keep + dt_s;
        self.moved_m = self.moved_m * keep + moved_m;
        self.moved_squares = self.moved_squares * keep + moved_m.norm_sqr() / moved_in_s;
        self.squares = self.squares * keep + seen[FIXED].norm_sqr() * dt_s;
        let sums = self.flown_m.iter_mut().zip(&mut self.products);
        for ((flown_m, product), seen) in sums.zip(seen) {
            *flown_m = *flown_m * keep + seen * dt_s;
            *product = *product * keep + moved_m * seen.conj();
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
        let covariance = self.products[frame] - self.moved_m * flown_m.conj() / time_s;
        let variance = self.variance(frame);
        let moved_variance = self.moved_squares - self.moved_m.norm_sqr() / time_s;
        let fits = FIT.contains(&(covariance.norm() / variance))
            && covariance.norm_sqr() >= DETERMINATION_MIN * variance * moved_variance;
        fits.then(|| covariance / covariance.norm())
    }
}

/// Motion of the last seconds by three witnesses, while the drone's axes are not known: lengths of ways and
/// speeds do not depend on the axes. Ways show a drift that is flown against, speeds one that is not.
#[derive(Debug, Clone, Copy, Default)]
struct Ways {
    poses_m: Complex<f64>,
    /// Velocity by the poses, low-pass filtered. m/s
    poses_mps: Complex<f64>,
    /// Way by the drone in each frame. m
    flown_m: [Complex<f64>; FRAMES],
    /// Speed by the drone in each kind of axes, those that are fixed and those that turn with the body.
    drone: [DroneSpeed; 2],
    /// By the inputs of a typical vehicle. m
    inputs_m: Complex<f64>,
    /// Velocity that the inputs ask for, after the lag. m/s
    asked_mps: Complex<f64>,
}

/// Speed by the drone in one kind of axes.
#[derive(Debug, Clone, Copy, Default)]
struct DroneSpeed {
    /// Low-pass filtered. m/s
    velocity_mps: Complex<f64>,
    /// Difference between the speeds by poses and by drone, less a tolerance. m/s
    excess_mps: f64,
    /// Its leaky integral. m
    difference_m: f64,
}

impl Ways {
    fn add(
        &mut self,
        moved_m: Complex<f64>,
        seen: &[Complex<f64>; FRAMES],
        asked_mps: Complex<f64>,
        dt_s: f64,
    ) {
        let keep = (-dt_s / WAY_FORGET_S).exp();
        let keep_difference = (-dt_s / SPEED_FORGET_S).exp();
        let smooth = 1.0 - (-dt_s / SPEED_TAU_S).exp();
        self.asked_mps += (asked_mps - self.asked_mps) * (1.0 - decay(dt_s));
        self.inputs_m = self.inputs_m * keep + self.asked_mps * dt_s;
        self.poses_m = self.poses_m * keep + moved_m;
        self.poses_mps += (moved_m / dt_s - self.poses_mps) * smooth;
        let by_poses_mps = self.poses_mps.norm();
        for (flown_m, seen) in self.flown_m.iter_mut().zip(seen) {
            *flown_m = *flown_m * keep + seen * dt_s;
        }
        for (drone, seen) in self.drone.iter_mut().zip([seen[FIXED], seen[TURNING]]) {
            drone.velocity_mps += (seen - drone.velocity_mps) * smooth;
            let by_drone_mps = drone.velocity_mps.norm();
            let tolerance_mps = (TOLERANCE * by_poses_mps.max(by_drone_mps)).max(TOLERANCE_MPS);
            drone.excess_mps = ((by_poses_mps - by_drone_mps).abs() - tolerance_mps).max(0.0);
            drone.difference_m = drone.difference_m * keep_difference + drone.excess_mps * dt_s;
        }
    }

    /// Whether the speeds by poses and by drone agree.
    fn speeds_agree(&self) -> bool {
        self.drone.iter().any(|drone| drone.excess_mps <= 0.0)
    }

    /// By how much the poses differ from the two others, less a tolerance; `None` if those do not agree,
    /// as with a drone whose unit is not ours, or did not move. m
    fn difference_m(&self) -> Option<f64> {
        let (inputs_m, poses_m) = (self.inputs_m.norm(), self.poses_m.norm());
        let difference_m = |frame: usize, drone: &DroneSpeed| {
            let way_m = self.flown_m[frame].norm();
            // A drone whose unit is another differs from the inputs more than the poses do.
            let is_nearer = (way_m - inputs_m).abs() <= (poses_m - inputs_m).abs();
            let is_witness =
                way_m >= WAY_MIN_M && WAY_FIT.contains(&(way_m / inputs_m)) && is_nearer;
            let difference_m = (poses_m - way_m).abs() - TOLERANCE * way_m;
            is_witness.then(|| difference_m.max(drone.difference_m))
        };
        let [fixed, turning] = &self.drone;
        Some(difference_m(FIXED, fixed)?.min(difference_m(TURNING, turning)?))
    }

    /// By how much the way of the poses differs from `way_m` of the drone, less a tolerance; `None` unless
    /// the drone is closer than half as far from the inputs as the poses are. m
    fn vector_difference_m(&self, way_m: Complex<f64>) -> Option<f64> {
        let turn_rad = (self.poses_m * way_m.conj()).arg().clamp(-TURN, TURN);
        let poses_m = self.poses_m * Complex::from_polar(1.0, -turn_rad);
        let is_nearer = (way_m - self.inputs_m).norm() <= 0.5 * (poses_m - self.inputs_m).norm();
        is_nearer.then(|| (poses_m - way_m).norm() - TOLERANCE * way_m.norm())
    }
}

/// Velocity that the inputs ask of a typical vehicle.
fn asked(sample: &Sample, at: Option<Pose>) -> Complex<f64> {
    let u = sample.u_applied;
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    let (forward, left) = (excess(u[stick::PITCH]), -excess(u[stick::ROLL]));
    GAIN_MPS * Complex::new(forward, left) * Complex::from_polar(1.0, theta_rad)
}

/// A velocity of the drone in each of the frames: fixed or turning with the body, right- or left-handed.
fn frames(velocity_mps: Complex<f64>, at: Option<Pose>) -> [Complex<f64>; FRAMES] {
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_mps, velocity_mps.conj(), velocity_mps * turn, velocity_mps.conj() * turn]
}

#[cfg(test)]
mod tests;
