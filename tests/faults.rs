//! Each fault ends in its documented reaction, in the whole loop, after the drone really flew: judged by
//! what was put on the wire, when, and by where the drone really was.
//!
//! The table "What is tested" of `docs/safety.md` names these files.

#[path = "faults/drone.rs"]
mod drone;
#[path = "faults/fence.rs"]
mod fence;
#[path = "faults/hands.rs"]
mod hands;
#[path = "faults/landed.rs"]
mod landed;
#[path = "faults/mocap.rs"]
mod mocap;
#[path = "faults/solver.rs"]
mod solver;
#[path = "faults/story.rs"]
mod story;
