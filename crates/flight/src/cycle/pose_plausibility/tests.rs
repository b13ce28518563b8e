use horizon_model::check::minimum;

use super::*;
use crate::time::SpanNs;

fn filtered(o: Pose, position: Acceptance, heading: Acceptance) -> Filtered {
    Filtered { o: Some(o), position, heading }
}

const HERE: Pose = Pose::new(1.0, 2.0, 1.0, 0.1);

/// The moment so many milliseconds after the first pose.
fn at(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

#[test]
fn a_pose_is_as_much_too_far_as_a_vehicle_does_not_fly() {
    let there = HERE + Pose::new(0.3, 0.4, 0.0, 0.0);
    for (ms, jump_m) in [(20, 0.46), (250, 0.0), (1000, -1.5)] {
        let mut plausibility = Plausibility::default();
        let accepted = |o| filtered(o, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.check(Some(&HERE), &accepted(HERE), at(0));
        assert_eq!(plausibility.jump_m(), None, "the first");
        plausibility.check(Some(&there), &accepted(there), at(ms));
        let found_m = plausibility.jump_m().unwrap();
        assert!((found_m - jump_m).abs() < 1e-9, "{ms} ms: {found_m} m");
        plausibility.begin_tick();
        assert_eq!(plausibility.jump_m(), None);
    }
}

#[test]
fn a_position_that_was_repeated_is_as_old_as_when_it_was_measured() {
    let mut plausibility = Plausibility::default();
    let mut see = |x_m: f64, ms| {
        let o = HERE + Pose::new(x_m, 0.0, 0.0, 0.0);
        plausibility.begin_tick();
        let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.check(Some(&o), &seen, at(ms));
        plausibility.jump_m()
    };
    let least_m = (0..=80).filter_map(|k| see(0.0, 20 * k)).fold(0.0, minimum);
    assert!((least_m + 2.04).abs() < 1e-9, "{least_m} m: up to a second");
    let jump_m = see(2.5, 1620).unwrap();
    assert!((jump_m - 0.46).abs() < 1e-9, "{jump_m} m");
    let jump_m = see(3.3, 1640).unwrap();
    assert!((jump_m - 0.76).abs() < 1e-9, "{jump_m} m");
    assert!(plausibility.shift_m() > 0.7);
}

#[test]
fn a_drop_is_what_the_largest_descent_of_a_tick_exceeds_a_vehicles() {
    let mut plausibility = Plausibility::default();
    let mut see = |dz_m: f64, ms| {
        let o = HERE + Pose::new(0.0, 0.0, dz_m, 0.0);
        plausibility.check(
            Some(&o),
            &filtered(o, Acceptance::Accepted, Acceptance::Accepted),
            at(ms),
        );
        plausibility.drop_m()
    };
    assert_eq!(see(0.0, 0), None);
    // 2 m/s for 20 ms are 0.04 m.
    assert!((see(-0.5, 20).unwrap() - 0.46).abs() < 1e-9);
    assert!((see(-0.6, 40).unwrap() - 0.46).abs() < 1e-9, "the largest of the tick");
    assert!((see(-1.3, 60).unwrap() - 0.66).abs() < 1e-9);
    plausibility.begin_tick();
    assert_eq!(plausibility.drop_m(), None);
    let up = HERE + Pose::new(0.0, 0.0, 0.5, 0.0);
    plausibility.check(
        Some(&up),
        &filtered(up, Acceptance::Accepted, Acceptance::Accepted),
        at(80),
    );
    assert!((plausibility.drop_m().unwrap() + 1.84).abs() < 1e-9, "a climb");
}

#[test]
fn what_jumps_between_two_positions_shows_nothing_of_the_commands_for_a_second() {
    let mut plausibility = Plausibility::default();
    let observed = Observed { o: HERE, is_present: [true, true, true, false] };
    let mut see = |x_m: f64, ms| {
        let o = HERE + Pose::new(x_m, 0.0, 0.0, 0.0);
        plausibility.begin_tick();
        let accepted = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.check(Some(&o), &accepted, at(ms));
        plausibility.steady(&observed).is_present
    };
    // 1.9 m/s and 3 m/s for 20 ms are steady, 0.25 m are not.
    assert_eq!(see(0.0, 0), observed.is_present);
    assert_eq!(see(0.038, 20), observed.is_present);
    assert_eq!(see(0.098, 40), observed.is_present);
    assert_eq!(see(0.348, 60), [false; pose::COUNT]);
    for k in 1..50 {
        assert_eq!(see(0.348, 60 + 20 * k), [false; pose::COUNT], "{k} ticks later");
    }
    assert_eq!(see(0.348, 1060), observed.is_present);
}

#[test]
fn an_object_in_two_positions_is_rough_and_one_that_is_moved_at_times_is_not() {
    let rough_after = |period_ticks: i64| {
        let mut plausibility = Plausibility::default();
        (0..2000).find(|k| {
            // What a stream repeats to the last digit would be one position.
            let o =
                HERE + Pose::new(0.2 * (k / period_ticks % 2) as f64, 1e-9 * *k as f64, 0.0, 0.0);
            plausibility.begin_tick();
            let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.check(Some(&o), &seen, at(20 * k));
            plausibility.is_rough()
        })
    };
    assert_eq!(rough_after(1), Some(5));
    assert_eq!(rough_after(12), Some(60));
    assert_eq!(rough_after(13), Some(91));
    assert_eq!(rough_after(33), Some(231));
    assert_eq!(rough_after(34), Some(272));
    assert_eq!(rough_after(85), Some(680));
    assert_eq!(rough_after(86), None);
}

#[test]
fn many_small_steps_beyond_a_vehicles_speed_are_rough() {
    let rough_after = |step_m: f64, period_ticks: i64| {
        let mut plausibility = Plausibility::default();
        (0..1000).find(|k| {
            let o = HERE
                + Pose::new(step_m * (k / period_ticks % 2) as f64, 1e-9 * *k as f64, 0.0, 0.0);
            plausibility.begin_tick();
            let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.check(Some(&o), &seen, at(20 * k));
            plausibility.is_rough()
        })
    };
    // 2 m/s for 20 ms are 0.04 m.
    assert_eq!(rough_after(0.091, 1), Some(20));
    assert_eq!(rough_after(0.091, 10), Some(200));
    assert_eq!(rough_after(0.091, 11), None);
    assert_eq!(rough_after(0.089, 1), None);
}

#[test]
fn a_jump_counts_for_fifty_ticks_with_four_others() {
    for (last, is_rough) in [(50, true), (51, false)] {
        let mut plausibility = Plausibility::default();
        let mut x_m = 0.0;
        for k in 0..=last {
            plausibility.begin_tick();
            // The first pose is none that jumped.
            x_m += if [1, 10, 20, 30, last].contains(&k) { 0.2 } else { 0.0 };
            let o = HERE + Pose::new(x_m, 1e-9 * k as f64, 0.0, 0.0);
            let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.check(Some(&o), &seen, at(20 * k));
        }
        assert_eq!(plausibility.is_rough(), is_rough, "{last}");
    }
}

#[test]
fn refused_poses_are_not_the_vehicles_and_time_goes_on() {
    let mut plausibility = Plausibility::default();
    plausibility.check(
        Some(&HERE),
        &filtered(HERE, Acceptance::Accepted, Acceptance::Accepted),
        at(0),
    );
    let there = HERE + Pose::new(0.6, 0.0, 0.0, 0.0);
    for k in 1..4 {
        let held = filtered(HERE, Acceptance::Held, Acceptance::Held);
        plausibility.check(Some(&there), &held, at(20 * k));
        assert_eq!(plausibility.jump_m(), None);
    }
    let seen = filtered(there, Acceptance::Accepted, Acceptance::Accepted);
    plausibility.check(Some(&there), &seen, at(80));
    assert!((plausibility.jump_m().unwrap() - 0.44).abs() < 1e-9);
    plausibility.restart();
    plausibility.begin_tick();
    plausibility.check(
        Some(&HERE),
        &filtered(HERE, Acceptance::Accepted, Acceptance::Held),
        at(100),
    );
    assert_eq!((plausibility.jump_m(), plausibility.drop_m()), (None, None), "begun anew");
}

/// The shift after poses at these x, 20 ms apart.
fn shift_m(x_m: &[f64]) -> f64 {
    let mut plausibility = Plausibility::default();
    for (x_m, ms) in x_m.iter().zip((0..).step_by(20)) {
        let o = HERE + Pose::new(*x_m, 0.0, 0.0, 0.0);
        let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.check(Some(&o), &seen, at(ms));
    }
    plausibility.shift_m()
}

#[test]
fn rough_steps_one_way_add_up_and_those_there_and_back_cancel() {
    for (x_m, expected_m) in [
        (&[0.0, 0.13, 0.13][..], 0.0),
        (&[0.0, 0.34, 0.36, 0.7], 0.6),
        (&[0.0, 0.34, 0.34, 0.0], 0.04),
        // Stalled for 0.2 s at 1.5 m/s.
        (&[0.0, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.33], 0.0),
    ] {
        let found_m = shift_m(x_m);
        assert!((found_m - expected_m).abs() < 1e-9, "{x_m:?}: {found_m} m");
    }
    let mut carried = Plausibility { shift_w: Vector3::repeat(1.0), ..Plausibility::default() };
    carried.reset_shift();
    assert!(carried.shift_m().abs() < 1e-12);
}

#[test]
fn only_equal_poses_in_a_row_are_repetitions() {
    let mut plausibility = Plausibility::default();
    let seen = filtered(HERE, Acceptance::Accepted, Acceptance::Accepted);
    for _ in 0..3 {
        plausibility.check(Some(&HERE), &seen, at(0));
        plausibility.check(None, &seen, at(0));
    }
    assert!(!plausibility.is_repeated());
    plausibility.check(Some(&HERE), &seen, at(0));
    assert!(plausibility.is_repeated());
    // Height and heading that go on do not make a position a new one.
    let turned = HERE + Pose::new(0.0, 0.0, 0.1, 0.1);
    plausibility.check(Some(&turned), &seen, at(0));
    assert!(plausibility.is_repeated());
    let moved = HERE + Pose::new(1e-4, 0.0, 0.0, 0.0);
    let seen = filtered(moved, Acceptance::Accepted, Acceptance::Accepted);
    plausibility.check(Some(&moved), &seen, at(0));
    assert!(!plausibility.is_repeated());
}
