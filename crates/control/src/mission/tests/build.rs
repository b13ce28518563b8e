//! Tables that are refused.

use super::*;

fn refusal(mut table: Value, path: &str, value: Value) -> String {
    *table.pointer_mut(path).unwrap() = value;
    match serde_json::from_value::<MissionTable>(table) {
        Ok(table) => Mission::new(&table, DT_S).unwrap_err().to_string(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn each_bad_value_is_refused_with_key_value_and_rule() {
    for (table, path, value, message) in [
        (
            square(0.1),
            "/waypoints/corner_m",
            json!(0.2),
            "waypoints.corner_m = 0.2 violates below follow.reach = 0.2",
        ),
        (
            square(0.1),
            "/waypoints/corner_m",
            json!(-0.1),
            "waypoints.corner_m = -0.1 violates finite and >= 0",
        ),
        (
            square(0.1),
            "/waypoints/limits/accel_max_mps2",
            json!(0.0),
            "waypoints.limits.accel_max_mps2 = 0 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/limits/speed_max_mps",
            json!(-1.0),
            "waypoints.limits.speed_max_mps = -1 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/limits/climb_max_mps",
            json!(0.0),
            "waypoints.limits.climb_max_mps = 0 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/limits/turn_max_radps",
            json!(0.0),
            "waypoints.limits.turn_max_radps = 0 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/follow/reach",
            json!(0.0),
            "waypoints.corner_m = 0.1 violates below follow.reach = 0",
        ),
        (
            square(0.1),
            "/waypoints/follow/start/within",
            json!(0.0),
            "waypoints.follow.start.within = 0 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/follow/start/settle_s",
            json!(61.0),
            "waypoints.follow.start.settle_s = 61 violates 0.0..=60.0",
        ),
        (
            square(0.1),
            "/waypoints/follow/wait/begin_m",
            json!(0.0),
            "waypoints.follow.wait.begin_m = 0 violates finite and > 0",
        ),
        (
            square(0.1),
            "/waypoints/follow/wait/stop_m",
            json!(0.15),
            "waypoints.follow.wait.stop_m = 0.15 violates above wait.begin_m = 0.15",
        ),
        (
            square(0.1),
            "/waypoints/waypoints",
            json!([[0.0, 0.0, 1.0, 0.0]]),
            "waypoints.number of waypoints = 1 violates 2..=300",
        ),
        (
            square(0.1),
            "/waypoints/waypoints/1",
            json!([-2.0, -3.0, 1.3, 1.0]),
            "waypoints.waypoints[1] = [-2.0, -3.0, 1.3, 1.0] violates at least 0.01 m from the waypoint before",
        ),
        (
            square(0.1),
            "/waypoints/waypoints/1/0",
            json!(1e4),
            "waypoints.length of waypoints = 20005.500112477504 violates at most 500 m",
        ),
        (
            eight(),
            "/spline/waypoints/7",
            json!([0.0, 0.0, 1.3, 0.0]),
            "spline.waypoints[7] = [0.0, 0.0, 1.3, 0.0] violates at least 0.01 m from the waypoint before",
        ),
        (
            eight(),
            "/spline/waypoints",
            json!([[0.0, 0.0, 1.3, 0.0], [1.0, 0.0, 1.3, 0.0]]),
            "spline.number of waypoints = 2 violates 3..=300",
        ),
        (circle(), "/circle/radius_m", json!(0.0), "circle.radius_m = 0 violates 0.05..=50.0"),
        (
            circle(),
            "/circle/turns",
            json!(100.0),
            "circle.turns = 100 violates at most 500 m in all",
        ),
        (circle(), "/circle/turns", json!(-1.0), "circle.turns = -1 violates finite and > 0"),
        (
            timed(),
            "/trajectory/points/rows/2/0",
            json!(2.0),
            "trajectory.points[2][0] = 2 violates above the time before, 2",
        ),
        (
            timed(),
            "/trajectory/points/rows/4/0",
            json!(4000.0),
            "trajectory.duration of points = 3999 violates at most 3600",
        ),
        (
            timed(),
            "/trajectory/points/rows",
            json!([[0.0, 0.0, 0.0, 0.0, 0.0]]),
            "trajectory.number of points = 1 violates at least 2",
        ),
        (
            timed(),
            "/trajectory/points",
            json!({ "csv": "eight.csv" }),
            "trajectory.points.csv = eight.csv violates read before the mission is made",
        ),
        (
            timed(),
            "/trajectory/accel_max_mps2",
            json!(0.0),
            "trajectory.accel_max_mps2 = 0 violates finite and > 0",
        ),
        (targets(), "/targets/reach", json!(0.0), "targets.reach = 0 violates finite and > 0"),
        (
            targets(),
            "/targets",
            json!({ "reach": 0.2, "targets": [], "colour": 1 }),
            "unknown field `colour`, expected `reach` or `targets`",
        ),
    ] {
        assert_eq!(refusal(table, path, value), message);
    }
}

#[test]
fn a_number_that_is_none_is_refused_in_every_row() {
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
