//! One step of the lagged vehicle and its derivatives, from terms that they have in common.
//!
//! Owns the chain rule. The step and its Jacobians fill the velocity rows first; [`integrate`] then carries
//! them into the pose, for a state and for the columns of a Jacobian alike.

mod hessian;

use nalgebra::Vector2;

use super::smooth::{Excess, Fraction, Limit, fraction, limit};
use super::{Lagged, LaggedShape, dead_of};
use crate::vehicles::rows::{Motion, Sticks, lag, motion, stick};
use crate::vehicles::world_from_sticks;
use crate::{Matrix, Vector};

/// Parameter, rows [`lag`].
pub(super) type Parameter = Vector<{ lag::COUNT }>;
/// Derivatives of a step by the state.
pub(super) type ByState = Matrix<{ motion::COUNT }, { motion::COUNT }>;
/// Derivatives of a step by the input.
pub(super) type ByInput = Matrix<{ motion::COUNT }, { stick::COUNT }>;
/// Derivatives of a step by the parameter.
pub(super) type ByParameter = Matrix<{ motion::COUNT }, { lag::COUNT }>;

/// Rows of the pose, and velocities that move them.
const MOVED: [(usize, usize); 7] = [
    (motion::X, motion::V_X),
    (motion::X, motion::D_X),
    (motion::Y, motion::V_Y),
    (motion::Y, motion::D_Y),
    (motion::Z, motion::V_Z),
    (motion::Z, motion::D_Z),
    (motion::THETA, motion::OMEGA),
];

/// Terms of a step that depend on the time constants and the period only.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lags {
    /// Time constants and period for which the terms were computed, see [`Lags::key_of`].
    key: [u64; 4],
    /// `k_h`.
    fraction_h: Fraction,
    /// `k_v`.
    fraction_v: Fraction,
    /// `k_a`.
    fraction_a: Fraction,
    /// Fraction of the disturbance velocity that a period leaves, horizontal and vertical. 1
    keep_h: f64,
    keep_v: f64,
}

impl Lags {
    pub(super) fn new(shape: &LaggedShape, p: &Parameter, dt_s: f64) -> Self {
        Self {
            key: Self::key_of(p, dt_s),
            fraction_h: fraction(p[lag::TAU_H], dt_s),
            fraction_v: fraction(p[lag::TAU_V], dt_s),
            fraction_a: fraction(p[lag::TAU_A], dt_s),
            keep_h: (-dt_s / shape.decay_h_s).exp(),
            keep_v: (-dt_s / shape.decay_v_s).exp(),
        }
    }

    /// The terms that `model` was prepared with, if it was prepared for these arguments, else new ones. Both have
    /// equal bits.
    #[inline]
    fn cached_or_new(model: &Lagged, p: &Parameter, dt_s: f64) -> Self {
        match &model.lags {
            Some(lags) if lags.key == Self::key_of(p, dt_s) => *lags,
            _ => Self::new(&model.shape, p, dt_s),
        }
    }

    /// Bits of the time constants and the period.
    #[inline]
    fn key_of(p: &Parameter, dt_s: f64) -> [u64; 4] {
        [p[lag::TAU_H], p[lag::TAU_V], p[lag::TAU_A], dt_s].map(f64::to_bits)
    }
}

/// What a step at `(s, u, p)` and its derivatives have in common.
#[derive(Debug, Clone, Copy)]
pub(super) struct Terms {
    /// How long a velocity after the step moves the pose, `dt (1 - kappa)`. s
    after_s: f64,
    /// How long a velocity before the step moves it, `dt kappa`. s
    before_s: f64,
    /// `n(roll)`, and of the other sticks likewise.
    roll: Excess,
    pitch: Excess,
    yaw: Excess,
    throttle: Excess,
    lags: Lags,
    /// Sine and cosine of psi. 1
    heading: (f64, f64),
    /// Horizontal velocity that the sticks ask for, `c`, world frame. m/s
    commanded_w_mps: Vector2<f64>,
    /// How much of it is missing, `c - v`, world frame. m/s
    missing_w_mps: Vector2<f64>,
    /// Change of the horizontal velocity before the limit, `e`, world frame. m/s
    change_w_mps: Vector2<f64>,
    /// `1 / (a_max dt)^2`. s^2/m^2
    per_limit2: f64,
    /// `q = |e|^2 / (a_max dt)^2`. 1
    ratio2: f64,
    limit: Limit,
    /// How much of the climb that the throttle asks for is missing, `lambda_v n(throttle) - v_z`. m/s
    climb_missing_mps: f64,
    /// How much of the turn that the yaw stick asks for is missing, `lambda_a n(yaw) - omega`. rad/s
    turn_missing_radps: f64,
}

impl Terms {
    #[inline(always)]
    #[expect(
        clippy::inline_always,
        reason = "innermost loop of a plan: out of line, all terms are computed and copied"
    )]
    pub(super) fn new(model: &Lagged, s: &Motion, u: &Sticks, p: &Parameter, dt_s: f64) -> Self {
        let shape = &model.shape;
        let effect = |row: usize| model.excess(u[row], p[dead_of(row)]);
        let (roll, pitch) = (effect(stick::ROLL), effect(stick::PITCH));
        let (throttle, yaw) = (effect(stick::THROTTLE), effect(stick::YAW));
        let before_s = (0.5 * (dt_s - shape.period_s)).max(0.0);
        let heading = (s[motion::THETA] + p[lag::THETA_0]).sin_cos();
        let lags = Lags::cached_or_new(model, p, dt_s);
        let commanded_w_mps =
            p[lag::LAMBDA_H] * world_from_sticks(heading, pitch.value, roll.value);
        let missing_w_mps = commanded_w_mps - Vector2::new(s[motion::V_X], s[motion::V_Y]);
        let change_w_mps = lags.fraction_h.value * missing_w_mps;
        let per_limit2 = (p[lag::A_MAX] * dt_s).powi(-2);
        let ratio2 = change_w_mps.norm_squared() * per_limit2;
        Self {
            after_s: dt_s - before_s,
            before_s,
            roll,
            pitch,
            yaw,
            throttle,
            lags,
            heading,
            commanded_w_mps,
            missing_w_mps,
            change_w_mps,
            per_limit2,
            ratio2,
            limit: limit(ratio2, shape.limit_width),
            climb_missing_mps: p[lag::LAMBDA_V] * throttle.value - s[motion::V_Z],
            turn_missing_radps: p[lag::LAMBDA_A] * yaw.value - s[motion::OMEGA],
        }
    }

    /// The state one period after `s`.
    #[inline]
    pub(super) fn next(&self, s: &Motion) -> Motion {
        let mut s_next = *s;
        let change_w_mps = self.limit.factor * self.change_w_mps;
        s_next[motion::V_X] += change_w_mps.x;
        s_next[motion::V_Y] += change_w_mps.y;
        s_next[motion::V_Z] += self.lags.fraction_v.value * self.climb_missing_mps;
        s_next[motion::OMEGA] += self.lags.fraction_a.value * self.turn_missing_radps;
        s_next[motion::D_X] *= self.lags.keep_h;
        s_next[motion::D_Y] *= self.lags.keep_h;
        s_next[motion::D_Z] *= self.lags.keep_v;
        integrate(&mut s_next, self.after_s);
        for (at, v) in MOVED {
            s_next[at] += self.before_s * s[v];
        }
        s_next
    }

    /// Derivative of [`Terms::next`] by the state.
    #[inline]
    pub(super) fn next_by_state(&self) -> ByState {
        let fraction = self.lags.fraction_h.value;
        let mut j = Matrix::identity();
        set(
            &mut j,
            motion::THETA,
            self.limited_derivative(fraction * quarter_turn(self.commanded_w_mps)),
        );
        set(&mut j, motion::V_X, Vector2::x() - self.limited_derivative(fraction * Vector2::x()));
        set(&mut j, motion::V_Y, Vector2::y() - self.limited_derivative(fraction * Vector2::y()));
        j[(motion::V_Z, motion::V_Z)] = 1.0 - self.lags.fraction_v.value;
        j[(motion::OMEGA, motion::OMEGA)] = 1.0 - self.lags.fraction_a.value;
        j[(motion::D_X, motion::D_X)] = self.lags.keep_h;
        j[(motion::D_Y, motion::D_Y)] = self.lags.keep_h;
        j[(motion::D_Z, motion::D_Z)] = self.lags.keep_v;
        integrate(&mut j, self.after_s);
        for at in MOVED {
            j[at] += self.before_s;
        }
        j
    }

    /// Derivative of [`Terms::next`] by the input.
    #[inline]
    pub(super) fn next_by_input(&self, p: &Parameter) -> ByInput {
        let mut j = Matrix::zeros();
        for (col, by_stick) in self.change_by_stick(p) {
            set(&mut j, col, self.limited_derivative(by_stick));
        }
        j[(motion::V_Z, stick::THROTTLE)] =
            self.lags.fraction_v.value * p[lag::LAMBDA_V] * self.throttle.by_stick;
        j[(motion::OMEGA, stick::YAW)] =
            self.lags.fraction_a.value * p[lag::LAMBDA_A] * self.yaw.by_stick;
        integrate(&mut j, self.after_s);
        j
    }

    /// Derivative of [`Terms::next`] by the parameter.
    #[inline]
    pub(super) fn next_by_parameter(&self, p: &Parameter) -> ByParameter {
        let fraction = self.lags.fraction_h.value;
        let along = world_from_sticks(self.heading, self.pitch.value, self.roll.value);
        let shrunk = world_from_sticks(self.heading, self.pitch.by_dead, self.roll.by_dead);
        let by_limit = -2.0 * self.limit.by_ratio2 * self.ratio2 / p[lag::A_MAX];
        let mut j = Matrix::zeros();
        set(&mut j, lag::LAMBDA_H, self.limited_derivative(fraction * along));
        set(
            &mut j,
            lag::THETA_0,
            self.limited_derivative(fraction * quarter_turn(self.commanded_w_mps)),
        );
        set(
            &mut j,
            lag::TAU_H,
            self.limited_derivative(self.lags.fraction_h.by_tau * self.missing_w_mps),
        );
        set(&mut j, lag::DEAD_H, self.limited_derivative(fraction * p[lag::LAMBDA_H] * shrunk));
        set(&mut j, lag::A_MAX, by_limit * self.change_w_mps);

        j[(motion::V_Z, lag::LAMBDA_V)] = self.lags.fraction_v.value * self.throttle.value;
        j[(motion::V_Z, lag::TAU_V)] = self.lags.fraction_v.by_tau * self.climb_missing_mps;
        j[(motion::V_Z, lag::DEAD_V)] =
            self.lags.fraction_v.value * p[lag::LAMBDA_V] * self.throttle.by_dead;
        j[(motion::OMEGA, lag::LAMBDA_A)] = self.lags.fraction_a.value * self.yaw.value;
        j[(motion::OMEGA, lag::TAU_A)] = self.lags.fraction_a.by_tau * self.turn_missing_radps;
        j[(motion::OMEGA, lag::DEAD_A)] =
            self.lags.fraction_a.value * p[lag::LAMBDA_A] * self.yaw.by_dead;
        integrate(&mut j, self.after_s);
        j
    }

    /// Derivatives of the horizontal change before the limit by the sticks that drive it.
    #[inline]
    fn change_by_stick(&self, p: &Parameter) -> [(usize, Vector2<f64>); 2] {
        let scale = self.lags.fraction_h.value * p[lag::LAMBDA_H];
        [
            (stick::ROLL, world_from_sticks(self.heading, 0.0, scale * self.roll.by_stick)),
            (stick::PITCH, world_from_sticks(self.heading, scale * self.pitch.by_stick, 0.0)),
        ]
    }

    /// Derivative of the limited change along the derivative `by` of the change before the limit.
    #[inline]
    fn limited_derivative(&self, by: Vector2<f64>) -> Vector2<f64> {
        let e = self.change_w_mps;
        let by_factor = 2.0 * self.limit.by_ratio2 * self.per_limit2 * e.dot(&by);
        self.limit.factor * by + by_factor * e
    }
}

/// Derivative of a direction by psi.
#[inline]
fn quarter_turn(q: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-q.y, q.x)
}

/// Puts a horizontal velocity into column `col`.
#[inline]
fn set<const N: usize>(j: &mut Matrix<{ motion::COUNT }, N>, col: usize, v: Vector2<f64>) {
    j[(motion::V_X, col)] = v.x;
    j[(motion::V_Y, col)] = v.y;
}

/// Adds the velocities of each column, times `after_s`, to its pose.
#[inline]
fn integrate<const N: usize>(columns: &mut Matrix<{ motion::COUNT }, N>, after_s: f64) {
    for mut column in columns.column_iter_mut() {
        column[motion::X] += after_s * (column[motion::V_X] + column[motion::D_X]);
        column[motion::Y] += after_s * (column[motion::V_Y] + column[motion::D_Y]);
        column[motion::Z] += after_s * (column[motion::V_Z] + column[motion::D_Z]);
        column[motion::THETA] += after_s * column[motion::OMEGA];
    }
}

#[cfg(test)]
mod tests;
