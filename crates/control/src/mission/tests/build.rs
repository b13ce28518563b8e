//! Tables that are refused.

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
    for (table, key, value, rule) in [
        (square(0.1), "waypoints.corner_m", "0.2", "below follow.reach = 0.2"),
        (square(0.1), "waypoints.corner_m", "-0.1", "finite and >= 0"),
        (square(0.1), "waypoints.limits.accel_max_mps2", "0", positive),
        (square(0.1), "waypoints.limits.speed_max_mps", "-1", positive),
        (square(0.1), "waypoints.limits.climb_max_mps", "0", positive),
        (square(0.1), "waypoints.limits.turn_max_radps", "0", positive),
        (square(0.1), "waypoints.follow.start.within", "0", positive),
        (square(0.1), "waypoints.follow.start.settle_s", "61", "0.0..=60.0"),
        (square(0.1), "waypoints.follow.wait.begin_m", "0", positive),
        (square(0.1), "waypoints.follow.wait.stop_m", "0.15", "above wait.begin_m = 0.15"),
        (eight(), "spline.limits.accel_max_mps2", "0", positive),
        (eight(), "spline.follow.reach", "0", positive),
        (circle(), "circle.limits.speed_max_mps", "0", positive),
        (circle(), "circle.radius_m", "0", "0.05..=50.0"),
        (circle(), "circle.turns", "100", "at most 500 m in all"),
        (circle(), "circle.turns", "-1", positive),
        (timed(), "trajectory.accel_max_mps2", "0", positive),
        (targets(), "targets.reach", "0", positive),
    ] {
        let bad = with(table, key, value.parse().unwrap());
        assert_eq!(refusal(&bad), format!("{key} = {value} violates {rule}"));
    }
}

#[test]
fn bad_waypoints_are_refused() {
    let same = "[0.0, 0.0, 1.3, 0.0] violates at least 0.01 m from the waypoint before";
    let here = json!([0.0, 0.0, 1.3, 0.0]);
    let few = json!([[0.0, 0.0, 1.3, 0.0]]);
    for (table, key, value, message) in [
        (
            square(0.1),
            "waypoints.waypoints",
            few.clone(),
            "number of waypoints = 1 violates 2..=300",
        ),
        (eight(), "spline.waypoints", few, "number of waypoints = 1 violates 3..=300"),
        (square(0.1), "waypoints.waypoints.0.0", json!(600), "length of waypoints = 606.5018687"),
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
        assert_eq!(error, format!("waypoints.waypoints[3][{row}] = NaN violates finite"));
    }
    assert!(Mission::new(&MissionTable::Waypoints(good), 0.0).is_err());
}

#[test]
fn bad_points_are_refused() {
    for (key, value, message) in [
        ("rows.2.0", json!(2.0), "points[2][0] = 2 violates above the time before, 2"),
        ("rows.4.0", json!(4000), "duration of points = 3999 violates at most 3600"),
        ("rows", json!([[0, 0, 0, 0, 0]]), "number of points = 1 violates at least 2"),
    ] {
        let bad = with(timed(), &format!("trajectory.points.{key}"), value);
        assert_eq!(refusal(&bad), format!("trajectory.{message}"));
    }
    let unread = with(timed(), "trajectory.points", json!({ "csv": "eight.csv" }));
    let rule = "trajectory.points.csv = eight.csv violates read before the mission is made";
    assert_eq!(refusal(&unread), rule);
}

#[test]
fn unknown_and_missing_keys_are_refused() {
    let colour = json!({ "targets": { "reach": 0.2, "targets": [], "colour": 1 } });
    assert_eq!(refusal(&colour), "unknown field `colour`, expected `reach` or `targets`");
    let two = json!({ "targets": targets()["targets"], "circle": circle()["circle"] });
    assert!(refusal(&two).contains("expected"), "{}", refusal(&two));
    let mut missing = circle();
    missing["circle"].as_object_mut().unwrap().remove("turns");
    assert_eq!(refusal(&missing), "missing field `turns`");
}
