//! Vehicles that are late, lost or elsewhere.

use serde_json::json;

use super::super::tests::vehicle;
use super::super::tests::vehicle::fly;
use super::super::tests::*;
use super::super::*;
use super::*;

#[test]
fn the_reference_slows_down_and_stands_for_a_late_vehicle_and_takes_up_speed_again() {
    let mut mission = set_off(&square(0.1));
    let mut held = Pose::zeros();
    for _ in 0..60 {
        held = now(&mission).pose;
        mission.advance(&held);
    }
    for _ in 0..200 {
        mission.advance(&held);
    }
    let standing = now(&mission);
    let lag_m = position_gap(&standing.pose, &held);
    assert!(standing.rate.norm() < 1e-3, "{}", standing.rate);
    assert!((0.38..0.401).contains(&lag_m), "{lag_m} m");
    // The vehicle comes back.
    let mut speed_mps = standing.rate.norm();
    for _ in 0..400 {
        let next = now(&mission);
        let faster = next.rate.norm() - speed_mps;
        assert!(faster <= 1.02 * DT_S, "{faster}");
        speed_mps = next.rate.norm();
        mission.advance(&next.pose);
    }
    assert!(mission.is_finished());
}

#[test]
fn resuming_starts_at_the_vehicle_with_its_speed() {
    let mut mission = set_off(&square(0.1));
    let first = mission.first_pose();
    for _ in 0..60 {
        let next = now(&mission).pose;
        mission.advance(&next);
    }
    let vehicle = first + Pose::new(0.15, 0.3, 0.0, 0.0);
    mission.resume(&vehicle, &Pose::new(0.2, 0.3, 0.0, 0.0));
    let next = now(&mission);
    assert!((next.pose[pose::Y] - vehicle[pose::Y] - 0.3 * DT_S).abs() < 0.004, "{}", next.pose);
    assert!((next.rate[pose::Y] - 0.3).abs() < 0.05, "{}", next.rate);
    // Backwards, beside the corner beyond the next waypoint, and far away.
    mission.resume(&vehicle, &Pose::new(0.0, -0.5, 0.0, 0.0));
    assert!(now(&mission).rate[pose::Y].abs() <= 1.02 * DT_S);
    let vehicle = first + Pose::new(0.1, 1.0, 0.0, 0.0);
    mission.resume(&vehicle, &Pose::zeros());
    let outside = first + Pose::new(0.9, 1.5, 0.0, 0.0);
    mission.resume(&outside, &Pose::zeros());
    assert_eq!(mission.targets_reached(), 1);
    let corner = now(&mission).pose - mission.target();
    assert!(corner.norm() < 0.11, "{corner}");
}

#[test]
fn resuming_before_the_start_and_at_a_crossing_skips_nothing() {
    let mut standing = mission(&eight());
    let first = standing.first_pose();
    standing.resume(&(first + Pose::new(2.0, 0.0, 0.0, 0.0)), &Pose::zeros());
    assert_eq!(now(&standing).pose, first);
    // Near the crossing, which is passed again half the way later.
    let mut early = set_off(&eight());
    for _ in 0..50 {
        let next = now(&early).pose;
        early.advance(&next);
    }
    early.resume(&first, &Pose::zeros());
    let rest_s = fly(&mut early, exactly, 5000);
    let whole_s = fly(&mut set_off(&eight()), exactly, 5000);
    assert!((whole_s - rest_s).abs() < 0.3, "{rest_s} s instead of {whole_s} s");
}

#[test]
fn a_missed_corner_is_flown_to_before_the_path_goes_on() {
    let mut mission = set_off(&square(0.1));
    let corner = mission.outline()[1];
    let (mut returns, mut before) = (0, mission.first_pose());
    let push = |reference: &Reference, at: &Pose| {
        // The reference begins its path to the corner at the vehicle.
        returns += u32::from(position_gap(&reference.pose, &before) > 0.2);
        before = reference.pose;
        // Pushed outwards around the corner until the first return.
        let is_pushed = returns == 0 && position_gap(at, &corner) < 0.5;
        let push_m = if is_pushed { 0.3 } else { 0.0 };
        reference.pose + Pose::new(-push_m, push_m, 0.0, 0.0)
    };
    fly(&mut mission, push, 2000);
    assert_eq!(returns, 1);
    assert!(mission.is_finished(), "{} targets", mission.targets_reached());
}

#[test]
fn a_vehicle_that_cuts_its_corners_misses_one_and_no_other() {
    let mut mission = set_off(&square(0.15));
    let corners = mission.outline();
    // The reference steps to the vehicle where a return begins, and from the corner to the path where it ends.
    let (mut steps, mut before) = (0, mission.first_pose());
    // At most 0.15 m from a corner by the reference; 0.07 m more inside, where it turns.
    let middle = corners.iter().take(4).fold(Pose::zeros(), |sum, at| sum + at / 4.0);
    let cut = |reference: &Reference, _: &Pose| {
        steps += u32::from(position_gap(&reference.pose, &before) > 0.05);
        before = reference.pose;
        let inward = (middle - reference.pose).fixed_rows::<2>(pose::X).normalize();
        let is_near = corners.iter().any(|corner| position_gap(&reference.pose, corner) < 0.4);
        let by_m = if is_near { 0.07 } else { 0.0 };
        reference.pose + Pose::new(by_m * inward.x, by_m * inward.y, 0.0, 0.0)
    };
    fly(&mut mission, cut, 4000);
    assert!(mission.is_finished() && steps == 2, "{steps} steps");
}

#[test]
fn every_mission_ends_once_the_vehicle_follows_again() {
    for (index, table) in
        [targets(), square(0.1), square(0.0), eight(), circle(), timed()].iter().enumerate()
    {
        for seed in 0..30 {
            let mut mission = mission(table);
            let mut vehicle = vehicle::Disturbed::new(seed, mission.first_pose());
            // 40 s of disturbances, then 60 s without.
            for step in 0..5000 {
                let next = now(&mission);
                assert!(next.pose.iter().chain(next.rate.iter()).all(|entry| entry.is_finite()));
                let at = vehicle.follow(&next.pose, step < 2000);
                mission.advance(&at);
                if vehicle.is_released() {
                    mission.resume(&at, &Pose::zeros());
                }
            }
            let (reached, count) = (mission.targets_reached(), mission.targets_count());
            assert!(mission.is_finished(), "mission {index}, seed {seed}: {reached} of {count}");
        }
    }
}

#[test]
fn hovering_takes_its_time_however_often_it_is_resumed() {
    let mut table = timed();
    table["trajectory"]["points"]["rows"] =
        json!([[0.0, 1.0, 2.0, 1.3, 0.5], [6.0, 1.0, 2.0, 1.3, 0.5]]);
    let mut mission = set_off(&table);
    let at = mission.first_pose() + Pose::new(0.05, -0.05, 0.05, 0.0);
    let mut periods = 0;
    while !mission.is_finished() && periods < 1000 {
        assert_eq!(now(&mission), Reference::at_rest(mission.first_pose()));
        mission.advance(&at);
        if periods % 50 == 0 {
            mission.resume(&at, &Pose::zeros());
        }
        periods += 1;
    }
    // 6 s; the sum of 300 periods may be a rounding short of it.
    assert!((300..=301).contains(&periods), "{periods} periods");
}

#[test]
fn an_estimate_that_is_no_number_moves_nothing() {
    let nothing = Pose::from_element(f64::NAN);
    let mut mission = set_off(&square(0.1));
    for _ in 0..50 {
        let next = now(&mission).pose;
        mission.advance(&next);
    }
    let before = mission.clone();
    mission.advance(&nothing);
    mission.resume(&nothing, &Pose::zeros());
    mission.resume(&Pose::zeros(), &nothing);
    assert_eq!(mission, before);
}

#[test]
fn the_pace_falls_from_one_at_the_first_limit_to_nothing_at_the_second() {
    for (distance_m, pace) in
        [(-9.0, 1.0), (0.0, 1.0), (0.25, 1.0), (0.5, 0.5), (0.75, 0.0), (9.0, 0.0)]
    {
        assert_eq!(
            falling(distance_m, [0.25, 0.75]).to_bits(),
            f64::to_bits(pace),
            "{distance_m} m"
        );
    }
}

/// A follower of `table`, which is a trajectory.
fn follower(table: &serde_json::Value) -> Follower {
    let MissionTable::Trajectory(table) = serde_json::from_value(table.clone()).unwrap() else {
        panic!("not timed")
    };
    build::timed(&table, DT_S).unwrap()
}

#[test]
fn there_is_no_reference_before_the_vehicle_is_seen_and_its_time_includes_settling() {
    let mut follower = follower(&timed());
    assert_eq!(follower.now(), None);
    follower.advance(&Pose::from_element(f64::INFINITY));
    assert_eq!(follower.now(), None);
    follower.advance(&follower.next().pose.clone());
    assert!(follower.now().is_some());
    // 5.5 s from the first row to the last.
    assert!((follower.planned_s() - 5.9).abs() < 1e-9, "{} s", follower.planned_s());
}

#[test]
fn a_waypoint_counts_from_its_time_on_and_within_reach() {
    let mut follower = follower(&timed());
    follower.reached = 1;
    let last = follower.next().clone();
    let end_s = last.counts_from_s;
    let at = |x_m: f64| last.pose + Pose::new(0.0, 0.0, x_m, 0.0);
    for (at_s, z_m, is_there) in [
        (end_s, 0.0, true),
        (end_s.next_down(), 0.0, false),
        (end_s, 0.199, true),
        (end_s, 0.201, false),
    ] {
        follower.time.at_s = at_s;
        assert_eq!(follower.is_at_next(&at(z_m)), is_there, "{at_s} s, {z_m} m");
        assert!(!follower.has_missed_next(), "the last one");
    }
}

#[test]
fn the_pace_grows_within_what_the_trajectory_leaves_of_the_acceleration() {
    let follower = follower(&timed());
    let x = |x| Pose::new(x, 0.0, 0.0, 0.0);
    let growth = |vel_mps, accel_mps2, pace| {
        let at = Moment { pose: Pose::zeros(), rate: x(vel_mps), accel: accel_mps2 };
        follower.pace_growth(&at, pace)
    };
    // At most 1 m/s^2: at a constant 2 m/s the pace may grow by 0.5/s.
    assert!((growth(2.0, x(0.0), 0.5) - 0.5).abs() < 1e-12);
    // The trajectory itself speeds up by 0.6 m/s^2, or brakes by as much, or turns.
    assert!((growth(2.0, x(0.6), 1.0) - 0.2).abs() < 1e-12);
    assert!((growth(2.0, x(-0.6), 1.0) - 0.8).abs() < 1e-12);
    assert!((growth(2.0, Pose::new(0.0, 0.6, 0.0, 0.0), 1.0) - 0.4).abs() < 1e-12);
    assert!((growth(2.0, x(0.6), 0.0) - 0.5).abs() < 1e-12, "at rest it takes up nothing");
    assert!((growth(2.0, x(1.0), 1.0) - PACE_GROWTH_MIN).abs() < 1e-12);
    assert!((growth(0.0, x(0.0), 0.5) - 1.0 / DT_S).abs() < 1e-9, "at a standstill");
}
