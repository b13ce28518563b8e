//! The outside world: clock, motion capture, Tello, manual input, logs, settings files.
//!
//! Owns every socket and clock reading of a flight. Bytes become values here and values
//! become bytes. It refuses to estimate or to decide: what a pose means and what to fly is not
//! known here.
//!
//! Cost: functions for a tick have a line *Real time* with their cost. A function without that line may allocate.

pub mod atomic_file;
pub mod clock;
pub mod config;
mod counter;
pub mod held_messages;
pub mod link_diagnosis;
pub mod log;
pub mod manual;
pub mod mocap;
mod stop;
pub mod tello;

pub use counter::Counter;
pub use stop::{EmergencyRequest, StopSignal, Stopper};
