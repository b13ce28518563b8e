//! Parts of the program fail while it flies an emulated drone over real sockets: judged by the emulator.

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use serde_json::Value;
use tello_ctl::config;
use tello_io::clock::Clock;
use tello_io::log::LogReader;
use tello_sim::{Cause, Emulator, MocapAddresses, Phase, Profile, World};

/// When the part fails: the drone is in the air and steered. s
const DRILL_AT_S: u64 = 9;

/// The program, and the drone that it flies.
struct Bench {
    emulator: Emulator,
    child: Child,
    folder: PathBuf,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Bench {
    /// Starts a flight over real sockets.
    fn start(name: &str, more: &[&str]) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("faults-{name}"));
        std::fs::remove_dir_all(&folder).ok();
        std::fs::create_dir_all(&folder).unwrap();
        let mut sim = config::sim(None).unwrap();
        sim.profile = Profile::Clean;
        let any_port = ([127, 0, 0, 1], 0).into();
        let mocap = MocapAddresses { relay: Some(any_port), ..MocapAddresses::default() };
        let emulator = Emulator::start(World::new(&sim, 1).unwrap(), any_port, mocap).unwrap();
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let text = std::fs::read_to_string(root.join("fly.json")).unwrap();
        let mut table: Value = serde_json::from_str(&text).unwrap();
        table["mission"] = root.join("missions/big_square.json").display().to_string().into();
        let relay = emulator.mocap().relay.unwrap();
        table["mocap"]["relay"]["address"] = relay.to_string().into();
        table["tello"]["address"] = emulator.drone_address().to_string().into();
        std::fs::write(folder.join("fly.json"), table.to_string()).unwrap();
        let child = Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
            .args(["fly", "--yes", "--config", "fly.json", "--log", "flight.mcap"])
            .args(more)
            .current_dir(&folder)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self { emulator, child, folder }
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

    /// The drone took off, was landed by order and stands; the program ended, and its log is closed.
    fn assert_landed(mut self) {
        self.wait_for(Phase::Flying, 30.0);
        self.wait_for(Phase::Landing(Cause::Order), 30.0);
        self.wait_for(Phase::Grounded, 30.0);
        let status = self.child.wait().unwrap();
        assert!(!status.success(), "{status:?}");
        assert_eq!(self.emulator.truth().phase, Phase::Grounded);
        let mut log = LogReader::open(&self.folder.join("flight.mcap")).unwrap();
        while log.next_message().unwrap().is_some() {}
        assert!(log.ending().unwrap().is_complete(), "the log is torn");
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
