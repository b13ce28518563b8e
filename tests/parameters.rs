//! Parameter files on their way into `check`, `fly`, `replay` and `sim`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::{Value, json};
use tello_eval::flight_log::{self, TickRecord};
use tello_flight::Start;
use tello_flight::cycle::{FlightTable, Timing};
use tello_io::config;
use tello_io::log::LogReader;
use tello_sim::virtual_time::VirtualFlight;

use crate::program;
use program::{tello_ctl, text};

/// A fresh folder of a test.
fn folder(name: &str) -> PathBuf {
    program::folder(&format!("parameters-{name}"))
}

const KINEMATIC: [(&str, f64, &str); 4] = [
    ("lambda_h", 1.3, "m/s"),
    ("lambda_v", 0.5, "m/s"),
    ("lambda_a", 1.0, "rad/s"),
    ("theta_0", 0.03, "rad"),
];

const LAGGED: [(&str, f64, &str); 11] = [
    ("lambda_h", 2.1, "m/s"),
    ("lambda_v", 0.8, "m/s"),
    ("lambda_a", 1.5, "rad/s"),
    ("theta_0", -0.1, "rad"),
    ("tau_h", 0.7, "s"),
    ("tau_v", 0.3, "s"),
    ("tau_a", 0.1, "s"),
    ("dead_h", 0.05, "1"),
    ("dead_v", 0.1, "1"),
    ("dead_a", 0.06, "1"),
    ("a_max", 1.2, "m/s^2"),
];

/// Dead times beside [`LAGGED`].
const DEAD_TIME_S: [f64; 4] = [0.3, 0.3, 0.05, 0.2];

/// Writes a parameter file of `model` to `params.json`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn write(folder: &Path, model: &str, rows: &[(&str, f64, &str)], dead_time_s: [f64; 4]) {
    let entry = |(name, value, unit): &(&str, f64, &str)| {
        let entry =
            json!({ "value": value, "std": 0.1, "lower": null, "upper": null, "unit": unit });
        ((*name).to_owned(), entry)
    };
    let file = json!({
        "format": 1,
        "model": model,
        "parameters": rows.iter().map(entry).collect::<serde_json::Map<String, Value>>(),
        "dead_time_s": dead_time_s,
        "data": [],
        "settings": {},
        "revision": "0123abc",
    });
    fs::write(folder.join("params.json"), file.to_string()).unwrap();
}

/// The settings in the head of a log.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn settings(log: &Path) -> FlightTable {
    flight_log::settings(&LogReader::open(log).unwrap(), log).unwrap()
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn make_log(path: &Path) {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let mut virtual_flight =
        VirtualFlight::new(&flight, &tello_sim::settings(None).unwrap(), 11).unwrap();
    let mut log = flight_log::create(path, &flight, 0, &virtual_flight.new_outcome()).unwrap();
    for step in 0..200 {
        let out = virtual_flight.tick().unwrap().clone();
        let inbox = virtual_flight.inbox().clone();
        let timing = Timing { step, ..Timing::default() };
        flight_log::write_tick(&mut log, &TickRecord { inbox, out, timing }).unwrap();
    }
    log.finish().unwrap();
}

#[test]
fn a_parameter_file_is_checked_and_shown() {
    let folder = folder("check");
    write(&folder, "lagged", &LAGGED, DEAD_TIME_S);
    let output = tello_ctl(&folder, &["check", "params.json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("\"a_max\""), "{}", text(&output));
    write(&folder, "lagged", &KINEMATIC, DEAD_TIME_S);
    let output = tello_ctl(&folder, &["check", "params.json"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("parameters.tau_h = nothing"), "{}", text(&output));
    let output = tello_ctl(&folder, &["check", "--schema", "params"]);
    assert!(text(&output).contains("\"dead_time_s\""), "{}", text(&output));
}

#[test]
fn a_replay_with_parameters_differs_and_logs_them() {
    let folder = folder("replay");
    make_log(&folder.join("flight.mcap"));
    write(&folder, "lagged", &LAGGED, DEAD_TIME_S);
    let arguments =
        ["replay", "flight.mcap", "--params", "params.json", "--out", "again.mcap", "--json"];
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    let (then, now) = (settings(&folder.join("flight.mcap")), settings(&folder.join("again.mcap")));
    let mut expected = then.clone();
    expected.cycle.mhe.p_prior = LAGGED.map(|(_, value, _)| value).to_vec();
    expected.cycle.dead_time_s = DEAD_TIME_S.to_vec();
    assert_eq!(now, expected, "parameters and nothing else");
    // The log of the replay carries them: it replays without the file.
    let output = tello_ctl(&folder, &["replay", "again.mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
}

#[test]
fn a_flight_with_parameters_logs_them() {
    let folder = folder("fly");
    write(&folder, "lagged", &LAGGED, DEAD_TIME_S);
    let mut child = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["fly", "--sim", "--params", "params.json", "--log", "flight.mcap"])
        .current_dir(&folder)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let log = folder.join("flight.mcap");
    let is_there = (0..100).any(|_| {
        sleep(Duration::from_millis(50));
        LogReader::open(&log).is_ok()
    });
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(is_there, "no log after 5 s");
    let cycle = settings(&log).cycle;
    assert_eq!(cycle.mhe.p_prior, LAGGED.map(|(_, value, _)| value));
    assert_eq!(cycle.dead_time_s, DEAD_TIME_S);
}

#[test]
fn a_batch_flies_the_identified_vehicle() {
    let folder = folder("sim");
    write(&folder, "lagged", &LAGGED, DEAD_TIME_S);
    let batch = |more: &[&str]| {
        let arguments = [&["sim", "--batch", "2", "--json"][..], more].concat();
        let output = tello_ctl(&folder, &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        output.stdout
    };
    let mut sim = serde_json::to_value(tello_sim::settings(None).unwrap()).unwrap();
    let plant = &mut sim["plant"];
    let axis = |gain: f64, dead_time_s: f64, tau_s: f64, dead_zone: f64| json!({ "gain": gain, "dead_time_s": dead_time_s, "tau_s": tau_s, "dead_zone": dead_zone });
    plant["horizontal"] = axis(2.1, 0.3, 0.7, 0.05);
    plant["vertical"] = axis(0.8, 0.2, 0.3, 0.1);
    plant["yaw"] = axis(1.5, 0.05, 0.1, 0.06);
    plant["theta_0"] = json!(-0.1);
    plant["accel_max_mps2"] = json!(1.2);
    fs::write(folder.join("sim.json"), sim.to_string()).unwrap();
    let by_params = batch(&["--params", "params.json"]);
    assert_eq!(by_params, batch(&["--sim-config", "sim.json"]));
    assert_ne!(by_params, batch(&[]));
}

#[test]
fn a_file_that_does_not_fit_is_refused_with_the_way_out() {
    let folder = folder("refused");
    make_log(&folder.join("flight.mcap"));
    let refuse = |arguments: &[&str], parts: &[&str]| {
        let output = tello_ctl(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        for part in parts {
            assert!(text(&output).contains(part), "{part} is not in {}", text(&output));
        }
    };
    let (fly, replay, sim) = (
        ["fly", "--sim", "--params", "params.json"],
        ["replay", "flight.mcap", "--params", "params.json"],
        ["sim", "--batch", "1", "--params", "params.json"],
    );
    write(&folder, "kinematic", &KINEMATIC, [0.3; 4]);
    for arguments in [&fly, &replay] {
        refuse(arguments, &["params.json", "model kinematic", "the loop runs lagged"]);
    }
    refuse(&sim, &["params.json", "model kinematic", "identify lagged"]);
    let mut wide = LAGGED;
    wide[0].1 = 4.7;
    write(&folder, "lagged", &wide, [0.3; 4]);
    refuse(&fly, &["lambda_h = 4.7 m/s lies outside", "cycle.mhe.p_ub"]);
    let mut lagged = LAGGED;
    lagged[4].1 = -0.1;
    write(&folder, "lagged", &lagged, [0.3; 4]);
    refuse(&sim, &["params.json", "tau_s = -0.1"]);
    refuse(&["fly", "--sim", "--params", "nowhere.json"], &["cannot read nowhere.json"]);
}
