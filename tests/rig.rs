//! A simulated drone outside of the program, and settings with which the program flies it.

use std::fs;
use std::net::SocketAddr;
use std::path::PathBuf;

use serde_json::Value;
use tello_sim::{Emulator, MocapAddresses, Profile, World};

use crate::program::{config_file, folder};

/// Starts a drone and its mocap without faults, in a fresh folder with a `fly.json`: the big square, with
/// the poses from where `poses_by` has them, given the address of the mocap. `name` is unique among all tests.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn start(
    name: &str,
    poses_by: impl FnOnce(SocketAddr) -> SocketAddr,
) -> (PathBuf, Emulator) {
    let folder = folder(name);
    let mut sim = tello_sim::settings(None).unwrap();
    sim.profile = Profile::Clean;
    let any_port = ([127, 0, 0, 1], 0).into();
    let mocap = MocapAddresses { relay: Some(any_port), ..MocapAddresses::default() };
    let emulator = Emulator::start(World::new(&sim, 1).unwrap(), any_port, mocap).unwrap();
    let text = fs::read_to_string(config_file("fly.json")).unwrap();
    let mut table: Value = serde_json::from_str(&text).unwrap();
    table["mission"] = config_file("missions/big_square.json").into();
    let relay = poses_by(emulator.mocap().relay.unwrap());
    table["mocap"]["relay"]["address"] = relay.to_string().into();
    table["tello"]["address"] = emulator.drone_address().to_string().into();
    fs::write(folder.join("fly.json"), table.to_string()).unwrap();
    (folder, emulator)
}
