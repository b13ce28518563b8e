//! Poses over time, with cubics between them.
//!
//! Owns the table that a reference is read from in flight. What times a path takes is
//! `path/speed.rs`; how the time of a trajectory runs on is `mission/follower.rs`.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, PoseRate, pose};
use nalgebra::Vector3;

/// Time between nodes of a trajectory through given points. s
const SPACING_S: f64 = 0.02;

/// By how much a trajectory may leave the poses that it goes through, in each row: a smooth one turns between two of
/// them. m and rad
const OVERSHOOT_MAX: f64 = 0.02;

/// A pose of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Node {
    /// Time since the beginning. s
    pub at_s: f64,
    /// Arc length since the beginning. m
    pub arc_m: f64,
    /// Pose, theta continuous over the trajectory. m, rad
    pub pose: Pose,
    /// Derivative of `pose` by time. m/s, rad/s
    pub rate: PoseRate,
}

/// A trajectory at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Moment {
    /// Pose, theta continuous over the trajectory. m, rad
    pub pose: Pose,
    /// First derivative of `pose` by time. m/s, rad/s
    pub rate: PoseRate,
    /// Second derivative of `pose` by time. m/s^2, rad/s^2
    pub accel: Pose,
}

/// Poses over time: cubics that keep the poses and rates of nodes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Trajectory {
    /// At least two, with rising times.
    nodes: Vec<Node>,
}

impl Trajectory {
    pub(crate) fn new(nodes: Vec<Node>) -> Self {
        debug_assert!(nodes.len() >= 2 && nodes.windows(2).all(|pair| pair[0].at_s < pair[1].at_s));
        Self { nodes }
    }

    /// The trajectory through `poses` at `times_s`, at rest at both ends.
    ///
    /// The rate at an inner point is that of the parabola through it and its neighbours, limited in each row: a pose
    /// that is held stays held, to 2 cm (see `limited`). Both slices have one length of at least two; times rise.
    pub(crate) fn through(times_s: &[f64], poses: &[Pose]) -> Self {
        let mut theta = poses[0][pose::THETA];
        let continuous = |at: &Pose| {
            theta = unwrap_near(at[pose::THETA], theta);
            Pose::new(at[pose::X], at[pose::Y], at[pose::Z], theta)
        };
        let poses: Vec<Pose> = poses.iter().map(continuous).collect();
        let derivative = |i: usize| (poses[i + 1] - poses[i]) / (times_s[i + 1] - times_s[i]);
        let rate = |i: usize| {
            if i == 0 || i + 1 == poses.len() {
                return Pose::zeros();
            }
            let (before_s, after_s) = (times_s[i] - times_s[i - 1], times_s[i + 1] - times_s[i]);
            let (before, after) = (derivative(i - 1), derivative(i));
            let rate = (after_s * before + before_s * after) / (before_s + after_s);
            rate.zip_zip_map(&before, &after, |rate, before, after| {
                limited(rate, [before, before_s], [after, after_s])
            })
        };
        let node = |i: usize| Node {
            at_s: times_s[i] - times_s[0],
            arc_m: 0.0,
            pose: poses[i],
            rate: rate(i),
        };
        Self::new((0..poses.len()).map(node).collect()).refined()
    }

    /// The trajectory with a node at least every [`SPACING_S`], and arc lengths.
    fn refined(&self) -> Self {
        let mut nodes = vec![self.nodes[0]];
        let mut arc_m = 0.0;
        for pair in self.nodes.windows(2) {
            let length_s = pair[1].at_s - pair[0].at_s;
            let count = horizon_model::whole((length_s / SPACING_S).ceil()).max(1);
            for i in 1..=count {
                let q = i as f64 / count as f64;
                let Moment { pose: at, rate, .. } = between(pair, q);
                let before = nodes[nodes.len() - 1].pose;
                arc_m += (at - before).fixed_rows::<3>(pose::X).norm();
                nodes.push(Node { at_s: pair[0].at_s + q * length_s, arc_m, pose: at, rate });
            }
        }
        Self::new(nodes)
    }

    /// The nodes, at least two.
    pub(crate) fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// Nodes in the middle between two nodes: there a step between standing poses is fastest.
    pub(crate) fn middles(&self) -> impl Iterator<Item = Node> {
        self.nodes.windows(2).map(|pair| {
            let Moment { pose, rate, .. } = between(pair, 0.5);
            let (at_s, arc_m) = (
                f64::midpoint(pair[0].at_s, pair[1].at_s),
                f64::midpoint(pair[0].arc_m, pair[1].arc_m),
            );
            Node { at_s, arc_m, pose, rate }
        })
    }

    /// When it ends. s
    pub(crate) fn end_s(&self) -> f64 {
        self.nodes[self.nodes.len() - 1].at_s
    }

    /// Pose and derivatives at `at_s`, at an end if that is outside.
    pub(crate) fn at(&self, at_s: f64) -> Moment {
        let first = self.node_before(at_s).min(self.nodes.len() - 2);
        let pair = &self.nodes[first..first + 2];
        let q = (at_s - pair[0].at_s) / (pair[1].at_s - pair[0].at_s);
        between(pair, q.clamp(0.0, 1.0))
    }

    /// The last node at or before `at_s`, the first if there is none.
    pub(crate) fn node_before(&self, at_s: f64) -> usize {
        self.nodes.partition_point(|node| node.at_s <= at_s).saturating_sub(1)
    }

    /// Arc length up to `at_s`, which lies within the trajectory. m
    pub(crate) fn arc_at_m(&self, at_s: f64) -> f64 {
        let first = self.node_before(at_s).min(self.nodes.len() - 2);
        let (a, b) = (&self.nodes[first], &self.nodes[first + 1]);
        a.arc_m + (b.arc_m - a.arc_m) * ((at_s - a.at_s) / (b.at_s - a.at_s))
    }

    /// Arc length up to the point beside `at`, which is nearest to `node`. m
    pub(crate) fn arc_beside_m(&self, node: usize, at: &Pose) -> f64 {
        let Node { arc_m, pose: node_at, .. } = self.nodes[node];
        let vel_w = self.nodes[node].vel_w();
        let along = (at - node_at).fixed_rows::<3>(pose::X).dot(&vel_w);
        let arc_of = |i: usize| self.nodes[i].arc_m;
        let ahead_m = along / vel_w.norm().max(f64::MIN_POSITIVE);
        (arc_m + ahead_m)
            .clamp(arc_of(node.saturating_sub(1)), arc_of((node + 1).min(self.nodes.len() - 1)))
    }

    /// Horizontal distance of `at` from the tangent at `node`. m
    pub(crate) fn aside_m(&self, node: usize, at: &Pose) -> f64 {
        let Node { pose: node_at, .. } = self.nodes[node];
        let (vel_w, displacement) = (self.nodes[node].vel_w(), at - node_at);
        let across = displacement[pose::X] * vel_w.y - displacement[pose::Y] * vel_w.x;
        across.abs() / vel_w.xy().norm().max(f64::MIN_POSITIVE)
    }

    /// The node of `among` that is nearest to the position of `at`, the first of equals.
    pub(crate) fn nearest(&self, among: impl Iterator<Item = usize>, at: &Pose) -> Option<usize> {
        let distance2 =
            |i: usize| (self.nodes[i].pose - at).fixed_rows::<3>(pose::X).norm_squared();
        let nearest = among.map(|i| (distance2(i), i)).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|(_, i)| i)
    }
}

impl Node {
    /// Velocity. m/s
    pub(crate) fn vel_w(&self) -> Vector3<f64> {
        self.rate.fixed_rows::<3>(pose::X).into()
    }
}

impl Moment {
    /// Velocity. m/s
    pub(crate) fn vel_w(&self) -> Vector3<f64> {
        self.rate.fixed_rows::<3>(pose::X).into()
    }

    /// Acceleration. m/s^2
    pub(crate) fn accel_w(&self) -> Vector3<f64> {
        self.accel.fixed_rows::<3>(pose::X).into()
    }
}

/// The cubic of two nodes at the fraction `q` of the time between them; `mean_rate` is `m` of `docs/control.md`.
fn between(pair: &[Node], q: f64) -> Moment {
    let (a, b) = (&pair[0], &pair[1]);
    let h = b.at_s - a.at_s;
    let mean_rate = (b.pose - a.pose) / h;
    let second = 3.0 * mean_rate - 2.0 * a.rate - b.rate;
    let third = a.rate + b.rate - 2.0 * mean_rate;
    Moment {
        pose: a.pose + (a.rate + (second + third * q) * q) * (q * h),
        rate: a.rate + (2.0 * second + third * (3.0 * q)) * q,
        accel: (2.0 * second + third * (6.0 * q)) / h,
    }
}

/// `rate` at a point, limited so that the cubics beside it stay near their ends; `before` and `after` are the mean
/// rates of the intervals beside it and their lengths (s). Where both have one sign, three times the smaller rate
/// leaves neither (Fritsch and Carlson 1980); and a rate r leaves one of length h by at most 4/27 r h.
fn limited(rate: f64, [before, before_s]: [f64; 2], [after, after_s]: [f64; 2]) -> f64 {
    let least = if before * after > 0.0 { before.abs().min(after.abs()) } else { 0.0 };
    let most = (3.0 * least).max(OVERSHOOT_MAX / (4.0 / 27.0 * before_s.max(after_s)));
    rate.clamp(-most, most)
}

#[cfg(test)]
mod tests {
    use horizon_model::check::{amax, maximum};

    use super::*;

    fn two_nodes() -> [Node; 2] {
        let pose = |x: f64| Pose::new(x, 1.0 - 0.5 * x, 1.2 + 0.1 * x, 0.3 * x);
        let rate = |v: f64| Pose::new(v, -0.4 * v, 0.2, 0.1 - v);
        [
            Node { at_s: 2.0, arc_m: 0.0, pose: pose(0.4), rate: rate(0.7) },
            Node { at_s: 2.5, arc_m: 0.5, pose: pose(0.9), rate: rate(-0.2) },
        ]
    }

    #[test]
    fn rate_and_acceleration_are_the_derivatives_of_the_pose() {
        let trajectory = Trajectory::new(two_nodes().into());
        let dt_s = 1e-5;
        for at_s in [2.01, 2.13, 2.25, 2.42, 2.49] {
            let [before, now, after] = [at_s - dt_s, at_s, at_s + dt_s].map(|t| trajectory.at(t));
            let rate = (after.pose - before.pose) / (2.0 * dt_s);
            let accel = (after.rate - before.rate) / (2.0 * dt_s);
            assert!(amax(&(rate - now.rate)) < 1e-8, "{rate} at {at_s} s beside {}", now.rate);
            assert!(amax(&(accel - now.accel)) < 1e-8, "{accel} at {at_s} s beside {}", now.accel);
        }
    }

    #[test]
    fn a_cubic_keeps_poses_and_rates_of_its_nodes() {
        let nodes = two_nodes();
        let trajectory = Trajectory::new(nodes.into());
        for node in nodes {
            let at = trajectory.at(node.at_s);
            assert!(amax(&(at.pose - node.pose)) < 1e-15 && amax(&(at.rate - node.rate)) < 1e-14);
        }
        // Outside it stays at its ends.
        assert_eq!(trajectory.at(-1.0).pose, nodes[0].pose);
        assert!(amax(&(trajectory.at(99.0).pose - nodes[1].pose)) < 1e-15);
    }

    #[test]
    fn a_trajectory_through_points_meets_them_and_rests_at_its_ends() {
        let poses = [Pose::zeros(), Pose::new(1.0, 0.0, 0.2, 3.1), Pose::new(1.0, 1.0, 0.0, -3.1)];
        let trajectory = Trajectory::through(&[5.0, 6.0, 8.0], &poses);
        assert!((trajectory.end_s() - 3.0).abs() < 1e-15);
        for (at_s, expected) in [0.0, 1.0, 3.0].into_iter().zip(&poses) {
            let gap = (trajectory.at(at_s).pose - expected).fixed_rows::<3>(pose::X).norm();
            assert!(gap < 1e-12, "{gap} m at {at_s} s");
        }
        // The heading goes on over pi, the short way round.
        let theta = trajectory.at(3.0).pose[pose::THETA];
        assert!((theta - (std::f64::consts::TAU - 3.1)).abs() < 1e-12, "{theta}");
        for at_s in [0.0, 3.0] {
            assert!(amax(&trajectory.at(at_s).rate) < 1e-12);
        }
        let nodes = trajectory.nodes();
        assert!(nodes.windows(2).all(|pair| pair[1].at_s - pair[0].at_s <= SPACING_S + 1e-12));
        assert!(nodes.windows(2).all(|pair| pair[0].arc_m <= pair[1].arc_m));
    }

    fn maximum_of(values: &[f64]) -> f64 {
        values.iter().copied().fold(0.0, maximum)
    }

    #[test]
    fn a_place_that_is_held_stays_held_and_a_way_there_is_not_left_by_much() {
        let at = |x_m: f64| Pose::new(x_m, 0.0, 0.0, 0.0);
        let range_m = |times_s: &[f64], positions_m: &[f64]| {
            let poses: Vec<Pose> = positions_m.iter().map(|x_m| at(*x_m)).collect();
            let nodes = Trajectory::through(times_s, &poses).nodes;
            let x_m = nodes.iter().map(|node| node.pose[pose::X]);
            x_m.fold((0.0_f64, 0.0_f64), |(low, high), x_m| (low.min(x_m), high.max(x_m)))
        };
        for (times_s, positions_m) in [
            ([0.0, 30.0, 32.0, 62.0], [0.0, 0.0, 1.0, 1.0]),
            // A slow way before a quick one, on, and back.
            ([0.0, 10.0, 10.5, 20.0], [0.0, 0.5, 1.5, 2.0]),
            ([0.0, 10.0, 10.5, 20.0], [0.5, 1.0, 0.0, 0.5]),
        ] {
            let (low_m, high_m) = range_m(&times_s, &positions_m);
            let most_m = maximum_of(&positions_m) + OVERSHOOT_MAX;
            assert!(low_m >= -OVERSHOOT_MAX && high_m <= most_m, "{low_m}..{high_m} m");
        }
    }

    #[test]
    fn a_smooth_trajectory_keeps_its_acceleration_between_its_points() {
        // A phase at which no point is an extremum.
        let position = |t_s: f64| 0.65 * (1.1 * t_s + 0.3).sin();
        for spacing_s in [0.1, 0.2, 0.5] {
            let times_s: Vec<f64> = (0..=40).map(|i| f64::from(i) * spacing_s).collect();
            let poses: Vec<Pose> =
                times_s.iter().map(|t_s| Pose::new(position(*t_s), 0.0, 0.0, 0.0)).collect();
            let trajectory = Trajectory::through(&times_s, &poses);
            // At rest at both ends: not in the first and the last interval.
            let inside = trajectory
                .nodes
                .iter()
                .filter(|node| (1.5 * spacing_s..38.5 * spacing_s).contains(&node.at_s));
            let accels_mps2: Vec<f64> =
                inside.map(|node| trajectory.at(node.at_s).accel[pose::X].abs()).collect();
            let most_mps2 = 0.65 * 1.1 * 1.1;
            assert!(maximum_of(&accels_mps2) < 1.25 * most_mps2, "{spacing_s} s");
        }
    }
}
