//! Vehicles that are not where the path begins or goes on.

use std::f64::consts::TAU;

use horizon_model::check::maximum;
use horizon_model::rows::Pose;

use super::super::tests::vehicle::fly;
use super::super::tests::*;
use super::super::*;
use super::*;

/// Limits of a mission: speed, acceleration, climb, yaw rate.
type Most = [f64; 4];

/// Refuses references of a horizon that move faster than `most` or take up speed faster.
fn keeps_limits(refs: &[Reference], [speed, accel, climb, turn]: Most) {
    let speed_of = |reference: &Reference| reference.rate.fixed_rows::<3>(pose::X).norm();
    for Reference { rate, .. } in refs {
        // 1e-9: limits are met exactly but for rounding.
        let within = |value: f64, limit: f64| value.abs() <= limit * (1.0 + 1e-9);
        assert!(within(rate.fixed_rows::<3>(pose::X).norm(), speed), "{rate}");
        assert!(within(rate[pose::Z], climb) && within(rate[pose::THETA], turn), "{rate}");
    }
    for pair in refs.windows(2) {
        let moved = (pair[1].pose - pair[0].pose) / DT_S - pair[1].rate;
        // A path ends when a micrometre is left, from where 1.4 mm/s come to rest with 1 m/s^2.
        assert!(moved.norm() < 2e-3, "{moved}");
        let change_mps2 = (speed_of(&pair[1]) - speed_of(&pair[0])) / DT_S;
        assert!(change_mps2.abs() <= 1.001 * accel, "{change_mps2} m/s^2");
    }
}

/// A vehicle that follows with a time constant of 0.25 s.
fn lag_behind(at: &mut Pose, to: &Pose) {
    *at += (to - *at) * (DT_S / 0.25);
}

/// Leads a lagging vehicle from `at` until one more target is reached. Time and largest speed of the
/// reference come back. s, m/s
fn lead(mission: &mut Mission, at: &mut Pose, most: Most) -> (f64, f64) {
    let (goal, begin, count) = (*mission.target(), *at, mission.targets_reached());
    let direction_w = (goal - begin).fixed_rows::<3>(pose::X).normalize();
    let overshoot_m = |at: &Pose| (at - goal).fixed_rows::<3>(pose::X).dot(&direction_w);
    let mut refs = [Reference::default(); 60];
    let mut speed_mps = 0.0_f64;
    for step in 1..1000 {
        mission.advance(at);
        if mission.targets_reached() > count {
            return (f64::from(step) * DT_S, speed_mps);
        }
        mission.fill(0, &vec![1; refs.len()], &mut refs);
        // Up to the goal; what comes after it is the path.
        let led = refs.iter().take_while(|led| led.rate != Pose::zeros()).count();
        keeps_limits(&refs[..refs.len().min(led + 1)], most);
        // A micrometre counts as arrived.
        assert!(overshoot_m(&refs[0].pose) < 1e-6, "{}", refs[0].pose);
        assert!(overshoot_m(at) < 1e-6, "vehicle at {at}");
        speed_mps = maximum(speed_mps, refs[0].rate.fixed_rows::<3>(pose::X).norm());
        lag_behind(at, &refs[0].pose);
    }
    panic!("{} of {} targets, vehicle at {at}", mission.targets_reached(), mission.targets_count());
}

#[test]
fn a_vehicle_far_away_is_led_to_the_beginning_within_the_limits() {
    for (table, most) in [
        (square(0.1), [1.2, 1.0, 0.5, 1.0]),
        (eight(), [0.8, 0.9, 0.5, 1.0]),
        (circle(), [0.8, 0.9, 0.5, 1.0]),
        // Its own fastest speeds are 1.02 m/s and 1.1 rad/s.
        (timed(), [1.05, 1.0, 1.0, 1.2]),
    ] {
        let mut mission = mission(&table);
        // Two turns further, 0.5 rad beside.
        let offset = Pose::new(2.4, -3.2, -0.5, 0.5 + 2.0 * TAU);
        let mut at = mission.first_pose() + offset;
        mission.advance(&at);
        let next = now(&mission).pose;
        let step = (next - at)[pose::THETA] + 2.0 * TAU;
        assert!(position_gap(&next, &at) < 1e-3 && step.abs() < 1e-3, "{next} beside {at}");
        let (time_s, speed_mps) = lead(&mut mission, &mut at, most);
        // 4 m with a blend of half a second at both ends, and 0.4 s to settle.
        assert!((4.0..12.0).contains(&time_s), "{time_s} s");
        assert!((0.5 * most[0]..=most[0] + 1e-9).contains(&speed_mps), "{speed_mps} m/s");
    }
}

#[test]
fn a_vehicle_that_missed_a_waypoint_is_led_back_within_the_limits() {
    let mut mission = set_off(&square(0.1));
    let mut at = mission.first_pose();
    // Beside the path by more than the reach until the corner is missed.
    let beside = Pose::new(-0.3, 0.3, 0.0, 0.0);
    let mut before = now(&mission).pose;
    for _ in 0..1000 {
        at = before + beside;
        mission.advance(&at);
        let next = now(&mission).pose;
        if position_gap(&next, &before) > 0.3 {
            break;
        }
        before = next;
    }
    assert_eq!(mission.targets_reached(), 1);
    assert!(position_gap(&now(&mission).pose, &at) < 1e-3, "{} at {at}", now(&mission).pose);
    let (time_s, _) = lead(&mut mission, &mut at, [1.2, 1.0, 0.5, 1.0]);
    assert!((1.0..5.0).contains(&time_s), "{time_s} s");
    fly(&mut mission, exactly, 2000);
    assert!(mission.is_finished(), "{} targets", mission.targets_reached());
}

#[test]
fn the_path_waits_for_the_vehicle_and_begins_again_where_it_is_released() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    let held = first + Pose::new(4.0, 0.0, 0.0, 0.0);
    for _ in 0..500 {
        mission.advance(&held);
    }
    let standing = now(&mission);
    let lag_m = position_gap(&standing.pose, &held);
    // wait.begin_m is 0.15 and wait.stop_m 0.4.
    assert!((0.38..0.401).contains(&lag_m), "{lag_m} m");
    assert!(standing.rate.norm() < 0.05, "{}", standing.rate);
    let released = first + Pose::new(3.0, 1.0, 0.0, 0.0);
    mission.resume(&released, &Pose::zeros());
    let mut at = released;
    assert!(position_gap(&now(&mission).pose, &at) < 1e-3, "{}", now(&mission).pose);
    lead(&mut mission, &mut at, [1.2, 1.0, 0.5, 1.0]);
}

#[test]
fn the_path_is_looked_ahead_as_it_comes() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    let far = first + Pose::new(1.0, -0.5, 0.2, -2.0);
    mission.advance(&far);
    let mut ahead = vec![Reference::default(); 300];
    mission.fill(0, &[1; 300], &mut ahead);
    assert_eq!(ahead[299], Reference::at_rest(first));
    // From start.within = 0.1 on the vehicle is there.
    let is_on_its_way = |expected: &&Reference| (expected.pose - first).norm() > 0.1;
    for expected in ahead.iter().take_while(is_on_its_way) {
        assert_eq!(now(&mission), *expected);
        mission.advance(&expected.pose);
    }
}

const LIMITS: Limits = Limits {
    speed_mps: 1.0,
    accel_mps2: 0.5,
    speed_up_mps2: 0.5,
    climb_mps: 0.25,
    turn_radps: 0.5,
};

#[test]
fn the_path_begins_from_rest_and_turns_the_short_way() {
    let (from, goal) = (Pose::new(0.0, 0.0, 1.0, 3.0), Pose::new(2.0, 0.0, 1.0, -3.0));
    let carrot = Carrot::new(&from, &goal, &LIMITS);
    assert!(
        (carrot.displacement_w[pose::THETA] - (TAU - 6.0)).abs() < 1e-12,
        "{}",
        carrot.displacement_w
    );
    let start = carrot.reference();
    // The same angle as 3 rad, one turn away.
    assert!((start.pose - from + Pose::new(0.0, 0.0, 0.0, TAU)).norm() < 1e-12, "{}", start.pose);
    assert_eq!(start.rate, Pose::zeros());
    let rate = carrot.after(DT_S).reference().rate;
    assert!((rate.norm() - LIMITS.accel_mps2 * DT_S).abs() < 1e-12, "{rate}");
}

#[test]
fn each_axis_has_its_own_limit_of_the_pace() {
    for (displacement, pace_limit) in [
        (Pose::new(4.0, 0.0, 0.0, 0.0), 1.0 / 4.0),
        (Pose::new(0.0, 0.0, -2.0, 0.0), 0.25 / 2.0),
        (Pose::new(0.1, 0.0, 0.0, -2.0), 0.5 / 2.0),
    ] {
        let carrot = Carrot::new(&Pose::zeros(), &displacement, &LIMITS);
        assert!(
            (carrot.pace_limit - pace_limit).abs() < 1e-12,
            "{displacement}: {}",
            carrot.pace_limit
        );
    }
}

#[test]
fn a_path_of_no_length_has_arrived_and_stays_finite() {
    for (x_m, is_arrived) in [(0.0, true), (ARRIVED, true), (2.0 * ARRIVED, false)] {
        let goal = Pose::new(x_m, 0.0, 0.0, 0.0);
        let carrot = Carrot::new(&Pose::zeros(), &goal, &LIMITS);
        assert_eq!(carrot.is_arrived(), is_arrived, "{x_m} m");
        assert!(carrot.lag_m(&goal).abs() <= x_m, "{x_m} m");
        let after = carrot.after(DT_S);
        assert!(after.is_arrived() && after.reference() == Reference::at_rest(goal), "{after:?}");
    }
}

#[test]
fn a_vehicle_behind_the_reference_is_late_along_the_path_only() {
    let mut carrot = Carrot::new(&Pose::zeros(), &Pose::new(4.0, 0.0, 0.0, 1.0), &LIMITS);
    carrot.left = 0.5;
    for (vehicle, lag_m) in [
        (Pose::new(1.5, 0.0, 0.0, 0.0), 0.5),
        (Pose::new(2.5, 3.0, -1.0, 2.0), -0.5),
        (Pose::new(2.0, 9.0, 1.0, 0.0), 0.0),
    ] {
        assert!((carrot.lag_m(&vehicle) - lag_m).abs() < 1e-12, "{vehicle}");
    }
    carrot.allowed = 0.0;
    assert_eq!(
        carrot.after(DT_S).reference(),
        Reference { rate: Pose::zeros(), ..carrot.reference() }
    );
}
