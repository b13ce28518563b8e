use std::fs;

use tello_flight::Start;
use tello_io::config;
use tello_io::log::LogReader;

use super::*;

const MISSION: &str =
    r#"{"targets": { "reach": 0.3, "targets": [[-0.5, 0.0, 1.2, 0.0], [0.5, 0.0, 1.2, 0.0]] }}"#;

fn flight() -> FlightTable {
    let (fly, _) = config::fly(None, None).unwrap();
    config::flight(&fly, serde_json::from_str(MISSION).unwrap(), Start::Airborne)
}

fn path(name: &str) -> PathBuf {
    let name = format!("tello-sim-logged-{}-{name}.mcap", std::process::id());
    let path = std::env::temp_dir().join(name);
    fs::remove_file(&path).ok();
    path
}

fn logged(phase: Phase, targets_reached: usize) -> Logged {
    Logged {
        log: "a.mcap".into(),
        seed: 7,
        phase,
        ended_by: Vec::new(),
        targets_reached,
        targets_count: 2,
        lasted_s: 9.5,
    }
}

#[test]
fn a_flight_is_a_success_only_if_it_reached_all_and_landed() {
    for (phase, reached, is_success) in [
        (Phase::Landed, 2, true),
        (Phase::Landed, 1, false),
        (Phase::LandingUnconfirmed, 2, false),
        (Phase::MotorsStopped, 2, false),
        (Phase::Flying, 2, false),
    ] {
        assert_eq!(logged(phase, reached).is_success(), is_success, "{phase:?}, {reached}");
    }
    let by_fault = Logged { ended_by: vec![Fault::TrackingLost], ..logged(Phase::Landed, 2) };
    assert!(!by_fault.is_success());
    assert!(by_fault.to_string().starts_with("seed 7: landed (off the reference), 2 of 2"));
    let text = logged(Phase::Landed, 1).to_string();
    assert_eq!(text, "seed 7: landed, 1 of 2 targets, 9.50 s; log a.mcap\n");
}

#[test]
fn a_flight_may_last_twice_its_planned_time_and_a_minute() {
    let flight = flight();
    let planned_s = Mission::new(&flight.mission, flight.cycle.dt_s).unwrap().planned_s();
    let (targets_count, steps_max) = bounds(&flight).unwrap();
    assert_eq!(targets_count, 2);
    let longest_s = steps_max as f64 * flight.cycle.dt_s;
    assert!((longest_s - 2.0 * planned_s - 60.0).abs() <= flight.cycle.dt_s, "{longest_s} s");
}

#[test]
fn the_log_has_a_record_of_every_tick_up_to_the_landing_and_is_written_alike_again() {
    let sim = crate::settings(None).unwrap();
    let (first, second) = (path("first"), path("second"));
    let logged = fly(&flight(), &sim, 1, &first).unwrap();
    assert!(logged.is_success(), "{logged}");
    assert_eq!((&logged.log, logged.seed, logged.targets_count), (&first, 1, 2));
    let mut log = LogReader::open(&first).unwrap().select(&["/cycle/inbox"]);
    let mut times_s = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        times_s.push(message.t.seconds());
    }
    let dt_s = flight().cycle.dt_s;
    let last_s = times_s.last().copied().unwrap();
    assert!((last_s - logged.lasted_s).abs() < 1e-9, "{last_s} s");
    assert!((times_s.len() as f64 - 1.0 - last_s / dt_s).abs() < 0.5, "{last_s} s");
    fly(&flight(), &sim, 1, &second).unwrap();
    assert!(fs::read(&first).unwrap() == fs::read(&second).unwrap(), "the logs differ");
    fs::remove_file(&first).unwrap();
    fs::remove_file(&second).unwrap();
}

#[test]
fn a_flight_that_is_stopped_leaves_no_log() {
    let path = path("stopped");
    let asked = std::cell::Cell::new(0);
    let is_stopped = || {
        asked.set(asked.get() + 1);
        asked.get() > 20
    };
    let sim = crate::settings(None).unwrap();
    let error = fly_until(&flight(), &sim, 3, &path, &is_stopped).unwrap_err();
    assert!(format!("{error:#}").ends_with("interrupted"), "{error:#}");
    assert_eq!(asked.get(), 21, "it goes on");
    assert!(!path.exists());
}
