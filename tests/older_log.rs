//! A flight that an earlier revision recorded, through the tick of this one: its settings are read, and the decisions
//! are the same.
//!
//! `tests/data/flight_7a8414a7.mcap`: `fly --sim --profile bad_day` of revision 7a8414a7 (2026-11-26), a step of 1.1 m
//! over sockets in real time; of its channels the inboxes and what is compared here.

use std::path::{Path, PathBuf};

use horizon_model::check::maximum;
use serde_json::Value;
use tello_eval::flight_log;
use tello_flight::Phase;
use tello_flight::cycle::{self, FlightTable, Inbox, Unwatched};
use tello_io::log::LogReader;

/// Largest difference of sticks and states: the last bits of sine and exponential differ between machines.
/// Mixed, by the row
const TOLERANCE: f64 = 1e-6;

/// Rows of `/estim/state` and of `/tello/command`, in the order of the vectors.
const STATE: [&str; 11] =
    ["x", "y", "z", "theta", "v_x", "v_y", "v_z", "omega", "d_x", "d_y", "d_z"];
const COMMAND: [&str; 4] = ["roll", "pitch", "yaw", "throttle"];

fn log() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/flight_7a8414a7.mcap")
}

/// One tick as it was recorded.
#[derive(Debug, Default)]
struct Recorded {
    inbox: Inbox,
    state: Option<[f64; STATE.len()]>,
    command: Option<[f64; COMMAND.len()]>,
    phase: Option<Value>,
    faults: Option<Value>,
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn rows<const N: usize>(record: &Value, names: [&str; N]) -> [f64; N] {
    names.map(|name| record[name].as_f64().unwrap())
}

/// Settings and ticks of the log.
#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
fn read() -> (FlightTable, Vec<Recorded>) {
    let path = log();
    let mut log = LogReader::open(&path).unwrap();
    let settings = flight_log::settings(&log, &path).unwrap();
    let mut ticks: Vec<Recorded> = Vec::new();
    while let Some(message) = log.next_message().unwrap() {
        if message.topic == "/cycle/inbox" {
            ticks.push(Recorded { inbox: message.decode().unwrap(), ..Recorded::default() });
            continue;
        }
        let record: Value = message.decode().unwrap();
        let tick = ticks.last_mut().unwrap();
        assert_eq!(record["step"], tick.inbox.step, "{}", message.topic);
        match message.topic {
            "/estim/state" => tick.state = Some(rows(&record, STATE)),
            "/tello/command" => tick.command = Some(rows(&record, COMMAND)),
            "/supervisor/phase" => tick.phase = Some(record["phase"].clone()),
            "/supervisor/fault" => tick.faults = Some(record["faults"].clone()),
            other => panic!("{other} is not compared"),
        }
    }
    (settings, ticks)
}

/// Largest entry of `a - b`; NaN if any is, infinite if one is missing.
fn gap(a: &[f64], b: Option<&[f64]>) -> f64 {
    match b {
        Some(b) if a.len() == b.len() => {
            a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, maximum)
        }
        None if a.is_empty() => 0.0,
        _ => f64::INFINITY,
    }
}

/// The largest difference of states and of sticks, and the number of ticks that steered.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn repeat(settings: &FlightTable, ticks: &[Recorded]) -> (f64, f64, usize) {
    let mut cycle = cycle::build(settings).unwrap();
    let mut out = cycle.new_outcome();
    let (mut state_gap, mut stick_gap, mut steered) = (0.0, 0.0, 0);
    for tick in ticks {
        cycle.tick(&tick.inbox, &mut Unwatched::as_recorded(&tick.inbox), &mut out);
        state_gap =
            maximum(state_gap, gap(&out.s_hat, tick.state.as_ref().map(<[f64; _]>::as_slice)));
        let command = tick.command.as_ref().map(<[f64; _]>::as_slice);
        stick_gap = maximum(stick_gap, gap(out.u_sent.as_slice(), command));
        steered += usize::from(out.u_sent.amax() > 0.0);
        let decision = out.decision.unwrap();
        let faults: Vec<_> = decision.faults.iter().collect();
        let step = tick.inbox.step;
        assert_eq!(serde_json::to_value(decision.phase).ok(), tick.phase, "tick {step}");
        let recorded = tick.faults.clone().unwrap_or_else(|| Value::Array(Vec::new()));
        assert_eq!(serde_json::to_value(&faults).unwrap(), recorded, "tick {step}");
    }
    assert_eq!(out.phase(), Phase::Landed);
    (state_gap, stick_gap, steered)
}

#[test]
fn a_flight_of_an_earlier_revision_is_repeated_by_this_one() {
    let (settings, ticks) = read();
    assert_eq!(ticks.len(), 794);
    let (state_gap, stick_gap, steered) = repeat(&settings, &ticks);
    assert_eq!(steered, 221);
    assert!(state_gap <= TOLERANCE, "estimates differ by {state_gap:.1e}");
    assert!(stick_gap <= TOLERANCE, "sticks differ by {stick_gap:.1e}");
}

#[test]
fn one_changed_weight_shows_in_the_repeated_flight() {
    let (settings, ticks) = read();
    let mut control = settings.clone();
    control.cycle.mpc.c_u[0] *= 1.01;
    let (_, stick_gap, _) = repeat(&control, &ticks);
    assert!(stick_gap > 100.0 * TOLERANCE, "{stick_gap:.1e}");
}
