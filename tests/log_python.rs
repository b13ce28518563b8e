//! A log of ours in the hands of a program that we did not write: the Python package `mcap`.

use std::path::Path;
use std::process::Command;

use tello_eval::flight_log::{self, TickRecord};
use tello_eval::scene::{self, Scene};
use tello_flight::Start;
use tello_flight::cycle::{Timing, Topic};
use tello_io::config;
use tello_io::mocap::StreamReport;
use tello_sim::virtual_time::VirtualFlight;

use crate::python;
use crate::support;

/// Ticks of the flight: it is still flying at the end.
const TICKS: u64 = 700;

#[test]
fn python_reads_a_log_whole_and_cut() {
    let Some(python) = python::with("mcap") else { return };
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let path = folder.join("log_python.mcap");
    std::fs::remove_file(&path).ok();

    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Grounded);
    let mut virtual_flight =
        VirtualFlight::new(&flight, &tello_sim::settings(None).unwrap(), 2).unwrap();
    let mut log = flight_log::create(&path, &flight, 0, &virtual_flight.new_outcome()).unwrap();
    let mut scene = Scene::new(&flight, 0).unwrap();
    for step in 0..TICKS {
        let out = virtual_flight.tick().unwrap().clone();
        let (inbox, timing) =
            (virtual_flight.inbox().clone(), Timing { step, ..Timing::default() });
        let tick = TickRecord { inbox, out, timing };
        flight_log::write_tick(&mut log, &tick).unwrap();
        scene.write(&mut log, &tick).unwrap();
        if step % 50 == 0 {
            let now = virtual_flight.inbox().now;
            log.write(flight_log::STREAM, now, &StreamReport::default()).unwrap();
            log.flush().unwrap();
        }
    }
    log.finish().unwrap();

    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/log_python.py");
    let output = Command::new(python)
        .arg(script)
        .arg(&path)
        .args(["--period", "0.02", "--cut", "0.7", "--topics"])
        .args(Topic::ALL.iter().copied().map(Topic::name))
        .args([flight_log::STREAM, flight_log::LINK])
        .args(scene::topics())
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
}

#[test]
fn python_reads_a_converted_recording() {
    let Some(python) = python::with("mcap") else { return };
    let Some(original) = support::data("thesis/closed_loop/big_square1_4.log") else { return };
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("log_python-converted.mcap");
    let output = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .arg("convert")
        .arg(original)
        .arg("--force")
        .arg("--out")
        .arg(&path)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/log_python.py");
    let output = Command::new(python)
        .arg(script)
        .arg(&path)
        .args(["--document", "recording.json", "--topics", "/recording/pose", "/tello/command"])
        .args(["/control/target", "/estim/parameter"])
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout) + String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{text}");
}
