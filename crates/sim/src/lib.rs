//! The world that the controller is tested in.
//!
//! Owns the deterministic plant, the faults of sensor and link, and the emulators that put both
//! behind the sockets of a real Tello and a real motion capture system. One seed, one flight, bit for
//! bit. The numbers come from real flights and stand beside the code that uses them.
//!
//! Flight code never depends on this crate.

pub mod batch;
pub mod campaign;
pub mod command_link;
mod datagram_channel;
mod distortion;
pub mod drone;
mod drone_status;
pub mod emulator;
mod excitation;
#[cfg(feature = "failing_model")]
pub mod failing_model;
pub mod fault;
mod firmware;
mod frame_lag;
mod frames;
mod held_by_hand;
mod identified_plant;
pub mod logged_flight;
pub mod mocap;
mod nominal;
pub mod plant;
pub mod profile;
pub mod random;
mod sdk;
mod second_object;
mod seeds;
pub mod self_test;
pub mod tuning;
pub mod virtual_time;
mod world;

use std::path::Path;

use anyhow::{Context, Result};
use serde_json::{Value, json};
use tello_io::config;

use plant::RIGID_BODY;

pub use datagram_channel::AirTable;
pub use drone::{Cause, DronePhase, ReceivedOrders, Truth};
pub use emulator::{Emulator, EmulatorError, MocapAddresses, MocapServers, NatnetServer};
pub use excitation::ManualFlight;
pub use fault::{InjectedFault, ScriptedFault};
pub use firmware::{
    Axes, CancelledBy, DroneTable, EmergencyTable, FlyingFlag, HeadingReport, LandingTable,
    Measured, OutageBehaviour, ReplyTo, SdkVersion, StatusTable, VelocityReport,
};
pub use mocap::MocapReport;
pub use nominal::NominalFlight;
pub use profile::Profile;
pub use second_object::PasserTable;
pub use world::{SimStart, SimTable, World};

/// Period of the simulated world, of its pose stream and of its plant. s
pub const DT_S: f64 = tello_flight::cycle::DT_S;

/// The built-in settings of the simulator, as JSON.
pub const BUILT_IN: &str = include_str!("../../../configs/sim.json");

/// The settings of the simulator in `path`, or the built-in ones.
///
/// # Errors
/// All mistakes of the file, as [`config::Problems`].
pub fn settings(path: Option<&Path>) -> Result<SimTable> {
    let Some(path) = path else {
        return config::parse(BUILT_IN).context("in the built-in configs/sim.json");
    };
    let check = |table: &SimTable| World::new(table, 0).map(drop);
    config::problems(path, template, check).into_result()?;
    config::load(path)
}

/// Valid settings with as many faults and the structure of the vehicle of `settings`.
fn template(settings: &Value) -> Option<Value> {
    let mut template: Value = config::parse(BUILT_IN).ok()?;
    if let Some(faults) = settings.get("faults").and_then(Value::as_array) {
        let valid = json!({ "fault": "mocap_lost", "from_s": 1.0, "for_s": 1.0 });
        template["faults"] = faults.iter().map(|_| valid.clone()).collect();
    }
    if settings.pointer("/plant/rigid_body").is_some_and(|it| !it.is_null()) {
        template["plant"]["rigid_body"] = serde_json::to_value(RIGID_BODY).ok()?;
    }
    if let Some(kinds) = settings.get("start").and_then(Value::as_object)
        && kinds.len() == 1
        && kinds.contains_key("air")
    {
        template["start"] = json!({ "air": { "x": 0.0, "y": 0.0, "z": 1.0, "theta": 0.0 } });
    }
    Some(template)
}

#[cfg(test)]
mod tests;
