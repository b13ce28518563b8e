//! Tables that are refused.

use horizon_model::rows::{Pose, pose};
use serde_json::{Value, json};

use super::super::tests::vehicle::fly;
use super::super::tests::*;
use super::super::tests::{circle, timed};
use super::super::*;
use super::*;

fn refusal(table: &Value) -> String {
    match serde_json::from_value::<MissionTable>(table.clone()) {
        Ok(table) => Mission::new(&table, DT_S).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    }
}

/// `table` with `value` at the dotted `key`.
fn with(mut table: Value, key: &str, value: Value) -> Value {
    *table.pointer_mut(&format!("/{}", key.replace('.', "/"))).unwrap() = value;
    table
}

#[test]
fn each_bad_value_is_refused_with_key_value_and_rule() {
    let positive = "finite and > 0";
    let (limit, near) = ("finite and >= 0.01", "finite and >= 0.02");
    for (table, key, value, rule) in [
        (square(0.1), "waypoints.corner_m", "0.2", "below follow.reach = 0.2"),
        (square(0.1), "waypoints.corner_m", "-0.1", "finite and >= 0"),
        (square(0.1), "waypoints.limits.accel_max_mps2", "0", limit),
        (square(0.1), "waypoints.limits.speed_max_mps", "-1", limit),
        (square(0.1), "waypoints.limits.climb_max_mps", "0", limit),
        (square(0.1), "waypoints.limits.turn_max_radps", "0", limit),
        (square(0.1), "waypoints.follow.start.within", "0.019", near),
        (square(0.1), "waypoints.follow.start.settle_s", "61", "0.0..=60.0"),
        (square(0.1), "waypoints.follow.wait.begin_m", "0", positive),
        (square(0.1), "waypoints.follow.wait.stop_m", "0.15", "above wait.begin_m = 0.15"),
        (eight(), "spline.limits.accel_max_mps2", "0", limit),
        (eight(), "spline.follow.reach", "0.001", "0.02..=2.0"),
        (eight(), "spline.follow.reach", "20", "0.02..=2.0"),
        (circle(), "circle.limits.speed_max_mps", "0", limit),
        (circle(), "circle.radius_m", "0", "0.05..=50.0"),
        (circle(), "circle.turns", "100", "at most 500 m in all"),
        (circle(), "circle.turns", "-1", "0.01..=1600.0"),
        (timed(), "trajectory.accel_max_mps2", "0", limit),
        (targets(), "targets.reach", "0", near),
    ] {
        let bad = with(table, key, value.parse().unwrap());
        assert_eq!(refusal(&bad), format!("{key} = {value}: expected {rule}"));
    }
}

#[test]
fn bad_waypoints_are_refused() {
    let same = "[0.0, 0.0, 1.3, 0.0]: expected at least 0.01 m from the waypoint before";
    let here = json!([0.0, 0.0, 1.3, 0.0]);
    let few = json!([[0.0, 0.0, 1.3, 0.0]]);
    for (table, key, value, message) in [
        (square(0.1), "waypoints.waypoints", few.clone(), "waypoints = 1: expected 2..=300 poses"),
        (eight(), "spline.waypoints", few, "waypoints = 1: expected 3..=300 poses"),
        (square(0.1), "waypoints.waypoints.0.0", json!(600), "waypoints = 606.50 m: expected"),
        (eight(), "spline.waypoints.1", here.clone(), &format!("waypoints[1] = {same}")),
        // The last waypoint of a closed spline is followed by the first.
        (eight(), "spline.waypoints.7", here, &format!("waypoints[7] = {same}")),
    ] {
        let refusal = refusal(&with(table, key, value));
        assert!(refusal.contains(message), "{refusal}");
    }
    let MissionTable::Waypoints(good) = serde_json::from_value(square(0.1)).unwrap() else {
        panic!("not waypoints")
    };
    for row in 0..pose::COUNT {
        let mut bad = good.clone();
        bad.waypoints[3][row] = f64::NAN;
        let error = Mission::new(&MissionTable::Waypoints(bad), DT_S).unwrap_err().to_string();
        assert_eq!(error, format!("waypoints.waypoints[3][{row}] = NaN: expected finite"));
    }
    assert!(Mission::new(&MissionTable::Waypoints(good), 0.0).is_err());
}

#[test]
fn bad_points_are_refused() {
    for (key, value, message) in [
        ("rows.2.0", json!(2.0), "points[2][0] = 2: expected above the time before, 2"),
        ("rows.4.0", json!(4000), "points = 3999 s: expected at most 3600 s in all"),
        ("rows", json!([[0, 0, 0, 0, 0]]), "points = 1: expected at least 2 rows"),
    ] {
        let bad = with(timed(), &format!("trajectory.points.{key}"), value);
        assert_eq!(refusal(&bad), format!("trajectory.{message}"));
    }
    let unread = with(timed(), "trajectory.points", json!({ "csv": "eight.csv" }));
    let rule = "trajectory.points.csv = eight.csv: expected rows of `points`: a CSV file is read only from a mission file";
    assert_eq!(refusal(&unread), rule);
}

#[test]
fn a_path_that_takes_hours_is_refused_by_the_limit_that_costs_the_time() {
    let tower = json!([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 41.0, 0.0]]);
    let zigzag: Vec<Value> = (0..300).map(|k| json!([f64::from(k % 2), 0.0, 1.0, 0.0])).collect();
    let coil = with(circle(), "circle.turns", json!(50));
    for (table, key, value) in [
        (with(circle(), "circle.turns", json!(50)), "circle.limits.speed_max_mps", "0.05"),
        (
            with(square(0.0), "waypoints.waypoints", json!(zigzag)),
            "waypoints.limits.accel_max_mps2",
            "0.01",
        ),
        (with(square(0.0), "waypoints.waypoints", tower), "waypoints.limits.climb_max_mps", "0.01"),
        (coil, "circle.limits.turn_max_radps", "0.01"),
    ] {
        let refusal = refusal(&with(table, key, value.parse().unwrap()));
        let expected = format!("{key} = {value}: expected at most 3600 s for the path instead of ");
        assert!(refusal.starts_with(&expected), "{refusal}");
    }
}

#[test]
fn splines_that_turn_back_on_themselves_are_refused_or_flown_in_a_time() {
    // Waypoint 2 is nearer and nearer to the return from waypoint 1.
    let mut refused = 0;
    for exponent in 0..=120 {
        let offset_m = 0.3 * 10_f64.powf(-0.1 * f64::from(exponent));
        for end_m in [-0.3, 0.0, 0.4] {
            let mut table = eight();
            table["spline"]["closed"] = json!(false);
            table["spline"]["waypoints"] =
                json!([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0], [end_m, offset_m, 1.0, 0.0]]);
            let table = serde_json::from_value(table).unwrap();
            match Mission::new(&table, DT_S) {
                Ok(mut mission) => {
                    let first = mission.first_pose();
                    while mission.targets_reached() == 0 {
                        mission.advance(&first);
                    }
                    let flown_s = fly(&mut mission, vehicle_at, 2000);
                    assert!(flown_s < 15.0, "{flown_s} s with {offset_m} m, {end_m} m");
                }
                Err(error) => {
                    refused += 1;
                    assert!(error.key.starts_with("spline.waypoints["), "{error}");
                }
            }
        }
    }
    assert!((1..363).contains(&refused), "{refused} refused");
}

/// A vehicle that is where the reference is, which is some place.
fn vehicle_at(reference: &Reference, _: &Pose) -> Pose {
    let entries = reference.pose.iter().chain(reference.rate.iter());
    assert!(entries.into_iter().all(|entry| entry.is_finite()), "{reference:?}");
    reference.pose
}

#[test]
fn unknown_and_missing_keys_are_refused() {
    let colour = json!({ "targets": { "reach": 0.2, "targets": [], "colour": 1 } });
    assert_eq!(refusal(&colour), "unknown field `colour`, expected `reach` or `targets`");
    let two = json!({ "targets": targets()["targets"], "circle": circle()["circle"] });
    assert!(refusal(&two).contains("expected"), "{}", refusal(&two));
    let mut missing = circle();
    missing["circle"].as_object_mut().unwrap().remove("radius_m");
    assert_eq!(refusal(&missing), "missing field `radius_m`");
}

#[test]
fn times_rise_above_all_before_them() {
    let rows = [0.0, 5.0, 5.0, 3.0, 4.0, 6.0].map(|t_s| [t_s, 0.0, 0.0, 1.0, 0.0]);
    let keys: Vec<String> = falling_times(&rows).map(|refused| refused.key).collect();
    assert_eq!(keys, ["points[2][0]", "points[3][0]", "points[4][0]"]);
}

#[test]
fn a_path_may_have_the_longest_length_and_no_more() {
    let line =
        |x_m: f64| [Pose::zeros(), Pose::new(300.0, 0.0, 0.0, 9.0), Pose::new(x_m, 0.0, 0.0, 0.0)];
    assert!(check_length(&line(LENGTH_MAX_M)).is_ok());
    assert!(check_length(&line(LENGTH_MAX_M + 1e-6)).is_err());
    assert!(check_length(&line(99.0)).is_err(), "there and back");
}

#[test]
fn a_waypoint_is_left_at_the_first_node_out_of_its_reach_or_at_the_end() {
    let poses: Vec<Pose> = (0..5).map(|k| Pose::new(f64::from(k), 0.0, 1.0, 0.0)).collect();
    let times_s: Vec<f64> = (0..5).map(f64::from).collect();
    let trajectory = Trajectory::through(&times_s, &poses);
    let nodes = trajectory.nodes();
    let left = leave(&trajectory, 0, &poses[0], 1.5);
    let x_m = |node: usize| nodes[node].pose[pose::X];
    assert!(x_m(left) > 1.5 && x_m(left - 1) <= 1.5, "{} m", x_m(left));
    assert_eq!(leave(&trajectory, 0, &poses[0], 4.0), nodes.len() - 1);
    assert_eq!(leave(&trajectory, 0, &poses[0], 9.0), nodes.len() - 1);
}

#[test]
fn the_path_to_a_trajectory_has_the_speed_of_its_fastest_point_and_a_least_one() {
    let led = |x_m, theta_rad| {
        let poses = [
            Pose::zeros(),
            Pose::new(x_m, 0.0, 0.0, theta_rad),
            Pose::new(2.0 * x_m, 0.0, 0.0, 2.0 * theta_rad),
        ];
        own_limits(&Trajectory::through(&[0.0, 1.0, 2.0], &poses), 0.7)
    };
    let calm = led(0.01, 0.0);
    assert_eq!(
        (calm.speed_mps, calm.turn_radps, calm.climb_mps),
        (SLOWEST.0, SLOWEST.1, SLOWEST.0)
    );
    assert_eq!((calm.accel_mps2, calm.speed_up_mps2), (0.7, 0.7));
    let fast = led(1.0, -2.0);
    assert!(fast.speed_mps >= 1.0 && fast.turn_radps >= 2.0, "{fast:?}");
}
