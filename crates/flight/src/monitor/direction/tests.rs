use std::f64::consts::{FRAC_PI_2, PI};

use horizon_model::rows::{Sticks, stick};

use super::*;

/// Sums over half a second whose motion is the input times `u_o`: its angle is the turn, its length the
/// correlation.
fn sums(u_o: Complex<f64>) -> Sums {
    Sums { time_s: 0.5, u_o: u_o * 0.5, u_u: 0.5, o_o: 0.5, ..Sums::default() }
}

fn monitor(limit_rad: f64, turns: [Complex<f64>; 3]) -> DirectionMonitor {
    DirectionMonitor { sums: turns.map(sums), ..DirectionMonitor::new(limit_rad, 0.02) }
}

#[test]
fn a_shift_counts_if_it_correlates_better_and_turns_less() {
    let i = Complex::i();
    let (none, half, whole) = (Complex::default(), Complex::from(0.5), Complex::from(1.0));
    for (turns, error_rad) in [
        ([i, none, none], FRAC_PI_2),
        ([i, whole, none], FRAC_PI_2),
        ([i, none, half], FRAC_PI_2),
        ([i * 0.9, whole, none], 0.0),
        ([i * 0.9, none, whole], 0.0),
        ([i * 0.9, -i, -whole], FRAC_PI_2),
        ([whole * 0.9, i, none], 0.0),
    ] {
        assert_eq!(monitor(0.8, turns).error_rad(), Some(error_rad), "{turns:?}");
    }
    assert_eq!(monitor(0.8, [none, whole, whole]).error_rad(), None, "as it is, none shows");
}

#[test]
fn a_velocity_that_decays_is_left_out_of_direction_and_correlation() {
    let (gain, before) = (Complex::from_polar(1.5, 0.5), Complex::new(-0.7, 2.0));
    let mut sums = Sums::default();
    for k in 0..200_u32 {
        let t_s = f64::from(k) * 0.02;
        let (u, y) = (Complex::new((5.0 * t_s).sin(), (3.0 * t_s).cos()), lag_decay(t_s));
        sums.add([u, gain * u + before * y], y, 0.02);
    }
    let Turn { angle_rad, correlation2 } = sums.turn(true).unwrap();
    assert!((angle_rad - 0.5).abs() < 1e-9, "{angle_rad} rad");
    assert!((correlation2 - 1.0).abs() < 1e-9, "{correlation2}");
}

#[test]
fn a_turn_is_found_with_a_source_of_4_hz_and_with_one_that_misses_frames() {
    let found_s = |has_pose: fn(u32) -> bool, turn_rad: f64| {
        let mut monitor = DirectionMonitor::new(1.0, 0.02);
        let (mut v, mut at) = (Complex::default(), Complex::default());
        (0..500).map(|k| (k, f64::from(k) * 0.02)).find_map(|(k, t_s)| {
            let asked = Complex::new((1.3 * t_s).sin(), (0.9 * t_s).cos()) * 0.6;
            let target = 1.9 * asked * Complex::from_polar(1.0, turn_rad);
            v += (target - v) * (1.0 - lag_decay(0.02));
            at += v * 0.02;
            let mut u_applied = Sticks::zeros();
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (asked.re, -asked.im);
            let pose = has_pose(k).then(|| Pose::new(at.re, at.im, 1.0, 0.0));
            let sample = Sample { pose, drone: None, u_applied, link_is_up: true };
            monitor.update(&sample).1.then_some(t_s)
        })
    };
    let sources: [fn(u32) -> bool; 7] = [
        |_| true,
        |k| k % 2 == 0,
        |k| k % 5 == 0,
        |k| k % 10 == 0,
        |k| k % 25 == 0 || k % 25 == 13,
        |k| k % 7 > 2,
        // A hole of 0.3 s in each half second.
        |k| k % 25 < 11,
    ];
    for has_pose in sources {
        let found_s = [FRAC_PI_2, 3.0, 0.8, 0.0].map(|turn_rad| found_s(has_pose, turn_rad));
        let [Some(right_s), Some(back_s), None, None] = found_s else { panic!("{found_s:?}") };
        assert!(right_s < 1.8 && back_s < 1.5, "{found_s:?}");
    }
}

#[test]
fn a_gap_of_a_quarter_of_a_second_is_a_motion_and_a_longer_one_begins_the_shifts_anew() {
    for (gap, is_motion) in [(13, true), (14, false)] {
        let mut monitor = DirectionMonitor::new(1.0, 0.02);
        for k in 0..=30 + gap {
            let pose = (k <= 30 || k == 30 + gap).then(Pose::zeros);
            let sample = Sample { pose, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
            monitor.update(&sample);
        }
        let [_, later, _] = &monitor.sums;
        assert_eq!(later.time_s > 0.3, is_motion, "{gap} periods: {later:?}");
        assert_eq!(monitor.count > 0, is_motion, "{gap} periods");
    }
}

#[test]
fn after_an_outage_the_decay_of_a_velocity_is_summed() {
    let mut monitor = DirectionMonitor { is_shown: true, ..DirectionMonitor::new(1.0, 0.02) };
    let mut see = |link_is_up, pose| {
        let u_applied = Sticks::zeros();
        monitor.update(&Sample { pose, drone: None, u_applied, link_is_up });
        monitor.sums[0].y
    };
    see(false, None);
    // The mean over two periods is that of the one motion.
    see(true, Some(Pose::zeros()));
    see(true, None);
    let sum = see(true, Some(Pose::zeros()));
    let keep = lag_decay(0.02);
    assert!((sum - 0.02 * (keep * keep + keep * keep * keep)).abs() < 1e-3, "{sum}");
}

#[test]
fn an_angle_is_wrong_beyond_the_limit_only() {
    let quiet = Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
    for (limit_rad, is_wrong) in [(FRAC_PI_2, false), (1.5, true)] {
        let mut monitor = monitor(limit_rad, [Complex::i(); 3]);
        let found = (0..40).map(|_| monitor.update(&quiet)).last();
        assert_eq!(found, Some((Some(FRAC_PI_2), is_wrong)), "limit of {limit_rad} rad");
    }
}

#[test]
fn a_vehicle_that_flies_against_its_inputs_is_found_though_it_looks_like_an_outage() {
    // Full pitch from 1 s on; from 1.6 s on the link monitor takes what it sees for an outage.
    let found_after_s = |waits_s: f64, turn_rad: f64, shown_before: bool| {
        let mut monitor = DirectionMonitor::new(0.785, 0.02);
        monitor.is_shown = shown_before;
        for _ in 0..horizon_model::steps(waits_s, 0.02) {
            let (pose, u_applied) = (Some(Pose::new(0.0, 0.0, 1.0, 0.0)), Sticks::zeros());
            monitor.update(&Sample { pose, drone: None, u_applied, link_is_up: true });
        }
        let (mut v, mut x) = (0.0, 0.0);
        (0..150).map(|k| (k, f64::from(k) * 0.02)).find_map(|(k, t_s)| {
            let mut u_applied = Sticks::zeros();
            u_applied[stick::PITCH] = if t_s < 1.0 { 0.0 } else { 0.5 };
            v += (1.9 * u_applied[stick::PITCH] * turn_rad.cos() - v) * (1.0 - lag_decay(0.02));
            x += v * 0.02;
            let pose = Some(Pose::new(x, 0.0, 1.0, 0.0));
            let link_is_up = !(80..130).contains(&k);
            let sample = Sample { pose, drone: None, u_applied, link_is_up };
            monitor.update(&sample).1.then_some(t_s)
        })
    };
    for waits_s in [0.0, 15.0] {
        let found = found_after_s(waits_s, PI, false).unwrap();
        assert!(found < 2.2, "{found} s after {waits_s} s without inputs");
    }
    assert_eq!(found_after_s(0.0, PI, true), None, "forgotten in the outage");
    assert_eq!(found_after_s(0.0, 0.0, false), None);
}

#[test]
fn the_direction_is_shown_by_a_motion_along_the_inputs_until_the_vehicle_stands() {
    for (turn_rad, expected) in [(0.0, true), (0.7, true), (0.9, false), (PI, false)] {
        let mut monitor = monitor(0.785, [Complex::from_polar(1.0, turn_rad); 3]);
        let quiet =
            Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
        for _ in 0..12 {
            monitor.update(&quiet);
        }
        assert_eq!(monitor.is_shown, expected, "{turn_rad} rad");
        monitor.reset_on_ground();
        assert!(!monitor.is_shown);
    }
}

#[test]
fn an_outage_counts_for_the_time_of_forgetting_or_until_the_direction_is_shown() {
    let quiet =
        |link_is_up| Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up };
    let mut monitor = DirectionMonitor::new(0.785, 0.02);
    monitor.update(&quiet(false));
    let steps = (0..300).position(|_| {
        monitor.update(&quiet(true));
        !monitor.has_outage
    });
    assert!(steps.is_some_and(|steps| (198..=201).contains(&steps)), "{steps:?}");
    monitor.update(&quiet(false));
    monitor.sums = [sums(Complex::from(1.0)); 3];
    for _ in 0..12 {
        monitor.update(&quiet(true));
    }
    assert!(monitor.is_shown && !monitor.has_outage);
}
