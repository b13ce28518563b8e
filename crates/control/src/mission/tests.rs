mod build;
mod vehicle;

use serde_json::{Value, json};
use tello_model::rows::{Pose, pose};

use super::*;
use vehicle::fly;

/// Period. s
const DT_S: f64 = 0.02;

fn follow() -> Value {
    json!({
        "reach": 0.2,
        "start": { "within": 0.1, "settle_s": 0.4 },
        "wait": { "begin_m": 0.15, "stop_m": 0.4 }
    })
}

fn limits(accel: f64, speed: f64) -> Value {
    json!({
        "speed_max_mps": speed, "accel_max_mps2": accel,
        "climb_max_mps": 0.5, "turn_max_radps": 1.0
    })
}

/// The square of the thesis, flown with an acceleration of 1 m/s^2 and at most 1.2 m/s.
fn square(corner_m: f64) -> Value {
    json!({ "waypoints": {
        "waypoints": [
            [-2.0, -3.0, 1.3, 0.0], [-2.0, -1.5, 1.3, 0.0], [-0.5, -1.5, 1.3, 0.0],
            [-0.5, -3.0, 1.3, 0.0], [-2.0, -3.0, 1.3, 0.0]
        ],
        "corner_m": corner_m, "heading": "fixed", "limits": limits(1.0, 1.2), "follow": follow()
    }})
}

fn eight() -> Value {
    json!({ "spline": {
        "waypoints": [
            [0.0, 0.0, 1.3, 0.0], [1.0, 1.0, 1.3, 0.0], [2.0, 0.0, 1.3, 0.0], [1.0, -1.0, 1.3, 0.0],
            [0.0, 0.0, 1.3, 0.0], [-1.0, 1.0, 1.3, 0.0], [-2.0, 0.0, 1.3, 0.0],
            [-1.0, -1.0, 1.3, 0.0]
        ],
        "closed": true, "heading": "along", "limits": limits(0.9, 0.8), "follow": follow()
    }})
}

fn circle() -> Value {
    json!({ "circle": {
        "centre": [1.0, 0.0, 1.3, 0.5], "radius_m": 1.0, "begin_rad": 3.0, "turns": 1.5,
        "direction": "clockwise", "heading": "along", "limits": limits(0.9, 0.8), "follow": follow()
    }})
}

fn timed() -> Value {
    json!({ "trajectory": {
        "points": { "rows": [
            [1.0, 0.0, 0.0, 1.0, 3.0], [2.0, 0.5, 0.0, 1.0, -3.0], [3.0, 1.0, 0.0, 1.2, -2.5],
            [5.0, 1.0, 0.0, 1.2, -2.5], [6.5, 1.0, 1.0, 1.0, -2.5]
        ]},
        "accel_max_mps2": 1.0, "follow": follow()
    }})
}

fn targets() -> Value {
    json!({ "targets": { "reach": 0.2, "targets": [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 3.0]] } })
}

fn mission(table: &Value) -> Mission {
    Mission::new(&serde_json::from_value(table.clone()).unwrap(), DT_S).unwrap()
}

fn now(mission: &Mission) -> Reference {
    let mut refs = [Reference::default()];
    mission.fill(0, &mut refs);
    refs[0]
}

/// A mission whose vehicle has just settled: the reference sets off with the next period.
fn set_off(table: &Value) -> Mission {
    let mut mission = mission(table);
    let first = mission.first_pose();
    while mission.targets_reached() == 0 {
        mission.advance(&first);
    }
    mission
}

fn place_gap(a: &Pose, b: &Pose) -> f64 {
    (a - b).fixed_rows::<3>(pose::X).norm()
}

#[test]
fn the_square_takes_the_time_of_the_hand_computation() {
    // Blends of T = 2 * 0.1036 / sin(45 deg) = 0.293 m, entered at sqrt(T sqrt(2) a) = 0.644 m/s and
    // left as fast 0.911 s later. First side: 1.207 m up to 1.189 m/s and down to 0.644 m/s, 1.734 s.
    // Two sides of 0.914 m up to 1.153 m/s and down again, 1.018 s each. Last side as the first, but
    // for the last 0.2 m, which take 0.632 s.
    let expected_s = 1.734 + 3.0 * 0.911 + 2.0 * 1.018 + 1.734 - 0.632;
    let flown = fly(&mut set_off(&square(0.1036)), |reference, _| reference.pose, 1000);
    let gap_s = flown.last().unwrap().at_s - expected_s;
    // One period, and 0.2 % for points that do not lie on the ends of the pieces.
    assert!((-0.02..0.04).contains(&gap_s), "{gap_s} s beside {expected_s} s");
}

#[test]
fn the_reference_stands_until_the_vehicle_has_settled() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    let outside = first + Pose::new(0.08, 0.0, 0.08, 0.0);
    for k in 0..100 {
        // Settling takes 20 periods without a break.
        mission.advance(if k % 20 == 19 { &outside } else { &first });
        assert_eq!((now(&mission), mission.targets_reached()), (Reference::at_rest(first), 0));
    }
    for _ in 0..20 {
        mission.advance(&first);
        assert_eq!(mission.targets_reached(), 0);
    }
    mission.advance(&first);
    assert_eq!(mission.targets_reached(), 1);
}

#[test]
fn a_reference_about_to_set_off_says_so_in_time() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    for _ in 0..5 {
        mission.advance(&first);
    }
    let mut ahead = [Reference::default(); 60];
    mission.fill(0, &mut ahead);
    for (k, expected) in ahead.iter().enumerate() {
        mission.advance(&first);
        assert_eq!(Reference::at_rest(first) == *expected, k <= 15, "{k}");
        if k < 59 && mission.targets_reached() == 1 {
            assert_eq!(now(&mission), ahead[k + 1], "{k}");
            mission.advance(&ahead[k + 1].pose);
            assert_eq!(now(&mission), ahead[k + 2]);
            break;
        }
    }
    mission.advance(&(first + Pose::new(0.2, 0.0, 0.0, 0.0)));
}

#[test]
fn look_ahead_is_what_comes_if_the_vehicle_follows() {
    for table in [square(0.1), square(0.0), eight(), circle(), timed()] {
        let mut mission = set_off(&table);
        let mut ahead = [Reference::default(); 80];
        let mut later = [Reference::default(); 50];
        for _ in 0..5 {
            mission.fill(0, &mut ahead);
            mission.fill(30, &mut later);
            assert_eq!(ahead[30..], later);
            for expected in &ahead {
                assert_eq!(now(&mission), *expected);
                mission.advance(&expected.pose);
            }
        }
    }
}

#[test]
fn references_are_smooth_and_keep_the_limits() {
    for (table, accel, speed) in [
        (square(0.1), 1.0, 1.2),
        (square(0.0), 1.0, 1.2),
        (eight(), 0.9, 0.8),
        (circle(), 0.9, 0.8),
    ] {
        let mut before = None;
        fly(
            &mut set_off(&table),
            |reference, _| {
                let Reference { pose: at, rate } = *reference;
                if let Some(Reference { pose: at_before, rate: rate_before }) = before {
                    // The mean rate of a period is that of its ends within the change of a corner.
                    let moved = (at - at_before) / DT_S - 0.5 * (rate + rate_before);
                    assert!(moved.fixed_rows::<3>(pose::X).norm() < 0.01, "{moved}");
                    let accel_mps2 = place_gap(&rate, &rate_before) / DT_S;
                    assert!(accel_mps2 < 1.02 * accel, "{accel_mps2} at {at}");
                    assert!(rate.fixed_rows::<3>(pose::X).norm() < speed + 1e-3, "{rate}");
                    let turn = (at - at_before)[pose::THETA] / DT_S;
                    assert!(turn.abs() < 1.0 + 1e-9, "{turn} rad/s at {at}");
                }
                before = Some(*reference);
                at
            },
            2000,
        );
    }
}

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
    let lag_m = place_gap(&standing.pose, &held);
    assert!(standing.rate.norm() < 1e-3, "{}", standing.rate);
    assert!((0.35..0.405).contains(&lag_m), "{lag_m} m");
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
    let beyond = first + Pose::new(0.9, 1.5, 0.0, 0.0);
    mission.resume(&beyond, &Pose::zeros());
    assert_eq!(mission.targets_reached(), 1);
    let corner = now(&mission).pose - mission.target();
    assert!(corner.norm() < 0.11, "{corner}");
    // An estimate that is no number moves nothing.
    mission.resume(&Pose::from_element(f64::NAN), &Pose::from_element(f64::NAN));
    assert!(now(&mission).pose.iter().all(|entry| entry.is_finite()));
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
    let expected =
        fly(&mut early.clone(), |reference, _| reference.pose, 5000).last().unwrap().at_s;
    let whole = fly(&mut set_off(&eight()), |reference, _| reference.pose, 5000);
    assert!((whole.last().unwrap().at_s - expected).abs() < 0.3, "{expected}");
}

#[test]
fn a_missed_corner_is_flown_to_before_the_path_goes_on() {
    let mut mission = set_off(&square(0.1));
    let corner = mission.outline()[1];
    let mut has_returned = false;
    let flown = fly(
        &mut mission,
        |reference, at| {
            has_returned |= reference.pose == corner;
            // Pushed aside by 0.3 m around the corner until the reference comes back.
            let is_near = place_gap(at, &corner) < 0.5 && !has_returned;
            reference.pose
                + Pose::new(
                    if is_near { -0.3 } else { 0.0 },
                    if is_near { 0.3 } else { 0.0 },
                    0.0,
                    0.0,
                )
        },
        2000,
    );
    assert!(has_returned && mission.is_finished(), "{:?}", flown.last());
}

#[test]
fn every_mission_ends_once_the_vehicle_follows_again() {
    for (index, table) in
        [targets(), square(0.1), square(0.0), eight(), circle(), timed()].iter().enumerate()
    {
        for seed in 0..30 {
            let mut mission = set_off_or_start(table);
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

fn set_off_or_start(table: &Value) -> Mission {
    mission(table)
}

#[test]
fn the_heading_is_continuous_and_takes_the_short_way() {
    for (table, turned) in [(timed(), 3.783), (circle(), -3.0 * std::f64::consts::PI)] {
        let mut mission = set_off(&table);
        let mut theta = mission.first_pose()[pose::THETA];
        let begin = theta;
        fly(
            &mut mission,
            |reference, _| {
                assert!((reference.pose[pose::THETA] - theta).abs() < 0.03, "{theta}");
                theta = reference.pose[pose::THETA];
                reference.pose
            },
            2000,
        );
        let gap = theta - begin - turned;
        assert!(
            gap.abs() < 1e-2 || (turned - 3.783).abs() < 1e-9 && (gap + 3.0).abs() < 1e-2,
            "{gap}"
        );
    }
}

#[test]
fn missions_tell_what_they_are() {
    let (points, path, curve) = (mission(&targets()), mission(&square(0.1)), mission(&circle()));
    assert!(points.is_pointwise() && !path.is_pointwise() && !curve.is_pointwise());
    assert_eq!([&points, &path, &curve].map(Mission::targets_count), [2, 5, 2]);
    assert_eq!(path.outline().len(), 5);
    assert_eq!(path.outline()[2], Pose::new(-0.5, -1.5, 1.3, 0.0));
    let outline = curve.outline();
    let length_m: f64 = outline.windows(2).map(|pair| place_gap(&pair[0], &pair[1])).sum();
    assert!((length_m - 3.0 * std::f64::consts::PI).abs() < 1e-3, "{length_m} m");
    assert_eq!(outline[0], curve.first_pose());
}
