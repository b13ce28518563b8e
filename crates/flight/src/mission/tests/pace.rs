//! Laps, and missions flown slower or faster than they are written.

use crate::Start;
use crate::cycle::FlightTable;
use crate::drone::Protocol;

use super::*;

fn mission(table: &Value) -> Mission {
    Mission::new(&serde_json::from_value(table.clone()).unwrap(), DT_S).unwrap()
}

fn with_laps(mut table: Value, kind: &str, laps: u32) -> Value {
    table[kind]["laps"] = json!(laps);
    table
}

#[test]
fn laps_repeat_the_way_without_a_stop() {
    let lap_s = mission(&square(0.1)).survey().duration_s;
    for (table, kind) in [(square(0.1), "waypoints"), (eight(), "spline")] {
        let (one, three) = (mission(&table), mission(&with_laps(table, kind, 3)));
        let (one, three) = (one.survey(), three.survey());
        assert!((three.length_m / one.length_m - 3.0).abs() < 0.05, "{kind}: {three:?}");
        // Two of three times the speed is neither taken up nor given up.
        let saved_s = 3.0 * one.duration_s - three.duration_s;
        assert!((0.5..4.0).contains(&saved_s), "{kind}: {saved_s} s saved of {lap_s} s a lap");
        assert_eq!((one.low_w, one.high_w), (three.low_w, three.high_w), "{kind}");
    }
    assert_eq!(mission(&with_laps(square(0.1), "waypoints", 3)).targets_count(), 13);
}

#[test]
fn a_way_that_does_not_end_where_it_begins_has_no_laps() {
    let mut open = with_laps(square(0.1), "waypoints", 2);
    open["waypoints"]["waypoints"].as_array_mut().unwrap().pop();
    let mut line = with_laps(eight(), "spline", 2);
    line["spline"]["closed"] = json!(false);
    let none = with_laps(square(0.1), "waypoints", 0);
    for (table, message) in [
        (open, "waypoints.laps = 2 violates 1 for a path whose last waypoint is not its first"),
        (line, "spline.laps = 2 violates 1 for a path whose last waypoint is not its first"),
        (none, "waypoints.laps = 0 violates 1..=100"),
    ] {
        let table = serde_json::from_value(table).unwrap();
        let error = Mission::new(&table, DT_S).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
}

fn flight(mission: Value) -> FlightTable {
    let fly: Value = serde_json::from_str(include_str!("../../../../../configs/fly.json")).unwrap();
    FlightTable {
        start: Start::Airborne,
        mission: serde_json::from_value(mission).unwrap(),
        cycle: serde_json::from_value(fly["cycle"].clone()).unwrap(),
        protocol: Protocol::Binary,
    }
}

fn duration_s(flight: FlightTable, speed: f64) -> f64 {
    let mission = flight.at_speed(speed).unwrap().mission;
    Mission::new(&mission, DT_S).unwrap().survey().duration_s
}

#[test]
fn half_is_as_written_and_less_takes_longer_in_proportion() {
    let written = flight(square(0.1));
    assert_eq!(written.clone().at_speed(0.5).unwrap(), written);
    let whole_s = duration_s(written.clone(), 0.5);
    // The same curve in twice the time.
    let half_s = duration_s(written, 0.25);
    assert!((half_s / whole_s - 2.0).abs() < 1e-6, "{half_s} s, {whole_s} s");
}

#[test]
fn more_leads_to_the_limits_of_the_vehicle() {
    let calm = square(0.1);
    let (mut before_s, written_s) = (f64::INFINITY, duration_s(flight(calm.clone()), 0.5));
    for speed in [0.5, 0.6, 0.8, 1.0] {
        let now_s = duration_s(flight(calm.clone()), speed);
        assert!(now_s < before_s, "{speed}: {now_s} s");
        before_s = now_s;
    }
    assert!(before_s < 0.9 * written_s);
    let fast = flight(calm.clone()).at_speed(1.0).unwrap();
    let MissionTable::Waypoints(fast) = fast.mission else { panic!("not waypoints") };
    // 0.955 (a_max - 1 / C_p), with 1.1 m/s^2 and 100 in the settings.
    assert!((fast.limits.accel_max_mps2 - 0.955 * 1.09).abs() < 1e-12);
    assert!((fast.limits.speed_max_mps - 1.9 * 0.93).abs() < 1e-12);
    assert!((fast.corner_m - 0.135).abs() < 1e-12);
    assert!((fast.follow.wait.begin_m - 0.03).abs() < 1e-12);
    assert!((fast.follow.wait.stop_m - 0.3).abs() < 1e-12);
    // A stronger vehicle, and one that is less certain.
    let mut strong = flight(calm.clone());
    strong.cycle.mhe.p_prior[10] = 1.5;
    let mut uncertain = flight(calm);
    uncertain.cycle.mhe.c_p[10] = 5.0;
    assert!(duration_s(strong, 1.0) < before_s && duration_s(uncertain, 1.0) > before_s);
}

#[test]
fn a_speed_that_means_nothing_is_refused() {
    let mut kinematic = flight(square(0.1));
    kinematic.cycle.model = crate::cycle::ModelKind::Kinematic;
    for (flight, speed, message) in [
        (flight(square(0.1)), 1.1, "speed = 1.1 violates 0.1..=1.0"),
        (flight(square(0.1)), f64::NAN, "speed = NaN violates 0.1..=1.0"),
        (flight(timed()), 0.7, "speed = 0.7 violates 0.5 for targets and timed trajectories"),
        (kinematic, 0.7, "speed = 0.7 violates at most 0.5 for a model without"),
    ] {
        let error = flight.at_speed(speed).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
    assert!(flight(targets()).at_speed(0.5).is_ok());
}
