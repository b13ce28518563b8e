//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both. The drone's horizontal axes are not known: firmware,
//! protocol and libraries differ in names and signs, and whether they turn with the body. The one
//! that fits the motion so far is used, and none before it fits: a drone that reports no velocity is no witness.

use horizon_model::rows::{Pose, pose, stick};
use nalgebra::Complex;

use super::{Agreement, Sample, Verdict};

/// Time within which a difference is forgotten. s
const FORGET_S: f64 = 15.0;
/// Time within which motion that showed the axes is forgotten. s
const AXES_FORGET_S: f64 = 30.0;
/// Motion that shows the axes: integral of the squared deviation of the drone's velocity from its mean. m^2/s
const MOTION_MIN: f64 = 0.15;
/// Speed by the poses over speed by the drone if the axes fit.
const FIT: std::ops::RangeInclusive<f64> = 0.6..=1.6;

/// Time within which a way is forgotten while the axes are not known. s
const WAY_FORGET_S: f64 = 4.0;
/// Way of the drone that counts. m
const WAY_MIN_M: f64 = 0.6;
/// Way of the drone over that of the inputs if the drone is a witness.
const WAY_FIT: std::ops::RangeInclusive<f64> = 0.4..=2.5;
/// Difference between the speeds by poses and by drone that does not count: a fraction of the larger one,
/// and at least so much. 1, m/s
const SPEED_TOLERANCE: f64 = 0.25;
const SPEED_TOLERANCE_MPS: f64 = 0.1;
/// Time constant of the low-pass filter of both velocities before their speeds are compared: longer than the
/// age of a report. s
const SPEED_TAU_S: f64 = 0.4;
/// Velocity per input of a typical vehicle, and its lag. m/s, s
const GAIN_MPS: f64 = 1.9;
const LAG_S: f64 = 0.6;

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
    sums: Sums,
    ways: Ways,
    /// Newest speed by the drone; `None` before the first that was not zero. m/s
    speed_mps: Option<f64>,
    /// Displacement by the poses less that by the drone. m
    error_m: Complex<f64>,
    verdict: Verdict,
}

impl VelocityMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        Self {
            limit_m,
            dt_s,
            before: None,
            sums: Sums::default(),
            ways: Ways::default(),
            speed_mps: None,
            error_m: Complex::default(),
            verdict: Verdict::default(),
        }
    }

    /// On the ground nothing differs.
    pub(super) fn rest(&mut self, sample: &Sample) {
        self.before = sample.pose.or(self.before);
        self.error_m = Complex::default();
        self.ways = Ways::default();
        self.verdict = Verdict::default();
    }

    /// Takes a tick in flight; how both compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        // Without a pose the displacement of this tick is part of a later one's.
        let moved_m = match (sample.pose, self.before) {
            (Some(now), Some(before)) => {
                Complex::new(now[pose::X] - before[pose::X], now[pose::Y] - before[pose::Y])
            }
            _ => Complex::default(),
        };
        self.before = sample.pose.or(self.before);
        let Some([first_mps, second_mps]) = sample.drone.and_then(|drone| drone.horizontal_mps)
        else {
            self.error_m *= (-self.dt_s / FORGET_S).exp();
            self.speed_mps = None;
            return (Agreement::Unknown, self.error_m.norm());
        };
        let speed_mps = first_mps.hypot(second_mps);
        self.speed_mps = (self.speed_mps.is_some() || speed_mps > 0.0).then_some(speed_mps);
        let seen = frames(Complex::new(first_mps, second_mps), self.before);
        self.ways.add(moved_m, &seen, asked(sample, self.before), self.dt_s);
        let axes = self.axes();
        if let Some((frame, axes)) = axes {
            self.error_m = self.error_m * (-self.dt_s / FORGET_S).exp() + moved_m
                - axes * seen[frame] * self.dt_s;
        }
        // What contradicts the axes does not move them.
        if axes.is_none() || self.error_m.norm() <= 0.5 * self.limit_m {
            self.sums.add(moved_m, &seen, self.dt_s);
        }
        let error_m = self.error_m.norm();
        match axes {
            // What the drone flew since is in the next pose.
            _ if sample.pose.is_none() => (Agreement::Unknown, error_m),
            Some(_) => (self.verdict.on(error_m, self.limit_m, self.dt_s), error_m),
            None => match self.ways.difference_m() {
                Some(error_m) => (self.verdict.on(error_m, self.limit_m, self.dt_s), error_m),
                None => (Agreement::Unknown, 0.0),
            },
        }
    }

    /// Newest speed by the drone; `None` if it reports none. m/s
    pub(super) fn speed_mps(&self) -> Option<f64> {
        self.speed_mps
    }

    /// The frame that fits best and the rotation of its axes; `None` before one fits.
    fn axes(&self) -> Option<(usize, Complex<f64>)> {
        let (frame, covariance, ratio) = self.sums.best()?;
        let is_known = self.sums.motion() >= MOTION_MIN && FIT.contains(&ratio);
        is_known.then(|| (frame, covariance / covariance.norm()))
    }
}

/// Exponentially weighted sums over poses and reports. Deviations from the means are compared: a constant drift
/// of the poses has no say about the axes.
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
}

impl Sums {
    fn add(&mut self, moved_m: Complex<f64>, seen: &[Complex<f64>; FRAMES], dt_s: f64) {
        let keep = (-dt_s / AXES_FORGET_S).exp();
        self.time_s = self.time_s * keep + dt_s;
        self.moved_m = self.moved_m * keep + moved_m;
        self.squares = self.squares * keep + seen[FIXED].norm_sqr() * dt_s;
        let sums = self.flown_m.iter_mut().zip(&mut self.products);
        for ((flown_m, product), seen) in sums.zip(seen) {
            *flown_m = *flown_m * keep + seen * dt_s;
            *product = *product * keep + moved_m * seen.conj();
        }
    }

    /// Integral of the squared deviation of the drone's velocity from its mean. m^2/s
    fn motion(&self) -> f64 {
        self.squares - self.flown_m[FIXED].norm_sqr() / self.time_s.max(f64::MIN_POSITIVE)
    }

    /// The frame that fits best, its covariance with the poses (m^2/s), and the ratio of the speeds.
    fn best(&self) -> Option<(usize, Complex<f64>, f64)> {
        let time_s = self.time_s.max(f64::MIN_POSITIVE);
        let covariances = (self.products.iter().zip(&self.flown_m))
            .map(|(product, flown_m)| product - self.moved_m * flown_m.conj() / time_s);
        let (frame, covariance) =
            covariances.enumerate().max_by(|a, b| a.1.norm().total_cmp(&b.1.norm()))?;
        let flown_m = self.flown_m[frame];
        let motion = self.squares - flown_m.norm_sqr() / time_s;
        Some((frame, covariance, covariance.norm() / motion.max(f64::MIN_POSITIVE)))
    }
}

/// Motion of the last seconds by three witnesses, while the drone's axes are not known: lengths of ways and
/// speeds do not depend on the axes.
#[derive(Debug, Clone, Copy, Default)]
struct Ways {
    /// Velocity by the poses, low-pass filtered. m/s
    poses_mps: Complex<f64>,
    /// Of each kind of axes, those that are fixed and those that turn with the body.
    drone: [DroneWay; 2],
    /// By the inputs of a typical vehicle. m
    inputs_m: Complex<f64>,
    /// Velocity that the inputs ask for, after the lag. m/s
    asked_mps: Complex<f64>,
}

/// Motion by the drone in one kind of axes.
#[derive(Debug, Clone, Copy, Default)]
struct DroneWay {
    way_m: Complex<f64>,
    /// Low-pass filtered. m/s
    velocity_mps: Complex<f64>,
    /// Leaky integral of the difference between the speeds by poses and by drone, less a tolerance. m
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
        let smooth = 1.0 - (-dt_s / SPEED_TAU_S).exp();
        self.asked_mps += (asked_mps - self.asked_mps) * (1.0 - (-dt_s / LAG_S).exp());
        self.inputs_m = self.inputs_m * keep + self.asked_mps * dt_s;
        self.poses_mps += (moved_m / dt_s - self.poses_mps) * smooth;
        let by_poses_mps = self.poses_mps.norm();
        for (drone, seen) in self.drone.iter_mut().zip([seen[FIXED], seen[TURNING]]) {
            drone.way_m = drone.way_m * keep + seen * dt_s;
            drone.velocity_mps += (seen - drone.velocity_mps) * smooth;
            let by_drone_mps = drone.velocity_mps.norm();
            let tolerance_mps = SPEED_TOLERANCE * by_poses_mps.max(by_drone_mps);
            let excess_mps =
                (by_poses_mps - by_drone_mps).abs() - tolerance_mps.max(SPEED_TOLERANCE_MPS);
            drone.difference_m = drone.difference_m * keep + excess_mps.max(0.0) * dt_s;
        }
    }

    /// By how much the poses differ from the two others, less a tolerance; `None` if those do not agree,
    /// as with a drone whose unit is not ours, or did not move. m
    fn difference_m(&self) -> Option<f64> {
        let inputs_m = self.inputs_m.norm();
        let difference_m = |drone: &DroneWay| {
            let way_m = drone.way_m.norm();
            let is_witness = way_m >= WAY_MIN_M && WAY_FIT.contains(&(way_m / inputs_m));
            is_witness.then_some(drone.difference_m)
        };
        let [fixed_m, turning_m] = self.drone.each_ref().map(difference_m);
        Some(fixed_m?.min(turning_m?))
    }
}

/// Velocity that the inputs ask of a typical vehicle.
fn asked(sample: &Sample, at: Option<Pose>) -> Complex<f64> {
    let u = sample.u_applied;
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    GAIN_MPS * Complex::new(u[stick::PITCH], -u[stick::ROLL]) * Complex::from_polar(1.0, theta_rad)
}

/// A velocity of the drone in each of the frames: fixed or turning with the body, right- or left-handed.
fn frames(velocity_mps: Complex<f64>, at: Option<Pose>) -> [Complex<f64>; FRAMES] {
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_mps, velocity_mps.conj(), velocity_mps * turn, velocity_mps.conj() * turn]
}
