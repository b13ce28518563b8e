//! What a vehicle model is: dimensions, named rows, difference equation and derivatives.
//!
//! Estimation and control are generic over [`Model`]; they know no vehicle. Noise, input delay and
//! limits live elsewhere.

use nalgebra::{SMatrix, SVector};

use crate::group::Group;

/// Name, unit and topology of one row of a vector.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Row {
    /// Name in logs, settings and messages, as in `docs/notation.md`.
    pub name: &'static str,
    /// SI unit; `"1"` for a ratio.
    pub unit: &'static str,
    /// Whether values that differ by 2 pi mean the same.
    pub is_angle: bool,
    /// Where values make sense.
    pub domain: Domain,
}

/// Values that a row can take.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// Every finite number.
    Real,
    /// Above zero.
    Positive,
    /// From zero up to, but not including, one.
    Share,
}

impl Row {
    /// A row on the real line.
    pub const fn linear(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit, is_angle: false, domain: Domain::Real }
    }

    /// A row that is positive by its nature.
    pub const fn positive(name: &'static str, unit: &'static str) -> Self {
        Self { domain: Domain::Positive, ..Self::linear(name, unit) }
    }

    /// A part of something: at least zero, below one.
    pub const fn share(name: &'static str) -> Self {
        Self { domain: Domain::Share, ..Self::linear(name, "1") }
    }

    /// A row on the circle, in radians.
    pub const fn angle(name: &'static str) -> Self {
        Self { is_angle: true, ..Self::linear(name, "rad") }
    }
}

/// A step and its derivatives at the same arguments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearized<const NS: usize, const NP: usize> {
    /// [`Model::step`].
    pub s_next: SVector<f64, NS>,
    /// [`Model::step_by_state`].
    pub by_state: SMatrix<f64, NS, NS>,
    /// [`Model::step_by_parameter`].
    pub by_parameter: SMatrix<f64, NS, NP>,
}

/// A step and its derivatives by state and input at the same arguments.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven<const NS: usize, const NU: usize> {
    /// [`Model::step`].
    pub s_next: SVector<f64, NS>,
    /// [`Model::step_by_state`].
    pub by_state: SMatrix<f64, NS, NS>,
    /// [`Model::step_by_input`].
    pub by_input: SMatrix<f64, NS, NU>,
}

/// Second derivatives of `w' f(s, u, p)`, a weighted sum of the rows of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Curvature<const NS: usize, const NP: usize> {
    /// By the state, twice. Symmetric.
    pub by_state: SMatrix<f64, NS, NS>,
    /// By the state and the parameter.
    pub by_state_parameter: SMatrix<f64, NS, NP>,
    /// By the parameter, twice. Symmetric.
    pub by_parameter: SMatrix<f64, NP, NP>,
}

/// Which second derivatives of a step a controller gets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Bend {
    /// As they are. Far from an optimum their sum over a horizon may be no valley.
    Exact,
    /// A stand-in that is negative along no direction, so that every sum of them is a valley.
    Convex,
}

/// Second derivatives of `w' f(s, u, p)` by state and input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveCurvature<const NS: usize, const NU: usize> {
    /// By the state, twice. Symmetric.
    pub by_state: SMatrix<f64, NS, NS>,
    /// By the input and the state.
    pub by_input_state: SMatrix<f64, NU, NS>,
    /// By the input, twice. Symmetric.
    pub by_input: SMatrix<f64, NU, NU>,
}

/// A discrete-time model `s' = f(s, u, p)`, `o = g(s)` with hand-written Jacobians.
///
/// The dimensions are part of the type: `NS` states, `NU` inputs, `NO` observations, `NP`
/// parameters. Implementations are pure and allocate nothing. An implementation is finished when
/// [`crate::check::model_gap`] is small for it at several points, angles beyond pi included.
///
/// | symbol | shape | meaning                                    |
/// |--------|-------|--------------------------------------------|
/// | `s`    | NS    | state, rows [`Model::STATE`]               |
/// | `u`    | NU    | input held over the period, [`Model::INPUT`] |
/// | `o`    | NO    | observation, [`Model::OBSERVATION`]        |
/// | `p`    | NP    | parameter, [`Model::PARAMETER`]            |
/// | `dt_s` | 1     | period, s, > 0                             |
pub trait Model<const NS: usize, const NU: usize, const NO: usize, const NP: usize>: Copy {
    /// Name in settings and logs.
    const NAME: &'static str;
    /// Rows of the state.
    const STATE: [Row; NS];
    /// Rows of the input.
    const INPUT: [Row; NU];
    /// Rows of the observation.
    const OBSERVATION: [Row; NO];
    /// Rows of the parameter.
    const PARAMETER: [Row; NP];
    /// How many rows of the state inputs reach, at once or in time, counted from the first; at most `NS`. The
    /// others follow from themselves and the parameter alone, so that a controller need not vary them.
    const REACHED: usize = NS;
    /// Groups that hold every row once, for solvers that take them one by one; empty where all rows belong
    /// together.
    const GROUPS: &'static [Group] = &[];

    /// State one period later, thesis equation 3.49.
    fn step(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SVector<f64, NS>;

    /// Jacobian of [`Model::step`] by `s`, at the same arguments.
    fn step_by_state(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NS>;

    /// Jacobian of [`Model::step`] by `u`, at the same arguments.
    fn step_by_input(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NU>;

    /// Jacobian of [`Model::step`] by `p`, at the same arguments.
    fn step_by_parameter(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> SMatrix<f64, NS, NP>;

    /// [`Model::step`], [`Model::step_by_state`] and [`Model::step_by_parameter`] at one point: what an
    /// estimator needs of a transition.
    ///
    /// A model whose three functions share costly terms computes them once here.
    #[inline]
    fn linearize(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> Linearized<NS, NP> {
        Linearized {
            s_next: self.step(s, u, p, dt_s),
            by_state: self.step_by_state(s, u, p, dt_s),
            by_parameter: self.step_by_parameter(s, u, p, dt_s),
        }
    }

    /// [`Model::step`], [`Model::step_by_state`] and [`Model::step_by_input`] at one point: what a
    /// controller needs of a transition.
    ///
    /// A model whose three functions share costly terms computes them once here.
    #[inline]
    fn linearize_drive(
        &self,
        s: &SVector<f64, NS>,
        u: &SVector<f64, NU>,
        p: &SVector<f64, NP>,
        dt_s: f64,
    ) -> Driven<NS, NU> {
        Driven {
            s_next: self.step(s, u, p, dt_s),
            by_state: self.step_by_state(s, u, p, dt_s),
            by_input: self.step_by_input(s, u, p, dt_s),
        }
    }

    /// Second derivatives of `w' f(s, u, p)`, or `None` where the model does not say: a solver then
    /// does with the first ones and needs more iterations.
    #[inline]
    fn step_curvature(
        &self,
        _s: &SVector<f64, NS>,
        _u: &SVector<f64, NU>,
        _p: &SVector<f64, NP>,
        _dt_s: f64,
        _w: &SVector<f64, NS>,
    ) -> Option<Curvature<NS, NP>> {
        None
    }

    /// Second derivatives of `w' f(s, u, p)` as a controller needs them, or `None` where the model does
    /// not say or has nothing convex to offer.
    ///
    /// `by_input` is [`Model::step_by_input`] at the same arguments: much of it may come back here.
    #[inline]
    fn drive_curvature(
        &self,
        (_s, _u): (&SVector<f64, NS>, &SVector<f64, NU>),
        _p: &SVector<f64, NP>,
        _dt_s: f64,
        _by_input: &SMatrix<f64, NS, NU>,
        (_w, _bend): (&SVector<f64, NS>, Bend),
    ) -> Option<DriveCurvature<NS, NU>> {
        None
    }

    /// Expected observation `g(s)`, thesis equation 3.17.
    fn observe(&self, s: &SVector<f64, NS>) -> SVector<f64, NO>;

    /// Jacobian of [`Model::observe`] by `s`.
    fn observe_by_state(&self, s: &SVector<f64, NS>) -> SMatrix<f64, NO, NS>;

    /// The state at rest that is observed as `o`: where an estimator starts and what a target means.
    ///
    /// `observe(at_rest(o)) == o`.
    fn at_rest(&self, o: &SVector<f64, NO>) -> SVector<f64, NS>;

    /// The state that is observed as `o` while the observation changes by `rate` per second, in the
    /// surroundings of `s`: what a moving reference means.
    ///
    /// A model without velocities is at `at_rest(o)` however it moves.
    #[inline]
    fn moving(
        &self,
        o: &SVector<f64, NO>,
        _rate: &SVector<f64, NO>,
        _s: &SVector<f64, NS>,
    ) -> SVector<f64, NS> {
        self.at_rest(o)
    }

    /// The dynamics behind the static part of the input: `step(s, u, p)` is
    /// `core().step(s, effect(u, p), p)`.
    ///
    /// A controller plans on them where the static part has kinks or flat places, and asks
    /// [`Model::input_for`] what to send.
    #[must_use]
    fn core(&self) -> Self {
        *self
    }

    /// The same model for steps with this parameter and this period: what follows from them alone is computed
    /// once. With others it is as right as before, and as slow.
    #[must_use]
    #[inline]
    fn prepared(&self, _p: &SVector<f64, NP>, _dt_s: f64) -> Self {
        *self
    }

    /// What of an input takes effect.
    #[inline]
    fn effect(&self, u: &SVector<f64, NU>, _p: &SVector<f64, NP>) -> SVector<f64, NU> {
        *u
    }

    /// The input that has this effect: the inverse of [`Model::effect`].
    #[inline]
    fn input_for(&self, effect: &SVector<f64, NU>, _p: &SVector<f64, NP>) -> SVector<f64, NU> {
        *effect
    }
}
