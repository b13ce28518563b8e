//! Occupancy queries of the supervisor: whether a position or a path is free of obstacles.
//!
//! Owns the distances within which obstacles that do not move, and the moving one, count for a flight, a take-off and a
//! landing. The plan does not depend on the answers.

use horizon_model::check::minimum;
use nalgebra::Vector3;

use super::Walls;
use crate::Obstacle;
use crate::supervisor::CLIMB_MAX_M;

/// Least distance between the points of a path that are checked for obstacles, and the largest number of points. m, 1
const PATH_SPACING_M: f64 = 0.01;
const PATH_POINTS_MAX: u32 = 200;

/// Distance from an obstacle within which a plan that evades it may change the height of the vehicle. m
const BESIDE_M: f64 = 0.6;

/// Height above a start that must be free of obstacles: a take-off and 0.1 m. m
const CLIMB_M: f64 = CLIMB_MAX_M + 0.1;

/// Time within which the moving obstacle must not meet a climb or landing: a landing from 1.3 m takes 3.5 s. s
const APPROACH_S: f64 = 4.0;

/// Time in which the acceleration of the moving obstacle adds to the distance within which it blocks a path. s
const PATH_REACH_S: f64 = 1.0;

/// Largest speed of a person who stands and shifts weight. m/s
const STANDING_SPEED_MAX_MPS: f64 = 0.3;

/// How far a climb, in which nothing steers, may carry the vehicle towards the moving obstacle. m
const CLIMB_DRIFT_M: f64 = 0.3;

impl Walls {
    /// Whether `at_w` is inside of an obstacle that does not move.
    pub(in crate::cycle) fn is_in_fixed(&self, at_w: &Vector3<f64>) -> bool {
        is_within(self.distance_to_fixed_m(at_w), 0.0)
    }

    /// Whether `at_w` is nearer than [`BESIDE_M`] to an obstacle that does not move.
    pub(in crate::cycle) fn is_beside_fixed(&self, at_w: &Vector3<f64>) -> bool {
        is_within(self.distance_to_fixed_m(at_w), BESIDE_M)
    }

    /// Whether the moving obstacle keeps the vehicle from getting from `at_w` to `to_w`, world frame, m: it is nearer
    /// than [`BESIDE_M`] to the straight path or one of its ends. For an obstacle with the acceleration `a` the limit
    /// grows by `(a - obstacle_accel_mps2) T^2 / 2`, `T` = [`PATH_REACH_S`] (`docs/control.md`, section 3).
    pub(in crate::cycle) fn moving_blocks_path(
        &self,
        at_w: &Vector3<f64>,
        to_w: &Vector3<f64>,
    ) -> bool {
        let Some(moving_w) = self.moving.position(0.0) else { return false };
        let along = nearest_along(at_w, to_w, &moving_w);
        let nearest_w = at_w + along.clamp(0.0, 1.0) * (to_w - at_w);
        let more_mps2 = self.shown_accel_mps2() - self.table.obstacle_accel_mps2;
        let limit_m = BESIDE_M + 0.5 * more_mps2.max(0.0) * PATH_REACH_S.powi(2);
        self.moving_obstacle().is_some_and(|obstacle| {
            obstacle.distance_from(&nearest_w, Some(&moving_w)).distance_m < limit_m
        })
    }

    /// Whether the straight path from `at_w` to `to_w`, world frame, m, leads through an obstacle that does not move.
    ///
    /// A path that is not checked up to its end by [`PATH_POINTS_MAX`] points, since it is too long and too near to an
    /// obstacle, counts as one through it.
    ///
    /// Real time: no allocation; the distances of at most so many points from all obstacles.
    pub(in crate::cycle) fn fixed_blocks_path(
        &self,
        at_w: &Vector3<f64>,
        to_w: &Vector3<f64>,
    ) -> bool {
        let path_w = to_w - at_w;
        let length_m = path_w.norm();
        let mut gone_m = 0.0;
        // The path is free as far as the distance from the nearest obstacle.
        for _ in 0..PATH_POINTS_MAX {
            let point_w = at_w + path_w * (gone_m / length_m.max(f64::MIN_POSITIVE));
            let free_m = self.distance_to_fixed_m(&point_w);
            let is_inside = is_within(free_m, 0.0);
            if is_inside || gone_m >= length_m {
                return is_inside;
            }
            gone_m = (gone_m + free_m.max(PATH_SPACING_M)).min(length_m);
        }
        true
    }

    /// Least distance from the obstacles that do not move; infinite without one, NaN if any is. m
    fn distance_to_fixed_m(&self, at_w: &Vector3<f64>) -> f64 {
        let distances_m = self.fixed_obstacles().map(|obstacle| obstacle.distance(at_w).distance_m);
        distances_m.fold(f64::INFINITY, minimum)
    }

    /// Whether the moving obstacle, by its present velocity, comes within the margin of a vehicle that stays at `at_w`
    /// during a landing.
    pub(in crate::cycle) fn is_approached(&self, at_w: &Vector3<f64>) -> bool {
        let Some((from_w, to_w)) = self.moving.position(0.0).zip(self.moving.position(APPROACH_S))
        else {
            return false;
        };
        let along = nearest_along(&from_w, &to_w, at_w);
        let nearest_w = from_w + along.clamp(0.0, 1.0) * (to_w - from_w);
        let comes_near = |obstacle: &Obstacle| {
            obstacle.distance_from(at_w, Some(&nearest_w)).distance_m < self.table.margin_m
        };
        self.moving_obstacle().is_some_and(comes_near)
    }

    /// Whether the moving obstacle could come within the margin of `at_w` during a landing if it turned towards it.
    pub(in crate::cycle) fn may_be_approached(&self, at_w: &Vector3<f64>) -> bool {
        let (moving_w, speed_mps) = (self.moving.position(0.0), self.moving.speed_mps());
        let may_turn =
            |speed_mps: &f64| self.may_accelerate() && *speed_mps > STANDING_SPEED_MAX_MPS;
        let Some(speed_mps) = speed_mps.filter(may_turn) else { return false };
        let is_within = |obstacle: &Obstacle| {
            let distance_m = obstacle.distance_from(at_w, moving_w.as_ref()).distance_m;
            distance_m < self.table.margin_m + speed_mps * APPROACH_S
        };
        self.moving_obstacle().is_some_and(is_within)
    }

    /// Whether no vehicle may take off from `at_w`: that is inside of an obstacle, would climb into one, or the moving
    /// obstacle approaches or is too near.
    pub(in crate::cycle) fn blocks_take_off(&self, at_w: &Vector3<f64>) -> bool {
        let moving_w = self.moving.position(0.0);
        let least_m = |obstacle: &Obstacle| {
            obstacle.distance_in_climb(at_w, CLIMB_M, moving_w.as_ref()).distance_m
        };
        let beside_m = climb_beside_m(self.table.margin_m);
        self.is_approached(at_w)
            || self.fixed_obstacles().any(|it| least_m(it) < 0.0)
            || self.moving_obstacle().is_some_and(|it| least_m(it) < beside_m)
    }
}

/// Whether `distance_m` is below `limit_m`; a distance of NaN is.
fn is_within(distance_m: f64, limit_m: f64) -> bool {
    distance_m.is_nan() || distance_m < limit_m
}

/// Least distance of a take-off from the moving obstacle, of which plans keep `margin_m` away. m
pub(in crate::cycle) fn climb_beside_m(margin_m: f64) -> f64 {
    margin_m + CLIMB_DRIFT_M
}

/// Where the line from `from_w` to `to_w` is nearest to `point_w`, all in m: 0 at `from_w`, 1 at `to_w`. Horizontally:
/// the moving obstacle has no ends.
fn nearest_along(from_w: &Vector3<f64>, to_w: &Vector3<f64>, point_w: &Vector3<f64>) -> f64 {
    let (path_w, apart_w) = ((to_w - from_w).xy(), (point_w - from_w).xy());
    apart_w.dot(&path_w) / path_w.norm_squared().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests;
