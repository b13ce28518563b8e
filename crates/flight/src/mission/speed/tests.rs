//! Missions flown slower or faster than they are written.

use serde_json::Value;

use super::super::tests::*;
use super::super::*;
use super::*;
use crate::Start;
use crate::cycle::FlightTable;
use crate::drone::Protocol;

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
    // 0.946 a_max, with 1.1 m/s^2 in the settings.
    assert!((fast.limits.accel_max_mps2 - 0.946 * 1.1).abs() < 1e-12);
    assert!((fast.limits.speed_max_mps - 1.9 * 0.93).abs() < 1e-12);
    assert!((fast.limits.speed_up_max_mps2.unwrap() - 3.0 * 1.1).abs() < 1e-12);
    assert!((fast.corner_m - 0.12).abs() < 1e-12);
    assert!((fast.follow.wait.begin_m - 0.03).abs() < 1e-12);
    assert!((fast.follow.wait.stop_m - 0.3).abs() < 1e-12);
    let mut strong = flight(calm);
    strong.cycle.mhe.p_prior[lag::A_MAX] = 1.5;
    assert!(duration_s(strong, 1.0) < before_s);
}

#[test]
fn a_speed_that_means_nothing_is_refused() {
    let mut kinematic = flight(square(0.1));
    kinematic.cycle.model = ModelKind::Kinematic;
    for (flight, speed, message) in [
        (flight(square(0.1)), 1.1, "speed = 1.1: expected 0.1..=1.0"),
        (flight(square(0.1)), f64::NAN, "speed = NaN: expected 0.1..=1.0"),
        (flight(timed()), 0.7, "speed = 0.7: expected 0.5 for targets and timed trajectories"),
        (kinematic, 0.7, "speed = 0.7: expected at most 0.5 for a model without"),
    ] {
        let error = flight.at_speed(speed).unwrap_err().to_string();
        assert!(error.starts_with(message), "{error}");
    }
    assert!(flight(targets()).at_speed(0.5).is_ok());
}

#[test]
fn both_ends_of_the_range_of_speeds_are_in_it() {
    for speed in [0.1, 1.0] {
        assert!(flight(square(0.1)).at_speed(speed).is_ok(), "{speed}");
    }
    for speed in [0.1_f64.next_down(), 1.0_f64.next_up()] {
        assert!(flight(square(0.1)).at_speed(speed).is_err(), "{speed}");
    }
}

#[test]
fn half_of_the_pace_has_half_of_the_speeds_and_a_quarter_of_the_acceleration() {
    let limits = |speed| {
        let MissionTable::Waypoints(table) = flight(square(0.1)).at_speed(speed).unwrap().mission
        else {
            panic!("not waypoints")
        };
        table.limits
    };
    let (written, half) = (limits(0.5), limits(0.25));
    for (found, expected) in [
        (half.speed_max_mps, 0.5 * written.speed_max_mps),
        (half.climb_max_mps, 0.5 * written.climb_max_mps),
        (half.turn_max_radps, 0.5 * written.turn_max_radps),
        (half.accel_max_mps2, 0.25 * written.accel_max_mps2),
    ] {
        assert!((found - expected).abs() < 1e-12, "{found}, not {expected}");
    }
    assert_eq!(half.speed_up_max_mps2, None, "as fast as it falls");
}

#[test]
fn a_curve_waits_for_a_vehicle_beside_it_only_above_the_pace_as_written() {
    let aside = |speed, written: Option<[f64; 2]>| {
        let mut flight = flight(circle());
        if let MissionTable::Circle(table) = &mut flight.mission {
            table.follow.wait.aside_m = written;
        }
        match flight.at_speed(speed).unwrap().mission {
            MissionTable::Circle(table) => table.follow.wait.aside_m,
            _ => panic!("not a circle"),
        }
    };
    assert_eq!([aside(0.5, None), aside(0.51, None)], [None, Some(ASIDE_M)]);
    assert_eq!(aside(1.0, Some([0.1, 0.2])), Some([0.1, 0.2]));
}
