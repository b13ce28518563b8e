//! The parts of a step one by one: the whole is tested in `lagged/tests.rs`.

use nalgebra::{Matrix2, Vector1};

use super::*;
use crate::check::jacobian_gap;
use crate::vehicles::rows::pose;

const DT_S: f64 = 0.02;

/// Near the corner of the limit and of the dead zones.
fn terms_of(u: &Sticks, v_mps: [f64; 2]) -> Terms {
    let p = Parameter::from([1.9, 0.89, 1.4, -0.06, 0.64, 0.25, 0.12, 0.07, 0.12, 0.08, 1.1]);
    let mut s = Motion::zeros();
    (s[motion::THETA], s[motion::V_X], s[motion::V_Y]) = (2.0, v_mps[0], v_mps[1]);
    Terms::new(&Lagged::default(), &s, u, &p, DT_S)
}

pub(super) fn all() -> impl Iterator<Item = Terms> {
    let sticks =
        [Sticks::zeros(), Sticks::new(0.3, -0.2, 0.1, 0.4), Sticks::new(1.0, 0.07, 0.0, 0.0)];
    let velocities = [[0.0, 0.0], [0.4, -0.3], [-0.8, 1.1]];
    sticks.into_iter().flat_map(move |u| velocities.map(|v_mps| terms_of(&u, v_mps)))
}

/// The change after the limit, of a change `e` before it.
fn limited_change(terms: &Terms, e: &Vector2<f64>) -> Vector2<f64> {
    limit(e.norm_squared() * terms.per_limit2, LIMIT_WIDTH).factor * e
}

pub(super) const LIMIT_WIDTH: f64 = 0.1;

#[test]
fn the_limited_change_meets_its_numeric_twin() {
    for terms in all() {
        let e = terms.change_w_mps;
        let exact = Matrix2::from_columns(&[
            terms.limited_derivative(Vector2::x()),
            terms.limited_derivative(Vector2::y()),
        ]);
        // The limit is 0.022 m/s: third derivatives are of order 1e4, 1e-6 of them is left.
        let gap = jacobian_gap(|e| limited_change(&terms, e), &e, &exact);
        assert!(gap < 1e-6, "gap {gap:e} at {e}");
    }
}

#[test]
fn a_quarter_turn_is_the_derivative_of_a_direction_by_the_heading() {
    for psi in [-2.0, 0.0, 1.0, 3.0] {
        let direction = |x: &Vector1<f64>| world_from_sticks(x[0].sin_cos(), 0.8, -0.3);
        let x = Vector1::new(psi);
        let gap = jacobian_gap(direction, &x, &quarter_turn(direction(&x)));
        assert!(gap < 1e-9, "gap {gap:e} at {psi}");
    }
    // To the right of +x is -y.
    assert_eq!(world_from_sticks((0.0, 1.0), 0.0, 1.0), Vector2::new(0.0, -1.0));
}

#[test]
fn the_pose_moves_with_velocity_and_disturbance_of_its_axis() {
    let s = Motion::from_fn(|row, _| f64::from(1_u32 << row));
    let mut moved = s;
    integrate(&mut moved, 0.5);
    let change = moved - s;
    for (at, velocities) in [
        (pose::X, s[motion::V_X] + s[motion::D_X]),
        (pose::Y, s[motion::V_Y] + s[motion::D_Y]),
        (pose::Z, s[motion::V_Z] + s[motion::D_Z]),
        (pose::THETA, s[motion::OMEGA]),
    ] {
        assert_eq!(change[at].to_bits(), (0.5 * velocities).to_bits(), "row {at}");
    }
    let from_moved = MOVED.iter().fold(Motion::zeros(), |mut sum, (at, v)| {
        sum[*at] += 0.5 * s[*v];
        sum
    });
    assert_eq!(change, from_moved);
}
