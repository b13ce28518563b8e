//! The ways of poses, drone and inputs, which count before the drone's axes are known.

use std::f64::consts::FRAC_PI_2;

use horizon_model::rows::Sticks;

use super::*;

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
            (ways.drone[0].way_m.norm(), integral_m(|_| 0.9, 15.0, count)),
            (ways.drone[1].way_m.norm(), integral_m(|_| 0.3, 15.0, count)),
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
        let drone = |kind: usize| DroneWay {
            way_m: Complex::from(ways_m[kind]),
            difference_m: speeds_m[kind],
            ..DroneWay::default()
        };
        let (poses_m, inputs_m) = (Complex::from(poses_m), Complex::from(inputs_m));
        Ways { poses_m, inputs_m, drone: [drone(0), drone(1)], ..Ways::default() }.difference_m()
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
