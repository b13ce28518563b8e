//! Integrals, tolerances, and which drone is compared.

use std::f64::consts::FRAC_PI_2;

use super::*;

const DT_S: f64 = 0.02;

/// Poses, drone and inputs at constant velocities for `count` ticks. m/s
fn displacements(poses: f64, [fixed, turning]: [f64; 2], asked: f64, count: u32) -> Displacements {
    let mut displacements = Displacements::default();
    let along = |v_mps: f64| Complex::new(0.6 * v_mps, -0.8 * v_mps);
    let drone_d_mps = [along(fixed), Complex::default(), along(turning), Complex::default()];
    for _ in 0..count {
        displacements.add(along(poses) * DT_S, &drone_d_mps, along(asked), DT_S);
    }
    displacements
}

/// Integral of a velocity over `count` ticks, each part of which is forgotten within `forget_s`. m
fn integral_m(v_mps: impl Fn(u32) -> f64, forget_s: f64, count: u32) -> f64 {
    (1..=count).map(|k| v_mps(k) * DT_S * (-f64::from(count - k) * DT_S / forget_s).exp()).sum()
}

/// What a low-pass filter has taken over after `k` ticks. 1
fn step(k: u32, tau_s: f64) -> f64 {
    1.0 - (-f64::from(k) * DT_S / tau_s).exp()
}

/// The same within 15 s, 0.05 m/s less. m
fn shown_m(v_mps: impl Fn(u32) -> f64, count: u32) -> f64 {
    let keep = (-DT_S / 15.0).exp();
    (1..=count).fold(0.0, |sum_m: f64, k| (keep * sum_m - 0.05 * DT_S).max(0.0) + v_mps(k) * DT_S)
}

#[test]
fn displacements_are_integrals_over_the_last_15_s_less_what_the_drone_may_be_wrong_by() {
    for count in [1, 10, 100, 500] {
        let displacements = displacements(0.5, [0.9, 0.3], 1.2, count);
        for (got_m, expected_m) in [
            (displacements.poses_w_m.norm(), shown_m(|_| 0.5, count)),
            (displacements.drone_d_m[FIXED].norm(), shown_m(|_| 0.9, count)),
            (displacements.drone_d_m[TURNING].norm(), shown_m(|_| 0.3, count)),
            // The vehicle follows its inputs with a lag of 0.6 s.
            (displacements.inputs_w_m.norm(), shown_m(|k| 1.2 * step(k, 0.6), count)),
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
        for got in displacements(poses, [drone; 2], 0.0, 200).drone_speeds {
            let got_m = got.difference_m;
            assert!((got_m - expected_m).abs() < 1e-9, "{got_m}, {expected_m} m");
        }
    }
}

#[test]
fn displacements_differ_if_drone_and_inputs_agree_in_both_kinds_of_axes() {
    let difference_m = |poses_m: f64, drone_m: [f64; 2], inputs_m: f64, speeds_m: [f64; 2]| {
        let drone_speeds =
            speeds_m.map(|difference_m| DroneSpeed { difference_m, ..DroneSpeed::default() });
        let (poses_w_m, inputs_w_m) = (Complex::from(poses_m), Complex::from(inputs_m));
        let mut displacements =
            Displacements { poses_w_m, drone_speeds, inputs_w_m, ..Displacements::default() };
        (displacements.drone_d_m[FIXED], displacements.drone_d_m[TURNING]) =
            (drone_m[0].into(), drone_m[1].into());
        displacements.difference_m()
    };
    let none = [0.0; 2];
    assert_eq!(difference_m(4.0, [2.0, 2.0], 2.0, none), Some(1.5));
    assert_eq!(difference_m(0.0, [2.0, 2.0], 2.0, none), Some(1.5));
    assert_eq!(difference_m(4.0, [2.0, 1.0], 2.0, none), Some(1.5), "the least");
    assert_eq!(difference_m(4.0, [2.0, 2.0], 2.0, [3.0, 2.0]), Some(2.0), "by the speeds");
    assert_eq!(difference_m(4.0, [2.0, 0.5], 1.0, none), None, "too short");
    assert_eq!(difference_m(4.0, [0.5, 2.0], 1.0, none), None, "too short");
    assert_eq!(difference_m(1.0, [0.6, 0.6], 0.6, none), Some(0.4 - 0.15));
    assert_eq!(difference_m(4.0, [2.0, 2.0], 0.5, none), None, "4 times that of the inputs");
    assert_eq!(difference_m(0.0, [1.0, 1.0], 4.0, none), None, "a quarter of it");
}

#[test]
fn directions_differ_beyond_the_turn_of_the_vehicles_own_axes() {
    let difference_m = |length_m: f64, turn_rad: f64, inputs_m: f64| {
        let drone_w_m = Complex::from_polar(length_m, turn_rad);
        let inputs_w_m = Complex::from_polar(inputs_m, turn_rad);
        Displacements { poses_w_m: Complex::new(1.2, 0.0), inputs_w_m, ..Displacements::default() }
            .vector_difference_m(drone_w_m)
    };
    for (length_m, turn_rad, expected_m) in [
        (1.0, 0.0, 0.2 - 0.25),
        (1.0, TURN_RAD, 0.2 - 0.25),
        (1.0, -TURN_RAD, 0.2 - 0.25),
        (1.2, TURN_RAD + FRAC_PI_2, 1.2 * 2.0_f64.sqrt() - 0.3),
        (1.2, -TURN_RAD - FRAC_PI_2, 1.2 * 2.0_f64.sqrt() - 0.3),
        (0.0, 0.0, 1.2),
    ] {
        let got_m = difference_m(length_m, turn_rad, length_m).unwrap();
        assert!((got_m - expected_m).abs() < 1e-12, "{length_m} m, {turn_rad} rad: {got_m} m");
    }
    for (inputs_m, is_compared) in [(-0.01, false), (0.01, true), (0.79, true), (0.81, false)] {
        let found = difference_m(0.6, 0.0, inputs_m).is_some();
        assert_eq!(found, is_compared, "drone at 0.6 m, poses at 1.2 m, inputs at {inputs_m} m");
    }
}
