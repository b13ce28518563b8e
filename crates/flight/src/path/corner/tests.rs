use std::f64::consts::{FRAC_PI_2, SQRT_2};

use horizon_model::check::minimum;
use horizon_model::rows::{Pose, pose};

use super::super::tests::{at, curves};
use super::super::*;
use super::*;

#[test]
fn a_rounded_corner_passes_its_waypoint_at_the_distance_asked_for() {
    for turn in [0.3, FRAC_PI_2, 2.5, -1.0] {
        let corner = at(2.0, 0.0, 1.0, 0.0);
        let end = corner + 3.0 * Pose::new(f64::cos(turn), f64::sin(turn), 0.0, 0.0);
        let path = rounded(&[at(-1.0, 0.0, 1.0, 0.0), corner, end], 0.1);
        let corner_w: Vector3<f64> = corner.fixed_rows::<3>(pose::X).into();
        let distances_m = path.points.iter().map(|point| (point.pos_w - corner_w).norm());
        let passing_m = (path.points[path.marks[1]].pos_w - corner_w).norm();
        assert!((passing_m - 0.1).abs() < 1e-9, "{passing_m} m for a turn by {turn}");
        assert!((distances_m.fold(f64::INFINITY, minimum) - passing_m).abs() < 1e-9);
    }
}

#[test]
fn a_short_side_bounds_the_rounding_and_blends_may_touch() {
    let (_, path) = curves().swap_remove(1);
    // Half sides of 0.75 m: the middle of the parabola is 0.75 sqrt(2) / 4 from the waypoint.
    let passing_m = (path.points[path.marks[2]].pos_w - Vector3::new(1.5, 1.5, 1.0)).norm();
    assert!((passing_m - 0.75 * SQRT_2 / 4.0).abs() < 1e-9, "{passing_m} m");
}

#[test]
fn a_reversal_and_an_unrounded_corner_are_sharp_but_a_straight_waypoint_is_not() {
    let sharp = |waypoints: &[Pose], corner_m| {
        let path = rounded(waypoints, corner_m);
        path.marks.iter().map(|mark| path.points[*mark].is_sharp).collect::<Vec<bool>>()
    };
    let [a, b, c] = [0.0, 1.0, 2.0].map(|x| at(x, 0.0, 1.0, 0.0));
    assert_eq!(sharp(&[a, b, c], 0.1), [false; 3]);
    assert_eq!(sharp(&[a, c, b], 0.1), [false, true, false]);
    assert_eq!(sharp(&[a, b, at(1.0, 1.0, 1.0, 0.0)], 0.0), [false, true, false]);
    let path = spline(&[a, c, a], false);
    assert!(path.points[path.marks[1]].is_sharp);
}

#[test]
fn a_turn_just_short_of_a_reversal_is_rounded_and_a_tiny_blend_is_not() {
    let turned = |cos: f64| Vector3::new(cos, (1.0 - cos * cos).sqrt(), 0.0);
    let blend_m = |cos: f64, corner_m: f64| blend(Vector3::x(), turned(cos), corner_m);
    assert!(blend_m(REVERSAL_COS + 1e-6, 0.1) > 0.2 && blend_m(REVERSAL_COS - 1e-6, 0.1) == 0.0);
    // A right angle: T = 2 corner / sin(45 degrees).
    let corner_m = 0.25 * SQRT_2 * BLEND_MIN_M;
    assert!(blend_m(0.0, 1.001 * corner_m) > BLEND_MIN_M && blend_m(0.0, 0.999 * corner_m) == 0.0);
    assert!(blend_m(1.0, 0.1) == 0.0, "no turn");
}

#[test]
fn a_line_of_less_than_the_shortest_blend_adds_nothing() {
    let start =
        Point { pos_w: Vector3::zeros(), tangent_w: Vector3::x(), curvature: 0.0, is_sharp: false };
    for (x_m, count) in [(0.999 * BLEND_MIN_M, 1), (1.001 * BLEND_MIN_M, 3), (0.02, 5)] {
        let mut points = vec![start];
        line_to(&mut points, Vector3::new(x_m, 0.0, 0.0), Vector3::x());
        assert_eq!(points.len(), count, "{x_m} m");
    }
}
