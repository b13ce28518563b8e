pub(super) mod vehicle;

use std::f64::consts::PI;

use horizon_model::check::maximum;
use horizon_model::rows::{Pose, pose};
use serde_json::{Value, json};

use super::*;
use vehicle::fly;

/// Period. s
pub(super) const DT_S: f64 = 0.02;

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
pub(super) fn square(corner_m: f64) -> Value {
    json!({ "waypoints": {
        "waypoints": [
            [-2.0, -3.0, 1.3, 0.0], [-2.0, -1.5, 1.3, 0.0], [-0.5, -1.5, 1.3, 0.0],
            [-0.5, -3.0, 1.3, 0.0], [-2.0, -3.0, 1.3, 0.0]
        ],
        "corner_m": corner_m, "heading": "fixed", "limits": limits(1.0, 1.2), "follow": follow()
    }})
}

pub(super) fn eight() -> Value {
    json!({ "spline": {
        "waypoints": [
            [0.0, 0.0, 1.3, 0.0], [1.0, 1.0, 1.3, 0.0], [2.0, 0.0, 1.3, 0.0], [1.0, -1.0, 1.3, 0.0],
            [0.0, 0.0, 1.3, 0.0], [-1.0, 1.0, 1.3, 0.0], [-2.0, 0.0, 1.3, 0.0],
            [-1.0, -1.0, 1.3, 0.0]
        ],
        "closed": true, "heading": "along", "limits": limits(0.9, 0.8), "follow": follow()
    }})
}

pub(super) fn circle() -> Value {
    json!({ "circle": {
        "centre": [1.0, 0.0, 1.3, 0.5], "radius_m": 1.0, "begin_rad": 3.0, "turns": 1.5,
        "direction": "clockwise", "heading": "along", "limits": limits(0.9, 0.8), "follow": follow()
    }})
}

pub(super) fn timed() -> Value {
    json!({ "trajectory": {
        "points": { "rows": [
            [1.0, 0.0, 0.0, 1.0, 3.0], [2.0, 0.5, 0.0, 1.0, -3.0], [3.0, 1.0, 0.0, 1.2, -2.5],
            [5.0, 1.0, 0.0, 1.2, -2.5], [6.5, 1.0, 1.0, 1.0, -2.5]
        ]},
        "accel_max_mps2": 1.0, "follow": follow()
    }})
}

pub(super) fn targets() -> Value {
    json!({ "targets": { "reach": 0.2, "targets": [[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 3.0]] } })
}

pub(super) fn mission(table: &Value) -> Mission {
    Mission::new(&serde_json::from_value(table.clone()).unwrap(), DT_S).unwrap()
}

pub(super) fn now(mission: &Mission) -> Reference {
    let mut refs = [Reference::default()];
    mission.fill(0, &[1], &mut refs);
    refs[0]
}

/// A mission whose vehicle has just settled: the reference sets off with the next period.
pub(super) fn set_off(table: &Value) -> Mission {
    let mut mission = mission(table);
    let first = mission.first_pose();
    while mission.targets_reached() == 0 {
        mission.advance(&first);
    }
    mission
}

/// A vehicle that is where the reference is.
pub(super) fn exactly(reference: &Reference, _: &Pose) -> Pose {
    reference.pose
}

pub(super) fn position_gap(a: &Pose, b: &Pose) -> f64 {
    (a - b).fixed_rows::<3>(pose::X).norm()
}

#[test]
fn the_square_takes_the_time_of_the_hand_computation() {
    // Blends of T = 2 * 0.1036 / sin(45 deg) = 0.293 m, entered at sqrt(T sqrt(2) a) = 0.644 m/s and
    // left as fast 0.911 s later. First side: 1.207 m up to 1.189 m/s and down to 0.644 m/s, 1.734 s.
    // Two sides of 0.914 m up to 1.153 m/s and down again, 1.018 s each. Last side as the first, but
    // for the last 0.2 m, which take 0.632 s.
    let expected_s = 1.734 + 3.0 * 0.911 + 2.0 * 1.018 + 1.734 - 0.632;
    let gap_s = fly(&mut set_off(&square(0.1036)), exactly, 1000) - expected_s;
    // One period, and 0.2 % for points that do not lie on the ends of the pieces.
    assert!((-0.02..0.04).contains(&gap_s), "{gap_s} s beside {expected_s} s");
}

#[test]
fn the_reference_stands_until_the_vehicle_has_settled() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    let outside = first + Pose::new(0.15, 0.0, 0.15, 0.0);
    // Too far to begin settling, near enough to go on with it: the plan begins to speed up before the path begins.
    let near = first + Pose::new(0.08, 0.0, 0.08, 0.0);
    for _ in 0..50 {
        mission.advance(&near);
    }
    assert!(position_gap(&now(&mission).pose, &first) < 1e-3, "{:?}", now(&mission));
    for k in 0..100 {
        // Settling takes 20 periods without a break.
        mission.advance(match k % 20 {
            19 => &outside,
            0 => &first,
            _ => &near,
        });
        assert_eq!(mission.targets_reached(), 0);
        assert!(k > 18 || now(&mission) == Reference::at_rest(first), "{:?}", now(&mission));
    }
    // A vehicle that has left is led back.
    assert!(position_gap(&now(&mission).pose, &outside) < 1e-3, "{:?}", now(&mission));
    for _ in 0..20 {
        mission.advance(&first);
        assert_eq!(now(&mission), Reference::at_rest(first));
        assert_eq!(mission.targets_reached(), 0);
    }
    mission.advance(&first);
    assert_eq!(mission.targets_reached(), 1);
}

#[test]
fn look_ahead_is_what_comes_if_the_vehicle_follows() {
    for table in [square(0.1), square(0.0), eight(), circle(), timed()] {
        let mut mission = set_off(&table);
        let mut ahead = [Reference::default(); 80];
        let mut later = [Reference::default(); 50];
        for _ in 0..5 {
            mission.fill(0, &[1; 80], &mut ahead);
            mission.fill(30, &[1; 50], &mut later);
            assert_eq!(ahead[30..], later);
            let mut by_stage = [Reference::default(); 3];
            mission.fill(30, &[1, 9, 40], &mut by_stage);
            assert_eq!(by_stage, [ahead[30], ahead[39], ahead[79]]);
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
                    let accel_mps2 = position_gap(&rate, &rate_before) / DT_S;
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
pub(super) fn missions_tell_what_they_are() {
    let (points, path, curve) = (mission(&targets()), mission(&square(0.1)), mission(&circle()));
    assert!(points.is_pointwise() && !path.is_pointwise() && !curve.is_pointwise());
    assert_eq!([&points, &path, &curve].map(Mission::targets_count), [2, 5, 2]);
    assert_eq!(path.outline().len(), 5);
    assert_eq!(path.outline()[2], Pose::new(-0.5, -1.5, 1.3, 0.0));
    let outline = curve.outline();
    let length_m: f64 = outline.windows(2).map(|pair| position_gap(&pair[0], &pair[1])).sum();
    assert!((length_m - 3.0 * PI).abs() < 1e-3, "{length_m} m");
    assert_eq!(outline[0], curve.first_pose());
}

#[test]
fn a_reference_about_to_set_off_shows_it_in_time() {
    let mut mission = mission(&square(0.1));
    let first = mission.first_pose();
    for _ in 0..5 {
        mission.advance(&first);
    }
    let mut ahead = [Reference::default(); 40];
    mission.fill(0, &[1; 80], &mut ahead);
    for (k, expected) in ahead.iter().enumerate() {
        assert_eq!(now(&mission), *expected, "{k} periods later");
        // The 21st period in a row is the one that sets off; 5 are over.
        assert_eq!(expected.rate == Pose::zeros(), k < 16, "{k} periods later");
        mission.advance(&expected.pose);
    }
    assert_eq!(mission.targets_reached(), 1);
}

#[test]
fn the_heading_is_continuous_and_takes_the_short_way() {
    // 3.0, -3.0 and -2.5 rad are 0.783 rad in all; the circle is one and a half turns to the right.
    for (table, expected) in [(timed(), 2.0 * PI - 5.5), (circle(), -3.0 * PI)] {
        let mut mission = set_off(&table);
        let mut thetas = vec![mission.first_pose()[pose::THETA]];
        let watch = |reference: &Reference, _: &Pose| {
            thetas.push(reference.pose[pose::THETA]);
            reference.pose
        };
        fly(&mut mission, watch, 2000);
        let steps = thetas.windows(2).map(|pair| (pair[1] - pair[0]).abs());
        // No motion asks for more than 1.1 rad/s.
        assert!(steps.fold(0.0, maximum) < 1.1 * DT_S);
        let turned = thetas[thetas.len() - 1] - thetas[0];
        assert!((turned - expected).abs() < 1e-9, "{turned} rad instead of {expected}");
    }
}

#[test]
fn a_circle_that_begins_nowhere_or_has_no_length_is_refused_by_its_own_key() {
    for (key, value) in [("begin_rad", 1e300), ("turns", 1e-300), ("turns", 1e300)] {
        let mut circle = circle();
        circle["circle"][key] = json!(value);
        let table: MissionTable = serde_json::from_value(circle).unwrap();
        let error = Mission::new(&table, 0.02).unwrap_err();
        assert_eq!(error.key, format!("circle.{key}"));
    }
}
