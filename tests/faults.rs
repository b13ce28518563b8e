//! Each fault ends in its documented reaction: simulated flights of the whole loop in virtual time, judged by
//! phases, faults, packets on the wire with their times, and the true pose of the drone.
//!
//! The table "What is tested" of `docs/safety.md` names these files.

#[path = "faults/blocked.rs"]
mod blocked;
#[path = "faults/descent.rs"]
mod descent;
#[path = "faults/drone.rs"]
mod drone;
#[path = "faults/fence.rs"]
mod fence;
#[path = "faults/frame.rs"]
mod frame;
#[path = "faults/hands.rs"]
mod hands;
#[path = "faults/heights.rs"]
mod heights;
#[path = "faults/landed.rs"]
mod landed;
#[path = "faults/limits.rs"]
mod limits;
#[path = "faults/mocap.rs"]
mod mocap;
#[path = "faults/solver.rs"]
mod solver;
#[path = "faults/story.rs"]
mod story;
#[path = "faults/take_off.rs"]
mod take_off;
