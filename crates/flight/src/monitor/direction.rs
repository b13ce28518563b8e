//! The direction of the motion beside that of the inputs.
//!
//! Owns the angle between both, which is large if the rigid body was defined turned, the frame is mirrored or the
//! heading is wrong. Deviations of the velocities from their means are compared, so that constant wind does not matter.
//! The angle is that of the covariance of the velocity `v_u` that the inputs ask of a typical vehicle, after its lag,
//! and the velocity `v_o` that the poses show, both as complex numbers: `arg m((v_u - m(v_u))^* (v_o - m(v_o)))`, with
//! the exponentially weighted mean `m`. An error of the dead time must not look like a turn: both velocities are also
//! compared with a shift in time. A shift of better correlation counts if its angle is smaller.
//!
//! After an outage the vehicle has a velocity that no known input caused. It decays with the lag, as
//! `y = exp(-t / lag)`. The part of both velocities that `y` explains is left out: the covariances are those given `y`.
//!
//! To the link monitor, a vehicle that flies against its inputs looks like one that does not receive them. So the
//! motion in an outage is compared, too, until the motion of this flight has followed its inputs once. A vehicle that
//! stood and receives no inputs does not move, and has no direction. As long as the compared motion includes an outage,
//! the inputs count as wrong only by a motion backwards that is as strong as they ask for.
//!
//! A motion along one line shows whether the frame is turned, but not whether it is mirrored about this line. That is
//! `mirror.rs`, whose sums go on in outages.

mod mirror;

use horizon_model::rows::{Pose, pose};
use nalgebra::Complex;

use self::mirror::MirrorMonitor;
use super::Sample;
use super::typical_vehicle::lag_decay;
use crate::commanded::inputs_w;
use crate::forgetting::decay;
use crate::ring::Ring;

/// Time constant with which motion is forgotten. s
const FORGET_S: f64 = 4.0;
/// Least variance of the inputs, after the lag, that shows a direction. 1
const VARIANCE_MIN: f64 = 0.012;
/// Least velocity per input of a motion that follows the inputs. m/s; 1.9 nominal
const GAIN_MIN_MPS: f64 = 0.4;
/// [`GAIN_MIN_MPS`] if the compared motion includes an outage: a vehicle that flies against its inputs follows them as
/// strongly as one that flies along them. m/s
const GAIN_SURE_MIN_MPS: f64 = 0.6;
/// Least variance of the decay `y` by which is divided: with less it explains nothing. 1
const DECAY_VARIANCE_MIN: f64 = 1e-9;
/// Least time of motion that the means need. s
const BEGIN_S: f64 = 0.5;
/// How long the angle must be beyond the limit for a wrong heading, and if it is beyond twice the limit. s
const WRONG_S: f64 = 0.6;
const WRONG_LARGE_S: f64 = 0.3;
/// How long the angle must be within the limit for a motion that has followed its inputs. s
const RIGHT_S: f64 = 0.2;
/// Time since the first input after which the motion in an outage is left out in any case: a hovering vehicle follows
/// no inputs, and wind moves it. s
const UNSHOWN_MAX_S: f64 = 15.0;
/// Shift in time by which the motion is compared later and earlier than the inputs ask for. s
const SHIFT_S: f64 = 0.25;
/// Longest time between two poses that show a motion: a source of 4 Hz. s
const MOTION_MAX_S: f64 = 0.25;

/// Comparison of the direction of the motion with that of the inputs.
#[derive(Debug, Clone, Default)]
pub(super) struct DirectionMonitor {
    limit_rad: f64,
    dt_s: f64,
    /// The newest pose.
    before: Option<Pose>,
    /// Heading of the newest pose with one. rad
    theta_rad: f64,
    since: PoseInterval,
    /// `v_u` over the gain, in the newest period. 1
    v_u_w: Complex<f64>,
    /// `y`: what is left of the velocity at the beginning of the comparison, over that velocity; 0 from rest. 1
    decay: f64,
    /// The newest velocities, as long as the shift.
    ring: Ring<Velocities>,
    count: usize,
    /// Without a shift, with a later and with an earlier motion.
    sums: [Sums; 3],
    /// For how long the angle has been beyond, and within the limit. s
    wrong_s: f64,
    right_s: f64,
    /// Time since the first input of roll or pitch in this flight. s
    steered_s: f64,
    /// Whether the motion has followed its inputs in this flight.
    is_shown: bool,
    /// Whether the compared motion includes an outage.
    has_outage: bool,
    /// For how long the link has been up. s
    up_s: f64,
    mirror: MirrorMonitor,
}

/// Sums over the periods since the newest pose.
#[derive(Debug, Clone, Copy, Default)]
struct PoseInterval {
    /// Number of periods.
    count: usize,
    /// Sum of [`DirectionMonitor::v_u_w`]. 1
    v_u_w: Complex<f64>,
    /// Sum of [`DirectionMonitor::decay`]. 1
    decay: f64,
}

/// One period of the motion.
#[derive(Debug, Clone, Copy, Default)]
struct Velocities {
    /// Commanded velocity after the lag, over the gain. 1
    v_u_w: Complex<f64>,
    /// Velocity that the poses show. m/s
    v_o_w: Complex<f64>,
}

/// Exponentially forgotten integrals over time; divided by `time_s` they are means.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    /// Of 1. s
    time_s: f64,
    /// Of `v_u`. s
    v_u_w: Complex<f64>,
    /// Of `v_o`. m
    v_o_w: Complex<f64>,
    /// Of the decay `y`. s
    y: f64,
    /// Of `v_u^* v_o`. m
    u_o: Complex<f64>,
    /// Of `v_u^* y`. s
    u_y: Complex<f64>,
    /// Of `y v_o`. m
    y_o: Complex<f64>,
    /// Of `|v_u|^2`. s
    u_u: f64,
    /// Of `|v_o|^2`. m^2/s
    o_o: f64,
    /// Of `y^2`. s
    y_y: f64,
}

/// Direction of the motion relative to that of the inputs.
#[derive(Debug, Clone, Copy)]
struct Turn {
    /// Counter-clockwise from above. rad
    angle_rad: f64,
    /// Square of the coefficient of correlation. 1, 0..=1
    correlation2: f64,
}

impl Sums {
    fn add(&mut self, [v_u_w, v_o_w]: [Complex<f64>; 2], y: f64, dt_s: f64) {
        let keep = decay(dt_s, FORGET_S);
        *self = Self {
            time_s: self.time_s * keep + dt_s,
            v_u_w: self.v_u_w * keep + v_u_w * dt_s,
            v_o_w: self.v_o_w * keep + v_o_w * dt_s,
            y: self.y * keep + y * dt_s,
            u_o: self.u_o * keep + v_u_w.conj() * v_o_w * dt_s,
            u_y: self.u_y * keep + v_u_w.conj() * y * dt_s,
            y_o: self.y_o * keep + v_o_w * y * dt_s,
            u_u: self.u_u * keep + v_u_w.norm_sqr() * dt_s,
            o_o: self.o_o * keep + v_o_w.norm_sqr() * dt_s,
            y_y: self.y_y * keep + y * y * dt_s,
        };
    }

    /// The turn; `None` if the inputs excite too little, or the motion does not follow them, with `is_sure` strongly.
    fn turn(&self, is_sure: bool) -> Option<Turn> {
        let Self { time_s, u_o, u_y, y_o, u_u, o_o, y_y, .. } = *self;
        if time_s < BEGIN_S {
            return None;
        }
        let (v_u_w, v_o_w, y) = (self.v_u_w / time_s, self.v_o_w / time_s, self.y / time_s);
        let (u_y, y_o) = (u_y / time_s - v_u_w.conj() * y, y_o / time_s - v_o_w * y);
        let s_yy = (y_y / time_s - y * y).max(DECAY_VARIANCE_MIN);
        let s_uo_y = u_o / time_s - v_u_w.conj() * v_o_w - u_y * y_o / s_yy;
        let s_uu_y = u_u / time_s - v_u_w.norm_sqr() - u_y.norm_sqr() / s_yy;
        let s_oo_y = o_o / time_s - v_o_w.norm_sqr() - y_o.norm_sqr() / s_yy;
        let gain_min_mps = if is_sure { GAIN_SURE_MIN_MPS } else { GAIN_MIN_MPS };
        let is_clear = s_uu_y >= VARIANCE_MIN && s_uo_y.norm() >= gain_min_mps * s_uu_y;
        let correlation2 = s_uo_y.norm_sqr() / (s_uu_y * s_oo_y).max(f64::MIN_POSITIVE);
        is_clear.then(|| Turn { angle_rad: s_uo_y.arg(), correlation2 })
    }
}

impl DirectionMonitor {
    pub(super) fn new(limit_rad: f64, dt_s: f64) -> Self {
        let length = horizon_model::steps(SHIFT_S, dt_s) + 1;
        let ring = Ring::new(Velocities::default(), length);
        Self { limit_rad, dt_s, ring, mirror: MirrorMonitor::new(dt_s), ..Self::default() }
    }

    /// Takes a tick on the ground: the motion has not followed its inputs yet.
    pub(super) fn reset_on_ground(&mut self) {
        self.reset_turn();
        self.steered_s = 0.0;
        self.is_shown = false;
        self.mirror.reset_on_ground();
    }

    /// Forgets the motion and begins at rest.
    pub(super) fn reset(&mut self) {
        self.mirror.reset();
        self.reset_turn();
    }

    fn reset_turn(&mut self) {
        self.before = None;
        self.since = PoseInterval::default();
        self.v_u_w = Complex::default();
        self.decay = 0.0;
        self.count = 0;
        self.sums = [Sums::default(); 3];
        self.wrong_s = 0.0;
        self.right_s = 0.0;
        self.has_outage = false;
    }

    /// Forgets the motion and begins at a velocity that no known input caused.
    fn reset_motion(&mut self) {
        self.reset_turn();
        self.decay = 1.0;
    }

    /// Takes a tick in flight: the angle, rad, if there is one, and whether the motion has shown for so long a turn
    /// beyond the limit, or a mirrored frame, that the heading is wrong.
    pub(super) fn update(&mut self, sample: &Sample) -> (Option<f64>, bool) {
        let is_steered = inputs_w(&sample.u_applied, 0.0).norm() > 0.0;
        if is_steered || self.steered_s > 0.0 {
            self.steered_s += self.dt_s;
        }
        if !sample.link_is_up && self.steered_s > UNSHOWN_MAX_S {
            self.mirror.end();
        }
        let is_mirrored = self.mirror.update(sample);
        let (error_rad, is_turned) = self.update_turn(sample);
        (error_rad, is_turned || is_mirrored)
    }

    /// As [`Self::update`], for a turn.
    ///
    /// A motion is that from one pose to the next, of a source of 4 Hz or more. In an outage the motion so far is
    /// forgotten once one has followed its inputs: the inputs had ceased to act before the outage was noticed.
    fn update_turn(&mut self, sample: &Sample) -> (Option<f64>, bool) {
        if !sample.link_is_up && (self.is_shown || self.steered_s > UNSHOWN_MAX_S) {
            self.reset_motion();
            return (None, false);
        }
        self.has_outage |= !sample.link_is_up;
        self.up_s = if sample.link_is_up { self.up_s + self.dt_s } else { 0.0 };
        if self.has_outage && self.up_s >= FORGET_S {
            self.reset_motion();
        }
        self.theta_rad = sample.pose.map_or(self.theta_rad, |now| now[pose::THETA]);
        self.ask(sample);
        if let Some(now) = sample.pose {
            self.move_to(&now);
        }
        let error_rad = self.error_rad();
        let is_beyond = |limit_rad| error_rad.is_some_and(|error_rad| error_rad.abs() > limit_rad);
        let least_rad = if self.has_outage { 2.0 * self.limit_rad } else { self.limit_rad };
        self.wrong_s = if is_beyond(least_rad) { self.wrong_s + self.dt_s } else { 0.0 };
        let is_right = error_rad.is_some_and(|error_rad| error_rad.abs() <= self.limit_rad);
        self.right_s = if is_right { self.right_s + self.dt_s } else { 0.0 };
        self.is_shown |= self.right_s >= RIGHT_S;
        self.has_outage &= !self.is_shown;
        let limit_s = if is_beyond(2.0 * self.limit_rad) { WRONG_LARGE_S } else { WRONG_S };
        (error_rad, self.wrong_s >= limit_s)
    }

    /// The velocity that the inputs ask for follows them with the lag. Pitch leads forward, roll to the right.
    fn ask(&mut self, sample: &Sample) {
        let [x, y] = inputs_w(&sample.u_applied, self.theta_rad).into();
        let asked_w = Complex::new(x, y);
        let keep = lag_decay(self.dt_s);
        self.v_u_w += (asked_w - self.v_u_w) * (1.0 - keep);
        self.decay *= keep;
        self.since.count += 1;
        self.since.v_u_w += self.v_u_w;
        self.since.decay += self.decay;
    }

    /// Enters the motion to a new pose, in each of its periods the mean of all.
    fn move_to(&mut self, now: &Pose) {
        let PoseInterval { count, v_u_w, decay } = std::mem::take(&mut self.since);
        let Some(before) = self.before.replace(*now) else { return };
        let periods = count as f64;
        let Some(v_o_w) = velocity_w(&before, now, periods * self.dt_s, self.dt_s) else {
            // Sums that stand still would hide what the others show.
            let [_, shifted @ ..] = &mut self.sums;
            *shifted = Default::default();
            self.count = 0;
            return;
        };
        for _ in 0..count {
            self.add(Velocities { v_u_w: v_u_w / periods, v_o_w }, decay / periods);
        }
    }

    fn add(&mut self, now: Velocities, decay: f64) {
        self.ring.push(now);
        self.count = self.count.saturating_add(1);
        let [unshifted, later, earlier] = &mut self.sums;
        unshifted.add([now.v_u_w, now.v_o_w], decay, self.dt_s);
        if self.count >= self.ring.len() {
            let oldest = self.ring.back(self.ring.len() - 1);
            later.add([oldest.v_u_w, now.v_o_w], decay, self.dt_s);
            earlier.add([now.v_u_w, oldest.v_o_w], decay, self.dt_s);
        }
    }

    /// The least angle of the motion as it is, if that shows one, and of the shifts that correlate better.
    fn error_rad(&self) -> Option<f64> {
        let [unshifted, shifted @ ..] = &self.sums;
        let as_is = unshifted.turn(self.has_outage)?;
        let better = shifted.iter().filter_map(|sums| sums.turn(self.has_outage));
        let better = better.filter(|turn| turn.correlation2 > as_is.correlation2);
        let angles_rad = better.map(|turn| turn.angle_rad);
        Some(angles_rad.fold(as_is.angle_rad, |a, b| if b.abs() < a.abs() { b } else { a }))
    }
}

/// Horizontal velocity from the pose `before` to `now`, `lasted_s` later; `None` if the periods of `dt_s` between take
/// longer than [`MOTION_MAX_S`]. World frame. m/s
fn velocity_w(before: &Pose, now: &Pose, lasted_s: f64, dt_s: f64) -> Option<Complex<f64>> {
    let rate = (now - before) / lasted_s;
    let shows_motion = lasted_s <= MOTION_MAX_S + 0.5 * dt_s;
    shows_motion.then(|| Complex::new(rate[pose::X], rate[pose::Y]))
}

#[cfg(test)]
mod tests;
