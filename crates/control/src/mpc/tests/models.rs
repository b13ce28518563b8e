//! Two small models: a linear one, and one whose linearization overshoots.

use horizon_model::{Matrix, Model, Row, Vector};
use nalgebra::Vector1;

/// A cart on a rail: `x' = x + dt v`, `v' = (1 - dt drag) v + dt force`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cart;

impl Cart {
    pub(super) fn dynamics(dt_s: f64) -> (Matrix<2, 2>, Matrix<2, 1>) {
        let a = Matrix::<2, 2>::new(1.0, dt_s, 0.0, 1.0 - 0.5 * dt_s);
        (a, Matrix::<2, 1>::new(0.0, dt_s))
    }
}

impl Model<2, 1, 2, 0> for Cart {
    const NAME: &'static str = "cart";
    const STATE: [Row; 2] = [Row::linear("x", "m"), Row::linear("v", "m/s")];
    const INPUT: [Row; 1] = [Row::linear("force", "m/s^2")];
    const OBSERVATION: [Row; 2] = Self::STATE;
    const PARAMETER: [Row; 0] = [];

    fn step(&self, s: &Vector<2>, u: &Vector<1>, _p: &Vector<0>, dt_s: f64) -> Vector<2> {
        let (a, b) = Self::dynamics(dt_s);
        a * s + b * u
    }

    fn step_by_state(
        &self,
        _s: &Vector<2>,
        _u: &Vector<1>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Matrix<2, 2> {
        Self::dynamics(dt_s).0
    }

    fn step_by_input(
        &self,
        _s: &Vector<2>,
        _u: &Vector<1>,
        _p: &Vector<0>,
        dt_s: f64,
    ) -> Matrix<2, 1> {
        Self::dynamics(dt_s).1
    }

    fn step_by_parameter(
        &self,
        _s: &Vector<2>,
        _u: &Vector<1>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Matrix<2, 0> {
        Matrix::zeros()
    }

    fn observe(&self, s: &Vector<2>) -> Vector<2> {
        *s
    }

    fn observe_by_state(&self, _s: &Vector<2>) -> Matrix<2, 2> {
        Matrix::identity()
    }

    fn at_rest(&self, o: &Vector<2>) -> Vector<2> {
        *o
    }
}

/// A stick that grows steeper: `s' = s + u + 40 u^3`. Full steps overshoot.
#[derive(Debug, Clone, Copy)]
pub(super) struct Steep {
    /// 1 for the true derivative by the input, anything else for a wrong one.
    pub(super) gradient_scale: f64,
}

impl Model<1, 1, 1, 0> for Steep {
    const NAME: &'static str = "steep";
    const STATE: [Row; 1] = [Row::linear("x", "m")];
    const INPUT: [Row; 1] = [Row::linear("u", "1")];
    const OBSERVATION: [Row; 1] = Self::STATE;
    const PARAMETER: [Row; 0] = [];

    fn step(&self, s: &Vector1<f64>, u: &Vector1<f64>, _p: &Vector<0>, _dt_s: f64) -> Vector1<f64> {
        s + u.map(|u| u + 40.0 * u.powi(3))
    }

    fn step_by_state(
        &self,
        _s: &Vector1<f64>,
        _u: &Vector1<f64>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Vector1<f64> {
        Vector1::new(1.0)
    }

    fn step_by_input(
        &self,
        _s: &Vector1<f64>,
        u: &Vector1<f64>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Vector1<f64> {
        u.map(|u| self.gradient_scale * (1.0 + 120.0 * u.powi(2)))
    }

    fn step_by_parameter(
        &self,
        _s: &Vector1<f64>,
        _u: &Vector1<f64>,
        _p: &Vector<0>,
        _dt_s: f64,
    ) -> Matrix<1, 0> {
        Matrix::zeros()
    }

    fn observe(&self, s: &Vector1<f64>) -> Vector1<f64> {
        *s
    }

    fn observe_by_state(&self, _s: &Vector1<f64>) -> Vector1<f64> {
        Vector1::new(1.0)
    }

    fn at_rest(&self, o: &Vector1<f64>) -> Vector1<f64> {
        *o
    }
}
