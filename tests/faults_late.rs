//! The mocap link falls behind while the program flies an emulated drone over real sockets: judged at the
//! drone's socket.

#[path = "faults_late/proxies.rs"]
mod proxies;
use std::fs;
use std::process::{Command, Stdio};
use std::thread::{self, sleep};
use std::time::Duration;

use serde_json::Value;
use tello_io::clock::{Clock, TimeNs};
use tello_sim::DronePhase;

use crate::rig;
use proxies::{Lag, Poses, Radio};

/// When the drone flies to its first target. s after the take-off
const FLYING_AFTER_S: f64 = 5.0;

/// Age from which a pose is not used. s
const LATE_S: f64 = 0.1;

/// Largest times from there. s
const NEUTRAL_MAX_S: f64 = 1.0;
const LANDING_MAX_S: f64 = 2.5;

/// Flies until the drone stands again; the times of the last deflected stick and of the first landing,
/// after the mocap fell behind. s
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(name: &str, lag: Lag) -> (f64, f64) {
    let clock = Clock::start();
    let mut poses = None;
    let through_proxy = |relay| poses.insert(Poses::start(relay, clock)).address;
    let (folder, emulator) = rig::start(&format!("late-{name}"), through_proxy);
    let poses = poses.unwrap();
    let radio = Radio::start(emulator.drone_address(), clock);
    let settings = folder.join("fly.json");
    let mut table: Value = serde_json::from_str(&fs::read_to_string(&settings).unwrap()).unwrap();
    table["tello"]["address"] = radio.address.to_string().into();
    fs::write(&settings, table.to_string()).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["fly", "--yes", "--config", "fly.json", "--log", "flight.mcap"])
        .current_dir(&folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let wait_for = |phase: DronePhase| {
        let begin = clock.now();
        while emulator.truth().phase != phase {
            assert!(clock.now().since(begin).seconds() < 40.0, "{lag:?}: {:?}", emulator.truth());
            sleep(Duration::from_millis(20));
        }
    };
    wait_for(DronePhase::Flying);
    sleep(Duration::from_secs_f64(FLYING_AFTER_S));
    let steered_s = clock.now().since(radio.heard().last_stick_at.unwrap()).seconds();
    assert!(steered_s < 0.2, "{lag:?}: not steered for {steered_s} s");
    let begin = poses.fall_behind(lag);
    wait_for(DronePhase::Grounded);
    assert!(!child.wait().unwrap().success());
    let after_s = |at: Option<TimeNs>| at.unwrap().since(begin).seconds();
    (after_s(radio.heard().last_stick_at), after_s(radio.heard().first_landing_at))
}

/// The drone is sent neutral sticks and a landing in time once poses are late, `late_at_s` after the link
/// begins to fall behind.
fn assert_lands(name: &str, lag: Lag, late_at_s: f64) {
    let (last_stick_s, landing_s) = fly(name, lag);
    println!("{lag:?}: last stick after {last_stick_s:.2} s, landing after {landing_s:.2} s");
    assert!(last_stick_s < late_at_s + NEUTRAL_MAX_S, "{lag:?}: steered for {last_stick_s} s");
    assert!(landing_s < late_at_s + LANDING_MAX_S, "{lag:?}: landing after {landing_s} s");
    assert!(
        landing_s > late_at_s + 1.0,
        "{lag:?}: landing after {landing_s} s, before it was lost"
    );
}

#[test]
fn a_mocap_link_that_falls_behind_lands_the_drone() {
    let lags = [
        ("400-ms", Lag::Step(0.4), 0.0),
        ("1200-ms", Lag::Step(1.2), 0.0),
        ("50-ms-per-s", Lag::Growth(0.05), LATE_S / 0.05),
        ("150-ms-per-s", Lag::Growth(0.15), LATE_S / 0.15),
        // A line takes about 60 bytes, 50 times a second: the link falls behind by a third of the time
        // at least.
        ("slow", Lag::Slow(2_000.0), LATE_S / 0.3),
    ];
    // Side by side: each takes its time by the clock. The scope ends in the panics of its threads.
    thread::scope(|flights| {
        for (name, lag, late_at_s) in lags {
            flights.spawn(move || assert_lands(name, lag, late_at_s));
        }
    });
}
