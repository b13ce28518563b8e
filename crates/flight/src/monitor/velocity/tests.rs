//! The ways of poses, drone and inputs, which count before the drone's axes are known.

use std::f64::consts::FRAC_PI_2;

use horizon_model::rows::Sticks;

use super::*;
use crate::monitor::DroneMotion;

const DT_S: f64 = 0.02;

/// Poses, drone and inputs at constant velocities for `count` ticks. m/s
fn ways(poses: f64, [fixed, turning]: [f64; 2], asked: f64, count: u32) -> Ways {
    let mut ways = Ways::default();
    let along = |v_mps: f64| Complex::new(0.6 * v_mps, -0.8 * v_mps);
    let seen = [along(fixed), Complex::default(), along(turning), Complex::default()];
    for _ in 0..count {
        ways.add(along(poses) * DT_S, &seen, along(asked), DT_S);
    }
    ways
}

/// Integral of a velocity over `count` ticks, each part of which is forgotten within `forget_s`. m
fn integral_m(v_mps: impl Fn(u32) -> f64, forget_s: f64, count: u32) -> f64 {
    (1..=count).map(|k| v_mps(k) * DT_S * (-f64::from(count - k) * DT_S / forget_s).exp()).sum()
}

/// What a low-pass filter has taken over after `k` ticks. 1
fn step(k: u32, tau_s: f64) -> f64 {
    1.0 - (-f64::from(k) * DT_S / tau_s).exp()
}

#[test]
fn ways_are_integrals_over_the_last_15_s() {
    for count in [1, 10, 100, 500] {
        let ways = ways(0.5, [0.9, 0.3], 1.2, count);
        for (got_m, expected_m) in [
            (ways.poses_m.norm(), integral_m(|_| 0.5, 15.0, count)),
            (ways.flown_m[FIXED].norm(), integral_m(|_| 0.9, 15.0, count)),
            (ways.flown_m[TURNING].norm(), integral_m(|_| 0.3, 15.0, count)),
            // The vehicle follows its inputs with a lag of 0.6 s.
            (ways.inputs_m.norm(), integral_m(|k| 1.2 * step(k, 0.6), 15.0, count)),
        ] {
            assert!((got_m - expected_m).abs() < 1e-9, "{count}: {got_m}, {expected_m} m");
        }
    }
}

#[test]
fn speeds_differ_beyond_a_quarter_of_the_larger_one_and_0_1_mps() {
    for (poses, drone) in [(0.5, 0.9), (0.9, 0.5), (0.0, 0.09), (0.15, 0.0), (1.0, 0.76)] {
        let excess_mps = |k: u32| {
            let (slow, fast) = (f64::min(poses, drone), f64::max(poses, drone));
            let seen = step(k, 0.4);
            ((fast - slow) * seen - (0.25 * fast * seen).max(0.1)).max(0.0)
        };
        let expected_m = integral_m(excess_mps, 4.0, 200);
        for got in ways(poses, [drone; 2], 0.0, 200).drone {
            let got_m = got.difference_m;
            assert!((got_m - expected_m).abs() < 1e-9, "{got_m}, {expected_m} m");
        }
    }
}

#[test]
fn ways_differ_if_drone_and_inputs_agree_in_both_kinds_of_axes() {
    let difference_m = |poses_m: f64, ways_m: [f64; 2], inputs_m: f64, speeds_m: [f64; 2]| {
        let drone =
            speeds_m.map(|difference_m| DroneSpeed { difference_m, ..DroneSpeed::default() });
        let (poses_m, inputs_m) = (Complex::from(poses_m), Complex::from(inputs_m));
        let mut ways = Ways { poses_m, drone, inputs_m, ..Ways::default() };
        (ways.flown_m[FIXED], ways.flown_m[TURNING]) = (ways_m[0].into(), ways_m[1].into());
        ways.difference_m()
    };
    let none = [0.0; 2];
    assert_eq!(difference_m(4.0, [2.0, 2.0], 2.0, none), Some(1.5));
    assert_eq!(difference_m(0.0, [2.0, 2.0], 2.0, none), Some(1.5));
    assert_eq!(difference_m(4.0, [2.0, 1.0], 2.0, none), Some(1.5), "the least");
    assert_eq!(difference_m(4.0, [2.0, 2.0], 2.0, [3.0, 2.0]), Some(2.0), "by the speeds");
    assert_eq!(difference_m(4.0, [2.0, 0.5], 1.0, none), None, "too short a way");
    assert_eq!(difference_m(4.0, [0.5, 2.0], 1.0, none), None, "too short a way");
    assert_eq!(difference_m(1.0, [0.6, 0.6], 0.6, none), Some(0.4 - 0.15));
    assert_eq!(difference_m(4.0, [2.0, 2.0], 0.5, none), None, "4 times that of the inputs");
    assert_eq!(difference_m(0.0, [1.0, 1.0], 4.0, none), None, "a quarter of it");
}

#[test]
fn directions_differ_beyond_the_turn_of_the_vehicles_own_axes() {
    let difference_m = |length_m: f64, turn_rad: f64, inputs_m: f64| {
        let way_m = Complex::from_polar(length_m, turn_rad);
        let inputs_m = Complex::from_polar(inputs_m, turn_rad);
        Ways { poses_m: Complex::new(1.2, 0.0), inputs_m, ..Ways::default() }
            .vector_difference_m(way_m)
    };
    for (length_m, turn_rad, expected_m) in [
        (1.0, 0.0, 0.2 - 0.25),
        (1.0, TURN, 0.2 - 0.25),
        (1.0, -TURN, 0.2 - 0.25),
        (1.2, TURN + FRAC_PI_2, 1.2 * 2.0_f64.sqrt() - 0.3),
        (1.2, -TURN - FRAC_PI_2, 1.2 * 2.0_f64.sqrt() - 0.3),
        (0.0, 0.0, 1.2),
    ] {
        let got_m = difference_m(length_m, turn_rad, length_m).unwrap();
        assert!((got_m - expected_m).abs() < 1e-12, "{length_m} m, {turn_rad} rad: {got_m} m");
    }
    for (inputs_m, is_witness) in [(-0.01, false), (0.01, true), (0.79, true), (0.81, false)] {
        let found = difference_m(0.6, 0.0, inputs_m).is_some();
        assert_eq!(found, is_witness, "drone at 0.6 m, poses at 1.2 m, inputs at {inputs_m} m");
    }
}

/// The monitor after inputs that sway along x in the world frame while the drone follows them in its axes, which
/// are turned by `turn_rad`, and the poses move at a constant velocity. m/s
fn swaying(turn_rad: f64, poses_mps: f64, count: u32) -> VelocityMonitor {
    let mut monitor = VelocityMonitor::new(0.6, DT_S);
    let mut v_mps = 0.0;
    for k in 0..count {
        let t_s = f64::from(k) * DT_S;
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = if t_s.rem_euclid(4.0) < 2.0 { -0.5 } else { 0.3 };
        let pose = Some(Pose::new(poses_mps * t_s, 0.0, 1.0, 0.0));
        let by_drone = Complex::from_polar(1.0, turn_rad) * v_mps;
        let drone = DroneMotion {
            horizontal_mps: Some([by_drone.re, by_drone.im]),
            height_m: None,
            heading_rad: None,
        };
        let sample = Sample { pose, drone: Some(drone), u_applied, link_is_up: true };
        monitor.update(&sample);
        let asked_mps = asked(&sample, pose).re;
        v_mps += (asked_mps - v_mps) * (1.0 - decay(DT_S));
    }
    monitor
}

#[test]
fn drone_and_inputs_that_agree_show_the_way_that_the_poses_deny() {
    for turn_rad in [0.0, 1.0, -2.5] {
        let monitor = swaying(turn_rad, 0.1, 180);
        let way_m = monitor.ways.inputs_m.re;
        let poses_m = monitor.ways.poses_m.re;
        assert!(way_m < -0.5 && poses_m > 0.15, "{way_m}, {poses_m} m");
        // The drone's report is a period late.
        let (square_m2, product_m2) = (poses_m.powi(2) + way_m.powi(2), poses_m * way_m);
        let expected_m = (square_m2 - 2.0 * product_m2 * TURN.cos()).sqrt() + TOLERANCE * way_m;
        let got_m = monitor.difference_m().unwrap();
        assert!((got_m - expected_m).abs() < 0.03, "{turn_rad} rad: {got_m}, {expected_m} m");
    }
    let early = swaying(0.0, 0.1, 30);
    assert!(early.sums_by_inputs.variance(FIXED) < MOTION_MIN);
    assert_eq!(early.difference_m(), None, "too little motion shows no axes");
}

#[test]
fn inputs_and_reports_are_turned_by_the_heading() {
    let mut u_applied = Sticks::zeros();
    (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (0.5, 0.2);
    let sample = Sample { pose: None, drone: None, u_applied, link_is_up: true };
    let close = |a: Complex<f64>, b: Complex<f64>| (a - b).norm() < 1e-12;
    // Forward is x and right is -y, at a heading of zero.
    assert!(close(asked(&sample, None), Complex::new(1.9 * 0.43, -1.9 * 0.13)));
    let left = Some(Pose::new(0.0, 0.0, 1.0, FRAC_PI_2));
    assert!(close(asked(&sample, left), Complex::new(1.9 * 0.13, 1.9 * 0.43)));
    let seen = frames(Complex::new(0.3, 0.1), left);
    let expected = [(0.3, 0.1), (0.3, -0.1), (-0.1, 0.3), (0.1, 0.3)];
    for (seen, (x, y)) in seen.into_iter().zip(expected) {
        assert!(close(seen, Complex::new(x, y)), "{seen}");
    }
}
