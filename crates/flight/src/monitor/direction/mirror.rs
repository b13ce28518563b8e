//! A mirrored frame, as a left-handed one, or one whose x and y are exchanged.
//!
//! Owns the comparison of two explanations of the motion: the velocity `v_u` that the inputs ask of a typical vehicle,
//! and `v_m`, which they ask for if the frame is mirrored: the roll then acts to the other side. Both are complex
//! numbers and are compared with the velocity `v_o` of the poses, up to a constant turn, which the nose may be off by.
//! Along one line both explain the same. The difference is `lambda`, which is the smaller eigenvalue of the covariance
//! of `v_u` if the heading is constant. Equations: `docs/model.md`, section 6, *Direction*.
//!
//! To the link monitor, a vehicle whose motion diverges looks like one that does not receive its inputs, so that an
//! outage does not end the comparison. A motion that is none of the inputs' does not look mirrored: along a line it
//! correlates with both alike.

use horizon_model::rows::{Pose, pose, stick};
use nalgebra::Complex;

use super::{BEGIN_S, FORGET_S, GAIN_SURE_MIN_MPS, RIGHT_S, VARIANCE_MIN, WRONG_S, velocity_w};
use crate::commanded::inputs_w;
use crate::forgetting::decay;
use crate::monitor::Sample;
use crate::monitor::typical_vehicle::lag_decay;

/// Least `lambda`. In mirrored frames it is reached 1.4 to 2.2 s after the first stick. Even with the half of it no
/// healthy flight, simulated or recorded, with outages or without, looks mirrored. 1
const LAMBDA_MIN: f64 = 0.002;
/// Least square of the coefficient of correlation with the explanation that counts. 1
const CORRELATION2_MIN: f64 = 0.5;

/// Comparison of the motion with that in a mirrored frame.
#[derive(Debug, Clone, Default)]
pub(super) struct MirrorMonitor {
    dt_s: f64,
    /// The newest pose.
    before: Option<Pose>,
    /// Heading of the newest pose with one. rad
    theta_rad: f64,
    /// `v_u` and `v_m` over the gain, in the newest period. 1
    asked_w: [Complex<f64>; 2],
    /// Sums of both since the newest pose, and the number of periods. 1
    since_w: [Complex<f64>; 2],
    count: usize,
    sums: Sums,
    /// For how long the frame has looked mirrored, and right. s
    wrong_s: f64,
    right_s: f64,
    /// Whether the frame was found to be mirrored in this flight.
    is_mirrored: bool,
    /// Whether the frame is known to be mirrored or not, or the motion cannot show it any more.
    is_over: bool,
}

/// Exponentially forgotten integrals over time; divided by `time_s` they are means.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Of 1. s
    time_s: f64,
    /// Of `v_u` and `v_m`. s
    v_u_w: Complex<f64>,
    v_m_w: Complex<f64>,
    /// Of `v_o`. m
    v_o_w: Complex<f64>,
    /// Of `v_u^* v_o` and `v_m^* v_o`. m
    u_o: Complex<f64>,
    m_o: Complex<f64>,
    /// Of `v_u^* v_m`. s
    u_m: Complex<f64>,
    /// Of `|v_u|^2` and `|v_m|^2`. s
    u_u: f64,
    m_m: f64,
    /// Of `|v_o|^2`. m^2/s
    o_o: f64,
}

/// What the motion shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Handedness {
    Unknown,
    Right,
    Mirrored,
}

impl Sums {
    fn add(&mut self, [v_u_w, v_m_w]: [Complex<f64>; 2], v_o_w: Complex<f64>, dt_s: f64) {
        let keep = decay(dt_s, FORGET_S);
        *self = Self {
            time_s: self.time_s * keep + dt_s,
            v_u_w: self.v_u_w * keep + v_u_w * dt_s,
            v_m_w: self.v_m_w * keep + v_m_w * dt_s,
            v_o_w: self.v_o_w * keep + v_o_w * dt_s,
            u_o: self.u_o * keep + v_u_w.conj() * v_o_w * dt_s,
            m_o: self.m_o * keep + v_m_w.conj() * v_o_w * dt_s,
            u_m: self.u_m * keep + v_u_w.conj() * v_m_w * dt_s,
            u_u: self.u_u * keep + v_u_w.norm_sqr() * dt_s,
            m_m: self.m_m * keep + v_m_w.norm_sqr() * dt_s,
            o_o: self.o_o * keep + v_o_w.norm_sqr() * dt_s,
        };
    }

    /// The explanation that is clearly the better one.
    fn handedness(&self) -> Handedness {
        let Self { time_s, u_o, m_o, u_m, u_u, m_m, o_o, .. } = *self;
        if time_s < BEGIN_S {
            return Handedness::Unknown;
        }
        let (v_u_w, v_m_w, v_o_w) = (self.v_u_w / time_s, self.v_m_w / time_s, self.v_o_w / time_s);
        let s_uo = (u_o / time_s - v_u_w.conj() * v_o_w).norm();
        let s_mo = (m_o / time_s - v_m_w.conj() * v_o_w).norm();
        let s_um = (u_m / time_s - v_u_w.conj() * v_m_w).norm();
        let s_uu = u_u / time_s - v_u_w.norm_sqr();
        let s_mm = m_m / time_s - v_m_w.norm_sqr();
        let s_oo = o_o / time_s - v_o_w.norm_sqr();
        let lambda = 0.5 * ((s_uu * s_mm).sqrt() - s_um);
        // False for NaN, which nothing but a variance below zero by rounding makes.
        if lambda >= LAMBDA_MIN && s_uu >= VARIANCE_MIN {
            let s_mo = s_mo * (s_uu / s_mm).sqrt();
            let least = 2.0 * GAIN_SURE_MIN_MPS * lambda;
            let is_strong = |s_o: f64| s_o * s_o >= CORRELATION2_MIN * s_uu * s_oo;
            if s_mo - s_uo >= least && is_strong(s_mo) {
                return Handedness::Mirrored;
            }
            if s_uo - s_mo >= least && is_strong(s_uo) {
                return Handedness::Right;
            }
        }
        Handedness::Unknown
    }
}

impl MirrorMonitor {
    pub(super) fn new(dt_s: f64) -> Self {
        Self { dt_s, ..Self::default() }
    }

    /// Takes a tick on the ground: nothing is known.
    pub(super) fn reset_on_ground(&mut self) {
        *self = Self { theta_rad: self.theta_rad, ..Self::new(self.dt_s) };
    }

    /// Forgets the motion and begins at rest.
    pub(super) fn reset(&mut self) {
        let Self { is_mirrored, is_over, .. } = *self;
        self.reset_on_ground();
        (self.is_mirrored, self.is_over) = (is_mirrored, is_over);
    }

    /// Ends the comparison for this flight.
    pub(super) fn end(&mut self) {
        self.is_over = true;
    }

    /// Takes a tick in flight: whether the motion was that in a mirrored frame for so long that it is one. A frame that
    /// was found stays mirrored for this flight: a person who flies on may hand the vehicle back.
    pub(super) fn update(&mut self, sample: &Sample) -> bool {
        if self.is_over {
            return self.is_mirrored;
        }
        self.theta_rad = sample.pose.map_or(self.theta_rad, |now| now[pose::THETA]);
        self.ask(sample);
        if let Some(now) = sample.pose {
            self.move_to(&now);
        }
        let handedness = self.sums.handedness();
        let held_s = |is_so, before_s: f64| if is_so { before_s + self.dt_s } else { 0.0 };
        self.wrong_s = held_s(handedness == Handedness::Mirrored, self.wrong_s);
        self.right_s = held_s(handedness == Handedness::Right, self.right_s);
        self.is_mirrored = self.wrong_s >= WRONG_S;
        self.is_over = self.is_mirrored || self.right_s >= RIGHT_S;
        self.is_mirrored
    }

    /// The velocities that the inputs ask for follow them with the lag.
    fn ask(&mut self, sample: &Sample) {
        let mut u_mirrored = sample.u_applied;
        u_mirrored[stick::ROLL] *= -1.0;
        let keep = lag_decay(self.dt_s);
        for (k, u) in [sample.u_applied, u_mirrored].iter().enumerate() {
            let [x, y] = inputs_w(u, self.theta_rad).into();
            self.asked_w[k] += (Complex::new(x, y) - self.asked_w[k]) * (1.0 - keep);
            self.since_w[k] += self.asked_w[k];
        }
        self.count += 1;
    }

    /// Enters the motion to a new pose, in each of its periods the mean of all.
    fn move_to(&mut self, now: &Pose) {
        let periods = std::mem::take(&mut self.count) as f64;
        let asked_w = std::mem::take(&mut self.since_w).map(|sum_w| sum_w / periods);
        let Some(before) = self.before.replace(*now) else { return };
        let lasted_s = periods * self.dt_s;
        let Some(v_o_w) = velocity_w(&before, now, lasted_s, self.dt_s) else { return };
        // One step of all periods: forgetting within a motion is negligible.
        self.sums.add(asked_w, v_o_w, lasted_s);
    }
}

#[cfg(test)]
mod tests;
