//! The direction of the motion beside that of the inputs.
//!
//! Owns the angle between both: a rigid body that was defined turned, a mirrored frame, a heading that
//! is wrong. Changes of the velocity are compared, not velocities: wind that the inputs work against has no say.
//! The angle is that of the covariance of the velocity `v_u`, which the inputs ask for after the lag
//! of a typical vehicle, and `v_o`, which the poses show, both as complex numbers:
//! `arg E[(v_u - E v_u)^* (v_o - E v_o)]`, with exponentially weighted means.

use horizon_model::rows::{Pose, pose, stick};
use nalgebra::Complex;

use super::Sample;

/// Time within which motion is forgotten. s
const FORGET_S: f64 = 4.0;
/// Lag of a typical vehicle. s
const LAG_S: f64 = 0.6;
/// Variance of the inputs, after the lag, that shows a direction. 1
const VARIANCE_MIN: f64 = 0.012;
/// Velocity per input below which the motion does not follow the inputs. m/s; 1.9 nominal
const GAIN_MIN_MPS: f64 = 0.4;
/// Time that the means need. s
const BEGIN_S: f64 = 0.5;
/// How long the angle must be too large. s
const WRONG_S: f64 = 0.6;

/// Exponentially weighted sums over the motion.
#[derive(Debug, Clone)]
pub(super) struct DirectionMonitor {
    limit_rad: f64,
    dt_s: f64,
    before: Option<Pose>,
    /// Velocity that the inputs ask for, after the lag, over the gain. 1
    v_u: Complex<f64>,
    sums: Sums,
    wrong_s: f64,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    time_s: f64,
    u: Complex<f64>,
    o: Complex<f64>,
    u_o: Complex<f64>,
    u_u: f64,
}

impl DirectionMonitor {
    pub(super) fn new(limit_rad: f64, dt_s: f64) -> Self {
        let (v_u, sums) = (Complex::default(), Sums::default());
        Self { limit_rad, dt_s, before: None, v_u, sums, wrong_s: 0.0 }
    }

    /// Forgets the motion.
    pub(super) fn restart(&mut self) {
        *self = Self::new(self.limit_rad, self.dt_s);
    }

    /// Takes a tick in flight: the angle, if there is one, and whether it has been wrong for long enough.
    ///
    /// Ticks without a pose are left out. In an outage the motion is forgotten: inputs had ceased to act
    /// before that was noticed.
    pub(super) fn update(&mut self, sample: &Sample) -> (Option<f64>, bool) {
        if !sample.link_is_up {
            self.restart();
            return (None, false);
        }
        let before = std::mem::replace(&mut self.before, sample.pose);
        if let Some(now) = sample.pose {
            self.ask(sample, now[pose::THETA]);
            if let Some(before) = before {
                self.add((now - before) / self.dt_s);
            }
        }
        let error_rad = self.error_rad();
        let is_wrong = error_rad.is_some_and(|error_rad| error_rad.abs() > self.limit_rad);
        self.wrong_s = if is_wrong { self.wrong_s + self.dt_s } else { 0.0 };
        (error_rad, self.wrong_s >= WRONG_S)
    }

    /// The velocity that the inputs ask for follows them with the lag. Pitch leads forward, roll to the right.
    fn ask(&mut self, sample: &Sample, theta_rad: f64) {
        let u = sample.u_applied;
        let asked =
            Complex::new(u[stick::PITCH], -u[stick::ROLL]) * Complex::from_polar(1.0, theta_rad);
        self.v_u += (asked - self.v_u) * (1.0 - (-self.dt_s / LAG_S).exp());
    }

    fn add(&mut self, rate: Pose) {
        let v_o = Complex::new(rate[pose::X], rate[pose::Y]);
        let keep = (-self.dt_s / FORGET_S).exp();
        let Sums { time_s, u, o, u_o, u_u } = self.sums;
        self.sums = Sums {
            time_s: time_s * keep + self.dt_s,
            u: u * keep + self.v_u * self.dt_s,
            o: o * keep + v_o * self.dt_s,
            u_o: u_o * keep + self.v_u.conj() * v_o * self.dt_s,
            u_u: u_u * keep + self.v_u.norm_sqr() * self.dt_s,
        };
    }

    fn error_rad(&self) -> Option<f64> {
        let Sums { time_s, u, o, u_o, u_u } = self.sums;
        if time_s < BEGIN_S {
            return None;
        }
        let (u, o) = (u / time_s, o / time_s);
        let covariance = u_o / time_s - u.conj() * o;
        let variance = u_u / time_s - u.norm_sqr();
        let is_clear = variance >= VARIANCE_MIN && covariance.norm() >= GAIN_MIN_MPS * variance;
        is_clear.then(|| covariance.arg())
    }
}
