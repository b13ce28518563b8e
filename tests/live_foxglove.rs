//! `fly --foxglove` in the hands of a client that we did not write: the Python package `websockets`.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use horizon_model::check::maximum;
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use tello_eval::{flight_log, scene};
use tello_flight::cycle::Topic;
use tello_io::log::LogReader;

use crate::program;
use crate::python;
use program::{folder, tello_ctl, text};

/// Starts a simulated flight that viewers can watch at `address`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(folder: &Path, address: &str) -> Child {
    Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["fly", "--sim", "--no-keys", "--log", "flight.mcap", "--foxglove", address])
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap()
}

/// The first line of what the program says that has `word`, and nobody reads the rest.
#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
fn says(program: &mut Child, word: &str) -> String {
    let lines = BufReader::new(program.stderr.take().unwrap()).lines().map(Result::unwrap);
    let mut lines = lines.inspect(|line| println!("{line}"));
    let line = lines.find(|line| line.contains(word)).expect("it ended without a word");
    // A pipe that nobody reads fills up; one that is closed does not hold up the status line.
    drop(lines);
    line
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn land(mut program: Child) -> Option<i32> {
    let pid = i32::try_from(program.id()).unwrap();
    kill(Pid::from_raw(pid), Signal::SIGINT).unwrap();
    program.wait().unwrap().code()
}

/// Messages of `topics` as text without spaces or as hexadecimal digits, by time since 1970 in ns.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn logged(log: &Path, topics: &[&str]) -> BTreeSet<(String, u64, String)> {
    let log = LogReader::open(log).unwrap();
    let started = log.head().started_unix_ns;
    let mut log = log.select(topics);
    let mut messages = BTreeSet::new();
    while let Some(message) = log.next_message().unwrap() {
        let hexadecimal =
            || message.data.iter().fold(String::new(), |text, byte| text + &format!("{byte:02x}"));
        let value: Value =
            if message.is_json { message.decode().unwrap() } else { hexadecimal().into() };
        let time = started.checked_add_signed(message.t.0).unwrap();
        messages.insert((message.topic.to_owned(), time, value.to_string()));
    }
    messages
}

#[test]
fn a_viewer_sees_what_the_log_has() {
    let Some(python) = python::with("websockets, foxglove_schemas_protobuf.Log_pb2") else {
        return;
    };
    let folder = folder("live-foxglove");
    let mut program = fly(&folder, "127.0.0.1:0");
    let line = says(&mut program, "ws://");
    let url = line.split_whitespace().last().unwrap();
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../tests/live_foxglove.py");
    let watched =
        Command::new(python).arg(script).args([url, "seen.jsonl"]).current_dir(&folder).output();
    assert_eq!(land(program), Some(1), "landed early");
    let watched = watched.unwrap();
    assert!(watched.status.success(), "{}", text(&watched));

    let channels: BTreeMap<String, (String, Vec<String>)> =
        serde_json::from_slice(&watched.stdout).unwrap();
    let known: BTreeSet<&str> = Topic::ALL
        .iter()
        .copied()
        .map(Topic::name)
        .chain(scene::topics())
        .chain([flight_log::STREAM, flight_log::LINK])
        .collect();
    assert_eq!(channels.keys().map(String::as_str).collect::<BTreeSet<_>>(), known);
    assert_eq!(channels["/scene/flight"].0, "foxglove.SceneUpdate");
    for key in ["x", "y", "z", "theta"] {
        assert!(channels["/estim/state"].1.iter().any(|known| known == key), "{channels:?}");
    }

    let mut counts = BTreeMap::new();
    let in_log =
        logged(&folder.join("flight.mcap"), &["/estim/state", "/scene/flight", "/scene/log"]);
    let mut highest_m = 0.0_f64;
    for line in fs::read_to_string(folder.join("seen.jsonl")).unwrap().lines() {
        let seen: Value = serde_json::from_str(line).unwrap();
        let topic = seen["topic"].as_str().unwrap();
        *counts.entry(topic.to_owned()).or_insert(0_u32) += 1;
        let message = (topic.to_owned(), seen["t"].as_u64().unwrap(), seen["message"].to_string());
        assert!(in_log.contains(&message), "not in the log: {line}");
        if topic == "/estim/state" {
            highest_m = maximum(highest_m, seen["message"]["z"].as_f64().unwrap());
        }
    }
    assert!((0.3..3.0).contains(&highest_m), "flies {highest_m} m high");
    assert!(counts["/estim/state"] > 100 && counts["/scene/flight"] > 20, "{counts:?}");
    assert!(counts["/scene/log"] >= 1, "{counts:?}");
    println!("{counts:?}, {highest_m} m high");
}

#[test]
fn an_address_that_is_taken_is_a_warning() {
    let folder = folder("live-foxglove-taken");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let mut program = fly(&folder, &address);
    let line = says(&mut program, "Foxglove");
    assert!(line.contains("warning: cannot serve") && line.contains(&address), "{line}");
    // It flies on.
    assert_eq!(program.try_wait().unwrap(), None);
    land(program);
    let info = tello_ctl(&folder, &["log", "info", "flight.mcap"]);
    assert_eq!(info.status.code(), Some(0), "{}", text(&info));
}
