//! The vehicle model of real flights: sticks drive velocities that lag behind.
//!
//! Owns dead zone, first-order velocity lag in the world frame, acceleration limit and decaying
//! disturbance velocity, with the corners rounded so that a solver can differentiate them. The dead time is in
//! `input_delay.rs`: inputs here are the applied ones. Derivation: `docs/model.md`, section 1.

mod smooth;
mod terms;

use crate::Matrix;
use crate::model::{HessianRequest, InputHessian, Linearized, LinearizedByInput, Model};
use crate::row::Row;
use crate::setting::{SettingError, positive};
use crate::subsystem::VisitSubsystems;
use crate::vehicles::kinematic::Kinematic;
use crate::vehicles::rows::{Motion, Pose, Sticks, lag, motion, pose, stick};
use smooth::{Excess, excess, excess_second};
use terms::{ByInput, ByParameter, ByState, Lags, Parameter, Terms};

/// Horizontal subsystem: position and velocity in the plane, and the heading that turns the sticks into it.
const HORIZONTAL_STATES: [usize; 8] = [
    motion::X,
    motion::Y,
    motion::THETA,
    motion::V_X,
    motion::V_Y,
    motion::OMEGA,
    motion::D_X,
    motion::D_Y,
];
const HORIZONTAL_INPUTS: [usize; 3] = [stick::ROLL, stick::PITCH, stick::YAW];
const HORIZONTAL_PARAMETERS: [usize; 8] = [
    lag::LAMBDA_H,
    lag::LAMBDA_A,
    lag::THETA_0,
    lag::TAU_H,
    lag::TAU_A,
    lag::DEAD_H,
    lag::DEAD_A,
    lag::A_MAX,
];

/// Vertical subsystem: only the throttle moves it.
const VERTICAL_STATES: [usize; 3] = [motion::Z, motion::V_Z, motion::D_Z];
const VERTICAL_INPUTS: [usize; 1] = [stick::THROTTLE];
const VERTICAL_PARAMETERS: [usize; 3] = [lag::LAMBDA_V, lag::TAU_V, lag::DEAD_V];

/// Settings of [`Lagged`] that are not identified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LaggedShape {
    /// Time in which the horizontal disturbance velocity decays. s, > 0
    pub decay_h_s: f64,
    /// Time in which the vertical disturbance velocity decays. s, > 0
    pub decay_v_s: f64,
    /// Width of the rounded corners of the dead zones. 1 (stick), > 0
    pub dead_width: f64,
    /// Width of the rounded corner of the acceleration limit, in squared acceleration over squared
    /// limit. 1, > 0
    pub limit_width: f64,
    /// Period for which the parameters were identified: a longer step leads about where steps of this
    /// length lead. s, > 0
    pub period_s: f64,
}

impl Default for LaggedShape {
    /// A residual velocity keeps 0.43 of itself over 1 s horizontally, 0.37 vertically.
    /// The widths keep the model within 0.005 stick, 0.025 of the acceleration limit and 1 cm
    /// after 1 s of the sharp one, which `docs/model.md` measures.
    fn default() -> Self {
        Self { decay_h_s: 1.2, decay_v_s: 1.0, dead_width: 0.01, limit_width: 0.1, period_s: 0.02 }
    }
}

/// The effective input, the excess of a stick over its dead zone, times the gain is the velocity that the vehicle
/// follows with a first-order lag.
///
/// One period by semi-implicit (symplectic) Euler: first the velocities, with the exact answer of a lag to a constant
/// target, from the heading before the step `psi = theta + theta_0`; then the pose, with the new velocities:
///
/// | symbol  | equation |
/// |---------|----------|
/// | `n`     | stick excess over its dead zone, smooth |
/// | `c`     | `lambda_h (cos psi n(pitch) + sin psi n(roll), sin psi n(pitch) - cos psi n(roll))` |
/// | `e`     | `(1 - exp(-dt / tau_h)) (c - v)` |
/// | `v'`    | `v + e`, the change limited to about `a_max dt` by a smooth factor |
/// | `v_z'`  | `v_z + (1 - exp(-dt / tau_v)) (lambda_v n(throttle) - v_z)` |
/// | `omega'`| `omega + (1 - exp(-dt / tau_a)) (lambda_a n(yaw) - omega)` |
/// | `d'`    | `exp(-dt / tau_d) d`; what excites it is noise |
/// | pose    | `x' = x + dt (v' + d')`, `theta' = theta + dt omega'` |
///
/// A step of several periods takes the mean of the velocities at their ends in place of the last one, as if they
/// changed evenly: `v' - kappa (v' - v)`, `kappa = (1 - period / dt) / 2`.
///
/// Rows: state [`motion`], input [`stick`], observation [`pose`], parameter [`lag`], each within the
/// [`Domain`](crate::Domain) of its row.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lagged {
    shape: LaggedShape,
    input_kind: InputKind,
    /// Lag factors of a prepared step.
    lags: Option<Lags>,
}

/// Kind of the inputs of the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum InputKind {
    /// Sticks, with dead zones.
    #[default]
    Sticks,
    /// Effective inputs, behind the dead zones.
    Effective,
}

impl Lagged {
    /// The model of this shape.
    ///
    /// # Errors
    /// An entry of `shape` is not finite and positive.
    pub fn new(shape: LaggedShape) -> Result<Self, SettingError> {
        positive("decay_h_s", shape.decay_h_s)?;
        positive("decay_v_s", shape.decay_v_s)?;
        positive("dead_width", shape.dead_width)?;
        positive("limit_width", shape.limit_width)?;
        positive("period_s", shape.period_s)?;
        Ok(Self { shape, ..Self::default() })
    }
}

impl Model<{ motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }> for Lagged {
    const NAME: &'static str = "lagged";
    const STATE: [Row; motion::COUNT] = [
        Row::linear("x", "m"),
        Row::linear("y", "m"),
        Row::linear("z", "m"),
        Row::angle("theta"),
        Row::linear("v_x", "m/s"),
        Row::linear("v_y", "m/s"),
        Row::linear("v_z", "m/s"),
        Row::linear("omega", "rad/s"),
        Row::linear("d_x", "m/s"),
        Row::linear("d_y", "m/s"),
        Row::linear("d_z", "m/s"),
    ];
    /// All but the disturbance.
    const CONTROLLABLE: usize = motion::CONTROLLABLE;

    fn subsystems(visit: &mut impl VisitSubsystems) {
        visit.visit(&HORIZONTAL_STATES, &HORIZONTAL_INPUTS, &HORIZONTAL_PARAMETERS);
        visit.visit(&VERTICAL_STATES, &VERTICAL_INPUTS, &VERTICAL_PARAMETERS);
    }
    const INPUT: [Row; stick::COUNT] = Kinematic::INPUT;
    const OBSERVATION: [Row; pose::COUNT] = Kinematic::OBSERVATION;
    const PARAMETER: [Row; lag::COUNT] = [
        Row::positive("lambda_h", "m/s"),
        Row::positive("lambda_v", "m/s"),
        Row::positive("lambda_a", "rad/s"),
        Row::angle("theta_0"),
        Row::positive("tau_h", "s"),
        Row::positive("tau_v", "s"),
        Row::positive("tau_a", "s"),
        Row::fraction("dead_h"),
        Row::fraction("dead_v"),
        Row::fraction("dead_a"),
        Row::positive("a_max", "m/s^2"),
    ];

    #[inline]
    fn step(&self, s: &Motion, u: &Sticks, p: &Parameter, dt_s: f64) -> Motion {
        Terms::new(self, s, u, p, dt_s).next(s)
    }

    #[inline]
    fn step_by_state(&self, s: &Motion, u: &Sticks, p: &Parameter, dt_s: f64) -> ByState {
        Terms::new(self, s, u, p, dt_s).next_by_state()
    }

    #[inline]
    fn step_by_input(&self, s: &Motion, u: &Sticks, p: &Parameter, dt_s: f64) -> ByInput {
        Terms::new(self, s, u, p, dt_s).next_by_input(p)
    }

    #[inline]
    fn step_by_parameter(&self, s: &Motion, u: &Sticks, p: &Parameter, dt_s: f64) -> ByParameter {
        Terms::new(self, s, u, p, dt_s).next_by_parameter(p)
    }

    #[inline]
    fn linearize(
        &self,
        s: &Motion,
        u: &Sticks,
        p: &Parameter,
        dt_s: f64,
    ) -> Linearized<{ motion::COUNT }, { lag::COUNT }> {
        let terms = Terms::new(self, s, u, p, dt_s);
        Linearized {
            s_next: terms.next(s),
            by_state: terms.next_by_state(),
            by_parameter: terms.next_by_parameter(p),
        }
    }

    #[inline]
    fn linearize_by_input(
        &self,
        s: &Motion,
        u: &Sticks,
        p: &Parameter,
        dt_s: f64,
    ) -> LinearizedByInput<{ motion::COUNT }, { stick::COUNT }> {
        let terms = Terms::new(self, s, u, p, dt_s);
        LinearizedByInput {
            s_next: terms.next(s),
            by_state: terms.next_by_state(),
            by_input: terms.next_by_input(p),
        }
    }

    #[inline]
    fn hessian_by_input(
        &self,
        request: &HessianRequest<'_, { motion::COUNT }, { stick::COUNT }, { lag::COUNT }>,
    ) -> Option<InputHessian<{ motion::COUNT }, { stick::COUNT }>> {
        let HessianRequest { s, u, p, dt_s, .. } = *request;
        Some(Terms::new(self, s, u, p, dt_s).hessian_by_input(self, request))
    }

    #[inline]
    fn observe(&self, s: &Motion) -> Pose {
        s.fixed_rows::<{ pose::COUNT }>(motion::X).into_owned()
    }

    #[inline]
    fn observe_by_state(&self, _s: &Motion) -> Matrix<{ pose::COUNT }, { motion::COUNT }> {
        Matrix::identity()
    }

    #[inline]
    fn at_rest(&self, o: &Pose) -> Motion {
        let mut s = Motion::zeros();
        s.fixed_rows_mut::<{ pose::COUNT }>(motion::X).copy_from(o);
        s
    }

    /// The driven velocity is what `rate` leaves beside the disturbance of `s`.
    #[inline]
    fn moving(&self, o: &Pose, rate: &Pose, s: &Motion) -> Motion {
        let mut moving = self.at_rest(o);
        for (v, d, row) in [
            (motion::V_X, motion::D_X, pose::X),
            (motion::V_Y, motion::D_Y, pose::Y),
            (motion::V_Z, motion::D_Z, pose::Z),
        ] {
            moving[d] = s[d];
            moving[v] = rate[row] - s[d];
        }
        moving[motion::OMEGA] = rate[pose::THETA];
        moving
    }

    /// `tau v + tau_d d`: velocities and disturbance decay exponentially.
    #[inline]
    fn coasting(&self, s: &Motion, p: &Parameter) -> Pose {
        let LaggedShape { decay_h_s, decay_v_s, .. } = self.shape;
        Pose::new(
            p[lag::TAU_H] * s[motion::V_X] + decay_h_s * s[motion::D_X],
            p[lag::TAU_H] * s[motion::V_Y] + decay_h_s * s[motion::D_Y],
            p[lag::TAU_V] * s[motion::V_Z] + decay_v_s * s[motion::D_Z],
            p[lag::TAU_A] * s[motion::OMEGA],
        )
    }

    #[inline]
    fn coasting_by_state(
        &self,
        _s: &Motion,
        p: &Parameter,
    ) -> Matrix<{ pose::COUNT }, { motion::COUNT }> {
        let LaggedShape { decay_h_s, decay_v_s, .. } = self.shape;
        let mut by_state = Matrix::zeros();
        for (row, velocity, time_s) in [
            (pose::X, motion::V_X, p[lag::TAU_H]),
            (pose::Y, motion::V_Y, p[lag::TAU_H]),
            (pose::Z, motion::V_Z, p[lag::TAU_V]),
            (pose::THETA, motion::OMEGA, p[lag::TAU_A]),
            (pose::X, motion::D_X, decay_h_s),
            (pose::Y, motion::D_Y, decay_h_s),
            (pose::Z, motion::D_Z, decay_v_s),
        ] {
            by_state[(row, velocity)] = time_s;
        }
        by_state
    }

    fn core(&self) -> Self {
        Self { input_kind: InputKind::Effective, ..*self }
    }

    #[inline]
    fn prepared(&self, p: &Parameter, dt_s: f64) -> Self {
        Self { lags: Some(Lags::new(&self.shape, p, dt_s)), ..*self }
    }

    #[inline]
    fn effect(&self, u: &Sticks, p: &Parameter) -> Sticks {
        Sticks::from_fn(|row, _| self.excess(u[row], p[dead_of(row)]).value)
    }

    #[inline]
    fn input_for(&self, effect: &Sticks, p: &Parameter) -> Sticks {
        match self.input_kind {
            InputKind::Effective => *effect,
            InputKind::Sticks => Sticks::from_fn(|row, _| {
                smooth::stick_for(effect[row], p[dead_of(row)], self.shape.dead_width)
            }),
        }
    }
}

impl Lagged {
    /// Effective input of one stick `u`, its excess over the dead zone, with derivatives.
    #[inline]
    fn excess(&self, u: f64, dead: f64) -> Excess {
        match self.input_kind {
            InputKind::Sticks => excess(u, dead, self.shape.dead_width),
            InputKind::Effective => Excess { value: u, by_stick: 1.0, by_dead: 0.0 },
        }
    }

    /// Second derivative of the effective input by the stick `u`.
    #[inline]
    fn excess_second(&self, u: f64, dead: f64) -> f64 {
        match self.input_kind {
            InputKind::Sticks => excess_second(u, dead, self.shape.dead_width),
            InputKind::Effective => 0.0,
        }
    }
}

/// Parameter row of the dead zone of stick `row`.
const fn dead_of(row: usize) -> usize {
    match row {
        stick::THROTTLE => lag::DEAD_V,
        stick::YAW => lag::DEAD_A,
        _ => lag::DEAD_H,
    }
}

#[cfg(test)]
mod tests;
