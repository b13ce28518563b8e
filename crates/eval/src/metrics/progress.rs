//! How far along its path a vehicle is: the thesis' matching of poses to points of the trajectory.
//!
//! Owns the thesis' progress and its distance in four rows (section 5.2.3), with the path sampled as the thesis does.
//! The horizontal distance is the exact one of [`ReferencePath::offset`](super::ReferencePath::offset): samples 0.02 m
//! apart read up to 0.01 m more beside a vehicle on the line.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose};
use nalgebra::Vector2;

use super::reference_path::horizontal;

/// Longest distance between neighbouring points of the path. m
const SPACING_M: f64 = 0.02;

/// A polyline as points, at most 0.02 m apart in x, y and z.
#[derive(Debug, Clone, PartialEq)]
pub struct PathProgress {
    points: Vec<Pose>,
    points_w: Vec<Vector2<f64>>,
}

/// A pose matched to the point of the path that is horizontally nearest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OnPath {
    /// Number of that point over the largest number: 0 at the begin of the path, 1 at its end. 1
    pub progress: f64,
    /// Norm of the difference to that point over x, y, z and theta. m and rad
    pub distance_4d: f64,
}

impl PathProgress {
    /// The path through `corners`: `ceil(length / 0.02 m)` points on each side, its end belonging to the
    /// next. `None` without a side.
    pub fn new(corners: &[Pose]) -> Option<Self> {
        let mut points = Vec::new();
        for side in corners.windows(2) {
            let [from, to] = side else { continue };
            let path = to - from;
            let count = (path.fixed_rows::<3>(pose::X).norm() / SPACING_M).ceil();
            let count = horizon_model::whole(count.min(1e6));
            points.extend((0..count).map(|k| from + path * (k as f64 / count as f64)));
        }
        let points_w = points.iter().map(horizontal).collect();
        (!points.is_empty()).then_some(Self { points, points_w })
    }

    /// The progress of the pose `at` (world frame, m and rad), and its distance from the path.
    ///
    /// Cost linear in the points, no allocation.
    pub fn place(&self, at: &Pose) -> OnPath {
        let at_w = horizontal(at);
        let squared_m2 = self.points_w.iter().map(|point_w| (at_w - point_w).norm_squared());
        let nearest =
            squared_m2.enumerate().fold((0, f64::INFINITY), |nearest, (k, squared_m2)| {
                if squared_m2 < nearest.1 { (k, squared_m2) } else { nearest }
            });
        let mut off = at - self.points[nearest.0];
        off[pose::THETA] = unwrap_near(off[pose::THETA], 0.0);
        OnPath {
            progress: nearest.0 as f64 / (self.points.len() - 1).max(1) as f64,
            distance_4d: off.norm(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_of_the_thesis_has_300_points() {
        let corners = [[0.0, 0.0], [0.0, 1.5], [1.5, 1.5], [1.5, 0.0], [0.0, 0.0]];
        let corners = corners.map(|[x, y]| Pose::new(x, y, 1.0, 0.0));
        let path = PathProgress::new(&corners).unwrap();
        assert_eq!(path.points.len(), 300);
        let place = path.place(&Pose::new(0.3, 0.76, 1.4, 0.1));
        // 38 points of 0.02 m, of which the last has the number 299.
        assert!((place.progress - 38.0 / 299.0).abs() < 1e-12, "{place:?}");
        assert!((place.distance_4d - 0.26_f64.sqrt()).abs() < 1e-12, "{place:?}");
    }

    #[test]
    fn a_path_of_one_point_is_refused() {
        assert_eq!(PathProgress::new(&[Pose::zeros()]), None);
        assert_eq!(PathProgress::new(&[Pose::zeros(); 3]), None);
        assert_eq!(PathProgress::new(&[]), None);
    }

    #[test]
    fn a_heading_is_compared_on_the_circle() {
        let corners = [Pose::new(0.0, 0.0, 1.0, 3.1), Pose::new(1.0, 0.0, 1.0, 3.1)];
        let place = PathProgress::new(&corners).unwrap().place(&Pose::new(0.5, 0.0, 1.0, -3.1));
        assert!((place.distance_4d - (std::f64::consts::TAU - 6.2)).abs() < 1e-9, "{place:?}");
    }
}
