//! Evidence with changes in one of its parts.

use super::*;

pub(in crate::supervisor) fn with_drone(
    e: Evidence,
    change: impl FnOnce(&mut DroneReport),
) -> Evidence {
    let mut drone = e.drone.unwrap();
    change(&mut drone);
    Evidence { drone: Some(drone), ..e }
}

pub(in crate::supervisor) fn with_obstacles(
    mut e: Evidence,
    change: impl FnOnce(&mut ObstacleEvidence),
) -> Evidence {
    change(&mut e.obstacles);
    e
}

pub(in crate::supervisor) fn with_poses(
    mut e: Evidence,
    change: impl FnOnce(&mut PoseEvidence),
) -> Evidence {
    change(&mut e.poses);
    e
}

pub(in crate::supervisor) fn with_tracking(
    mut e: Evidence,
    change: impl FnOnce(&mut TrackingEvidence),
) -> Evidence {
    change(&mut e.tracking);
    e
}
