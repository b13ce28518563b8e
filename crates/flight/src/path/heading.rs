//! Where the vehicle looks along a path.

use horizon_model::angle::unwrap_near;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Path;

/// Where the vehicle looks along a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Heading {
    /// To the theta of the waypoints, the short way round and in proportion to the way between them.
    #[default]
    Fixed,
    /// Along the path: the measured yaw is the direction of motion. The thetas of the waypoints do
    /// not count.
    Along,
}

/// Horizontal part of a direction below which it has none. 1
const HORIZONTAL_MIN: f64 = 1e-6;

impl Path {
    /// Heading at each point, continuous from point to point. rad
    ///
    /// `thetas` belong to the waypoints.
    pub(crate) fn headings(&self, heading: Heading, thetas: &[f64]) -> Vec<f64> {
        match heading {
            Heading::Fixed => self.interpolated(thetas),
            Heading::Along => self.directions(thetas.first().copied().unwrap_or(0.0)),
        }
    }

    fn interpolated(&self, thetas: &[f64]) -> Vec<f64> {
        let mut theta = thetas.first().copied().unwrap_or(0.0);
        let mut headings = vec![theta];
        for (ends, next) in self.marks.windows(2).zip(thetas.iter().skip(1)) {
            let arc_m = |point: usize| self.arcs_m[point];
            let next = unwrap_near(*next, theta);
            let length_m = arc_m(ends[1]) - arc_m(ends[0]);
            headings.extend((ends[0] + 1..=ends[1]).map(|point| {
                theta + (next - theta) * ((arc_m(point) - arc_m(ends[0])) / length_m)
            }));
            theta = next;
        }
        headings
    }

    /// Directions of motion; a vertical stretch keeps the one before it, or takes the one after it,
    /// or `otherwise`.
    fn directions(&self, otherwise: f64) -> Vec<f64> {
        let direction = |tangent_w: &Vector3<f64>| {
            (tangent_w.xy().norm() > HORIZONTAL_MIN).then(|| tangent_w.y.atan2(tangent_w.x))
        };
        let tangents_w = || self.points.iter().map(|point| &point.tangent_w);
        let mut theta = tangents_w().find_map(direction).unwrap_or(otherwise);
        tangents_w()
            .map(|tangent_w| {
                theta = direction(tangent_w).map_or(theta, |next| unwrap_near(next, theta));
                theta
            })
            .collect()
    }
}

#[cfg(test)]
mod tests;
