//! What a model is: dimensions, difference equation, observation and derivatives.
//!
//! Estimation and control are generic over [`Model`]. Noise: the weights of `horizon_estim`. Input delay:
//! `input_delay.rs`. Limits: the settings of `horizon_control`.

use crate::differences;
use crate::least_squares;
use crate::row::Row;
use crate::subsystem::VisitSubsystems;
use crate::{Matrix, Vector};

/// A step and its Jacobians by state and parameter at the same arguments: what an estimator needs of a transition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearized<const NS: usize, const NP: usize> {
    /// [`Model::step`]. Unit of each row
    pub s_next: Vector<NS>,
    /// [`Model::step_by_state`]. Unit of the row / unit of the column
    pub by_state: Matrix<NS, NS>,
    /// [`Model::step_by_parameter`]. Unit of the row / unit of the column
    pub by_parameter: Matrix<NS, NP>,
}

/// A step and its Jacobians by state and input at the same arguments: what a controller needs of a transition.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearizedByInput<const NS: usize, const NU: usize> {
    /// [`Model::step`]. Unit of each row
    pub s_next: Vector<NS>,
    /// [`Model::step_by_state`]. Unit of the row / unit of the column
    pub by_state: Matrix<NS, NS>,
    /// [`Model::step_by_input`]. Unit of the row / unit of the column
    pub by_input: Matrix<NS, NU>,
}

/// Hessian of `w' f(s, u, p)` by state and parameter, with `w` one weight per row of the step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ParameterHessian<const NS: usize, const NP: usize> {
    /// By the state, twice. Symmetric. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_state: Matrix<NS, NS>,
    /// By the state and the parameter. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_state_parameter: Matrix<NS, NP>,
    /// By the parameter, twice. Symmetric. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_parameter: Matrix<NP, NP>,
}

/// Which Hessian of the dynamics a controller asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HessianKind {
    /// The exact second derivatives. Far from an optimum their sum over a horizon may be indefinite.
    Exact,
    /// A positive semidefinite replacement, so that every sum of them is positive semidefinite.
    Convexified,
}

/// Hessian of `w' f(s, u, p)` by state and input.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InputHessian<const NS: usize, const NU: usize> {
    /// By the state, twice. Symmetric. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_state: Matrix<NS, NS>,
    /// By the input and the state. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_input_state: Matrix<NU, NS>,
    /// By the input, twice. Symmetric. Unit of `w' f` / (unit of the row, unit of the column)
    pub by_input: Matrix<NU, NU>,
}

/// Where and how a model is asked for its [`InputHessian`].
#[derive(Debug, Clone, Copy)]
pub struct HessianRequest<'a, const NS: usize, const NU: usize, const NP: usize> {
    /// State. Unit of each row
    pub s: &'a Vector<NS>,
    /// Input. Unit of each row
    pub u: &'a Vector<NU>,
    /// Parameter. Unit of each row
    pub p: &'a Vector<NP>,
    /// Period. s, > 0
    pub dt_s: f64,
    /// [`Model::step_by_input`] at these arguments, from which terms may be reused.
    pub by_input: &'a Matrix<NS, NU>,
    /// Weight of each row of the step; in a controller, the costate of the next state. 1 / unit of the row
    pub w: &'a Vector<NS>,
    /// Which Hessian is asked for.
    pub kind: HessianKind,
}

/// A discrete-time model `s' = f(s, u, p)`, `o = g(s)`.
///
/// The dimensions are part of the type: `NS` states, `NU` inputs, `NO` observations, `NP`
/// parameters. Implementations are pure and allocate nothing.
///
/// [`Model::step`] and [`Model::observe`] are required. Every derivative defaults to central differences
/// ([`crate::differences`]: two evaluations per column; error about 1e-10 by rows of order 1 and by positive rows of
/// any size, so declare an inertia of 1e-5 with [`Row::positive`], and keep origins near). For exact derivatives
/// write the functions in the scalar type (`Dual`, feature `dual`) or override the derivatives by hand; an
/// override is finished when [`crate::check::model_gap`] is small for it at several points, angles
/// beyond pi included.
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
    const NAME: &'static str = "unnamed";
    /// Rows of the state.
    const STATE: [Row; NS] = [Row::UNNAMED; NS];
    /// Rows of the input.
    const INPUT: [Row; NU] = [Row::UNNAMED; NU];
    /// Rows of the observation.
    const OBSERVATION: [Row; NO] = [Row::UNNAMED; NO];
    /// Rows of the parameter.
    const PARAMETER: [Row; NP] = [Row::UNNAMED; NP];
    /// Dimension of the controllable part of the state: the first `CONTROLLABLE` rows, at most `NS`. The other rows
    /// depend on themselves and the parameter alone, so that a controller need not vary them.
    const CONTROLLABLE: usize = NS;

    /// Passes the decoupled subsystems, which together hold every row once, to `visit`; none if the model is one
    /// system. A solver may then use a block for each of them instead of one large block.
    fn subsystems(_visit: &mut impl VisitSubsystems) {}

    /// State one period later, thesis equation 3.49. A controller with move blocking asks for `dt_s` of several
    /// periods: a model that holds for one period alone has to make as many steps.
    fn step(&self, s: &Vector<NS>, u: &Vector<NU>, p: &Vector<NP>, dt_s: f64) -> Vector<NS>;

    /// Jacobian of [`Model::step`] by `s`, at the same arguments.
    #[inline]
    fn step_by_state(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NS> {
        differences::jacobian_of_rows(|s| self.step(s, u, p, dt_s), s, &Self::STATE)
    }

    /// Jacobian of [`Model::step`] by `u`, at the same arguments.
    #[inline]
    fn step_by_input(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NU> {
        differences::jacobian_of_rows(|u| self.step(s, u, p, dt_s), u, &Self::INPUT)
    }

    /// Jacobian of [`Model::step`] by `p`, at the same arguments.
    #[inline]
    fn step_by_parameter(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Matrix<NS, NP> {
        differences::jacobian_of_rows(|p| self.step(s, u, p, dt_s), p, &Self::PARAMETER)
    }

    /// [`Model::step`], [`Model::step_by_state`] and [`Model::step_by_parameter`] at one point.
    ///
    /// A model whose three functions have costly terms in common computes them once here.
    #[inline]
    fn linearize(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> Linearized<NS, NP> {
        Linearized {
            s_next: self.step(s, u, p, dt_s),
            by_state: self.step_by_state(s, u, p, dt_s),
            by_parameter: self.step_by_parameter(s, u, p, dt_s),
        }
    }

    /// [`Model::step`], [`Model::step_by_state`] and [`Model::step_by_input`] at one point.
    ///
    /// A model whose three functions have costly terms in common computes them once here.
    #[inline]
    fn linearize_by_input(
        &self,
        s: &Vector<NS>,
        u: &Vector<NU>,
        p: &Vector<NP>,
        dt_s: f64,
    ) -> LinearizedByInput<NS, NU> {
        LinearizedByInput {
            s_next: self.step(s, u, p, dt_s),
            by_state: self.step_by_state(s, u, p, dt_s),
            by_input: self.step_by_input(s, u, p, dt_s),
        }
    }

    /// Hessian of `w' f(s, u, p)` by state and parameter, or `None` if the model has none: a solver then
    /// uses Gauss-Newton and may need more iterations.
    #[inline]
    fn hessian_by_parameter(
        &self,
        _s: &Vector<NS>,
        _u: &Vector<NU>,
        _p: &Vector<NP>,
        _dt_s: f64,
        _w: &Vector<NS>,
    ) -> Option<ParameterHessian<NS, NP>> {
        None
    }

    /// Hessian of `w' f(s, u, p)` by state and input, or `None` if the model has none of this kind.
    #[inline]
    fn hessian_by_input(
        &self,
        _request: &HessianRequest<'_, NS, NU, NP>,
    ) -> Option<InputHessian<NS, NU>> {
        None
    }

    /// Expected observation `g(s)`, thesis equation 3.17.
    fn observe(&self, s: &Vector<NS>) -> Vector<NO>;

    /// Jacobian of [`Model::observe`] by `s`.
    #[inline]
    fn observe_by_state(&self, s: &Vector<NS>) -> Matrix<NO, NS> {
        differences::jacobian_of_rows(|s| self.observe(s), s, &Self::STATE)
    }

    /// The state at rest that is observed as `o`: where an estimator starts and what a target means.
    ///
    /// `observe(at_rest(o)) == o` if a state explains `o`. The default is the least-squares solution by Gauss-Newton
    /// from `s = 0`, or from `s = (0.1, 0.2, ..)` if that explains `o` better, as with distances; with the minimum norm
    /// where `observe` is linear: rows that are not observed stay zero. Override it if rest means something else, or if
    /// `observe` has other places without a derivative.
    fn at_rest(&self, o: &Vector<NO>) -> Vector<NS> {
        least_squares::least_squares(|s| self.observe(s), |s| self.observe_by_state(s), o)
    }

    /// The state that is observed as `o` while the observation changes by `rate` per second, in the
    /// surroundings of `s`: what a moving reference means.
    ///
    /// A model without velocities is at `at_rest(o)` however it moves.
    #[inline]
    fn moving(&self, o: &Vector<NO>, _rate: &Vector<NO>, _s: &Vector<NS>) -> Vector<NS> {
        self.at_rest(o)
    }

    /// By how much the observation still changes from `s` on until the system is at rest, without inputs and within
    /// the limits of the model, NO rows in the units of [`Model::OBSERVATION`]; zero for a model without velocities.
    #[inline]
    fn coasting(&self, _s: &Vector<NS>, _p: &Vector<NP>) -> Vector<NO> {
        Vector::zeros()
    }

    /// Jacobian of [`Model::coasting`] by `s`, NO x NS.
    #[inline]
    fn coasting_by_state(&self, s: &Vector<NS>, p: &Vector<NP>) -> Matrix<NO, NS> {
        differences::jacobian_of_rows(|s| self.coasting(s, p), s, &Self::STATE)
    }

    /// The model behind its static input nonlinearity (Hammerstein model): `step(s, u, p)` is
    /// `core().step(s, effect(u, p), p)`.
    ///
    /// A controller plans on the core where the nonlinearity has a dead zone or corners, and asks
    /// [`Model::input_for`] what to send.
    #[must_use]
    fn core(&self) -> Self {
        *self
    }

    /// The model with the terms that depend on this parameter and period alone computed once. Any other
    /// parameter or period gives the same result at the cost of the unprepared model.
    #[must_use]
    #[inline]
    fn prepared(&self, _p: &Vector<NP>, _dt_s: f64) -> Self {
        *self
    }

    /// Effective input: the static input nonlinearity of a Hammerstein model at `u`. Both NU rows in the units of
    /// [`Model::INPUT`].
    #[inline]
    fn effect(&self, u: &Vector<NU>, _p: &Vector<NP>) -> Vector<NU> {
        *u
    }

    /// Inverse of [`Model::effect`], NU rows in the same units.
    #[inline]
    fn input_for(&self, effect: &Vector<NU>, _p: &Vector<NP>) -> Vector<NU> {
        *effect
    }
}

#[cfg(test)]
mod tests;
