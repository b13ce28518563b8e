use std::f64::consts::TAU;

use horizon_model::check::maximum;
use horizon_model::rows::Pose;
use nalgebra::Vector3;

use super::super::tests::{at, curves};
use super::super::*;
use super::*;

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

/// All but the acceleration, 0.5 m/s^2, lifted.
const LIMITS: Limits =
    Limits { speed_mps: 1e3, accel_mps2: 0.5, speed_up_mps2: 0.5, climb_mps: 1e3, turn_radps: 1e3 };

#[test]
fn the_square_of_the_speed_grows_with_the_way_and_no_further_than_the_curve_allows() {
    let line = rounded(&[Pose::zeros(), at(1.0, 0.0, 0.0, 0.0)], 0.0);
    let length_m = line.length_m(0);
    assert!((line.square_after(0, 0.25, 0.5) - 0.25 - length_m).abs() < 1e-12);
    // At a curvature of 2/m: at most v^2 = a / 2.
    let curve = circle(Vector3::zeros(), 0.5, 0.0, 1.0);
    let from_rest = curve.square_after(0, 0.0, 0.5);
    assert!((from_rest - 0.25 * (4.0 * curve.length_m(0)).sin()).abs() < 1e-12, "{from_rest}");
    for nearly in [0.24999, 0.25] {
        assert!((curve.square_after(0, nearly, 0.5) - 0.25).abs() < 1e-12);
    }
    assert!((curve.square_after(0, 9.0, 0.5) - 9.0).abs() < 1e-12, "faster stays as it is");
}

#[test]
fn a_path_begins_and_ends_and_turns_back_at_rest() {
    let path = rounded(&[Pose::zeros(), at(1.0, 0.0, 0.0, 0.0), Pose::zeros()], 0.0);
    let speeds_mps = path.speeds(&vec![0.0; path.points.len()], &LIMITS);
    for (i, speed_mps) in speeds_mps.iter().enumerate() {
        assert_eq!(*speed_mps == 0.0, path.marks.contains(&i), "{speed_mps} m/s at point {i}");
    }
}

#[test]
fn the_heading_between_points_never_leaves_theirs() {
    let path = rounded(&[Pose::zeros(), at(0.02, 0.0, 0.0, 0.0)], 0.0);
    let derivatives = path.heading_derivatives(&[0.0, 0.01, 0.02, 0.01, 0.01]);
    let length_m = path.length_m(0);
    let expected = [0.01, 0.01, 0.0, 0.0, 0.0].map(|change| change / length_m);
    for (found, expected) in derivatives.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{derivatives:?}");
    }
    assert_eq!(derivatives.len(), 5);
}
