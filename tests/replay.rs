//! A flight repeats itself: `tello-ctl replay` on logs of our own, made in virtual time.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use tello_eval::flight_log::{self, TickRecord};
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, Inbox, Outcome, TickStage, Timing, Unwatched, Watch};
use tello_io::config;
use tello_io::log::LogReader;
use tello_sim::virtual_time::VirtualFlight;

use crate::program::text;

/// A fresh folder of a test.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn folder(name: &str) -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("replay-{name}"));
    fs::remove_dir_all(&folder).ok();
    fs::create_dir_all(&folder).unwrap();
    folder
}

/// A log of `ticks` ticks of a virtual flight.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn make_log(path: &Path, start: Start, ticks: u64) -> FlightTable {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, start);
    let sim = tello_sim::settings(None).unwrap();
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 11).unwrap();
    let mut log = flight_log::create(path, &flight, 0, &virtual_flight.new_outcome()).unwrap();
    for step in 0..ticks {
        let out = virtual_flight.tick().unwrap().clone();
        let inbox = virtual_flight.inbox().clone();
        let timing = Timing { step, ..Timing::default() };
        flight_log::write_tick(&mut log, &TickRecord { inbox, out, timing }).unwrap();
    }
    log.finish().unwrap();
    flight
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn replay(arguments: &[&Path]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_tello-ctl")).arg("replay").args(arguments).output().unwrap()
}

#[test]
fn a_flight_replays_bit_by_bit() {
    let folder = folder("equal");
    let log = folder.join("flight.mcap");
    make_log(&log, Start::Airborne, 600);
    let again = folder.join("again.mcap");
    let output = replay(&[&log, Path::new("--out"), &again]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("equal, bit by bit"), "{}", text(&output));
    // Viewers can draw the repeated flight.
    let mut scene = LogReader::open(&again).unwrap().select(&["/scene/pose"]);
    let mut poses = 0;
    while scene.next_message().unwrap().is_some() {
        poses += 1;
    }
    assert!(poses > 500, "{poses} poses in 600 ticks");
}

#[test]
fn a_changed_weight_is_named_with_its_first_tick_and_channel() {
    let folder = folder("weight");
    let log = folder.join("flight.mcap");
    make_log(&log, Start::Airborne, 300);
    let (mut fly, _) = config::fly(None, None).unwrap();
    fly.cycle.mpc.c_u[0] *= 1.01;
    let changed = folder.join("changed.json");
    fs::write(&changed, serde_json::to_string(&fly).unwrap()).unwrap();
    let output = replay(&[&log, Path::new("--config"), &changed]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("first difference: tick"), "{}", text(&output));
    assert!(text(&output).contains("/control/"), "{}", text(&output));
}

#[test]
fn a_log_without_flight_cannot_pass() {
    let folder = folder("grounded");
    let grounded = folder.join("grounded.mcap");
    make_log(&grounded, Start::Grounded, 20);
    let output = replay(&[&grounded]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("never steered"), "{}", text(&output));
    // Nothing differs: it is not called different.
    assert!(!text(&output).contains("NOT equal"), "{}", text(&output));
    assert!(text(&output).contains("20 ticks are equal, and none"), "{}", text(&output));
    assert_eq!(finding(&grounded), "never_steered");

    let unsteered = folder.join("unsteered.mcap");
    make_log(&unsteered, Start::Carried, 20);
    let output = replay(&[&unsteered]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));

    let empty = folder.join("empty.mcap");
    make_log(&empty, Start::Airborne, 0);
    let output = replay(&[&empty]);
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    assert!(text(&output).contains("no tick"), "{}", text(&output));
}

/// Name of the result in `--json`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn finding(log: &Path) -> String {
    let output = replay(&[log, Path::new("--json")]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(report["is_equal"] == true, report["finding"] == "equal", "{report}");
    report["finding"].as_str().unwrap().to_owned()
}

/// A watch whose time is over at one poll.
struct LateAt {
    poll: u32,
    polls: u32,
}

impl Watch for LateAt {
    fn is_late(&mut self) -> bool {
        self.polls += 1;
        self.polls > self.poll
    }

    fn mark(&mut self, _stage: TickStage) {}

    fn send(&mut self, _out: &Outcome) {}
}

#[test]
fn a_late_solve_is_repeated_where_it_was_late_and_nowhere_else() {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let sim = tello_sim::settings(None).unwrap();
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 3).unwrap();
    let mut inboxes: Vec<Inbox> = (0..200)
        .map(|_| {
            virtual_flight.tick().unwrap();
            virtual_flight.inbox().clone()
        })
        .collect();
    let (mut live, mut repeated, mut wrong) = (
        cycle::build(&flight).unwrap(),
        cycle::build(&flight).unwrap(),
        cycle::build(&flight).unwrap(),
    );
    let (mut out, mut again, mut other) =
        (live.new_outcome(), live.new_outcome(), live.new_outcome());
    let mut is_different = false;
    for (inbox, poll) in inboxes.iter_mut().zip((0..6).cycle()) {
        live.tick(inbox, &mut LateAt { poll, polls: 0 }, &mut out);
        inbox.late_at_poll = Some(poll);
        repeated.tick(inbox, &mut Unwatched::as_recorded(inbox), &mut again);
        assert_eq!(out, again, "late at poll {poll}");
        inbox.late_at_poll = Some(poll + 1);
        wrong.tick(inbox, &mut Unwatched::as_recorded(inbox), &mut other);
        is_different |= out != other;
    }
    assert!(is_different, "one poll more changes nothing: the watch is not asked");
    assert!(out.u_sent.amax() > 0.0, "never steered");
}

#[test]
fn a_torn_log_is_repeated_up_to_the_tear_and_does_not_pass() {
    let folder = folder("torn");
    let log = folder.join("flight.mcap");
    make_log(&log, Start::Airborne, 600);
    let bytes = fs::read(&log).unwrap();
    let torn = folder.join("torn.mcap");
    fs::write(&torn, &bytes[..bytes.len() * 7 / 10]).unwrap();
    let output = replay(&[&torn]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("torn"), "{}", text(&output));
    assert!(!text(&output).contains("first difference: tick"), "{}", text(&output));
    assert!(!text(&output).contains("NOT equal"), "{}", text(&output));
    assert!(text(&output).contains("equal up to the tear"), "{}", text(&output));
    assert_eq!(finding(&torn), "torn");
    assert_eq!(finding(&log), "equal");
}

#[test]
fn a_missing_tick_is_named_and_what_follows_is_not_called_different() {
    let folder = folder("gap");
    let log = folder.join("flight.mcap");
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let sim = tello_sim::settings(None).unwrap();
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 11).unwrap();
    let shape = virtual_flight.new_outcome();
    let mut writer = flight_log::create(&log, &flight, 0, &shape).unwrap();
    for step in 0..100 {
        let out = virtual_flight.tick().unwrap().clone();
        let inbox = virtual_flight.inbox().clone();
        let timing = Timing { step, ..Timing::default() };
        if step != 60 {
            flight_log::write_tick(&mut writer, &TickRecord { inbox, out, timing }).unwrap();
        }
    }
    writer.finish().unwrap();
    let output = replay(&[&log]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(text(&output).contains("no tick 60"), "{}", text(&output));
    assert!(!text(&output).contains("NOT equal"), "{}", text(&output));
    assert_eq!(finding(&log), "tick_missing");
}

#[test]
fn what_is_no_log_is_refused_with_a_reason() {
    let folder = folder("refused");
    let empty = folder.join("empty.log");
    fs::write(&empty, "").unwrap();
    let missing = folder.join("missing.mcap");
    let prose = folder.join("prose.log");
    fs::write(&prose, "no flight in here\n").unwrap();
    for (path, reason) in [(&empty, "is empty"), (&missing, "cannot read"), (&prose, "no flight")] {
        let output = replay(&[path, Path::new("--out"), &folder.join("out.mcap")]);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output));
        let name = path.file_name().unwrap().to_string_lossy();
        assert!(text(&output).contains(reason), "{}", text(&output));
        assert!(text(&output).contains(&*name), "{}", text(&output));
    }
}
