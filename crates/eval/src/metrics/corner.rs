//! Corners of a reference path, and how far a flight goes beyond them.
//!
//! Owns the definition of overshoot. Which targets count as reached is the caller's business.

use horizon_model::rows::Pose;
use nalgebra::Vector2;

use super::reference_path::horizontal;

/// Distance to the next target at which a corner is left behind. m
const CORNER_LEFT_M: f64 = 0.25;

/// Largest cosine of the turn at a corner. From a right angle on the path itself does not lead beyond
/// it; the cosine of a right angle is zero up to rounding. 1
const CORNER_COS_MAX: f64 = 1e-9;

/// A target at which the way turns by a right angle or more.
#[derive(Debug, Clone, PartialEq)]
pub struct Corner {
    /// Index of the target.
    pub(super) target: usize,
    /// The target, world frame. m
    at_w: Vector2<f64>,
    /// Unit vector along the incoming side.
    way_w: Vector2<f64>,
    /// The next target, world frame. m
    next_w: Vector2<f64>,
    overshoot_m: f64,
    is_left: bool,
}

impl Corner {
    /// Whether it is among the first `reached` targets.
    pub fn is_reached(&self, reached: usize) -> bool {
        reached > self.target
    }

    /// The longest way beyond the corner along its incoming side. m, >= 0
    pub fn overshoot_m(&self) -> f64 {
        self.overshoot_m
    }

    /// Notes how far `at_w` lies beyond the corner while it is the next target or just passed.
    ///
    /// `at_w` is x and y in the world frame (m), `reached` the number of targets reached so far.
    pub fn pass(&mut self, at_w: &Vector2<f64>, reached: usize) {
        if self.is_left || reached < self.target {
            return;
        }
        self.overshoot_m = self.overshoot_m.max((at_w - self.at_w).dot(&self.way_w));
        let is_near_next = (at_w - self.next_w).norm() <= CORNER_LEFT_M;
        self.is_left = reached > self.target + 1 || (reached > self.target && is_near_next);
    }
}

/// The corners of the way through `targets` (world frame, m and rad), none of them passed yet. Of a target only x and y
/// count. Cost linear in the targets; allocates the answer.
pub fn corners(targets: &[Pose]) -> Vec<Corner> {
    let corner = |(target, around): (usize, &[Pose])| {
        let [from_w, at_w, next_w] =
            [around.first()?, around.get(1)?, around.get(2)?].map(horizontal);
        let way_w = (at_w - from_w).try_normalize(0.0)?;
        let on_w = (next_w - at_w).try_normalize(0.0)?;
        let corner = Corner { target, at_w, way_w, next_w, overshoot_m: 0.0, is_left: false };
        (way_w.dot(&on_w) <= CORNER_COS_MAX).then_some(corner)
    };
    (1..).zip(targets.windows(3)).filter_map(corner).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn targets(places: &[[f64; 2]]) -> Vec<Pose> {
        places.iter().map(|[x, y]| Pose::new(*x, *y, 1.0, 0.0)).collect()
    }

    #[test]
    fn a_corner_turns_by_a_right_angle_or_more() {
        let square = targets(&[[0.0, 0.0], [0.0, 1.5], [1.5, 1.5], [1.5, 0.0], [0.0, 0.0]]);
        let found: Vec<usize> = corners(&square).iter().map(|corner| corner.target).collect();
        assert_eq!(found, [1, 2, 3]);
        // The way comes along +y: the cosine of the turn is that to +y.
        for (next, is_corner) in [
            ([1.0, 1.0], true),
            ([1.0, 1.02], false),
            ([-1.0, 0.9], true),
            ([0.01, 2.0], false),
            ([0.0, 0.5], true),
        ] {
            let way = targets(&[[0.0, 0.0], [0.0, 1.0], next]);
            assert_eq!(corners(&way).len(), usize::from(is_corner), "{next:?}");
        }
        // A target on top of the one before has no side.
        assert!(corners(&targets(&[[0.0, 0.0], [0.0, 0.0], [1.0, 0.0]])).is_empty());
        assert!(corners(&targets(&[[0.0, 0.0], [1.0, 0.0]])).is_empty());
    }

    #[test]
    fn an_overshoot_is_the_longest_way_beyond_the_corner_until_it_is_left() {
        let mut corner = corners(&targets(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])).remove(0);
        for (at, reached, expected_m) in [
            // On the way to the target before, far along x: not yet its turn.
            ([3.0, 0.0], 0, 0.0),
            ([0.9, 0.0], 1, 0.0),
            ([1.2, 0.0], 1, 0.2),
            // Only what is along the incoming side counts.
            ([1.1, 0.7], 2, 0.2),
            ([1.3, 0.5], 2, 0.3),
            // 0.25 m from the next target it is left, that pose included.
            ([1.1, 0.8], 2, 0.3),
            ([2.0, 1.0], 2, 0.3),
        ] {
            corner.pass(&Vector2::from(at), reached);
            assert!((corner.overshoot_m() - expected_m).abs() < 1e-12, "{at:?}: {corner:?}");
        }
        assert!(!corner.is_reached(1) && corner.is_reached(2));
    }

    #[test]
    fn a_corner_is_left_when_the_target_behind_it_is_reached() {
        let mut corner = corners(&targets(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]])).remove(0);
        corner.pass(&Vector2::new(1.1, 0.4), 3);
        corner.pass(&Vector2::new(1.9, 0.4), 3);
        assert!((corner.overshoot_m() - 0.1).abs() < 1e-12, "{corner:?}");
    }
}
