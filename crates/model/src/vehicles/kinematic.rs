//! The thesis' vehicle model: sticks are scaled velocities.
//!
//! Owns equation 4.1, its explicit Euler form 4.3 and the derivatives. Equation 4.22 is misprinted
//! in the thesis (one sign, two rows swapped); the derivatives here are derived from 4.1 in
//! `docs/model.md` and checked numerically.

use crate::model::{HessianKind, HessianRequest, InputHessian, Model, ParameterHessian};
use crate::row::Row;
use crate::vehicles::rows::{Pose, Sticks, gain, pose, stick};
use crate::vehicles::world_from_sticks;
use crate::{Matrix, Vector};

/// Thesis equation 4.1: `x' = lambda_h (sin psi roll + cos psi pitch)`,
/// `y' = lambda_h (sin psi pitch - cos psi roll)`, `z' = lambda_v throttle`,
/// `theta' = lambda_a yaw`, with `psi = theta + theta_0`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Kinematic;

/// Parameter, rows [`gain`].
pub(super) type Parameter = Vector<{ gain::COUNT }>;
/// Derivatives of a step, or of an observation, by the state.
pub(super) type ByState = Matrix<{ pose::COUNT }, { pose::COUNT }>;
/// Derivatives of a step by the input.
pub(super) type ByInput = Matrix<{ pose::COUNT }, { stick::COUNT }>;
/// Derivatives of a step by the parameter.
pub(super) type ByParameter = Matrix<{ pose::COUNT }, { gain::COUNT }>;

/// Direction of the unit-gain horizontal velocity and of its derivative by `psi`.
///
/// `[q1, q2]` of thesis equations 4.17-4.18; the derivative of `[q1, q2]` by `psi` is `[-q2, q1]`.
#[inline]
fn heading_rows(s: &Pose, u: &Sticks, theta_0: f64) -> [f64; 2] {
    let heading = (s[pose::THETA] + theta_0).sin_cos();
    world_from_sticks(heading, u[stick::PITCH], u[stick::ROLL]).into()
}

impl Model<{ pose::COUNT }, { stick::COUNT }, { pose::COUNT }, { gain::COUNT }> for Kinematic {
    const NAME: &'static str = "kinematic";
    const STATE: [Row; pose::COUNT] =
        [Row::linear("x", "m"), Row::linear("y", "m"), Row::linear("z", "m"), Row::angle("theta")];
    const INPUT: [Row; stick::COUNT] = [
        Row::linear("roll", "1"),
        Row::linear("pitch", "1"),
        Row::linear("yaw", "1"),
        Row::linear("throttle", "1"),
    ];
    const OBSERVATION: [Row; pose::COUNT] = Self::STATE;
    const PARAMETER: [Row; gain::COUNT] = [
        Row::linear("lambda_h", "m/s"),
        Row::linear("lambda_v", "m/s"),
        Row::linear("lambda_a", "rad/s"),
        Row::angle("theta_0"),
    ];

    #[inline]
    fn step(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> Pose {
        let [q1, q2] = heading_rows(s, u, p[gain::THETA_0]);
        let mut s_next = *s;
        s_next[pose::X] += dt_s * p[gain::LAMBDA_H] * q1;
        s_next[pose::Y] += dt_s * p[gain::LAMBDA_H] * q2;
        s_next[pose::Z] += dt_s * p[gain::LAMBDA_V] * u[stick::THROTTLE];
        s_next[pose::THETA] += dt_s * p[gain::LAMBDA_A] * u[stick::YAW];
        s_next
    }

    #[inline]
    fn step_by_state(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> ByState {
        let [q1, q2] = heading_rows(s, u, p[gain::THETA_0]);
        let mut j = Matrix::identity();
        j[(pose::X, pose::THETA)] = -dt_s * p[gain::LAMBDA_H] * q2;
        j[(pose::Y, pose::THETA)] = dt_s * p[gain::LAMBDA_H] * q1;
        j
    }

    #[inline]
    fn step_by_input(&self, s: &Pose, _u: &Sticks, p: &Parameter, dt_s: f64) -> ByInput {
        let (sin, cos) = (s[pose::THETA] + p[gain::THETA_0]).sin_cos();
        let scale_h = dt_s * p[gain::LAMBDA_H];
        let mut j = Matrix::zeros();
        j[(pose::X, stick::ROLL)] = scale_h * sin;
        j[(pose::X, stick::PITCH)] = scale_h * cos;
        j[(pose::Y, stick::ROLL)] = -scale_h * cos;
        j[(pose::Y, stick::PITCH)] = scale_h * sin;
        j[(pose::Z, stick::THROTTLE)] = dt_s * p[gain::LAMBDA_V];
        j[(pose::THETA, stick::YAW)] = dt_s * p[gain::LAMBDA_A];
        j
    }

    #[inline]
    fn step_by_parameter(&self, s: &Pose, u: &Sticks, p: &Parameter, dt_s: f64) -> ByParameter {
        let [q1, q2] = heading_rows(s, u, p[gain::THETA_0]);
        let mut j = Matrix::zeros();
        j[(pose::X, gain::LAMBDA_H)] = dt_s * q1;
        j[(pose::X, gain::THETA_0)] = -dt_s * p[gain::LAMBDA_H] * q2;
        j[(pose::Y, gain::LAMBDA_H)] = dt_s * q2;
        j[(pose::Y, gain::THETA_0)] = dt_s * p[gain::LAMBDA_H] * q1;
        j[(pose::Z, gain::LAMBDA_V)] = dt_s * u[stick::THROTTLE];
        j[(pose::THETA, gain::LAMBDA_A)] = dt_s * u[stick::YAW];
        j
    }

    #[inline]
    fn hessian_by_parameter(
        &self,
        s: &Pose,
        u: &Sticks,
        p: &Parameter,
        dt_s: f64,
        w: &Pose,
    ) -> Option<ParameterHessian<{ pose::COUNT }, { gain::COUNT }>> {
        let [q1, q2] = heading_rows(s, u, p[gain::THETA_0]);
        // The heading enters as psi = theta + theta_0 only: each is the same to both.
        let by_psi_psi = -dt_s * p[gain::LAMBDA_H] * (w[pose::X] * q1 + w[pose::Y] * q2);
        let by_psi_lambda = dt_s * (w[pose::Y] * q1 - w[pose::X] * q2);
        let mut by_state = Matrix::zeros();
        by_state[(pose::THETA, pose::THETA)] = by_psi_psi;
        let mut by_state_parameter = Matrix::zeros();
        by_state_parameter[(pose::THETA, gain::THETA_0)] = by_psi_psi;
        by_state_parameter[(pose::THETA, gain::LAMBDA_H)] = by_psi_lambda;
        let mut by_parameter = Matrix::zeros();
        by_parameter[(gain::THETA_0, gain::THETA_0)] = by_psi_psi;
        by_parameter[(gain::THETA_0, gain::LAMBDA_H)] = by_psi_lambda;
        by_parameter[(gain::LAMBDA_H, gain::THETA_0)] = by_psi_lambda;
        Some(ParameterHessian { by_state, by_state_parameter, by_parameter })
    }

    #[inline]
    fn hessian_by_input(
        &self,
        request: &HessianRequest<'_, { pose::COUNT }, { stick::COUNT }, { gain::COUNT }>,
    ) -> Option<InputHessian<{ pose::COUNT }, { stick::COUNT }>> {
        let HessianRequest { u, by_input, w, kind, .. } = *request;
        if kind == HessianKind::Convexified {
            // By the heading the Hessian has eigenvalues of both signs.
            return None;
        }
        let along =
            |axis| w[pose::X] * by_input[(pose::X, axis)] + w[pose::Y] * by_input[(pose::Y, axis)];
        // A quarter turn makes pitch of roll, and the opposite of roll of pitch.
        let (by_roll, by_pitch) = (along(stick::ROLL), along(stick::PITCH));
        let mut by_state = Matrix::zeros();
        by_state[(pose::THETA, pose::THETA)] =
            -by_roll * u[stick::ROLL] - by_pitch * u[stick::PITCH];
        let mut by_input_state = Matrix::zeros();
        by_input_state[(stick::ROLL, pose::THETA)] = by_pitch;
        by_input_state[(stick::PITCH, pose::THETA)] = -by_roll;
        Some(InputHessian { by_state, by_input_state, by_input: Matrix::zeros() })
    }

    #[inline]
    fn observe(&self, s: &Pose) -> Pose {
        *s
    }

    #[inline]
    fn observe_by_state(&self, _s: &Pose) -> ByState {
        Matrix::identity()
    }

    #[inline]
    fn at_rest(&self, o: &Pose) -> Pose {
        *o
    }
}

#[cfg(test)]
mod tests {
    use crate::Vector;
    use std::f64::consts::{FRAC_PI_2, PI};

    use super::*;
    use crate::check::{Point, model_gap};

    const DT_S: f64 = 0.02;

    #[test]
    fn every_jacobian_meets_its_numeric_twin() {
        for theta in [-9.0, -PI, -1.0, 0.0, 0.3, FRAC_PI_2, PI - 1e-9, PI, PI + 1e-9, 7.0] {
            for theta_0 in [-0.3, 0.0, 2.0] {
                let at = Point {
                    s: Pose::new(0.4, -1.2, 1.3, theta),
                    u: Sticks::new(0.7, -0.6, 0.5, -0.9),
                    p: Vector::<4>::new(1.29, 0.445, 0.994, theta_0),
                    dt_s: DT_S,
                };
                // Central differences of sines over a step of 6e-6 leave about 1e-10.
                let gap = model_gap(&Kinematic, &at).gap;
                assert!(gap < 1e-8, "gap {gap:e} at theta = {theta}, theta_0 = {theta_0}");
            }
        }
    }

    #[test]
    fn sticks_move_the_vehicle_where_a_pilot_expects() {
        let p = Vector::<4>::new(1.0, 1.0, 1.0, 0.0);
        let at = |theta: f64, u: Sticks| {
            Kinematic.step(&Pose::new(0.0, 0.0, 1.0, theta), &u, &p, 1.0)
                - Pose::new(0.0, 0.0, 1.0, theta)
        };
        let close = |left: Pose, right: Pose| (left - right).norm() < 1e-12;
        let (roll, pitch) = (Sticks::new(1.0, 0.0, 0.0, 0.0), Sticks::new(0.0, 1.0, 0.0, 0.0));
        // Facing +x: forward is +x, right is -y. Facing +y: forward is +y, right is +x.
        assert!(close(at(0.0, pitch), Pose::new(1.0, 0.0, 0.0, 0.0)));
        assert!(close(at(0.0, roll), Pose::new(0.0, -1.0, 0.0, 0.0)));
        assert!(close(at(FRAC_PI_2, pitch), Pose::new(0.0, 1.0, 0.0, 0.0)));
        assert!(close(at(FRAC_PI_2, roll), Pose::new(1.0, 0.0, 0.0, 0.0)));
        assert!(close(at(0.0, Sticks::new(0.0, 0.0, 1.0, 0.0)), Pose::new(0.0, 0.0, 0.0, 1.0)));
        assert!(close(at(0.0, Sticks::new(0.0, 0.0, 0.0, 1.0)), Pose::new(0.0, 0.0, 1.0, 0.0)));
    }

    #[test]
    fn the_heading_offset_turns_the_direction_of_flight() {
        let p = Vector::<4>::new(1.0, 1.0, 1.0, FRAC_PI_2);
        let s = Kinematic.step(&Pose::zeros(), &Sticks::new(0.0, 1.0, 0.0, 0.0), &p, 1.0);
        assert!((s - Pose::new(0.0, 1.0, 0.0, 0.0)).norm() < 1e-12, "{s}");
    }
}
