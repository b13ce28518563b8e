//! The world that the controller is tested in.
//!
//! Owns the deterministic plant, the faults of sensor and link, and the emulators that put both
//! behind the sockets of a real Tello and a real motion capture system. One seed, one flight, bit for
//! bit. The numbers come from real flights and stand beside the code that uses them.
//!
//! Flight code never depends on this crate.

mod air;
mod distortion;
pub mod drone;
pub mod emulator;
mod excitation;
pub mod fault;
mod firmware;
mod lag;
pub mod mocap;
pub mod plant;
pub mod profile;
pub mod radio;
pub mod random;
mod sdk;
mod status;
mod wire;
mod world;

pub use air::AirTable;
pub use drone::{Cause, Phase, Told, Truth};
pub use emulator::{Emulator, EmulatorError, MocapAddresses, MocapServers};
pub use excitation::ManualFlight;
pub use fault::{Fault, ScriptedFault};
pub use firmware::{
    Axes, CancelledBy, DroneTable, EmergencyTable, FlyingFlag, LandingTable, Outage, ReplyTo,
    SdkVersion, StatusTable, VelocityReport,
};
pub use mocap::Report;
pub use profile::Profile;
pub use world::{SimTable, Start, World};

/// Period of the simulated world, of its pose stream and of its plant. s.
pub const DT_S: f64 = 0.02;
