//! Second derivatives of a step of the lagged vehicle by state and input.
//!
//! Owns the horizontal part, which the acceleration limit couples, and the part of each axis alone. First derivatives:
//! `terms.rs`.

use nalgebra::{Matrix2, Vector2};

use super::{Terms, quarter_turn};
use crate::model::{HessianKind, HessianRequest, InputHessian};
use crate::vehicles::lagged::smooth::limit_second;
use crate::vehicles::lagged::{Lagged, dead_of};
use crate::vehicles::rows::{lag, motion, stick};
use crate::vehicles::world_from_sticks;
use crate::{Matrix, Vector};

impl Terms {
    /// Second derivatives of `w'` times [`Terms::next`] by state and input.
    ///
    /// `phi e`, the horizontal change, is nonlinear in `e` by its limit; `e` and the other velocities are nonlinear in
    /// heading and sticks. With `J` the derivatives of `e`, and `by_change` and `H` the first and second ones
    /// of `W' phi e` by `e`: `J' H J + by_change' e''`, and `J' |H| J` as the convex part.
    #[inline]
    pub(in crate::vehicles::lagged) fn hessian_by_input(
        &self,
        model: &Lagged,
        request: &HessianRequest<'_, { motion::COUNT }, { stick::COUNT }, { lag::COUNT }>,
    ) -> InputHessian<{ motion::COUNT }, { stick::COUNT }> {
        let HessianRequest { p, w, kind, .. } = *request;
        let w_h = Vector2::new(
            self.velocity_weight(w, motion::V_X, motion::X),
            self.velocity_weight(w, motion::V_Y, motion::Y),
        );
        let h = self.limit_curvature(w_h, model.shape.limit_width);
        let h = if kind == HessianKind::Convexified { absolute(&h) } else { h };
        let sticks = self.change_by_stick(p);
        let mut hessian = self.horizontal_hessian(&h, &sticks);
        if kind == HessianKind::Exact {
            let by_change = self.limited_derivative(w_h);
            hessian.by_state[(motion::THETA, motion::THETA)] -=
                self.lags.fraction_h.value * by_change.dot(&self.commanded_w_mps);
            for (i, by_i) in sticks {
                hessian.by_input_state[(i, motion::THETA)] += by_change.dot(&quarter_turn(by_i));
            }
            self.add_axis_hessian(&mut hessian.by_input, model, request, by_change);
        }
        hessian
    }

    /// Weight of the velocity `v`, that of the pose `at` that it moves included.
    #[inline]
    fn velocity_weight(&self, w: &Vector<{ motion::COUNT }>, v: usize, at: usize) -> f64 {
        w[v] + self.after_s * w[at]
    }

    /// `J' h J` of the horizontal change, whose derivatives by the sticks are `sticks`.
    #[inline]
    fn horizontal_hessian(
        &self,
        h: &Matrix2<f64>,
        sticks: &[(usize, Vector2<f64>); 2],
    ) -> InputHessian<{ motion::COUNT }, { stick::COUNT }> {
        let fraction = self.lags.fraction_h.value;
        let states = [
            (motion::THETA, fraction * quarter_turn(self.commanded_w_mps)),
            (motion::V_X, -fraction * Vector2::x()),
            (motion::V_Y, -fraction * Vector2::y()),
        ];
        let (mut by_state, mut by_input_state, mut by_input) =
            (Matrix::zeros(), Matrix::zeros(), Matrix::zeros());
        for (j, by_j) in states {
            let h_by_j = h * by_j;
            for (i, by_i) in &states {
                by_state[(*i, j)] = h_by_j.dot(by_i);
            }
            for (i, by_i) in sticks {
                by_input_state[(*i, j)] = h_by_j.dot(by_i);
            }
        }
        for (j, by_j) in sticks {
            let h_by_j = h * by_j;
            for (i, by_i) in sticks {
                by_input[(*i, *j)] = h_by_j.dot(by_i);
            }
        }
        InputHessian { by_state, by_input_state, by_input }
    }

    /// Adds the second derivative of each effective input by its stick, times the weight of what it drives.
    #[inline]
    fn add_axis_hessian(
        &self,
        by_input: &mut Matrix<{ stick::COUNT }, { stick::COUNT }>,
        model: &Lagged,
        request: &HessianRequest<'_, { motion::COUNT }, { stick::COUNT }, { lag::COUNT }>,
        by_change: Vector2<f64>,
    ) {
        let HessianRequest { u, p, w, .. } = *request;
        let scale = self.lags.fraction_h.value * p[lag::LAMBDA_H];
        let climb = self.velocity_weight(w, motion::V_Z, motion::Z)
            * self.lags.fraction_v.value
            * p[lag::LAMBDA_V];
        let turn = self.velocity_weight(w, motion::OMEGA, motion::THETA)
            * self.lags.fraction_a.value
            * p[lag::LAMBDA_A];
        for (i, by_value) in [
            (stick::ROLL, by_change.dot(&world_from_sticks(self.heading, 0.0, scale))),
            (stick::PITCH, by_change.dot(&world_from_sticks(self.heading, scale, 0.0))),
            (stick::YAW, turn),
            (stick::THROTTLE, climb),
        ] {
            by_input[(i, i)] += by_value * model.excess_second(u[i], p[dead_of(i)]);
        }
    }

    /// Second derivative of `W' phi e` by the change `e` before the limit.
    #[inline]
    fn limit_curvature(&self, w: Vector2<f64>, width: f64) -> Matrix2<f64> {
        let e = self.change_w_mps;
        let derivative = 2.0 * self.limit.by_ratio2 * self.per_limit2;
        let second = 4.0 * limit_second(self.ratio2, width) * self.per_limit2 * self.per_limit2;
        let crossed = derivative * w * e.transpose();
        let along = Matrix2::from_diagonal_element(derivative) + second * e * e.transpose();
        crossed + crossed.transpose() + w.dot(&e) * along
    }
}

/// The matrix with the eigenvectors of the symmetric `h` and the absolute values of its eigenvalues.
///
/// It is the root of `h^2`, for which Cayley and Hamilton have a closed form at this size. In place of `h` it
/// bounds a step along a direction of negative curvature as one along positive curvature (Dauphin et al., 2014).
#[inline]
fn absolute(h: &Matrix2<f64>) -> Matrix2<f64> {
    let (square, determinant) = (h * h, h.determinant().abs());
    let trace = (square.trace() + 2.0 * determinant).sqrt();
    if trace > 0.0 {
        (square + Matrix2::from_diagonal_element(determinant)) / trace
    } else {
        Matrix2::zeros()
    }
}

#[cfg(test)]
mod tests;
