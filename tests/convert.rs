//! `tello-ctl convert` on real recordings and on logs of our own.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tello_eval::flight_log::{self, TickRecord};
use tello_flight::Start;
use tello_flight::cycle::Timing;
use tello_io::config;
use tello_io::log::{LogReader, csv};
use tello_sim::virtual_time::VirtualFlight;

use crate::program;
use crate::support;
use program::{json, tello_ctl, text};

/// A fresh folder of a test.
fn folder(name: &str) -> PathBuf {
    program::folder(&format!("convert-{name}"))
}

/// Names in a folder, sorted.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<String> =
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const FLIGHT: &str = "\
pos,0,-0.91,-2.02,1.13,0.03
input,0,-0.04,-0.06,-0.03,0.15
pos,1,-0.91,-2.02,1.13,0.04
input,1,-0.00,-0.06,-0.03,0.15
target,1,-1.00,-2.00,1.30,0.00
";

/// Converts all recordings of a folder there and back; the number that comes back, each compared with
/// its original less the lines that are named as skipped.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn there_and_back(thesis: &Path, name: &str) -> usize {
    let folder = folder(&name.replace('/', "-"));
    let originals = thesis.join(name);
    let there = tello_ctl(
        &folder,
        &["convert", &originals.display().to_string(), "--out-dir", "mcap", "--json"],
    );
    assert_eq!(there.status.code(), Some(0), "{}", text(&there));
    let back = tello_ctl(&folder, &["convert", "mcap", "--out-dir", "csv", "--json"]);
    assert_eq!(back.status.code(), Some(0), "{}", text(&back));
    let (there, back) = (json(&there), json(&back));
    let (there, back) = (there["files"].as_array().unwrap(), back["files"].as_array().unwrap());
    assert_eq!(there.len(), back.len());
    for (there, back) in there.iter().zip(back) {
        let from = there["from"].as_str().unwrap();
        assert_eq!(there["skipped"], back["skipped"], "{from}");
        let original = fs::read_to_string(from).unwrap();
        let skipped: Vec<usize> =
            csv::parse(original.as_bytes()).skipped.iter().map(|skipped| skipped.line).collect();
        assert_eq!(there["skipped"].as_array().unwrap().len(), skipped.len(), "{from}: {there}");
        let lines = original.split_inclusive('\n').enumerate();
        let expected: String =
            lines.filter(|(i, _)| !skipped.contains(&(i + 1))).map(|(_, line)| line).collect();
        let written = fs::read_to_string(folder.join(back["to"].as_str().unwrap())).unwrap();
        assert!(written == expected, "{from} does not come back as it was");
    }
    back.len()
}

#[test]
fn real_recordings_come_back_to_the_digit() {
    let Some(thesis) = support::data("thesis") else { return };
    let folders = ["ident/raw", "closed_loop", "manual/raw", "lockout/raw"];
    let counts = folders.map(|name| there_and_back(&thesis, name));
    assert_eq!(counts, [6, 46, 3, 2]);
}

#[test]
fn torn_lines_are_named_and_the_rest_comes_back() {
    let folder = folder("torn");
    let torn = FLIGHT.to_owned() + "pospos,2,1,2,3,4\npos,3,1.00,2.00,3.00,4.00\ninput,3,0.1";
    fs::write(folder.join("torn.log"), &torn).unwrap();
    let output = tello_ctl(&folder, &["convert", "torn.log", "-o", "torn.mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    for part in ["torn.mcap: 3 steps", "line 6, unknown tag: pospos", "line 8, cut off"] {
        assert!(text(&output).contains(part), "{part} is not in {}", text(&output));
    }
    let output = tello_ctl(&folder, &["convert", "torn.mcap", "-o", "back.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let back = fs::read_to_string(folder.join("back.csv")).unwrap();
    assert_eq!(back, FLIGHT.to_owned() + "pos,3,1.00,2.00,3.00,4.00\n");
}

#[test]
fn a_converted_recording_replays_as_its_original() {
    let Some(original) = support::data("thesis/ident/raw/5.log") else { return };
    let folder = folder("replay");
    let original = original.display().to_string();
    let output = tello_ctl(&folder, &["convert", &original, "-o", "5.mcap"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let replay = |log: &str, out: &str| {
        let output = tello_ctl(&folder, &["replay", log, "--out", out, "--json"]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        let mut report = json(&output);
        report["flights"][0]["log"].take();
        report
    };
    let report = replay("5.mcap", "from-mcap.mcap");
    assert_eq!(report, replay(&original, "from-csv.mcap"));
    assert!(report["flights"][0]["ticks_airborne"].as_u64().unwrap() > 3000, "{report}");
    let bytes = |name: &str| fs::read(folder.join(name)).unwrap();
    assert!(bytes("from-mcap.mcap") == bytes("from-csv.mcap"), "the logs differ");
}

/// A log of `ticks` ticks in flight; three periods are skipped before the tick `late`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn make_log(path: &Path, ticks: u64, late: Option<u64>) {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let mut virtual_flight =
        VirtualFlight::new(&flight, &tello_sim::settings(None).unwrap(), 11).unwrap();
    let mut log = flight_log::create(path, &flight, 0, &virtual_flight.new_outcome()).unwrap();
    for step in 0..ticks {
        let out = virtual_flight.tick().unwrap().clone();
        let mut inbox = virtual_flight.inbox().clone();
        inbox.skipped = if Some(step) == late { 3 } else { 0 };
        let timing = Timing { step, ..Timing::default() };
        flight_log::write_tick(&mut log, &TickRecord { inbox, out, timing }).unwrap();
    }
    log.finish().unwrap();
}

/// Row `key` of the records on `topic`, by step.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn records(log: &Path, topic: &str, key: &str) -> Vec<(u64, f64)> {
    let mut log = LogReader::open(log).unwrap().select(&[topic]);
    let mut rows = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        let record: Value = message.decode().unwrap();
        rows.push((record["step"].as_u64().unwrap(), record[key].as_f64().unwrap()));
    }
    rows
}

#[test]
fn a_flight_of_ours_becomes_the_four_tags_of_the_thesis() {
    let folder = folder("ours");
    let log = folder.join("flight.mcap");
    make_log(&log, 300, None);
    for (pos, topic) in
        [("estimate", "/estim/state"), ("filtered", "/estim/filtered"), ("raw", "/vicon/raw")]
    {
        let out = format!("{pos}.csv");
        let arguments = ["convert", "flight.mcap", "-o", &out, "--pos", pos, "--decimals", "17"];
        let output = tello_ctl(&folder, &arguments);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output));
        let flight = csv::read(&folder.join(&out)).unwrap();
        assert_eq!(flight.skipped, []);
        assert_eq!(flight.rows.len(), 300);
        let check = |topic: &str, key: &str, pick: &dyn Fn(&csv::CsvRow) -> Option<f64>| {
            let recorded = records(&log, topic, key);
            let rows = flight.rows.iter().filter_map(|row| Some((row.step, pick(row)?)));
            let rows: Vec<(u64, f64)> = rows.collect();
            assert_eq!(rows.len(), recorded.len(), "{topic}");
            for (row, recorded) in rows.iter().zip(&recorded) {
                assert_eq!(row.0, recorded.0, "{topic}");
                // Half of the last digit, and what rounding to a double takes.
                assert!((row.1 - recorded.1).abs() < 5e-16, "{topic}: {row:?}, {recorded:?}");
            }
            assert!(recorded.iter().any(|(_, value)| value.abs() > 0.01), "{topic} {key} is flat");
        };
        check(topic, "x", &|row| row.pos.map(|pos| pos.x));
        check("/tello/command", "pitch", &|row| row.input.map(|input| input.y));
        check("/control/target", "z", &|row| row.target.map(|target| target.z));
        check("/estim/parameter", "theta_0", &|row| row.param.map(|param| param.w));
    }
    let output = tello_ctl(&folder, &["convert", "flight.mcap", "-o", "default.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let default = csv::read(&folder.join("default.csv")).unwrap();
    assert_eq!(default.decimals, csv::THESIS_DECIMALS);
    let gap = default.rows.last().unwrap().pos.unwrap().x
        - records(&log, "/estim/state", "x").last().unwrap().1;
    assert!(gap.abs() <= 0.5e-4, "{gap}");
}

#[test]
fn periods_without_a_tick_are_missing_steps() {
    let folder = folder("late");
    make_log(&folder.join("flight.mcap"), 100, Some(60));
    let output = tello_ctl(&folder, &["convert", "flight.mcap", "-o", "flight.csv"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let rows = csv::read(&folder.join("flight.csv")).unwrap().rows;
    let steps: Vec<u64> = rows.iter().map(|row| row.step).collect();
    assert_eq!(steps, (0..60).chain(63..103).collect::<Vec<u64>>());
}

#[test]
fn a_torn_log_is_converted_up_to_the_tear() {
    let folder = folder("torn-log");
    make_log(&folder.join("flight.mcap"), 400, None);
    let bytes = fs::read(folder.join("flight.mcap")).unwrap();
    fs::write(folder.join("torn.mcap"), &bytes[..bytes.len() * 7 / 10]).unwrap();
    let output = tello_ctl(&folder, &["convert", "torn.mcap", "-o", "torn.csv"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("skipped torn"), "{}", text(&output));
    let rows = csv::read(&folder.join("torn.csv")).unwrap().rows.len();
    assert!((100..400).contains(&rows), "{rows} steps");
}

#[test]
fn nothing_is_replaced_without_force_and_no_half_file_is_left() {
    let folder = folder("force");
    fs::write(folder.join("a.log"), FLIGHT).unwrap();
    fs::write(folder.join("a.mcap"), "precious").unwrap();
    let output = tello_ctl(&folder, &["convert", "a.log", "-o", "a.mcap"]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("--force"), "{}", text(&output));
    assert_eq!(fs::read(folder.join("a.mcap")).unwrap(), b"precious");
    let output = tello_ctl(&folder, &["convert", "a.log", "-o", "a.mcap", "--force"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    LogReader::open(&folder.join("a.mcap")).unwrap();
    assert_eq!(names(&folder), ["a.log", "a.mcap"]);
}

#[test]
fn a_name_with_dots_is_kept_and_two_recordings_of_it_stay_two() {
    let folder = folder("dots");
    for name in ["run.1.log", "run.2.log"] {
        fs::write(folder.join(name), FLIGHT).unwrap();
    }
    let output = tello_ctl(&folder, &["convert", ".", "--out-dir", "out"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(names(&folder.join("out")), ["run.1.mcap", "run.2.mcap"]);
}

#[test]
fn what_cannot_be_converted_says_why_and_does_not_stop_the_rest() {
    let folder = folder("refused");
    for (name, text) in [("a.log", FLIGHT), ("b.log", ""), ("c.csv", "no flight in here\n")] {
        fs::write(folder.join(name), text).unwrap();
    }
    let output = tello_ctl(&folder, &["convert", ".", "--out-dir", "out"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    for part in ["a.mcap: 2 steps", "b.log: it is empty", "c.csv: no line of a flight log"] {
        assert!(text(&output).contains(part), "{part} is not in {}", text(&output));
    }
    assert_eq!(names(&folder.join("out")), ["a.mcap"]);
    let refuse = |arguments: &[&str], reason: &str| {
        let output = tello_ctl(&folder, arguments);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        assert!(text(&output).contains(reason), "{reason} is not in {}", text(&output));
    };
    refuse(&["convert", "nowhere.log", "-o", "x.mcap"], "cannot read nowhere.log");
    refuse(&["convert", "a.log", "b.log", "-o", "x.mcap"], "--out-dir");
    refuse(&["convert", "a.log"], "--out");
    refuse(&["convert", "a.log", "-o", "x.csv", "--to", "csv"], "it is csv already");
    refuse(&["convert", "a.log", "out/a.mcap", "--out-dir", "out"], "name of another recording");
    refuse(&["convert", "a.log", "-o", "nowhere/x.mcap"], "cannot write nowhere/x.mcap");
    refuse(&["convert", "b.log", "-o", "x.mcap"], "nothing was converted");
    assert_eq!(names(&folder), ["a.log", "b.log", "c.csv", "out"]);
}

#[test]
fn help_teaches_by_examples() {
    let output = tello_ctl(&folder("help"), &["convert", "--help"]);
    assert_eq!(output.status.code(), Some(0));
    for part in ["Examples:", "convert flight.log -o flight.mcap", "--pos", "Exit codes"] {
        assert!(text(&output).contains(part), "{part} is not in {}", text(&output));
    }
}
