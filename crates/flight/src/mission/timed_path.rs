//! Path of a reference: a trajectory and the waypoints on it.

use horizon_model::rows::Pose;

use crate::targets::pose_distance;
use crate::trajectory::Trajectory;

/// A pose that has to be reached.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Waypoint {
    /// Pose, theta continuous over the trajectory. m, rad
    pub pose: Pose,
    /// Node of the trajectory that passes it.
    pub node: usize,
    /// Node at which the trajectory has left its reach again.
    pub leave: usize,
    /// Time on the trajectory before which it does not count. s
    pub counts_from_s: f64,
}

/// A trajectory and the waypoints on it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct TimedPath {
    /// Trajectory of the reference.
    pub trajectory: Trajectory,
    /// At least two: the first at the beginning, the last at the end.
    pub waypoints: Vec<Waypoint>,
}

impl TimedPath {
    /// Arc length from node `from` to node `to`; negative if that lies before. m
    pub(super) fn length_m(&self, from: usize, to: usize) -> f64 {
        let nodes = self.trajectory.nodes();
        nodes[to].arc_m - nodes[from].arc_m
    }
}

/// The first node from `node` on that is out of `reach` of `waypoint`, else the last one.
pub(super) fn leave(trajectory: &Trajectory, node: usize, waypoint: &Pose, reach: f64) -> usize {
    let nodes = trajectory.nodes();
    let is_out = |i: &usize| pose_distance(waypoint, &nodes[*i].pose) > reach;
    (node..nodes.len()).find(is_out).unwrap_or(nodes.len() - 1)
}
