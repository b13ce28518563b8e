use tello_eval::telemetry::LinkTelemetry;

use super::*;
use crate::fly::tui::tests::view;

/// Full and empty columns, from left to right.
fn columns(u: f64) -> String {
    let [left, right] = gauge(u);
    format!("{left}|{right}").replace('\u{2588}', "#").replace('\u{b7}', ".")
}

fn texts(lines: &[Line<'_>]) -> Vec<String> {
    lines.iter().map(ToString::to_string).collect()
}

#[test]
fn a_gauge_fills_from_its_middle_and_never_beyond_its_ends() {
    for (u, expected) in [
        (0.0, "..........|.........."),
        (0.049, "..........|.........."),
        (0.051, "..........|#........."),
        (0.5, "..........|#####....."),
        (-0.2, "........##|.........."),
        (-1.0, "##########|.........."),
        (3.0, "..........|##########"),
        (f64::NEG_INFINITY, "##########|.........."),
        (f64::NAN, "..........|.........."),
    ] {
        assert_eq!(columns(u), expected, "{u}");
    }
}

#[test]
fn a_value_that_is_not_known_is_shown_as_a_dash() {
    let lines = texts(&places(&Telemetry::default()));
    for name in ["at", "measured", "speed"] {
        let line = lines.iter().find(|line| line.starts_with(&format!(" {name} "))).unwrap();
        assert!(line.ends_with("-      -      -     -"), "{line:?}");
    }
    assert_eq!(lines.last().unwrap(), " off path -");
}

#[test]
fn places_are_in_metres_and_degrees() {
    let facts = Telemetry {
        estimate: Some(Spot { x: -1.0, y: 0.25, z: 1.5, theta: -std::f64::consts::FRAC_PI_2 }),
        velocity_w: Some([0.5, -0.5, 0.0]),
        offset: Some([0.123, -0.5]),
        ..Telemetry::default()
    };
    let lines = texts(&places(&facts));
    assert_eq!(lines[1], " at         -1.00  +0.25  +1.50   -90");
    assert_eq!(lines[4], " speed      +0.50  -0.50  +0.00  m/s");
    assert_eq!(lines[5], " off path 0.12 m, height -0.50 m");
}

#[test]
fn an_old_status_of_the_drone_says_how_old() {
    let drone = |age_s, is_battery_low, is_flying| {
        of_drone(&DroneTelemetry {
            age_s,
            battery_pct: 12,
            is_battery_low,
            is_flying,
            height_m: None,
        })
    };
    assert_eq!(drone(1.0, Some(false), true), "12 %, flies");
    assert_eq!(drone(1.6, Some(true), false), "12 % LOW, stands, 2 s ago");
    assert_eq!(drone(0.0, None, false), "12 %, stands");
}

#[test]
fn a_link_acts_or_does_not_or_is_not_watched() {
    let link = |link| {
        let mut view = view(true);
        view.facts = std::sync::Arc::new(Telemetry { link, ..Telemetry::default() });
        texts(&links(&view)).swap_remove(0)
    };
    assert_eq!(link(None), " sticks   not watched");
    let fact = |is_down, score| Some(LinkTelemetry { is_down, score });
    assert_eq!(link(fact(false, -2.0)), " sticks   acts, score -2.0");
    assert_eq!(link(fact(true, 2.0)), " sticks   does not act, score +2.0");
}

#[test]
fn the_age_of_a_pose_is_in_milliseconds() {
    let mocap = MocapTelemetry { age_s: Some(0.0126), rate_hz: 99.6, ..MocapTelemetry::default() };
    assert_eq!(of_mocap(&mocap), "13 ms old, 100 Hz");
}
