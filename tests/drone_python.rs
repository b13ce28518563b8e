//! The simulated drone in the hands of clients that we did not write: nine Python libraries and a Rust crate.
//!
//! They know no address but 192.168.10.1, so each flies in a network namespace of its own.

use std::ffi::OsString;
use std::path::Path;
use std::process::{Command, Output};

use tello_sim::{Profile, SimStart};

const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/drone_python.py");

fn python() -> OsString {
    std::env::var_os("TELLO_PYTHON").unwrap_or_else(|| "python3".into())
}

fn succeeds(command: &mut Command) -> bool {
    command.output().is_ok_and(|out| out.status.success())
}

/// The arguments of `unshare` that give a process a network, if `has_client` and that is possible.
fn network(has_client: bool, client: &str) -> Option<&'static str> {
    // Root needs no user namespace, and where others may have none, there is no network for them.
    let make_cable = ["ip", "link", "add", "host0", "type", "veth", "peer", "name", "drone0"];
    let network = ["-n", "-rn"]
        .into_iter()
        .find(|flags| succeeds(Command::new("unshare").arg(flags).args(make_cable)));
    if has_client && network.is_some() {
        return network;
    }
    let missing = if has_client { "network namespaces (iproute2)" } else { client };
    assert!(std::env::var_os("CI").is_none(), "no {missing} in CI");
    eprintln!("NOT CHECKED: {client} does not fly the simulated drone: there is no {missing}");
    None
}

/// Flies `client` from the Python package `package` and asserts that every movement went where it should.
fn fly(client: &str, package: &str) {
    let has_package = succeeds(Command::new(python()).args(["-c", &format!("import {package}")]));
    fly_if(has_package, client);
}

/// As [`fly`]; `has_client` tells whether `client` is on this machine.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly_if(has_client: bool, client: &str) {
    let Some(network) = network(has_client, client) else { return };
    // Without chance: the libraries fly without looking.
    let mut sim = tello_sim::settings(None).unwrap();
    sim.profile = Profile::Clean;
    sim.has_spread = false;
    sim.start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 };
    sim.plant.disturbance_h_mps = 0.0;
    sim.plant.disturbance_v_mps = 0.0;
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join(format!("drone_python-{client}.json"));
    std::fs::write(&path, serde_json::to_string(&sim).unwrap()).unwrap();
    let Output { status, stdout, stderr } = Command::new("unshare")
        .arg(network)
        .arg(python())
        .args([SCRIPT, client, env!("CARGO_BIN_EXE_tello-ctl")])
        .arg(&path)
        .output()
        .unwrap();
    let stdout = String::from_utf8_lossy(&stdout);
    let story = stdout.lines().last().unwrap_or_default();
    assert!(status.success(), "{story}\n{}", String::from_utf8_lossy(&stderr));
}

#[test]
fn djitellopy_flies_the_simulated_drone() {
    fly("djitellopy", "djitellopy");
}

#[test]
fn tello_asyncio_flies_the_simulated_drone() {
    fly("tello-asyncio", "tello_asyncio");
}

#[test]
fn easytello_flies_the_simulated_drone() {
    fly("easytello", "easytello");
}

#[test]
fn tellopy_flies_the_simulated_drone() {
    fly("tellopy", "tellopy");
}

#[test]
fn rktellolib_flies_the_simulated_drone() {
    fly("rktellolib", "rktellolib");
}

#[test]
fn tello_control_flies_the_simulated_drone() {
    fly("tello-control", "tello_control");
}

#[test]
fn tellolib_flies_the_simulated_drone() {
    fly("tellolib", "tellolib");
}

#[test]
fn ktlib_flies_the_simulated_drone() {
    fly("KTLib", "KTLib");
}

#[test]
fn ryzetello_flies_the_simulated_drone() {
    fly("ryzetello", "ryzetello");
}

/// `TELLO_EDU` names the program in tests/clients, once it is built.
#[test]
fn the_crate_tello_edu_flies_the_simulated_drone() {
    fly_if(std::env::var_os("TELLO_EDU").is_some(), "tello-edu");
}
