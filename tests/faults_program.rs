//! Parts of the program, or the way to it, fail while it flies an emulated drone over real sockets: judged by
//! the emulator.

#[path = "faults_program/hose.rs"]
mod hose;
mod rig;

use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use tello_io::clock::Clock;
use tello_io::log::LogReader;
use tello_sim::{Cause, Emulator, Phase};

use hose::{Flow, Hose};

/// When the part fails: the drone is in the air and steered. s
const DRILL_AT_S: u64 = 9;

/// When the drone is under way to its first target. s after the take-off
const UNDER_WAY_S: u64 = 5;

/// The program, and the drone that it flies.
struct Bench {
    emulator: Emulator,
    /// What the poses come through.
    hose: Hose,
    child: Child,
    folder: PathBuf,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Bench {
    /// Starts a flight over real sockets.
    fn start(name: &str, more: &[&str]) -> Self {
        let mut hose = None;
        let through_hose = |relay| hose.insert(Hose::start(relay)).address;
        let (folder, emulator) = rig::start(&format!("faults-{name}"), through_hose);
        let hose = hose.unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
            .args(["fly", "--yes", "--config", "fly.json", "--log", "flight.mcap"])
            .args(more)
            .current_dir(&folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { emulator, hose, child, folder }
    }

    fn signal(&self, name: &str) {
        let pid = self.child.id().to_string();
        assert!(Command::new("kill").args([name, &pid]).status().unwrap().success());
    }

    /// Waits until the drone is in `phase`; the time that it took. s
    fn wait_for(&self, phase: Phase, at_most_s: f64) -> f64 {
        let clock = Clock::start();
        while clock.now().seconds() < at_most_s {
            if self.emulator.truth().phase == phase {
                return clock.now().seconds();
            }
            sleep(Duration::from_millis(20));
        }
        panic!("not {phase:?} within {at_most_s} s: {:?}", self.emulator.truth());
    }

    /// Waits until the drone flies its mission, fast.
    fn wait_until_under_way(&self) {
        self.wait_for(Phase::Flying, 30.0);
        sleep(Duration::from_secs(UNDER_WAY_S));
        let speed_mps = self.speed_mps();
        assert!(speed_mps > 0.2, "not under way: {speed_mps} m/s");
    }

    /// Horizontal speed of the drone. m/s
    fn speed_mps(&self) -> f64 {
        let velocity = self.emulator.truth().velocity;
        velocity.x_mps.hypot(velocity.y_mps)
    }

    /// The drone takes off, is landed by order and stands; the program ends, and its log is closed.
    fn assert_landed(self) {
        self.wait_for(Phase::Flying, 30.0);
        self.assert_comes_down(30.0);
    }

    /// The drone is landed by order within `at_most_s` and stands; the program ends, and its log is
    /// closed. What comes back is the time to the landing. s
    fn assert_comes_down(mut self, at_most_s: f64) -> f64 {
        let after_s = self.wait_for(Phase::Landing(Cause::Order), at_most_s);
        self.wait_for(Phase::Grounded, 30.0);
        let status = self.child.wait().unwrap();
        assert!(!status.success(), "{status:?}");
        let truth = self.emulator.truth();
        assert_eq!(truth.phase, Phase::Grounded, "{truth:?}");
        // Neutral sticks directly before each repetition of the landing, and no others.
        assert!(truth.told.sticks_in_landing < truth.told.landings, "{truth:?}");
        let mut log = LogReader::open(&self.folder.join("flight.mcap")).unwrap();
        while log.next_message().unwrap().is_some() {}
        assert!(log.ending().unwrap().is_complete(), "the log is torn");
        after_s
    }
}

#[test]
fn a_control_thread_that_stands_still_lands_the_drone() {
    Bench::start("stalls", &["--drill", &format!("control-stalls@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_control_thread_that_panics_lands_the_drone_and_closes_the_log() {
    Bench::start("panics", &["--drill", &format!("control-panics@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_main_thread_that_panics_lands_the_drone_and_closes_the_log() {
    Bench::start("main-panics", &["--drill", &format!("main-panics@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn sockets_that_stand_still_are_replaced_by_a_landing() {
    Bench::start("link-stalls", &["--drill", &format!("link-stalls@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_sender_that_is_gone_is_replaced_by_a_landing() {
    Bench::start("link-dies", &["--drill", &format!("link-dies@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_killed_program_leaves_the_drone_to_its_own_net() {
    let mut bench = Bench::start("killed", &[]);
    bench.wait_for(Phase::Flying, 30.0);
    sleep(Duration::from_secs(3));
    bench.child.kill().unwrap();
    bench.child.wait().unwrap();
    let after_s = bench.wait_for(Phase::Landing(Cause::Silence), 30.0);
    assert!((14.0..17.0).contains(&after_s), "its own landing after {after_s} s");
    bench.wait_for(Phase::Grounded, 20.0);
}

/// Poses end in this way: the drone comes to rest after `stale_s`, and is landed after `lost_s`.
fn assert_silence(name: &str, flow: Flow) {
    let bench = Bench::start(name, &[]);
    bench.wait_until_under_way();
    bench.hose.set(flow);
    let after_s = bench.wait_for(Phase::Landing(Cause::Order), 10.0);
    let speed_mps = bench.speed_mps();
    assert!((1.8..2.6).contains(&after_s), "{flow:?}: landing after {after_s} s");
    assert!(speed_mps < 0.15, "{flow:?}: still at {speed_mps} m/s, so it was steered blindly");
    bench.assert_comes_down(10.0);
}

#[test]
fn a_half_open_connection_is_silence() {
    assert_silence("half-open", Flow::HalfOpen);
}

#[test]
fn one_byte_per_second_is_silence() {
    assert_silence("trickle", Flow::Trickle);
}

#[test]
fn a_program_that_was_stopped_lands_as_soon_as_it_goes_on() {
    let bench = Bench::start("stopped", &[]);
    bench.wait_until_under_way();
    bench.signal("-STOP");
    sleep(Duration::from_secs(2));
    assert_eq!(bench.emulator.truth().phase, Phase::Flying, "its own net is slower");
    bench.signal("-CONT");
    let after_s = bench.assert_comes_down(10.0);
    assert!(after_s < 0.5, "landing {after_s} s after it went on");
}
