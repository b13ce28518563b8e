//! The bench over real sockets: does its report tell a drone that does what we assume from one that does not?

use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use serde_json::{Value, json};
use tello_io::tello::protocol::{Action, HostPacket};
use tello_sim::{DronePhase, Emulator, MocapAddresses, Profile, SdkVersion, SimStart, World};

use crate::program;
use program::{tello_ctl, text};

/// A drone on the floor behind a proxy that keeps packets from it.
struct Drone {
    emulator: Emulator,
    address: SocketAddr,
    is_over: Arc<AtomicBool>,
    proxy: Option<JoinHandle<()>>,
}

#[expect(clippy::unwrap_used, clippy::panic, reason = "a test may panic")]
impl Drone {
    /// A packet of the host for which `is_lost` is true never arrives.
    fn behind(mut is_lost: impl FnMut(&[u8]) -> bool + Send + 'static) -> Self {
        let mut sim = tello_sim::settings(None).unwrap();
        sim.profile = Profile::Clean;
        sim.has_spread = false;
        sim.start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 };
        sim.drone.sdk = SdkVersion::V3_0;
        let any = ([127, 0, 0, 1], 0).into();
        let world = World::new(&sim, 1).unwrap();
        let emulator = Emulator::start(world, any, MocapAddresses::default()).unwrap();
        let (outer, inner) = (UdpSocket::bind(any).unwrap(), UdpSocket::bind(any).unwrap());
        inner.connect(emulator.drone_address()).unwrap();
        outer.set_nonblocking(true).unwrap();
        inner.set_nonblocking(true).unwrap();
        let address = outer.local_addr().unwrap();
        let is_over = Arc::new(AtomicBool::new(false));
        let ends = Arc::clone(&is_over);
        let pass = move || {
            let (mut host, mut bytes) = (None, [0; 2000]);
            while !ends.load(Ordering::Relaxed) {
                while let Ok((length, from)) = outer.recv_from(&mut bytes) {
                    host = Some(from);
                    if !is_lost(&bytes[..length]) {
                        inner.send(&bytes[..length]).ok();
                    }
                }
                while let Ok(length) = inner.recv(&mut bytes) {
                    host.map(|host| outer.send_to(&bytes[..length], host).ok());
                }
                thread::sleep(Duration::from_millis(2));
            }
        };
        Self { emulator, address, is_over, proxy: Some(thread::spawn(pass)) }
    }

    /// Does one check on it; the line of the report, and the exit code.
    fn check(&self, folder: &Path, check: &str, more: &[&str]) -> (Value, Option<i32>) {
        let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs");
        let mut table: Value =
            serde_json::from_str(&fs::read_to_string(config.join("fly.json")).unwrap()).unwrap();
        table["mission"] = config.join("missions/square.json").display().to_string().into();
        table["tello"]["address"] = self.address.to_string().into();
        table["tello"]["local_port"] = 0.into();
        table["tello"]["state_port"] = 0.into();
        fs::write(folder.join("fly.json"), table.to_string()).unwrap();
        let arguments = ["bench", check, "--yes", "--config", "fly.json"];
        let output = tello_ctl(folder, &[&arguments[..], more].concat());
        let report = fs::read_to_string(folder.join("bench-report.json"));
        let report = report.unwrap_or_else(|error| panic!("{error}: {}", text(&output)));
        let line = report.lines().last().unwrap();
        (serde_json::from_str(line).unwrap(), output.status.code())
    }

    fn is_down(&self) -> bool {
        self.emulator.truth().phase == DronePhase::Grounded
    }
}

impl Drop for Drone {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Relaxed);
        self.proxy.take().map(JoinHandle::join);
    }
}

fn folder(name: &str) -> PathBuf {
    program::folder(&format!("bench-{name}"))
}

/// The first change of `what` to `to`.
fn change<'a>(record: &'a Value, what: &str, to: bool) -> Option<&'a Value> {
    let changes = record["seen"]["changes"].as_array()?;
    changes.iter().find(|change| change["what"] == what && change["to"] == to)
}

#[test]
fn evidence_is_kept_whose_reader_is_gone() {
    let folder = folder("full");
    let output = std::process::Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["bench", "status", "--sim", "--yes"])
        .current_dir(&folder)
        .stdout(fs::OpenOptions::new().write(true).open("/dev/full").unwrap())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output));
    let report = fs::read_to_string(folder.join("bench-report.json")).unwrap();
    assert!(report.contains("\"check\":\"status\""), "{report}");
}

#[test]
fn a_drone_that_obeys_the_emergency_stop_is_distinguished_from_one_that_does_not() {
    let tasks = [false, true].map(|is_deaf| {
        thread::spawn(move || {
            let drone = Drone::behind(move |bytes| is_deaf && bytes == b"emergency");
            let folder = folder(&format!("emergency-{is_deaf}"));
            let (record, code) = drone.check(&folder, "emergency", &[]);
            assert_eq!(record["seen"]["is_as_expected"], !is_deaf, "{}", record["seen"]);
            assert!(drone.is_down());
            assert_eq!(code, Some(0), "{}", record["seen"]);
            let off = change(&record, "is_running", false).unwrap();
            let (after, after_s) = (&off["after"], off["after_s"].as_f64().unwrap());
            let is_stopped = after == "emergency" && after_s < 1.0;
            assert_eq!(is_stopped, !is_deaf, "{off}");
            assert_eq!(after == "ending", is_deaf, "{off}");
            // One take-off, two emergency stops, and then the ending.
            assert_eq!(record["seen"]["orders_before_the_ending"], 3);
        })
    });
    for task in tasks {
        task.join().unwrap();
    }
}

#[test]
fn a_drone_that_obeys_the_emergency_stop_of_the_text_sdk_is_distinguished_from_one_that_does_not() {
    for is_deaf in [false, true] {
        let drone = Drone::behind(move |bytes| is_deaf && bytes == b"emergency");
        // The state line finds its way past the proxy.
        let (record, code) =
            drone.check(&folder(&format!("text-{is_deaf}")), "emergency", &["--protocol", "text"]);
        assert_eq!(record["protocol"], "text");
        assert_eq!(record["seen"]["is_as_expected"], !is_deaf, "{}", record["seen"]);
        assert!(drone.is_down() && code == Some(0), "{}", record["seen"]);
    }
}

#[test]
fn a_drone_that_drops_repeated_numbers_is_distinguished_from_one_that_does_not() {
    let tasks = [false, true].map(|drops| {
        thread::spawn(move || {
            let mut known = Vec::new();
            let drone = Drone::behind(move |bytes| {
                let Ok(HostPacket::Action { action: Action::Land, sequence }) =
                    HostPacket::decode(bytes)
                else {
                    return false;
                };
                let is_known = known.contains(&sequence);
                known.push(sequence);
                drops && is_known
            });
            let folder = folder(&format!("numbers-{drops}"));
            let (record, code) = drone.check(&folder, "land_same_number", &[]);
            assert_eq!(record["seen"]["is_as_expected"], !drops, "{}", record["seen"]);
            // The ending lands with new numbers.
            assert!(drone.is_down() && code == Some(0), "{}", record["seen"]);
        })
    });
    for task in tasks {
        task.join().unwrap();
    }
}

#[test]
fn a_drone_that_flies_is_not_taken_off_and_one_that_is_silent_neither() {
    let folder = folder("refused");
    let output = tello_ctl(&folder, &["bench", "flag", "--sim"]);
    assert!(text(&output).contains("run it on a terminal"), "{}", text(&output));
    assert_eq!(output.status.code(), Some(2));
    let sim = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/sim.json");
    let mut table: Value = serde_json::from_str(&fs::read_to_string(sim).unwrap()).unwrap();
    table["start"] = json!({ "air": { "x": 0.0, "y": 0.0, "z": 1.0, "theta": 0.0 } });
    fs::write(folder.join("sim.json"), table.to_string()).unwrap();
    let airborne = ["bench", "flag", "--sim", "--yes", "--sim-config", "sim.json"];
    let output = tello_ctl(&folder, &airborne);
    assert!(text(&output).contains("the drone reports that it flies"), "{}", text(&output));
    assert_eq!(output.status.code(), Some(2));
    assert!(!folder.join("bench-report.json").exists());
}

#[test]
fn a_signal_in_the_middle_lands_and_keeps_the_record() {
    let folder = folder("signal");
    let drone = Drone::behind(|_| false);
    let address = drone.address.to_string();
    // The settings are written by the first check.
    let (record, _) = drone.check(&folder, "status", &[]);
    assert_eq!(record["firmware"], "01.04.91.01", "{address}");
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["bench", "flag", "--yes", "--config", "fly.json"])
        .current_dir(&folder)
        .stdin(std::process::Stdio::null())
        .stdout(std::process::Stdio::piped())
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    while drone.emulator.truth().phase != DronePhase::TakingOff {
        thread::sleep(Duration::from_millis(20));
    }
    let pid = child.id().to_string();
    std::process::Command::new("kill").args(["-TSTP", &pid]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    assert!(drone.is_down(), "{:?}", drone.emulator.truth());
    let report = fs::read_to_string(folder.join("bench-report.json")).unwrap();
    let last: Value = serde_json::from_str(report.lines().last().unwrap()).unwrap();
    assert_eq!((report.lines().count(), &last["is_stopped"]), (2, &true.into()));
    assert!(last["seen"]["is_as_expected"].is_null(), "{}", last["seen"]);
    let output = tello_ctl(&folder, &["bench", "flag", "--sim", "--yes", "--protocol", "text"]);
    assert!(text(&output).contains("a check of the binary protocol"), "{}", text(&output));
}

/// The bench in the middle of a check that flies.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn in_flight(drone: &Drone, folder: &Path) -> std::process::Child {
    // The settings are written by the first check.
    drone.check(folder, "status", &[]);
    let child = std::process::Command::new(env!("CARGO_BIN_EXE_tello-ctl"))
        .args(["bench", "flag", "--yes", "--config", "fly.json"])
        .current_dir(folder)
        .stdin(std::process::Stdio::null())
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    while drone.emulator.truth().phase != DronePhase::Flying {
        thread::sleep(Duration::from_millis(20));
    }
    child
}

#[test]
fn a_bench_that_is_killed_is_landed_by_its_guardian() {
    let folder = folder("killed");
    let drone = Drone::behind(|_| false);
    let mut child = in_flight(&drone, &folder);
    let before = drone.emulator.truth().received.landings;
    child.kill().unwrap();
    child.wait().unwrap();
    thread::sleep(Duration::from_millis(500));
    assert!(drone.emulator.truth().received.landings > before, "nobody landed the drone");
    for _ in 0..100 {
        thread::sleep(Duration::from_millis(100));
        if drone.is_down() {
            return;
        }
    }
    panic!("{:?}", drone.emulator.truth());
}

#[test]
fn a_second_program_for_a_drone_at_the_bench_is_refused() {
    let folder = folder("second");
    let drone = Drone::behind(|_| false);
    let mut child = in_flight(&drone, &folder);
    for second in [
        &["bench", "status", "--yes", "--config", "fly.json"][..],
        &["fly", "--yes", "--config", "fly.json"],
    ] {
        let output = tello_ctl(&folder, second);
        assert_eq!(output.status.code(), Some(2), "{second:?}: {}", text(&output));
        assert!(text(&output).contains(&format!("process {}", child.id())), "{}", text(&output));
    }
    assert_eq!(child.wait().unwrap().code(), Some(0));
    assert!(drone.is_down());
}

#[test]
fn the_list_has_every_check_and_the_document_too() {
    let output = tello_ctl(&folder("list"), &["bench", "--list"]);
    let list = text(&output);
    let document = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/bench-test.md");
    let document = fs::read_to_string(document).unwrap();
    // A head is not indented as its lines are.
    let heads = list.lines().filter(|line| !line.starts_with("   "));
    let names: Vec<&str> = heads.filter_map(|line| line.split_whitespace().nth(1)).collect();
    assert_eq!(names.len(), 17, "{list}");
    for name in names {
        assert!(document.contains(&format!("`{name}`")), "{name} is not in docs/bench-test.md");
    }
}
