//! Lists of waypoints, laps, and limits of what a table may ask for.

use serde_json::{Value, json};

use super::super::tests::*;
use super::super::*;
use super::*;

fn with_laps(mut table: Value, kind: &str, laps: u32) -> Value {
    table[kind]["laps"] = json!(laps);
    table
}

#[test]
fn laps_repeat_the_path_without_a_stop() {
    let lap_s = mission(&square(0.1)).survey().duration_s;
    for (table, kind) in [(square(0.1), "waypoints"), (eight(), "spline")] {
        let (one, three) = (mission(&table), mission(&with_laps(table, kind, 3)));
        let (one, three) = (one.survey(), three.survey());
        assert!((three.length_m / one.length_m - 3.0).abs() < 0.05, "{kind}: {three:?}");
        // Three laps in one go save two starts and two stops.
        let saved_s = 3.0 * one.duration_s - three.duration_s;
        assert!((0.5..4.0).contains(&saved_s), "{kind}: {saved_s} s saved of {lap_s} s a lap");
        assert_eq!((one.low_w, one.high_w), (three.low_w, three.high_w), "{kind}");
    }
    assert_eq!(mission(&with_laps(square(0.1), "waypoints", 3)).targets_count(), 13);
}

#[test]
fn a_path_that_does_not_end_where_it_begins_has_no_laps() {
    let mut open = with_laps(square(0.1), "waypoints", 2);
    open["waypoints"]["waypoints"].as_array_mut().unwrap().pop();
    let mut line = with_laps(eight(), "spline", 2);
    line["spline"]["closed"] = json!(false);
    let none = with_laps(square(0.1), "waypoints", 0);
    for (table, message) in [
        (open, "waypoints.laps = 2: expected 1 for a path whose last waypoint is not its first"),
        (line, "spline.laps = 2: expected 1 for a path whose last waypoint is not its first"),
        (none, "waypoints.laps = 0: expected 1..=100"),
    ] {
        let table = serde_json::from_value(table).unwrap();
        let error = Mission::new(&table, DT_S).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}

#[test]
fn there_are_at_most_a_hundred_laps_and_three_hundred_waypoints() {
    let mut closed = vec![Pose::zeros(), Pose::new(1.0, 0.0, 0.0, 0.0), Pose::zeros()];
    assert!(repeat(&mut closed.clone(), LAPS_MAX + 1).is_err());
    repeat(&mut closed, LAPS_MAX).unwrap();
    assert_eq!(closed.len(), 2 * 100 + 1);
    let line = |count: u32| (0..count).map(|k| [f64::from(k), 0.0, 1.0, 0.0]).collect::<Vec<_>>();
    assert!(check_waypoints(&line(300), 2).is_ok() && check_waypoints(&line(301), 2).is_err());
    assert!(check_waypoints(&line(3), 3).is_ok() && check_waypoints(&line(2), 3).is_err());
}

#[test]
fn waypoints_are_a_centimetre_apart_by_their_places_alone() {
    let apart = |x_m: f64, theta_rad: f64| {
        check_apart(1, &Pose::new(x_m, 0.0, 0.0, theta_rad), &Pose::zeros()).is_ok()
    };
    assert!(apart(APART_MIN_M, 0.0) && apart(-APART_MIN_M, 0.0));
    assert!(!apart(APART_MIN_M.next_down(), 0.0) && !apart(0.0, 3.0));
}

#[test]
fn each_pose_has_its_key_and_curves_have_none() {
    let read = |table: &Value| serde_json::from_value::<MissionTable>(table.clone()).unwrap();
    let keys = |table: &Value| read(table).poses().map(|(key, _)| key).collect::<Vec<_>>();
    assert_eq!(keys(&targets()), ["targets.targets[0]", "targets.targets[1]"]);
    assert_eq!(keys(&square(0.1))[4], "waypoints.waypoints[4]");
    assert_eq!(keys(&eight())[7], "spline.waypoints[7]");
    assert!(keys(&circle()).is_empty() && keys(&timed()).is_empty());
    assert_eq!(read(&square(0.1)).poses().nth(2).unwrap().1, Pose::new(-0.5, -1.5, 1.3, 0.0));
    assert_eq!(read(&with_laps(eight(), "spline", 3)).laps(), 3);
    assert_eq!(read(&circle()).laps(), 1);
}

#[test]
fn speed_may_rise_as_fast_as_it_falls_and_places_to_stand_lie_behind_those_to_slow_down() {
    let limits = |speed_up_mps2| {
        let table = LimitTable { speed_up_max_mps2: speed_up_mps2, ..LimitTable::default() };
        table.check().map(|limits| limits.speed_up_mps2)
    };
    let accel_mps2 = LimitTable::default().accel_max_mps2;
    assert_eq!(limits(None), Ok(accel_mps2));
    assert_eq!(limits(Some(accel_mps2)), Ok(accel_mps2));
    for refused in [accel_mps2.next_down(), f64::NAN] {
        assert_eq!(limits(Some(refused)).unwrap_err().key, "speed_up_max_mps2");
    }
    let aside = |begin_m, stop_m| {
        let mut table = FollowTable::default();
        table.wait.aside_m = Some([begin_m, stop_m]);
        table.check().map(|_| ()).map_err(|error| error.key)
    };
    assert_eq!(aside(0.1, 0.1_f64.next_up()), Ok(()));
    assert_eq!(aside(0.1, 0.1), Err("wait.aside_m[1]".to_owned()));
    assert_eq!(aside(0.0, 0.1), Err("wait.aside_m[0]".to_owned()));
}

#[test]
fn the_names_are_those_that_settings_may_have() {
    let error = serde_json::from_str::<MissionTable>(r#"{ "": {} }"#).unwrap_err().to_string();
    let names = MissionTable::NAMES.iter().map(|name| format!("`{name}`"));
    let names = names.collect::<Vec<_>>().join(", ");
    assert!(error.contains(&format!("expected one of {names} at")), "{error}");
}
