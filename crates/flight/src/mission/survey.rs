//! Length, time, box and speeds of a mission, for a person who looks at it before a flight.

use horizon_model::check::minimum;
use horizon_model::rows::{Pose, pos_w, pose};
use nalgebra::Vector3;
use serde::Serialize;

use crate::Obstacle;
use crate::trajectory::{Node, Trajectory};

/// Statistics of a planned mission.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Survey {
    /// Length of the path, or of the straight lines between targets. m
    pub length_m: f64,
    /// Time as planned, from the first pose on; of targets a guess, the path to the first included. s
    pub duration_s: f64,
    /// Least x, y, z, in the world frame. m
    #[serde(rename = "low_m")]
    pub low_w: [f64; 3],
    /// Largest x, y, z, in the world frame. m
    #[serde(rename = "high_m")]
    pub high_w: [f64; 3],
    /// Where the reference is fastest; null for targets, which have no speed.
    pub fastest: Option<PathPoint>,
    /// Where the reference is slowest, the first and the last fifth of the time not counted; null for targets.
    pub slowest: Option<PathPoint>,
}

/// A point of a path, and the speed there.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathPoint {
    /// World x, y, z. m
    #[serde(rename = "at_m")]
    pub at_w: [f64; 3],
    /// Since the beginning. s
    pub at_s: f64,
    /// Speed of the reference. m/s
    pub speed_mps: f64,
}

/// The most that a path asks of a vehicle, each with its point. Speeds, a yaw rate and an acceleration.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Demands {
    /// Speed. m/s
    pub speed: Demand,
    /// Horizontal speed. m/s
    pub horizontal: Demand,
    /// Speed upwards or downwards. m/s
    pub vertical: Demand,
    /// Yaw rate. rad/s
    pub turn: Demand,
    /// Horizontal acceleration over 0.1 s without its part that raises the speed: what is missing of it carries the
    /// vehicle off the path. `sqrt(|dv|^2 - max(0, dv' n)^2) / 0.1 s`, `n` the direction of motion. m/s^2
    pub accel: Demand,
}

/// A value and where it is largest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Demand {
    /// In the unit of its field of [`Demands`]; never negative.
    pub value: f64,
    /// World x, y, z. m
    pub at_w: [f64; 3],
    /// Since the beginning. s
    pub at_s: f64,
}

/// Over which accelerations are means. s
const ACCEL_S: f64 = 0.1;

impl Demands {
    pub(super) fn of(trajectory: &Trajectory) -> Self {
        let most = |value: &dyn Fn(&Node) -> f64| {
            let nodes = trajectory.nodes().iter().copied().chain(trajectory.middles());
            let demands = nodes.map(|node| Demand {
                value: value(&node),
                at_w: pos_w(&node.pose).into(),
                at_s: node.at_s,
            });
            let none = Demand { value: 0.0, at_w: [0.0; 3], at_s: 0.0 };
            demands.fold(none, |most, demand| if demand.value > most.value { demand } else { most })
        };
        let horizontal = |node: &Node| node.vel_w().xy().norm();
        Self {
            speed: most(&speed_mps),
            horizontal: most(&horizontal),
            vertical: most(&|node| node.vel_w().z.abs()),
            turn: most(&|node| node.rate[pose::THETA].abs()),
            accel: most(&|node| {
                let (from, to) =
                    (node.vel_w().xy(), trajectory.at(node.at_s + ACCEL_S).vel_w().xy());
                let change = to - from;
                let direction = (from + to).try_normalize(1e-9).unwrap_or_default();
                let along = change.dot(&direction).max(0.0);
                (change.norm_squared() - along * along).max(0.0).sqrt() / ACCEL_S
            }),
        }
    }
}

/// Fraction of the time at either end, after and before rest, that does not count as slow. 1
const END: f64 = 0.2;

impl Survey {
    pub(super) fn of_targets(poses: &[Pose], duration_s: f64) -> Self {
        let steps = poses.windows(2).map(|pair| (pos_w(&pair[1]) - pos_w(&pair[0])).norm());
        let (low_w, high_w) = extent(poses.iter());
        Self { length_m: steps.sum(), duration_s, low_w, high_w, fastest: None, slowest: None }
    }

    pub(super) fn of_path(trajectory: &Trajectory) -> Self {
        let nodes = trajectory.nodes();
        let end_s = trajectory.end_s();
        let by_speed = |a: &&Node, b: &&Node| speed_mps(a).total_cmp(&speed_mps(b));
        let is_inner = |node: &&Node| node.at_s > END * end_s && node.at_s < (1.0 - END) * end_s;
        let (low_w, high_w) = extent(nodes.iter().map(|node| &node.pose));
        let length_m = nodes.last().map_or(0.0, |node| node.arc_m);
        let fastest = nodes.iter().max_by(by_speed).map(part);
        let slowest = nodes.iter().filter(is_inner).min_by(by_speed).map(part);
        Self { length_m, duration_s: end_s, low_w, high_w, fastest, slowest }
    }

    /// The least distance from the box to the walls, the lower and the upper one of each axis of the world; negative
    /// outside. m
    pub fn margin_m(&self, walls_m: [[f64; 2]; 3]) -> f64 {
        let axes = walls_m.iter().zip(self.low_w.iter().zip(&self.high_w));
        let margins = axes
            .map(|([wall_low, wall_high], (low, high))| minimum(low - wall_low, wall_high - high));
        margins.fold(f64::INFINITY, minimum)
    }
}

/// Distance between two sampled points of a line. m
const SPACING_M: f64 = 0.02;

/// Least distance of the polyline through `poses` from `obstacles`, sampled from each corner on at points
/// [`SPACING_M`] apart; the last end may lie that far from the nearest sample. m
pub(super) fn clearance_m<'a>(
    poses: impl Iterator<Item = &'a Pose>,
    obstacles: &[Obstacle],
) -> Option<f64> {
    let mut least_m: Option<f64> = None;
    let mut before_w: Option<Vector3<f64>> = None;
    for at_w in poses.map(pos_w) {
        let from_w = before_w.replace(at_w).unwrap_or(at_w);
        let length_m = (at_w - from_w).norm();
        let mut along_m = 0.0;
        while along_m <= length_m {
            let seen_w = if length_m > 0.0 { from_w.lerp(&at_w, along_m / length_m) } else { at_w };
            let distances = obstacles.iter().map(|one| one.distance(&seen_w).distance_m);
            least_m = distances.chain(least_m).reduce(minimum);
            along_m += SPACING_M;
        }
    }
    least_m
}

fn speed_mps(node: &Node) -> f64 {
    node.vel_w().norm()
}

fn part(node: &Node) -> PathPoint {
    PathPoint { at_w: pos_w(&node.pose).into(), at_s: node.at_s, speed_mps: speed_mps(node) }
}

fn extent<'a>(poses: impl Iterator<Item = &'a Pose>) -> ([f64; 3], [f64; 3]) {
    let none = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
    let (low, high) =
        poses.fold(none, |(low, high), at| (low.inf(&pos_w(at)), high.sup(&pos_w(at))));
    (low.into(), high.into())
}

#[cfg(test)]
mod tests {
    use crate::{Mission, MissionTable};

    #[test]
    fn a_circle_has_its_length_box_and_speed() {
        let text = r#"{ "circle": { "centre": [1.0, 2.0, 1.5, 0.0], "radius_m": 2.0 } }"#;
        let table: MissionTable = serde_json::from_str(text).unwrap();
        let survey = Mission::new(&table, 0.02).unwrap().survey();
        assert!((survey.length_m - 4.0 * std::f64::consts::PI).abs() < 0.01, "{survey:?}");
        let near = |found: [f64; 3], expected: [f64; 3]| {
            found.iter().zip(&expected).all(|(found, expected)| (found - expected).abs() < 0.01)
        };
        assert!(near(survey.low_w, [-1.0, 0.0, 1.5]), "{survey:?}");
        assert!(near(survey.high_w, [3.0, 4.0, 1.5]), "{survey:?}");
        // At full speed 1.2 m/s the curve alone would need 0.72 of 0.9 m/s^2.
        let [fastest, slowest] =
            [&survey.fastest, &survey.slowest].map(|part| part.as_ref().unwrap().speed_mps);
        assert!(fastest < 1.21 && fastest > 1.1 && slowest <= fastest, "{survey:?}");
        assert!(
            survey.duration_s > survey.length_m / 1.2 && survey.duration_s < 20.0,
            "{survey:?}"
        );
        let margin = survey.margin_m([[-2.0, 9.0], [-3.0, 4.5], [0.0, 2.5]]);
        assert!((margin - 0.5).abs() < 0.01, "{margin}");
        assert!(survey.margin_m([[-2.0, 9.0], [-3.0, 3.0], [0.0, 2.5]]) < -0.9);
    }
}
