//! The program as its users meet it: commands, messages, exit codes, over real sockets.

use std::fs;
use std::io::{BufRead, BufReader};
use std::net::{TcpListener, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::thread::sleep;
use std::time::Duration;

use horizon_model::check::maximum;
use serde_json::Value;
use tello_io::log::LogReader;

use crate::program;
use program::{config_file, json, tello_ctl, text};

/// A fresh folder of this test.
fn folder(name: &str) -> PathBuf {
    program::folder(&format!("commands-{name}"))
}

/// The built-in flight settings with one change, as a file.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn changed_fly(folder: &Path, change: impl FnOnce(&mut Value)) -> String {
    let mut table: Value =
        serde_json::from_str(&fs::read_to_string(config_file("fly.json")).unwrap()).unwrap();
    table["mission"] = config_file("missions/square.json").into();
    change(&mut table);
    let path = folder.join("changed.json");
    fs::write(&path, table.to_string()).unwrap();
    path.display().to_string()
}

#[test]
fn a_simulated_flight_takes_off_flies_the_square_lands_and_leaves_a_log() {
    let folder = folder("fly");
    let output = tello_ctl(&folder, &["fly", "--sim", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    let summary = json(&output);
    assert_eq!(summary["phase"], "landed", "{summary}");
    assert_eq!(summary["targets_reached"], 5, "{summary}");
    assert!(summary["metrics"]["finish_s"].as_f64().unwrap() < 60.0, "{summary}");
    assert_eq!(summary["records_dropped"], 0, "{summary}");
    let log = summary["log"].as_str().unwrap();
    let replayed = tello_ctl(&folder, &["replay", log, "--json"]);
    assert_eq!(replayed.status.code(), Some(0), "{}", text(&replayed));
    assert_eq!(json(&replayed)["is_equal"], true, "{}", text(&replayed));

    let (timings, _) = records(&folder.join(log), "/cycle/timing");
    for (_, timing) in &timings {
        let parts = ["estimate_ns", "plan_ns", "sent_ns", "tick_ns"];
        let [estimate, plan, sent, ended] = parts.map(|part| timing[part].as_i64().unwrap());
        assert!(0 < sent && estimate + plan <= sent && sent <= ended, "{timing}");
    }
    assert!(timings.iter().any(|(_, timing)| timing["way_ns"].as_i64().unwrap() > 0));
    let [answer, solve] = ["answer_ms", "solve_ms"].map(|of| summary[of][0].as_f64().unwrap());
    assert!(answer > solve && solve > 0.0, "{summary}");
}

/// The program in flight over the simulator, `seconds` after its start.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn start_flight(folder: &Path, more: &[&str], seconds: u64) -> Child {
    let child = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["fly", "--sim", "--profile", "clean", "--json", "--log", "flight.mcap"])
        .args(more)
        .current_dir(folder)
        // Not the terminal of the person who runs the tests: its keys would be live.
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    sleep(Duration::from_secs(seconds));
    child
}

/// Sends the signal of Ctrl-C on a terminal.
fn interrupt(child: &Child) {
    signal(child, "-INT");
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn signal(child: &Child, signal: &str) {
    let pid = child.id().to_string();
    assert!(Command::new("kill").args([signal, &pid]).status().unwrap().success());
}

/// Records of a channel with their times in s, and whether the log is complete.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn records(log: &Path, topic: &str) -> (Vec<(f64, Value)>, bool) {
    let mut log = LogReader::open(log).unwrap();
    let mut records = vec![];
    while let Some(message) = log.next_message().unwrap() {
        if message.topic == topic {
            records.push((message.t.seconds(), message.decode().unwrap()));
        }
    }
    (records, log.ending().unwrap().is_complete())
}

/// Heights of the raw poses in a log, and whether the log is complete.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn heights(log: &Path) -> (Vec<(f64, f64)>, bool) {
    let (poses, is_complete) = records(log, "/vicon/raw");
    (poses.iter().map(|(t_s, pose)| (*t_s, pose["z"].as_f64().unwrap())).collect(), is_complete)
}

#[test]
fn every_signal_to_end_lands_and_keeps_the_log() {
    // Also with nobody left to read the status line.
    let flights = [("-INT", true), ("-TERM", false), ("-HUP", false)].map(|(name, is_blind)| {
        let folder = folder(&format!("end{name}"));
        let mut child = start_flight(&folder, &[], 0);
        if is_blind {
            drop(child.stderr.take());
        }
        (name, folder, child)
    });
    sleep(Duration::from_secs(9));
    for (name, _, child) in &flights {
        signal(child, name);
    }
    for (_, folder, child) in flights {
        assert_is_landed(&folder, &child.wait_with_output().unwrap());
    }
}

fn assert_is_landed(folder: &Path, output: &Output) {
    assert_eq!(output.status.code(), Some(1), "{}", text(output));
    assert_eq!(json(output)["phase"], "landed", "{}", text(output));
    assert_flew_and_landed(&folder.join("flight.mcap"));
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn assert_flew_and_landed(log: &Path) {
    let (heights, is_complete) = heights(log);
    let highest_m = heights.iter().map(|(_, z)| *z).fold(0.0, maximum);
    let last_m = heights.last().unwrap().1;
    assert!(is_complete && highest_m > 0.8 && last_m < 0.1, "{is_complete}, {highest_m}, {last_m}");
}

#[test]
fn a_flight_and_a_report_that_nobody_reads_end_as_if_somebody_did() {
    let folder = folder("unread");
    // Gone before the first byte, so that no write of any length goes through.
    let nobody = || Stdio::from(std::io::pipe().unwrap().1);
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_tello-ctl"));
        command.args(arguments).current_dir(&folder).stdin(Stdio::null()).stdout(nobody());
        command
    };
    let flight = ["fly", "--sim", "--profile", "clean", "--log", "flight.mcap"];
    // Not even its messages are read: it flies, lands and keeps its log.
    assert_eq!(run(&flight).stderr(nobody()).status().unwrap().code(), Some(0));
    assert_flew_and_landed(&folder.join("flight.mcap"));
    for report in [
        &["check"][..],
        &["check", "--schema", "fly"],
        &["log", "info", "flight.mcap"],
        &["log", "info", "flight.mcap", "--json"],
        &["sim", "--batch", "1"],
    ] {
        let output = run(report).output().unwrap();
        assert_eq!((output.status.code(), text(&output)), (Some(0), String::new()), "{report:?}");
    }
}

#[test]
fn mocap_that_stops_in_flight_lands_the_drone() {
    let folder = folder("silence");
    let mut sim: Value =
        serde_json::from_str(&fs::read_to_string(config_file("sim.json")).unwrap()).unwrap();
    sim["faults"] =
        serde_json::json!([{ "fault": "mocap_silent", "from_s": 9.0, "for_s": 1000.0 }]);
    fs::write(folder.join("sim.json"), sim.to_string()).unwrap();
    let output = tello_ctl(&folder, &["fly", "--sim", "--json", "--sim-config", "sim.json"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    let summary = json(&output);
    assert_eq!(summary["phase"], "landed", "{summary}");
    let faults = summary["faults"].as_array().unwrap();
    assert!(faults.contains(&"mocap_lost".into()), "{summary}");
}

#[test]
fn the_simulator_alone_is_flown_by_another_process() {
    let folder = folder("alone");
    let any_port = "127.0.0.1:0";
    let mut sim = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["sim", "--profile", "clean", "--json", "--drone-address", any_port])
        .args(["--relay-address", any_port, "--datastream-address", any_port])
        .args(["--natnet-address", any_port, "--qtm-address", any_port, "--vrpn-address", any_port])
        .current_dir(&folder)
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = String::new();
    BufReader::new(sim.stdout.take().unwrap()).read_line(&mut line).unwrap();
    let addresses: Value = serde_json::from_str(&line).unwrap();
    let file = changed_fly(&folder, |table| {
        table["mocap"]["relay"]["address"] = addresses["relay"].clone();
        table["tello"]["address"] = addresses["drone"].clone();
    });
    let output = tello_ctl(&folder, &["fly", "--yes", "--json", "--config", &file]);
    interrupt(&sim);
    assert_eq!(sim.wait().unwrap().code(), Some(0));
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(json(&output)["targets_reached"], 5, "{}", text(&output));
}

#[test]
fn a_killed_flight_leaves_its_log_up_to_the_last_second() {
    let folder = folder("kill");
    let mut child = start_flight(&folder, &[], 6);
    child.kill().unwrap();
    child.wait().unwrap();
    let (heights, is_complete) = heights(&folder.join("flight.mcap"));
    let last_s = heights.last().unwrap().0;
    assert!(!is_complete);
    // Six seconds less the start of the program, the last second and a busy machine.
    assert!(last_s > 3.5, "the log ends after {last_s} s");
}

#[test]
fn a_dry_run_plans_and_sends_nothing() {
    let folder = folder("dry");
    let child = start_flight(&folder, &["--dry-run"], 4);
    interrupt(&child);
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("\"is_dry_run\":true"), "{}", text(&output));
    let (heights, _) = heights(&folder.join("flight.mcap"));
    assert!(heights.iter().all(|(_, z)| *z < 0.1), "the drone moved: {}", text(&output));
    let mut log = LogReader::open(&folder.join("flight.mcap")).unwrap().select(&["/control/plan"]);
    assert!(log.next_message().unwrap().is_some(), "nothing was planned: {}", text(&output));
}

#[test]
fn a_dry_run_without_any_mocap_ends_and_says_so() {
    // A privileged port: nothing listens there and no other test is given it.
    const NOBODY: &str = "127.0.0.1:1";
    let folder = folder("dry-alone");
    let file = changed_fly(&folder, |table| {
        table["mocap"]["relay"]["address"] = NOBODY.into();
        table["tello"]["address"] = NOBODY.into();
    });
    let output = tello_ctl(&folder, &["fly", "--dry-run", "--config", &file]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let message = text(&output);
    assert!(message.contains("not ready to fly within 10 s: mocap stale"), "{message}");
    // After 2 s, and at the end.
    let (first, _) = message.split_once("not ready").unwrap();
    assert!(first.contains("note  mocap      no pose, nobody is at 127.0.0.1"), "{message}");
}

#[test]
fn every_settings_file_of_the_project_is_valid() {
    let folder = folder("check");
    let root = PathBuf::from(config_file(""));
    let mut files = vec![];
    for sub in ["", "missions", "targets", "thesis"] {
        for entry in fs::read_dir(root.join(sub)).unwrap() {
            let path = entry.unwrap().path();
            if path.extension().is_some_and(|extension| extension == "json") {
                files.push(path.display().to_string());
            }
        }
    }
    assert!(files.len() >= 8, "{files:?}");
    let arguments: Vec<&str> =
        ["check", "--json"].into_iter().chain(files.iter().map(String::as_str)).collect();
    let output = tello_ctl(&folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert_eq!(json(&output)["files"].as_array().unwrap().len(), files.len());
}

#[test]
fn bad_settings_are_refused_with_file_key_value_and_rule() {
    let folder = folder("settings");
    let refuse = |change: &dyn Fn(&mut Value), words: &[&str]| {
        let file = changed_fly(&folder, change);
        for arguments in [&["check", &file][..], &["fly", "--sim", "--config", &file][..]] {
            let output = tello_ctl(&folder, arguments);
            let code = if arguments[0] == "check" { 1 } else { 2 };
            assert_eq!(output.status.code(), Some(code), "{}", text(&output));
            for word in words {
                assert!(text(&output).contains(word), "{word} is not in {}", text(&output));
            }
        }
    };
    let mpc = |table: &mut Value, key: &str, value: Value| table["cycle"]["mpc"][key] = value;
    refuse(&|table| mpc(table, "horizn_steps", 3.into()), &["horizn_steps", "changed.json"]);
    refuse(
        &|table| drop(table["cycle"]["mpc"].as_object_mut().unwrap().remove("C_u")),
        &["missing field `C_u`", "changed.json"],
    );
    refuse(&|table| mpc(table, "horizon_steps", 0.into()), &["cycle.mpc.horizon_steps = 0"]);
    refuse(&|table| mpc(table, "C_u", "high".into()), &["cycle.mpc.C_u", "invalid type"]);
    refuse(&|table| table["cycle"]["dt_s"] = (-1).into(), &["cycle.dt_s = -1"]);
}

#[test]
fn a_nan_weight_is_no_json_and_a_huge_one_is_no_number() {
    let folder = folder("nan");
    for bad in ["NaN", "1e999", "-Infinity"] {
        let text_in = fs::read_to_string(config_file("fly.json")).unwrap();
        let file = folder.join("bad.json");
        fs::write(&file, text_in.replacen("\"dt_s\": 0.02", &format!("\"dt_s\": {bad}"), 1))
            .unwrap();
        let output = tello_ctl(&folder, &["check", &file.display().to_string()]);
        assert_eq!(output.status.code(), Some(1), "{}", text(&output));
        let line = 1 + text_in.lines().position(|line| line.contains("\"dt_s\"")).unwrap();
        assert!(text(&output).contains(&format!("bad.json:{line}:")), "{}", text(&output));
        let rule = format!("cycle.dt_s = {bad}: expected finite");
        assert!(text(&output).contains(&rule), "{}", text(&output));
    }
}

#[test]
fn a_missing_file_is_named() {
    let folder = folder("missing");
    for arguments in [
        &["check", "nowhere.json"][..],
        &["fly", "--sim", "--config", "nowhere.json"][..],
        &["fly", "--sim", "--mission", "nowhere.json"][..],
        &["replay", "nowhere.json"][..],
    ] {
        let output = tello_ctl(&folder, arguments);
        assert_ne!(output.status.code(), Some(0), "{}", text(&output));
        assert!(text(&output).contains("cannot read nowhere.json"), "{}", text(&output));
    }
}

#[test]
fn mocap_that_never_answers_and_a_drone_that_never_answers_end_on_the_ground() {
    // A relay that accepts and says nothing, and a drone that ignores packets.
    let folder = folder("silent");
    let relay = TcpListener::bind("127.0.0.1:0").unwrap();
    let drone = UdpSocket::bind("127.0.0.1:0").unwrap();
    let file = changed_fly(&folder, |table| {
        table["mocap"]["relay"]["address"] = relay.local_addr().unwrap().to_string().into();
        table["tello"]["address"] = drone.local_addr().unwrap().to_string().into();
    });
    let output = tello_ctl(&folder, &["fly", "--yes", "--config", &file]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let message = text(&output);
    for part in [
        "pre-flight",
        "ok    mission    5 targets",
        "FAIL  mocap      no pose, nothing comes from 127.0.0.1",
        "FAIL  start      unknown",
        "FAIL  drone      it does not answer on 127.0.0.1",
        "note  operator   no keys",
        "not ready to fly within 10 s",
    ] {
        assert!(message.contains(part), "{part:?} is missing: {message}");
    }
}

#[test]
fn a_busy_port_is_named_with_the_way_out() {
    let folder = folder("busy");
    let busy = UdpSocket::bind("0.0.0.0:0").unwrap();
    let port = busy.local_addr().unwrap().port();
    let file = changed_fly(&folder, |table| {
        let tello = &mut table["tello"];
        (tello["local_port"], tello["address"]) = (port.into(), "127.0.0.1:8889".into());
    });
    let output = tello_ctl(&folder, &["fly", "--yes", "--config", &file]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains(&port.to_string()), "{}", text(&output));
}

#[test]
fn a_batch_prints_equal_bytes_for_equal_arguments() {
    let folder = folder("batch");
    let arguments = ["sim", "--batch", "4", "--seed", "3", "--profile", "outages", "--json"];
    let (first, again) = (tello_ctl(&folder, &arguments), tello_ctl(&folder, &arguments));
    assert_eq!(first.status.code(), Some(0), "{}", text(&first));
    assert_eq!(first.stdout, again.stdout);
    assert_eq!(json(&first)["flights"].as_array().unwrap().len(), 4);
    let other = tello_ctl(&folder, &["sim", "--batch", "4", "--seed", "4", "--json"]);
    assert_ne!(first.stdout, other.stdout);
}
