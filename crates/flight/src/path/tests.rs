use std::f64::consts::{FRAC_PI_2, PI, SQRT_2, TAU};

use horizon_model::check::maximum;
use horizon_model::rows::{Pose, pose};

use super::*;

fn at(x: f64, y: f64, z: f64, theta: f64) -> Pose {
    Pose::new(x, y, z, theta)
}

/// Curves of every kind, level and climbing.
fn curves() -> Vec<(&'static str, Path)> {
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
            let way_m = arcs_m[1] - arcs_m[0];
            // A spline's points are as dense only on average.
            assert!(chord_m > 0.0 && chord_m < 2.0 * SPACING_M, "{name}: {chord_m} m");
            // 1e-12: ways are differences of sums.
            assert!((-1e-12..1e-3 * chord_m).contains(&(way_m - chord_m)), "{name}: {way_m} m");
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
        assert!((distances_m.fold(f64::INFINITY, f64::min) - passing_m).abs() < 1e-9);
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
fn a_spline_passes_its_waypoints_with_continuous_curvature() {
    for (name, path) in curves() {
        if !name.ends_with("spline") {
            continue;
        }
        for triple in path.points.windows(3) {
            let jump = (triple[2].curvature - triple[0].curvature).abs();
            // Curvature changes by less than 20 / m^2 along these curves.
            assert!(jump < 20.0 * 2.0 * SPACING_M, "{name}: jump by {jump}");
        }
        let end = &path.points[path.points.len() - 1];
        let begin = &path.points[0];
        if name == "closed spline" {
            assert!((begin.pos_w - end.pos_w).norm() < 1e-12);
            assert!((begin.tangent_w - end.tangent_w).norm() < 1e-9);
            assert!((begin.curvature - end.curvature).abs() < 1e-9);
            assert!(
                (path.points[path.marks[2]].pos_w - Vector3::new(1.5, 1.5, 1.0)).norm() < 1e-12
            );
        } else {
            assert!(maximum(begin.curvature, end.curvature) < 1e-9, "{name}");
        }
    }
}

#[test]
fn a_spline_through_a_parabolic_arc_is_the_known_one() {
    // Natural spline through (-1, 0), (0, 1), (1, 0): its second derivative at 0 is -3 / h^2 with the
    // knots at -h, 0, h, by hand.
    let path =
        spline(&[at(-1.0, 0.0, 0.0, 0.0), at(0.0, 1.0, 0.0, 0.0), at(1.0, 0.0, 0.0, 0.0)], false);
    let top = &path.points[path.marks[1]];
    // The derivative by the chord is (1 / h, 0) there, so that the curvature is 3.
    assert!((top.curvature - 3.0).abs() < 1e-9, "{}", top.curvature);
}

#[test]
fn a_fixed_heading_turns_the_short_way_in_proportion_to_the_way() {
    let path =
        rounded(&[at(0.0, 0.0, 1.0, 0.0), at(2.0, 0.0, 1.0, 0.0), at(2.0, 1.0, 1.0, 0.0)], 0.1);
    let headings = path.headings(Heading::Fixed, &[3.0, -3.0, 2.0]);
    assert_eq!(headings.len(), path.points.len());
    let [first, second, third] = [0, 1, 2].map(|k| headings[path.marks[k]]);
    assert!((first - 3.0).abs() < 1e-12 && (second - (TAU - 3.0)).abs() < 1e-12, "{second}");
    assert!((third - 2.0).abs() < 1e-12, "{third}");
    let half = path.arcs_m.partition_point(|arc_m| *arc_m < 0.5 * path.arcs_m[path.marks[1]]);
    assert!((headings[half] - PI).abs() < 2e-3, "{}", headings[half]);
}

#[test]
fn a_heading_along_the_path_is_its_direction_and_never_jumps_by_a_turn() {
    let path = circle(Vector3::zeros(), 1.0, 0.0, 2.0);
    let headings = path.headings(Heading::Along, &[0.0, 0.0]);
    assert!((headings[0] - FRAC_PI_2).abs() < 1e-12);
    assert!((headings[headings.len() - 1] - FRAC_PI_2 - 2.0 * TAU).abs() < 1e-9);
    // Straight up has no direction: the one before it goes on, or the one after it comes early.
    let up = [at(0.0, 0.0, 1.0, 0.0), at(0.0, 0.0, 2.0, 0.0), at(0.0, -1.0, 2.0, 0.0)];
    for heading in rounded(&up, 0.0).headings(Heading::Along, &[1.0; 3]) {
        assert!((heading + FRAC_PI_2).abs() < 1e-12, "{heading}");
    }
    for heading in rounded(&up[..2], 0.0).headings(Heading::Along, &[1.0; 2]) {
        assert!((heading - 1.0).abs() < 1e-12, "{heading}");
    }
}

#[test]
fn each_limit_bounds_the_speed_and_the_time_is_that_of_the_closed_form() {
    let limits = Limits {
        speed_mps: 1.0,
        accel_mps2: 0.5,
        speed_up_mps2: 0.5,
        climb_mps: 0.3,
        turn_radps: 0.4,
    };
    let duration_s = |path: &Path, heading, thetas: &[f64]| {
        path.timed(&path.headings(heading, thetas), &limits).end_s()
    };
    let line = |to: Pose| rounded(&[Pose::zeros(), to], 0.0);
    for (path, heading, thetas, cruise_mps, length_m) in [
        (line(at(5.0, 0.0, 0.0, 0.0)), Heading::Fixed, [0.0, 0.0], 1.0, 5.0),
        (line(at(0.0, 0.0, 2.0, 0.0)), Heading::Fixed, [0.0, 0.0], 0.3, 2.0),
        (line(at(3.0, 0.0, 4.0, 0.0)), Heading::Along, [0.0, 0.0], 0.3 / 0.8, 5.0),
        (line(at(5.0, 0.0, 0.0, 0.0)), Heading::Fixed, [0.0, 3.0], 0.4 * 5.0 / 3.0, 5.0),
        (circle(Vector3::zeros(), 2.0, 0.0, 1.0), Heading::Along, [0.0, 0.0], 0.8, 2.0 * TAU),
    ] {
        let expected_s = length_m / cruise_mps + cruise_mps / limits.accel_mps2;
        let gap_s = duration_s(&path, heading, &thetas) - expected_s;
        // Up to one interval of 5 mm at each end of the cruise is flown a little slower; on the
        // circle the start divides its acceleration with the curve.
        assert!((-1e-6..0.03).contains(&gap_s), "{gap_s} s more than {expected_s} s");
    }
}

#[test]
fn a_curve_takes_its_part_of_the_acceleration() {
    let limits = Limits {
        speed_mps: 10.0,
        accel_mps2: 0.8,
        speed_up_mps2: 0.8,
        climb_mps: 1.0,
        turn_radps: 10.0,
    };
    for (name, path) in curves() {
        let trajectory = path.timed(&path.headings(Heading::Along, &[0.0]), &limits);
        let mut largest = 0.0_f64;
        for step in 0..20_000 {
            let at_s = trajectory.end_s() * f64::from(step) / 20_000.0;
            largest = maximum(largest, trajectory.at(at_s).accel_w().norm());
        }
        // 1.02: speeds are limited at points and half way between them.
        assert!((0.79..0.8 * 1.02).contains(&largest), "{name}: {largest} m/s^2");
    }
}

#[test]
fn a_jump_of_the_heading_is_turned_nearly_on_the_spot() {
    let limits = Limits {
        speed_mps: 1.0,
        accel_mps2: 1.0,
        speed_up_mps2: 1.0,
        climb_mps: 1.0,
        turn_radps: 1.0,
    };
    let there_and_back = [at(0.0, 0.0, 1.0, 0.0), at(1.0, 0.0, 1.0, 0.0), at(0.0, 0.0, 1.0, 0.0)];
    let path = rounded(&there_and_back, 0.1);
    let duration_s = path.timed(&path.headings(Heading::Along, &[0.0; 3]), &limits).end_s();
    // Two sides of 2 s, and pi at a mean of half the rate, since it begins from rest.
    assert!((duration_s - 4.0 - TAU).abs() < 0.1, "{duration_s} s");
}

#[test]
fn speed_may_rise_faster_than_it_falls() {
    let ends = [Pose::new(0.0, 0.0, 1.0, 0.0), Pose::new(3.0, 0.0, 1.0, 0.0)];
    let path = rounded(&ends, 0.0);
    let limits = Limits {
        speed_mps: 10.0,
        accel_mps2: 0.5,
        speed_up_mps2: 1.0,
        climb_mps: 1.0,
        turn_radps: 1.0,
    };
    // v^2 = 2 a s up to the place where both meet: a third of the way at 1 m/s^2, two thirds at 0.5 m/s^2.
    let trajectory = path.timed(&vec![0.0; path.points.len()], &limits);
    let speed_mps = 2.0_f64.sqrt();
    let duration_s = speed_mps / 1.0 + speed_mps / 0.5;
    assert!((trajectory.end_s() - duration_s).abs() < 0.02, "{} s", trajectory.end_s());
    let fastest = trajectory.nodes().iter().map(|node| node.vel_w().norm()).fold(0.0, maximum);
    assert!((fastest - speed_mps).abs() < 0.01, "{fastest} m/s");
}
