//! The drone's own velocity beside the displacement of the poses.
//!
//! Owns a leaky integral of the difference between both. The drone's horizontal axes are not known: firmware,
//! protocol and libraries differ in names and signs, and whether they turn with the body. The one
//! that fits the motion so far is used, and none before it fits: a drone that reports no velocity is no witness.

use horizon_model::rows::{Pose, pose};
use nalgebra::Complex;

use super::{Agreement, Sample, Verdict};

/// Time within which a difference is forgotten. s
const FORGET_S: f64 = 15.0;
/// Time within which motion that showed the axes is forgotten. s
const AXES_FORGET_S: f64 = 30.0;
/// Motion that shows the axes: integral of the squared speed by the drone. m^2/s
const MOTION_MIN: f64 = 0.15;
/// Speed by the poses over speed by the drone if the axes fit.
const FIT: std::ops::RangeInclusive<f64> = 0.6..=1.6;

/// Ways in which the drone's axes may lie.
const FRAMES: usize = 4;

/// Poses and velocity reports so far.
#[derive(Debug, Clone)]
pub(super) struct VelocityMonitor {
    limit_m: f64,
    dt_s: f64,
    before: Option<Pose>,
    /// Of each frame: sum of displacement times conjugate velocity. m^2/s
    products: [Complex<f64>; FRAMES],
    /// Sum of the squared speeds by the drone. m^2/s
    motion: f64,
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
            products: [Complex::default(); FRAMES],
            motion: 0.0,
            speed_mps: None,
            error_m: Complex::default(),
            verdict: Verdict::default(),
        }
    }

    /// On the ground nothing differs.
    pub(super) fn rest(&mut self, sample: &Sample) {
        self.before = sample.pose.or(self.before);
        self.error_m = Complex::default();
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
        let axes = self.axes();
        if let Some((frame, axes)) = axes {
            self.error_m = self.error_m * (-self.dt_s / FORGET_S).exp() + moved_m
                - axes * seen[frame] * self.dt_s;
        }
        // What contradicts the axes does not move them.
        if axes.is_none() || self.error_m.norm() <= 0.5 * self.limit_m {
            let keep = (-self.dt_s / AXES_FORGET_S).exp();
            for (product, seen) in self.products.iter_mut().zip(seen) {
                *product = *product * keep + moved_m * seen.conj();
            }
            self.motion = self.motion * keep + speed_mps * speed_mps * self.dt_s;
        }
        let error_m = self.error_m.norm();
        match axes {
            // What the drone flew since is in the next pose.
            _ if sample.pose.is_none() => (Agreement::Unknown, error_m),
            Some(_) => (self.verdict.on(error_m, self.limit_m, self.dt_s), error_m),
            None => (Agreement::Unknown, 0.0),
        }
    }

    /// Newest speed by the drone; `None` if it reports none. m/s
    pub(super) fn speed_mps(&self) -> Option<f64> {
        self.speed_mps
    }

    /// The frame that fits best and the rotation of its axes; `None` before one fits.
    fn axes(&self) -> Option<(usize, Complex<f64>)> {
        let sizes = self.products.iter().map(|product| product.norm()).enumerate();
        let (frame, size) = sizes.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let is_known = self.motion >= MOTION_MIN && FIT.contains(&(size / self.motion));
        is_known.then(|| (frame, self.products[frame] / size))
    }
}

/// A velocity of the drone in each of the frames: fixed or turning with the body, right- or left-handed.
fn frames(velocity_mps: Complex<f64>, at: Option<Pose>) -> [Complex<f64>; FRAMES] {
    let theta_rad = at.map_or(0.0, |at| at[pose::THETA]);
    let turn = Complex::from_polar(1.0, theta_rad);
    [velocity_mps, velocity_mps.conj(), velocity_mps * turn, velocity_mps.conj() * turn]
}
