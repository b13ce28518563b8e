//! Poses that stand still, and whether that shows anything.

use std::f64::consts::PI;

use super::super::tests::{DT_S, monitors, noise_m};
use super::super::*;
use super::*;

#[test]
fn a_still_pose_is_found_through_noise_and_a_moving_one_is_not_still() {
    let mut monitors = monitors();
    let mut seen_s = Vec::new();
    for (sd_m, speed_mps, is_still) in [
        (0.0, 0.0, true),
        (4e-4, 0.0, true),
        (1e-3, 0.0, true),
        (4e-4, 0.004, false),
        (4e-4, 0.05, false),
    ] {
        monitors.stillness.reset();
        let mut still_s = None;
        for k in 0..100_u32 {
            let x_m = speed_mps * f64::from(k) * DT_S + noise_m(k, sd_m);
            let at = Pose::new(x_m, noise_m(k + 13, sd_m), 1.0 + noise_m(k + 57, sd_m), 0.1);
            let before = still_s;
            still_s = monitors.stillness.update(Some(&at)).all_s;
            if before.is_none() && still_s.is_some() {
                seen_s.push(f64::from(k + 1) * DT_S);
            }
        }
        assert_eq!(still_s.is_some(), is_still, "{sd_m} m, {speed_mps} m/s");
    }
    assert!(seen_s.iter().all(|at_s| *at_s <= 0.81), "{seen_s:?}");
}

#[test]
fn an_object_at_rest_is_found_under_5_mm_of_noise_within_2_5_s() {
    for (sd_m, speed_mps, is_still) in
        [(3e-3, 0.0, true), (5e-3, 0.0, true), (3e-3, 0.008, false), (5e-3, 0.008, false)]
    {
        let mut stillness = StillnessMonitor::new(0.0015, DT_S);
        let found = (0..125_u32).any(|k| {
            let x_m = speed_mps * f64::from(k) * DT_S + noise_m(k, sd_m);
            let at = Pose::new(x_m, noise_m(k + 13, sd_m), 1.0 + noise_m(k + 57, sd_m), 0.1);
            stillness.update(Some(&at)).all_s.is_some()
        });
        assert_eq!(found, is_still, "{sd_m} m, {speed_mps} m/s");
    }
}

/// When a pose that stands still from the start is called frozen, the pitch given at each time. s
fn frozen_at_s(pitch: impl Fn(f64) -> f64, link_is_up: bool, velocity: Agreement) -> Option<f64> {
    let mut frozen = FrozenMonitor::new(DT_S);
    (1..=400_u32).map(|k| f64::from(k) * DT_S).find(|t_s| {
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = pitch(*t_s);
        let sample = Sample { pose: None, drone: None, u_applied, link_is_up };
        let still_s = (*t_s >= 0.8).then_some(*t_s);
        frozen.update(&Still { all_s: still_s, ..Still::default() }, &sample, velocity).is_some()
    })
}

#[test]
fn a_pose_is_frozen_that_stands_still_against_the_inputs() {
    use Agreement::{Agrees, Doubtful, Unknown};
    for (velocity, expected_s) in [(Agrees, None), (Unknown, Some(5.02)), (Doubtful, Some(5.02))] {
        let close = |at_s: Option<f64>, expected_s: Option<f64>| match (at_s, expected_s) {
            (Some(at_s), Some(expected_s)) => (at_s - expected_s).abs() < 0.011,
            (at_s, expected_s) => at_s == expected_s,
        };
        // Steered: as soon as it is still.
        assert_eq!(frozen_at_s(|_| 0.5, true, velocity).map(|at_s| at_s < 0.83), Some(true));
        // From 3 s on: the lag, and 0.4 s.
        let later_s = frozen_at_s(|t_s| if t_s > 3.0 { -0.5 } else { 0.1 }, true, velocity);
        assert!((3.4..3.9).contains(&later_s.unwrap()), "{later_s:?}");
        // Within the dead zone, to and fro, or for too short a time: a calm vehicle.
        let sway = |t_s: f64| 0.4 * (t_s * PI / 0.2).sin().signum();
        let short = |t_s: f64| if t_s < 0.4 { 0.4 } else { 0.0 };
        for at_s in [
            frozen_at_s(|_| 0.15, true, velocity),
            frozen_at_s(sway, true, velocity),
            frozen_at_s(short, true, velocity),
        ] {
            assert!(close(at_s, expected_s), "{velocity:?}: {at_s:?}");
        }
        let in_outage_s = frozen_at_s(|_| 0.8, false, velocity);
        assert!(close(in_outage_s, expected_s.map(|_| 2.42)), "{velocity:?}: {in_outage_s:?}");
    }
}

#[test]
fn what_was_asked_for_before_the_hold_counts_until_the_pose_moves() {
    let mut frozen = FrozenMonitor::new(DT_S);
    let mut see = |pitch: f64, still_s: Option<f64>| {
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = pitch;
        let sample = Sample { pose: None, drone: None, u_applied, link_is_up: true };
        frozen.update(&Still { all_s: still_s, ..Still::default() }, &sample, Agreement::Agrees)
    };
    assert!((0..60).all(|_| see(0.6, None).is_none()));
    assert_eq!(see(0.6, Some(0.8)), Some(0.8));
    assert!((0..100).all(|_| see(0.0, Some(1.0)).is_some()));
    assert_eq!((see(0.0, None), see(0.0, Some(0.8))), (None, None));
}

#[test]
fn time_goes_on_while_a_still_pose_is_missing_and_ends_with_a_move() {
    let mut stillness = StillnessMonitor::new(0.0015, DT_S);
    let here = Pose::new(1.0, 2.0, 1.0, 0.0);
    let still_s = (0..60).fold(None, |_, _| stillness.update(Some(&here)).all_s).unwrap();
    assert!((still_s - (0.8 + 20.0 * DT_S)).abs() < 1e-9, "{still_s}");
    let later_s = (0..50).fold(None, |_, _| stillness.update(None).all_s).unwrap();
    assert!((later_s - still_s - 1.0).abs() < 1e-9, "{later_s}");
    let there = here + Pose::new(0.1, 0.0, 0.0, 0.0);
    assert_eq!(stillness.update(Some(&there)).all_s, None);
}

#[test]
fn a_pose_that_is_repeated_and_changes_its_last_digit_now_and_then_is_frozen() {
    let found_at = |see_repeated: bool| {
        let mut monitors = monitors();
        (0..100_u32).find(|k| {
            let mut u_applied = Sticks::zeros();
            u_applied[stick::PITCH] = 0.8;
            let at = Pose::new(1.0 + 1e-4 * f64::from(k / 8 % 2), 2.0, 1.0, 0.0);
            let pose = k.is_multiple_of(8).then_some(at);
            if see_repeated && pose.is_none() {
                monitors.observe_repeated(&at);
            }
            let sample = Sample { pose, drone: None, u_applied, link_is_up: true };
            monitors.update(&sample).frozen_s.is_some()
        })
    };
    assert_eq!((found_at(true), found_at(false)), (Some(39), None));
}

/// Whether y is called frozen within 3 s after the end of a leg along x at 1 m/s, where the vehicle is ordered to turn
/// in the direction of -y. The link monitor reports no outage until 0.6 s after the turn.
fn is_frozen_after_a_corner(
    follows: bool,
    shows_y: bool,
    report: fn([f64; 2]) -> Option<[f64; 2]>,
) -> bool {
    let mut monitors = monitors();
    let (mut leg_mps, mut side_mps, mut x_m, mut y_m) = (0.0, 0.0, 0.0, 0.0);
    let mut reported = [0.0; 2];
    (0..250_u32).any(|k| {
        let t_s = f64::from(k) * DT_S - 2.0;
        let mut u_applied = Sticks::zeros();
        u_applied[if t_s < 0.0 { stick::PITCH } else { stick::ROLL }] = 0.6;
        let answer = 1.0 - (-DT_S / 0.6).exp();
        leg_mps += (if t_s < 0.0 { 1.0 } else { 0.0 } - leg_mps) * answer;
        side_mps += (if t_s >= 0.0 && follows { -1.0 } else { 0.0 } - side_mps) * answer;
        x_m += leg_mps * DT_S;
        y_m += if shows_y { side_mps * DT_S } else { 0.0 };
        // Ten reports a second, in whole dm/s.
        if k % 5 == 0 {
            reported = [leg_mps, side_mps].map(|mps| (10.0 * mps).round() / 10.0);
        }
        let noise = |row: u32| noise_m(k + row, 4e-4);
        let pose = Some(Pose::new(x_m + noise(0), y_m + noise(13), 1.0 + noise(57), 0.0));
        let drone = Some(DroneMotion {
            horizontal_d_mps: report(reported),
            height_m: None,
            heading_rad: None,
        });
        let link_is_up = t_s < 0.6 || (follows && shows_y);
        let sample = Sample { pose, drone, u_applied, link_is_up };
        monitors.update(&sample).frozen_s.is_some()
    })
}

#[test]
fn lost_commands_are_no_frozen_axis_if_the_drone_reports_no_motion() {
    let silent = |_| None;
    let small = |v_mps: [f64; 2]| Some(v_mps.map(|mps| 0.1 * mps));
    let turned = |[first_mps, second_mps]: [f64; 2]| Some([-second_mps, first_mps]);
    for report in [Some, turned] {
        assert!(!is_frozen_after_a_corner(false, true, report), "lost");
        assert!(!is_frozen_after_a_corner(true, true, report), "right");
        assert!(is_frozen_after_a_corner(true, false, report), "frozen");
    }
    // No speed by the drone, or one in another unit.
    for report in [silent, small] {
        assert!(is_frozen_after_a_corner(false, true, report));
        assert!(is_frozen_after_a_corner(true, false, report));
    }
}

#[test]
fn a_height_that_is_still_is_not_frozen_in_an_outage_that_the_drone_confirms() {
    // Confirmed: the poses show all of the drone's motion. Contradicted: 0.5 m/s that they do not show.
    for (reported, link_is_up, is_frozen) in [
        (Some([0.1, 0.0]), true, true),
        (Some([0.1, 0.0]), false, false),
        (Some([0.5, 0.0]), false, true),
        (None, false, true),
    ] {
        let mut monitors = monitors();
        let found = (0..150_u32).map(|k| {
            let mut u_applied = Sticks::zeros();
            u_applied[stick::THROTTLE] = 0.8;
            let [x_m, y_m] = [0.1, 0.05].map(|mps| mps * f64::from(k) * DT_S);
            let pose = Some(Pose::new(x_m, y_m, 1.0, 0.0));
            let drone =
                Some(DroneMotion { horizontal_d_mps: reported, height_m: None, heading_rad: None });
            let link_is_up = link_is_up || k < 60;
            let sample = Sample { pose, drone, u_applied, link_is_up };
            monitors.update(&sample).frozen_s.is_some()
        });
        assert_eq!(found.last(), Some(is_frozen), "{reported:?}, {link_is_up}");
    }
}

/// When one axis that stands still while the others move is called frozen, from the moment on at which it stops. The
/// vehicle follows `pitch` along x and flies along y. s
fn axis_frozen_at_s(pitch: impl Fn(f64) -> f64, noise_sd_m: f64, theta_rad: f64) -> Option<f64> {
    let mut monitors = monitors();
    let (mut x_mps, mut x_m) = (0.0, 0.0);
    let begin_s = 8.0;
    (1..=800_u32).find_map(|k| {
        let t_s = f64::from(k) * DT_S;
        let mut u_applied = Sticks::zeros();
        let (ahead, left) = (pitch(t_s), 0.1 * (1.1 * t_s).sin());
        let (sin, cos) = f64::sin_cos(-theta_rad);
        u_applied[stick::PITCH] = cos * ahead - sin * left;
        u_applied[stick::ROLL] = -(sin * ahead + cos * left);
        x_mps += (1.8 * ahead - x_mps) * (1.0 - (-DT_S / 0.6).exp());
        x_m += if t_s < begin_s { x_mps * DT_S } else { 0.0 };
        let y_m = 0.3 * (0.9 * t_s).sin() + noise_m(k + 13, noise_sd_m);
        let z_m = 1.0 + 0.02 * (0.7 * t_s).sin() + noise_m(k + 57, noise_sd_m);
        let pose = Some(Pose::new(x_m + noise_m(k, noise_sd_m), y_m, z_m, theta_rad));
        let sample = Sample { pose, drone: None, u_applied, link_is_up: true };
        let is_found = monitors.update(&sample).frozen_s.is_some();
        is_found.then_some(t_s - begin_s)
    })
}

#[test]
fn one_axis_that_stands_still_against_inputs_that_changed_is_frozen() {
    for theta_rad in [0.0, 1.2, -2.9] {
        // The controller pushes on, since the pose does not move.
        let push = |t_s: f64| 0.25 + 0.5 * (t_s - 8.0).clamp(0.0, 1.0);
        for (noise_sd_m, end_s) in [(5e-4, 1.5), (3e-3, 2.6)] {
            let found_s = axis_frozen_at_s(push, noise_sd_m, theta_rad);
            println!("{theta_rad} rad, {noise_sd_m} m: {found_s:?} s");
            assert!(found_s.is_some_and(|found_s| (0.0..end_s).contains(&found_s)), "{found_s:?}");
        }
    }
    // It leans against a wind all the time: the axis may be still.
    assert_eq!(axis_frozen_at_s(|_| 0.0, 4e-4, 0.4), None);
    let mut monitors = monitors();
    for k in 0..1000_u32 {
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] =
            0.6_f64.min(0.01 * f64::from(k)) + 0.05 * (0.1 * f64::from(k)).sin();
        let at = Pose::new(noise_m(k, 4e-4), 0.2 * (0.02 * f64::from(k)).sin(), 1.0, 0.0);
        let x_m = if k < 400 { 0.001 * f64::from(400 - k) } else { 0.0 };
        let pose = Some(at + Pose::new(x_m, 0.0, noise_m(k + 57, 4e-4), 0.0));
        let sample = Sample { pose, drone: None, u_applied, link_is_up: true };
        assert_eq!(monitors.update(&sample).frozen_s, None, "{k}");
    }
}

#[test]
fn an_axis_is_frozen_by_the_part_of_the_inputs_that_points_along_it() {
    // Forward and left at 45 degrees: along y alone, forward and right: along x alone.
    for (left, moved) in [(0.5, pose::Y), (-0.5, pose::X)] {
        for still in [pose::X, pose::Y] {
            let mut u_applied = Sticks::zeros();
            (u_applied[stick::PITCH], u_applied[stick::ROLL]) = (0.5, -left);
            let pose = Some(Pose::new(0.0, 0.0, 1.0, PI / 4.0));
            let sample = Sample { pose, drone: None, u_applied, link_is_up: true };
            let mut found = Still::default();
            found.rows_s[still] = Some(0.8);
            // One long step: the lag passes the inputs, their mean does not follow yet.
            let frozen_s = FrozenMonitor::new(2.0).update(&found, &sample, Agreement::Agrees);
            assert_eq!(
                frozen_s,
                (still == moved).then_some(0.8),
                "{left} to the left, row {still}"
            );
        }
    }
}

#[test]
fn a_drone_that_reports_to_fly_receives_its_inputs_whatever_the_poses_show() {
    for (speed_mps, is_frozen) in
        [(None, false), (Some([0.1, 0.2]), false), (Some([0.4, 0.0]), true)]
    {
        let mut monitors = monitors();
        let drone =
            Some(DroneMotion { horizontal_d_mps: speed_mps, height_m: None, heading_rad: None });
        let found = (0..100_u32).any(|k| {
            let mut u_applied = Sticks::zeros();
            u_applied[stick::PITCH] = 0.5;
            let pose = Some(Pose::new(0.0, 0.0, 1.0, 0.0));
            let sample = Sample { pose, drone, u_applied, link_is_up: k < 10 };
            monitors.update(&sample).frozen_s.is_some()
        });
        assert_eq!(found, is_frozen, "{speed_mps:?}");
    }
}

#[test]
fn inputs_that_a_dead_zone_may_swallow_contradict_nothing() {
    for (pitch, expected_s) in [(0.2, None), (-0.2, None), (0.201, Some(0.8)), (-0.201, Some(0.8))]
    {
        // With steps so long, the lag passes every input as it is.
        let mut frozen = FrozenMonitor::new(1e3);
        let mut u_applied = Sticks::zeros();
        u_applied[stick::PITCH] = pitch;
        let sample = Sample { pose: None, drone: None, u_applied, link_is_up: true };
        assert_eq!(
            frozen.update(
                &Still { all_s: Some(0.8), ..Still::default() },
                &sample,
                Agreement::Agrees
            ),
            expected_s,
            "{pitch}"
        );
    }
}

#[test]
fn a_pose_that_moves_by_the_limit_is_not_still() {
    for (moved_m, is_still) in [(0.5, false), (0.499, true)] {
        let mut stillness = StillnessMonitor::new(0.5, DT_S);
        // All of the short window: 0.8 s.
        let seen = (0..40).map(|k| {
            let x_m = if k < 20 { 0.0 } else { moved_m };
            stillness.update(Some(&Pose::new(x_m, 0.0, 1.0, 0.0)))
        });
        assert_eq!(seen.last().and_then(|still| still.all_s).is_some(), is_still, "{moved_m} m");
    }
}

#[test]
fn all_rows_are_still_as_long_as_the_one_that_stopped_last_and_windows_add_the_longer_time() {
    assert_eq!(all(&[Some(3.0), Some(1.0), Some(2.0)]), Some(1.0));
    for moving in 0..3 {
        let mut rows_s = [Some(1.0); 3];
        rows_s[moving] = None;
        assert_eq!(all(&rows_s), None, "row {moving}");
    }
    assert_eq!(longest(Some(1.0), Some(2.0)), Some(2.0));
    assert_eq!(longest(Some(2.0), Some(1.0)), Some(2.0));
    assert_eq!([longest(None, Some(1.0)), longest(Some(1.0), None)], [Some(1.0); 2]);
    assert_eq!(longest(None, None), None);
}

#[test]
fn inputs_contradict_from_their_least_time_on_whatever_a_report_of_rest_shows() {
    const LARGE: Signs = Signs { has_large_input: true, is_still: true, reports_no_motion: false };
    const QUIET: Signs = Signs { has_large_input: false, ..LARGE };
    const AT_REST: Signs = Signs { reports_no_motion: true, ..LARGE };
    const MOVED: Signs = Signs { is_still: false, ..LARGE };
    let found = |ticks: &[Signs]| {
        let mut contradiction = Contradiction::default();
        for signs in ticks {
            contradiction.update(*signs, LARGE_MIN_S / 2.0);
        }
        contradiction.is_found
    };
    for (ticks, expected) in [
        (&[LARGE][..], false),
        (&[LARGE, LARGE], true),
        (&[LARGE, QUIET, LARGE], false),
        (&[LARGE, LARGE, QUIET], true),
        (&[AT_REST, AT_REST, AT_REST], false),
        (&[LARGE, LARGE, AT_REST], true),
        (&[LARGE, LARGE, MOVED], false),
        (&[MOVED, MOVED, QUIET], false),
    ] {
        assert_eq!(found(ticks), expected, "{ticks:?}");
    }
}

#[test]
fn a_quiet_pose_may_be_still_up_to_the_limit() {
    let sample = Sample { pose: None, drone: None, u_applied: Sticks::zeros(), link_is_up: true };
    for (still_s, expected) in [(QUIET_S, None), (QUIET_S.next_up(), Some(QUIET_S.next_up()))] {
        let still = Still { all_s: Some(still_s), ..Still::default() };
        let mut frozen = FrozenMonitor::new(DT_S);
        assert_eq!(frozen.update(&still, &sample, Agreement::Unknown), expected);
    }
}
