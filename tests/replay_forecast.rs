//! How far ahead the estimator sees: `tello-ctl replay` on recordings of others, with the lagged model
//! and with the thesis' estimator and prediction.

use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};

use horizon_model::rows::{Pose, Sticks};
use serde_json::Value;
use tello_flight::Start;
use tello_io::config;
use tello_sim::virtual_time::VirtualFlight;

use crate::program;
use crate::support;
use program::{config_file, folder, tello_ctl, text};

/// Index of one second among the horizons.
const ONE_SECOND: usize = 2;

/// Report of `replay` on recordings, against the thesis' settings.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn report(folder: &Path, logs: &[PathBuf]) -> Value {
    let thesis = config_file("thesis/fly.json");
    let mut arguments = vec!["replay", "--json", "--against", &thesis];
    arguments.extend(logs.iter().map(|log| log.to_str().unwrap()));
    let output = tello_ctl(folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Root mean square error in x and y one second ahead of each rule: ours, the thesis', constant velocity.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn xy_rmse_m(report: &Value) -> [f64; 3] {
    let rules = report["pooled"].as_array().unwrap();
    let error = |rule: &Value| rule["xy_rmse_m"][ONE_SECOND].as_f64().unwrap();
    let errors: Vec<f64> = rules.iter().map(error).collect();
    errors.try_into().unwrap()
}

/// The lines of a step as in the thesis' recordings.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn write_step(csv: &mut String, step: u64, pose: &Pose, sticks: &Sticks) {
    let [x, y, z, theta] = (*pose).into();
    let [roll, pitch, yaw, throttle] = (*sticks).into();
    writeln!(csv, "pos,{step},{x:.4},{y:.4},{z:.4},{theta:.4}").unwrap();
    writeln!(csv, "input,{step},{roll:.4},{pitch:.4},{yaw:.4},{throttle:.4}").unwrap();
}

/// Squares flown in the simulator, recorded with their true poses.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn simulated(folder: &Path, seeds: std::ops::RangeInclusive<u64>) -> Vec<PathBuf> {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let sim = tello_sim::settings(None).unwrap();
    let record = |seed| {
        let mut flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
        let mut csv = String::new();
        for step in 0..400 {
            let u_sent = flight.tick().unwrap().u_sent;
            write_step(&mut csv, step, &flight.true_pose(), &u_sent);
        }
        let path = folder.join(format!("{seed}.log"));
        fs::write(&path, csv).unwrap();
        path
    };
    seeds.map(record).collect()
}

#[test]
fn simulated_flights_are_predicted_better_by_the_model_that_they_have() {
    let folder = folder("replay-forecast-simulated");
    let logs = simulated(&folder, 1..=3);
    let [ours, thesis, steady] = xy_rmse_m(&report(&folder, &logs));
    println!("x-y RMSE 1 s ahead: {ours:.3}, thesis {thesis:.3}, constant velocity {steady:.3} m");
    // What the disturbance of the plant (0.05 m/s, 1.2 s) and its spread leave unpredicted.
    assert!(ours < 0.08, "{ours} m");
    assert!(ours < 0.5 * thesis.min(steady), "{ours} m, thesis {thesis} m, steady {steady} m");
}

#[test]
fn real_flights_are_predicted_better_than_by_the_thesis() {
    let Some(squares) = support::data("thesis/squares") else { return };
    let folder = folder("replay-forecast-real");
    // Every seventh of the 29 valid squares, for the time that all of them take.
    let logs: Vec<PathBuf> =
        (1..=29).step_by(7).map(|number| squares.join(format!("{number:03}.log"))).collect();
    let report = report(&folder, &logs);
    let [ours, thesis, steady] = xy_rmse_m(&report);
    println!("x-y RMSE 1 s ahead: {ours:.3}, thesis {thesis:.3}, constant velocity {steady:.3} m");
    assert!(ours < thesis.min(steady), "{ours} m, thesis {thesis} m, steady {steady} m");
    let count = report["pooled"][0]["count"][ONE_SECOND].as_u64();
    assert!(count > Some(4000), "{count:?} moments judged");
    assert!(!folder.join("logs").exists(), "several recordings leave no log");
}

#[test]
fn a_forecast_knows_nothing_later_than_its_tick() {
    let folder = folder("replay-forecast-causal");
    let path = simulated(&folder, 5..=5).remove(0);
    let whole = fs::read_to_string(&path).unwrap();
    // The last 100 steps are flown near the ground, where nothing is judged, by the same sticks.
    let mut changed = String::new();
    for line in whole.lines() {
        let mut cells: Vec<&str> = line.split(',').collect();
        if cells[0] == "pos" && cells[1].parse::<u64>().unwrap() >= 300 {
            cells[4] = "0.2000";
        }
        writeln!(changed, "{}", cells.join(",")).unwrap();
    }
    let low = folder.join("low.log");
    fs::write(&low, changed).unwrap();
    // Two lines per step.
    let until: String = whole.split_inclusive('\n').take(2 * 300).collect();
    let ended = folder.join("ended.log");
    fs::write(&ended, until).unwrap();
    let (low, ended) = (report(&folder, &[low]), report(&folder, &[ended]));
    assert!(low["flights"][0]["ticks_airborne"].as_u64() < Some(350), "{low}");
    assert_eq!(low["pooled"], ended["pooled"], "what came later changed a forecast");
}

#[test]
fn what_cannot_be_compared_is_refused_with_a_reason() {
    let folder = folder("replay-forecast-refused");
    let logs = simulated(&folder, 6..=7);
    let (fly, _) = config::fly(None, None).unwrap();
    let mut slow = fly;
    slow.cycle.dt_s = 0.04;
    fs::write(folder.join("slow.json"), serde_json::to_string(&slow).unwrap()).unwrap();
    fs::create_dir(folder.join("missions")).unwrap();
    let square = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions/square.json");
    fs::copy(square, folder.join("missions/square.json")).unwrap();
    let [first, second] = [0, 1].map(|log: usize| logs[log].to_str().unwrap());
    for (arguments, reason) in [
        (&["replay", first, second, "--out", "out.mcap"][..], "--out is for one recording"),
        (&["replay", first, "--config", "slow.json"][..], "cycle.dt_s = 0.04"),
        (&["replay", first, "--against", "nowhere.json"][..], "cannot read nowhere.json"),
    ] {
        let output = tello_ctl(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(reason), "{}", text(&output));
    }
}
