//! Parts of the program, or the way to it, fail while it flies an emulated drone over real sockets: judged by
//! the emulator.

#[path = "faults_program/killed.rs"]
mod killed;
#[path = "faults_program/orders.rs"]
mod orders;
#[path = "faults_program/recording_proxy.rs"]
mod recording_proxy;
#[path = "faults_program/stalling_proxy.rs"]
mod stalling_proxy;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use serde_json::Value;
use tello_io::clock::{Clock, TimeNs};
use tello_io::log::LogReader;
use tello_sim::{Cause, DronePhase, Emulator};

use crate::program;
use crate::rig;
use recording_proxy::RecordingProxy;
use stalling_proxy::{Flow, StallingProxy};

/// When the part fails: the drone is in the air and steered. s
const DRILL_AT_S: u64 = 9;

/// When the drone flies to its first target. s after the take-off
const FLYING_AFTER_S: u64 = 5;

/// Where the program's standard error goes, in its folder.
const ERRORS: &str = "errors.txt";

/// The program, and the drone that it flies.
struct Fixture {
    emulator: Emulator,
    /// Proxy of the poses.
    mocap_proxy: StallingProxy,
    /// Proxy of the packets to the drone.
    drone_proxy: RecordingProxy,
    child: Child,
    folder: PathBuf,
}

/// The program with the settings in `folder`; nothing of it is read.
fn fly(folder: &Path, more: &[&str]) -> Command {
    by(Command::new(env!("CARGO_BIN_EXE_tello-ctl")), folder, more)
}

fn by(mut command: Command, folder: &Path, more: &[&str]) -> Command {
    command
        .args(["fly", "--config", "fly.json"])
        .args(more)
        .current_dir(folder)
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    if !more.contains(&"--log") {
        command.args(["--log", "flight.mcap"]);
    }
    command
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Fixture {
    /// Starts a flight over real sockets.
    fn start(name: &str, more: &[&str]) -> Self {
        Self::start_by(name, None, more)
    }

    /// The same, by another program and its argument, such as one that sets a limit.
    fn start_by(name: &str, starter: Option<(&str, &str)>, more: &[&str]) -> Self {
        let folder = program::folder(&format!("faults-{name}-errors"));
        let errors = File::create(folder.join(ERRORS)).unwrap();
        Self::start_with(name, starter, more, Stdio::null(), errors.into())
    }

    fn start_with(
        name: &str,
        starter: Option<(&str, &str)>,
        more: &[&str],
        out: Stdio,
        errors: Stdio,
    ) -> Self {
        let mut mocap_proxy = None;
        let through_proxy = |relay| mocap_proxy.insert(StallingProxy::start(relay)).address;
        let (folder, emulator) = rig::start(&format!("faults-{name}"), through_proxy);
        let (mocap_proxy, drone_proxy) =
            (mocap_proxy.unwrap(), RecordingProxy::start(emulator.drone_address()));
        let settings = folder.join("fly.json");
        let mut table: Value =
            serde_json::from_str(&fs::read_to_string(&settings).unwrap()).unwrap();
        table["tello"]["address"] = drone_proxy.address.to_string().into();
        fs::write(&settings, table.to_string()).unwrap();
        let mut command = if let Some((program, argument)) = starter {
            let mut command = Command::new(program);
            command.args([argument, env!("CARGO_BIN_EXE_tello-ctl")]);
            by(command, &folder, more)
        } else {
            fly(&folder, more)
        };
        let child = command.arg("--yes").stdout(out).stderr(errors).spawn().unwrap();
        Self { emulator, mocap_proxy, drone_proxy, child, folder }
    }

    /// Sends a signal to the program; when, by the clock of the proxy.
    fn send(&self, signal: Signal) -> TimeNs {
        let at = self.drone_proxy.clock.now();
        kill(Pid::from_raw(self.child.id().cast_signed()), signal).unwrap();
        at
    }

    /// Standard error of the program and its guardian.
    fn errors(&self) -> String {
        let folder = self.folder.with_file_name(format!(
            "{}-errors",
            self.folder.file_name().unwrap().to_string_lossy()
        ));
        fs::read_to_string(folder.join(ERRORS)).unwrap()
    }

    /// The program's own child.
    fn guardian(&self) -> Pid {
        self.guardian_if_any().unwrap()
    }

    fn guardian_if_any(&self) -> Option<Pid> {
        let parent = self.child.id().to_string();
        let processes = fs::read_dir("/proc").unwrap();
        let children = processes.filter_map(|process| {
            let stat = fs::read_to_string(process.ok()?.path().join("stat")).ok()?;
            // Number, name, state, parent.
            let (number, rest) = (stat.split(' ').next()?, stat.rsplit_once(") ")?.1);
            let is_child = rest.split(' ').nth(1)? == parent;
            is_child.then(|| Pid::from_raw(number.parse().unwrap()))
        });
        let children: Vec<Pid> = children.collect();
        assert!(children.len() < 2, "{children:?}");
        children.first().copied()
    }

    fn wait_until_gone(process: Pid, at_most_s: f64) {
        let clock = Clock::start();
        // A process that ended and that nobody waits for is still there, as `Z`.
        let is_there = || {
            let stat = fs::read_to_string(format!("/proc/{process}/stat"));
            stat.is_ok_and(|stat| !stat.contains(") Z"))
        };
        while is_there() {
            assert!(clock.now().seconds() < at_most_s, "{process} lives on");
            sleep(Duration::from_millis(100));
        }
    }

    /// Waits until the drone is in `phase`; the time that it took. s
    fn wait_for(&self, phase: DronePhase, at_most_s: f64) -> f64 {
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
    fn wait_until_it_flies(&self) {
        self.wait_for(DronePhase::Flying, 30.0);
        sleep(Duration::from_secs(FLYING_AFTER_S));
        let speed_mps = self.speed_mps();
        assert!(speed_mps > 0.2, "does not fly: {speed_mps} m/s");
    }

    /// Horizontal speed of the drone. m/s
    fn speed_mps(&self) -> f64 {
        let velocity = self.emulator.truth().velocity;
        velocity.x_mps.hypot(velocity.y_mps)
    }

    /// The drone takes off, is landed by order and stands; the program ends, and its log is closed.
    fn assert_landed(self) {
        self.wait_for(DronePhase::Flying, 30.0);
        self.assert_comes_down(30.0);
    }

    /// The drone is landed by order within `at_most_s` and stands; the program ends, and its log is
    /// closed. What comes back is the time to the landing. s
    fn assert_comes_down(self, at_most_s: f64) -> f64 {
        let after_s = self.wait_for(DronePhase::Landing(Cause::Order), at_most_s);
        self.assert_ends_on_the_ground();
        after_s
    }

    /// The drone stands in the end, nothing moved it after its first landing, and the log is closed.
    fn assert_ends_on_the_ground(mut self) -> (RecordingProxy, PathBuf) {
        self.wait_for(DronePhase::Grounded, 30.0);
        let status = self.child.wait().unwrap();
        assert!(status.code().is_some_and(|code| code != 0), "{status:?}");
        let truth = self.emulator.truth();
        assert_eq!(truth.phase, DronePhase::Grounded, "{truth:?}");
        self.drone_proxy.assert_only_landings(TimeNs(0), 1);
        assert_is_complete(&self.folder);
        (self.drone_proxy, self.folder)
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn assert_is_complete(folder: &Path) {
    let mut log = LogReader::open(&folder.join("flight.mcap")).unwrap();
    while log.next_message().unwrap().is_some() {}
    assert!(log.ending().unwrap().is_complete(), "the log in {} is torn", folder.display());
}

/// The last record of the link to the drone, and when it was written.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn last_link(folder: &Path) -> (TimeNs, Value) {
    let log = LogReader::open(&folder.join("flight.mcap")).unwrap();
    let mut log = log.select(&["/tello/link"]);
    let mut last = None;
    while let Some(message) = log.next_message().unwrap() {
        last = Some((message.t, message.decode().unwrap()));
    }
    last.unwrap()
}

#[test]
fn a_control_thread_that_stands_still_lands_the_drone() {
    Fixture::start("stalls", &["--drill", &format!("control-stalls@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_control_thread_that_panics_lands_the_drone_and_closes_the_log() {
    Fixture::start("panics", &["--drill", &format!("control-panics@{DRILL_AT_S}")]).assert_landed();
}

#[test]
fn a_main_thread_that_panics_lands_the_drone_and_closes_the_log() {
    Fixture::start("main-panics", &["--drill", &format!("main-panics@{DRILL_AT_S}")])
        .assert_landed();
}

#[test]
fn sockets_that_stand_still_are_replaced_by_a_landing() {
    Fixture::start("link-stalls", &["--drill", &format!("link-stalls@{DRILL_AT_S}")])
        .assert_landed();
}

#[test]
fn a_sender_that_is_gone_is_replaced_by_a_landing() {
    Fixture::start("link-dies", &["--drill", &format!("link-dies@{DRILL_AT_S}")]).assert_landed();
}

/// Poses end in this way: the drone comes to rest after `stale_s`, and is landed after `lost_s`.
fn assert_silence(name: &str, flow: Flow) {
    let bench = Fixture::start(name, &[]);
    bench.wait_until_it_flies();
    bench.mocap_proxy.set(flow);
    let after_s = bench.wait_for(DronePhase::Landing(Cause::Order), 10.0);
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
