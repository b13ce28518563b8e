//! The direction of the motion beside that of the inputs.

use horizon_model::check::maximum;
use nalgebra::Complex;

use super::*;

#[test]
fn a_dead_time_that_is_wrong_does_not_look_like_a_turn() {
    // To and fro, then sideways, as the vehicle flies it with a lag of 0.6 s, `late_s` after it is expected.
    let pitch = |t_s: f64| 0.4 * (1.6 * t_s).sin();
    let roll = |t_s: f64| 0.4 * (2.3 * t_s + 1.0).cos();
    for (late_s, turn_rad, is_wrong) in [
        (0.0, 0.0, false),
        (0.3, 0.0, false),
        (-0.3, 0.0, false),
        (0.3, FRAC_PI_2, true),
        (-0.3, PI, true),
    ] {
        let mut direction = DirectionMonitor::new(0.785, DT_S);
        let (mut at, mut v_w) = (Pose::zeros(), [0.0; 2]);
        let mut found = false;
        for k in 0..500_u32 {
            let t_s = f64::from(k) * DT_S;
            let (forward, left) = (1.9 * pitch(t_s - late_s), -1.9 * roll(t_s - late_s));
            let (sin, cos) = f64::sin_cos(turn_rad);
            let asked_w = [cos * forward - sin * left, sin * forward + cos * left];
            for (v, asked) in v_w.iter_mut().zip(asked_w) {
                *v += (asked - *v) * DT_S / 0.6;
            }
            at += Pose::new(v_w[0], v_w[1], 0.0, 0.0) * DT_S;
            let mut u_applied = Sticks::zeros();
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (pitch(t_s), roll(t_s));
            let sample = Sample { pose: Some(at), drone: None, u_applied, link_is_up: true };
            found |= direction.update(&sample).1;
        }
        assert_eq!(found, is_wrong, "{late_s} s, {turn_rad} rad");
    }
}

#[test]
fn a_heading_that_is_wrong_is_found_in_the_first_motion() {
    for (turn_rad, is_wrong) in [
        (0.0, false),
        (0.6, false),
        (-0.6, false),
        (FRAC_PI_2, true),
        (-FRAC_PI_2, true),
        (PI, true),
    ] {
        let mut flight = Flight::new();
        let wrong = Wrong { turn_rad, ..RIGHT };
        let steps = (1..=100).map(|_| flight.fly(DT_S, &wrong).is_direction_wrong);
        let found = steps.take_while(|is_wrong| !is_wrong).count();
        println!("{turn_rad} rad: {found} steps");
        assert_eq!(found < 100, is_wrong, "{turn_rad} rad, {found} steps");
        let findings = flight.fly(3.0, &wrong);
        let error_rad = findings.direction_error_rad.unwrap();
        let gap_rad = horizon_model::angle::wrap(error_rad - turn_rad).abs();
        assert!(gap_rad < 0.15, "{turn_rad} rad: {error_rad}");
    }
}

#[test]
fn wind_that_the_inputs_work_against_does_not_turn_the_heading() {
    // The inputs lean against 1.5 m/s from the front while the vehicle is carried slowly backwards and forwards.
    let mut direction = DirectionMonitor::new(0.785, DT_S);
    let mut at = Pose::zeros();
    let mut v_mps = 0.0;
    let mut worst_rad = 0.0_f64;
    for k in 0..1000_u32 {
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = 0.8 + 0.3 * (f64::from(k) * DT_S * 1.5).sin();
        v_mps += (1.9 * u_applied[stick::PITCH] - v_mps) * (1.0 - (-DT_S / 0.6).exp());
        at[pose::X] += (v_mps - 1.9) * DT_S;
        let sample = Sample { pose: Some(at), drone: None, u_applied, link_is_up: true };
        let (error_rad, is_wrong) = direction.update(&sample);
        worst_rad = maximum(worst_rad, error_rad.unwrap_or(0.0).abs());
        assert!(!is_wrong, "step {k}: {error_rad:?}");
    }
    assert!(worst_rad < 0.3, "{worst_rad} rad");
}

#[test]
fn an_outage_is_left_out_of_the_direction() {
    let mut direction = DirectionMonitor::new(0.785, DT_S);
    let mut u_applied = Sticks::zeros();
    u_applied[stick::PITCH] = 0.5;
    for k in 0..200_u32 {
        let pose = Some(Pose::new(-0.6 * f64::from(k) * DT_S, 0.0, 1.0, 0.0));
        let sample = Sample { pose, drone: None, u_applied, link_is_up: false };
        assert_eq!(direction.update(&sample), (None, false));
    }
}

#[test]
fn a_velocity_from_before_an_outage_does_not_turn_the_heading_after_it() {
    // It flies ahead while the outage is declared. From its end on a controller flies it around a corner: brakes,
    // to the left, and after the next corner back.
    let inputs = [(2.5, 0.5, 0.0), (3.0, -0.5, 0.8), (4.1, 0.0, 0.5), (4.7, -0.8, -0.5)];
    for (turn_rad, is_wrong) in [(0.0, false), (0.3, false), (FRAC_PI_2, true), (PI, true)] {
        let mut direction = DirectionMonitor::new(0.785, DT_S);
        let (mut at, mut v_w) = (Pose::zeros(), Complex::<f64>::default());
        let (mut u_applied, mut found_s) = (Sticks::zeros(), None);
        for k in 0..300_u32 {
            let t_s = f64::from(k) * DT_S;
            let next = inputs.iter().find(|(until_s, ..)| t_s < *until_s);
            let (ahead, left) = next.map_or((-0.5, 0.0), |(_, ahead, left)| (*ahead, *left));
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (ahead, -left);
            let asked_w = 1.9 * Complex::new(ahead, left) * Complex::from_polar(1.0, turn_rad);
            v_w += (asked_w - v_w) * DT_S / 0.6;
            at += Pose::new(v_w.re, v_w.im, 0.0, 0.0) * DT_S;
            let link_is_up = t_s > 2.5;
            let sample = Sample { pose: Some(at), drone: None, u_applied, link_is_up };
            let (error_rad, is_found) = direction.update(&sample);
            if is_found {
                found_s = found_s.or(Some(t_s - 2.5));
            }
            if let Some(error_rad) = error_rad {
                let gap_rad = horizon_model::angle::wrap(error_rad - turn_rad).abs();
                assert!(gap_rad < 0.1, "{turn_rad} rad: {error_rad} after {t_s} s");
            }
        }
        println!("{turn_rad} rad: {found_s:?} s");
        assert_eq!(found_s.is_some(), is_wrong, "{turn_rad} rad: {found_s:?}");
        assert!(found_s.is_none_or(|found_s| found_s < 2.6), "{turn_rad} rad: {found_s:?}");
    }
}
