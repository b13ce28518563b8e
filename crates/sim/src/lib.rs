//! The world that the controller is tested in.
//!
//! Owns the deterministic plant, the faults of sensor and link, and the emulators that put both
//! behind the sockets of a real Tello and a real motion capture system. One seed, one flight, bit for
//! bit. The numbers come from real flights and stand beside the code that uses them.
//!
//! Flight code never depends on this crate.

mod air;
pub mod batch;
pub mod campaign;
pub mod contact;
mod distortion;
pub mod drone;
pub mod emulator;
mod excitation;
pub mod fault;
mod firmware;
mod identified;
mod lag;
pub mod logged;
pub mod mocap;
mod passer;
pub mod plant;
pub mod profile;
pub mod radio;
pub mod random;
mod sdk;
pub mod self_test;
mod status;
pub mod virtual_time;
mod wire;
mod world;

use std::path::Path;

use anyhow::{Context, Result};
use tello_io::config;

pub use air::AirTable;
pub use drone::{Cause, Phase, ReceivedOrders, Truth};
pub use emulator::{Emulator, EmulatorError, MocapAddresses, MocapServers, NatnetServer};
pub use excitation::ManualFlight;
pub use fault::{Fault, ScriptedFault};
pub use firmware::{
    Axes, CancelledBy, DroneTable, EmergencyTable, FlyingFlag, LandingTable, Outage, ReplyTo,
    SdkVersion, StatusTable, VelocityReport,
};
pub use mocap::MocapReport;
pub use passer::PasserTable;
pub use profile::Profile;
pub use world::{SimTable, Start, World};

/// The built-in settings of the simulator, as JSON.
pub const BUILT_IN: &str = include_str!("../../../configs/sim.json");

/// The settings of the simulator in `path`, or the built-in ones.
///
/// # Errors
/// A file that cannot be read, is not JSON, has an unknown or missing key or a wrong type.
pub fn settings(path: Option<&Path>) -> Result<SimTable> {
    match path {
        Some(path) => config::load(path),
        None => config::parse(BUILT_IN).context("in the built-in configs/sim.json"),
    }
}

/// Period of the simulated world, of its pose stream and of its plant. s.
pub const DT_S: f64 = 0.02;
