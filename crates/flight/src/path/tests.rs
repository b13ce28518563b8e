use std::f64::consts::{SQRT_2, TAU};

use horizon_model::rows::Pose;

use super::*;

pub(super) fn at(x: f64, y: f64, z: f64, theta: f64) -> Pose {
    Pose::new(x, y, z, theta)
}

/// Curves of every kind, level and climbing.
pub(super) fn curves() -> Vec<(&'static str, Path)> {
    let square = [[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5], [0.0, 0.0]];
    let level = square.map(|[x, y]| at(x, y, 1.0, 0.0));
    let climbing = [at(0.0, 0.0, 1.0, 0.0), at(1.0, 0.2, 1.6, 1.0), at(1.2, 1.5, 1.4, -2.0)];
    vec![
        ("square", rounded(&level, 0.1)),
        ("short sides", rounded(&level, 2.0)),
        ("climbing sides", rounded(&climbing, 0.1)),
        ("open spline", spline(&climbing, false)),
        ("closed spline", spline(&level[..4], true)),
        ("left circle", circle(Vector3::new(1.0, 2.0, 3.0), 0.7, 1.0, 1.25)),
        ("right circle", circle(Vector3::new(1.0, 2.0, 3.0), 0.7, 1.0, -0.5)),
    ]
}

#[test]
fn directions_and_curvatures_meet_their_numeric_twins() {
    for (name, path) in curves() {
        for triple in path.points.windows(3) {
            let [before, point, after] = triple else { continue };
            let chord_w = after.pos_w - before.pos_w;
            // Second order in the spacing; at the joint of a line and a curve first order.
            let gap = (chord_w.normalize() - point.tangent_w).norm();
            assert!(gap < 0.012 * point.curvature.max(0.1), "{name}: direction off by {gap}");
            let turn_w = after.tangent_w - before.tangent_w;
            let curvature = turn_w.norm() / chord_w.norm();
            let is_joint = (before.curvature - after.curvature).abs() > 0.3 * point.curvature;
            let gap = (curvature - point.curvature).abs();
            assert!(is_joint || gap < 0.01 * point.curvature.max(0.1), "{name}: {curvature}");
            assert!((point.tangent_w.norm() - 1.0).abs() < 1e-12 && !point.is_sharp, "{name}");
        }
    }
}

#[test]
fn points_lie_as_dense_as_documented_and_the_arc_is_their_distance() {
    for (name, path) in curves() {
        for (pair, arcs_m) in path.points.windows(2).zip(path.arcs_m.windows(2)) {
            let chord_m = (pair[1].pos_w - pair[0].pos_w).norm();
            let length_m = arcs_m[1] - arcs_m[0];
            // A spline's points are as dense only on average.
            assert!(chord_m > 0.0 && chord_m < 2.0 * SPACING_M, "{name}: {chord_m} m");
            // 1e-12: ways are differences of sums.
            assert!(
                (-1e-12..1e-3 * chord_m).contains(&(length_m - chord_m)),
                "{name}: {length_m} m"
            );
        }
    }
}

#[test]
fn lengths_are_those_of_the_closed_forms() {
    let length_m = |path: &Path| path.arcs_m[path.arcs_m.len() - 1];
    let path = circle(Vector3::zeros(), 0.7, 1.0, -1.25);
    assert!((length_m(&path) - 1.25 * TAU * 0.7).abs() < 1e-6, "{} m", length_m(&path));
    // A parabola that takes T of both sides of a right angle is T (1 + asinh(1) / sqrt(2)) long.
    let path =
        rounded(&[at(0.0, 0.0, 1.0, 0.0), at(1.0, 0.0, 1.0, 0.0), at(1.0, 1.0, 1.0, 0.0)], 0.1);
    let blend_m = 0.2 * SQRT_2;
    let expected_m = 2.0 - 2.0 * blend_m + blend_m * (1.0 + 1.0_f64.asinh() / SQRT_2);
    assert!((length_m(&path) - expected_m).abs() < 1e-6, "{} m, not {expected_m}", length_m(&path));
}
