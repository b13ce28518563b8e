//! Walls and obstacles in the plan.
//!
//! Owns the distances that the controller's soft constraints (`plan_walls.rs`) need: of the planned pose from walls and
//! obstacles, and from the walls that of the place to which the vehicle would coast with neutral sticks, so that a
//! flight that ends in them tends to come to rest inside. Of an obstacle that moves, each of two predictions counts.

mod plan_walls;

use horizon_model::rows::{Pose, pos_w};
use horizon_model::setting::{SettingError, in_range};
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::moving_obstacle::MovingObstacle;
use crate::obstacle::{self, SignedDistance};
use crate::supervisor::CLIMB_MAX_M;
use crate::{Obstacle, ObstacleTable, Room};
pub(super) use plan_walls::PlanWalls;

/// What is further away than this is not looked at. m
const NEAR_M: f64 = 1.0;

/// Least distance between the places of a way that are looked at, and the most of them. m, 1
const WAY_SPACING_M: f64 = 0.01;
const WAY_PLACES_MAX: u32 = 200;

/// A plan that evades an obstacle may change the height of a vehicle that is nearer to it. m
const BESIDE_M: f64 = 0.6;

/// How far above a start obstacles are looked for: a take-off, and 0.1 m to spare. m
const CLIMB_M: f64 = CLIMB_MAX_M + 0.1;

/// An obstacle that moves is in the way of a climb or landing that it meets within so long: a landing from 1.3 m takes
/// 3.5 s. s
const APPROACH_S: f64 = 4.0;

/// A person who stands sways by less. m/s
const STANDS_MPS: f64 = 0.3;

/// How the plan keeps away from walls and obstacles.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct WallTable {
    /// Weight of each metre that is missing from the margin, per step, beside `C_s`. 1/m, 1..=10000
    pub weight: f64,
    /// Distance of the planned pose from walls and obstacles. m, 0..=1
    pub margin_m: f64,
    /// By how much the margin grows over the horizon: the error of the prediction. m/s, 0..=0.5
    pub growth_mps: f64,
    /// Acceleration that an obstacle may have which moves: its margin grows by `1/2 a t^2` besides, t from its newest
    /// place on. More, up to 1, if it has shown more. m/s^2, 0..=5; 0 in older settings and logs: none
    #[serde(default)]
    pub obstacle_accel_mps2: f64,
    /// Standard deviations of the predicted position, by the estimate's covariance over the committed time, that the
    /// margin grows by. 1, 0..=5; 0 in older settings and logs
    #[serde(default)]
    pub margin_sd: f64,
    /// Part of the way to rest with neutral sticks that walls keep clear as well, by the identified lags. 1, 0..=1; 0
    /// in older settings and logs
    #[serde(default)]
    pub coasting: f64,
}

/// The room and what stands in it, as the plan sees them.
#[derive(Debug, Clone)]
pub(super) struct Walls {
    room: Option<Room>,
    obstacles: Vec<Obstacle>,
    table: WallTable,
    /// What moves, by the newest tick.
    moving: MovingObstacle,
    /// From now to the beginning of the plan. s
    lead_s: f64,
    /// Covariance of the predicted position. m^2
    covariance_w: Matrix3<f64>,
}

/// How near a plan comes to walls and obstacles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Clearance {
    /// Least distance of a planned pose, negative beyond a wall or inside of an obstacle. m
    pub distance_m: f64,
    /// When the plan is nearest, from its beginning on. s
    pub ahead_s: f64,
    /// Planned poses that are nearer than the margin.
    pub active: u32,
}

impl Walls {
    /// Checks both tables; `None` without a table and without obstacles.
    ///
    /// # Errors
    /// The first value that breaks its rule, or obstacles without a table.
    pub(super) fn new(
        table: Option<&WallTable>,
        room: Option<Room>,
        obstacles: &[ObstacleTable],
    ) -> Result<Option<Self>, SettingError> {
        let obstacles = obstacle::obstacles(obstacles)?;
        let Some(table) = table else {
            if obstacles.is_empty() {
                return Ok(None);
            }
            let rule = "a table: the plan has to keep away from `obstacles`";
            return Err(SettingError::new("mpc.walls", "null", rule));
        };
        let check = || {
            in_range("weight", table.weight, 1.0..=10_000.0)?;
            in_range("margin_m", table.margin_m, 0.0..=1.0)?;
            in_range("growth_mps", table.growth_mps, 0.0..=0.5)?;
            in_range("obstacle_accel_mps2", table.obstacle_accel_mps2, 0.0..=5.0)?;
            in_range("margin_sd", table.margin_sd, 0.0..=5.0)?;
            in_range("coasting", table.coasting, 0.0..=1.0)
        };
        check().map_err(|error| error.under("mpc.walls"))?;
        let covariance_w = Matrix3::zeros();
        let table = table.clone();
        Ok(Some(Self {
            room,
            obstacles,
            table,
            moving: MovingObstacle::default(),
            lead_s: 0.0,
            covariance_w,
        }))
    }

    /// Follows the obstacle that moves by a period of `dt_s`, in which it was seen at `seen_w`, world frame. m
    pub(super) fn follow(&mut self, seen_w: Option<[f64; 3]>, dt_s: f64) {
        self.moving.follow(seen_w, dt_s);
    }

    /// Whether there is an obstacle that moves and nobody knows where.
    pub(super) fn is_moving_unseen(&self) -> bool {
        self.moving.place(0.0).is_none() && self.obstacles.iter().any(Obstacle::is_moving)
    }

    /// Whether `at_w` is inside of an obstacle that does not move.
    pub(super) fn is_in_obstacle(&self, at_w: &Vector3<f64>) -> bool {
        self.rest_distance_m(at_w) < 0.0
    }

    /// Whether `at_w` is nearer than 0.6 m to one.
    pub(super) fn is_beside_obstacle(&self, at_w: &Vector3<f64>) -> bool {
        self.rest_distance_m(at_w) < BESIDE_M
    }

    /// Whether the obstacle that moves is between `at_w` and `to_w`, world frame, and nearer than 0.6 m to the straight
    /// way, or so near to one of its ends that a vehicle is driven away: it does not get there. One that accelerates is
    /// evaded from further away, by what that adds to its margin within a second. m
    pub(super) fn is_way_blocked(&self, at_w: &Vector3<f64>, to_w: &Vector3<f64>) -> bool {
        let Some(moving_w) = self.moving.place(0.0) else { return false };
        let along = nearest_along(at_w, to_w, &moving_w);
        let nearest_w = at_w + along.clamp(0.0, 1.0) * (to_w - at_w);
        let is_between = (0.0..=1.0).contains(&along);
        let more_mps2 = self.shown_accel_mps2() - self.table.obstacle_accel_mps2;
        let limit_m = if is_between { BESIDE_M } else { self.table.margin_m };
        let limit_m = limit_m + 0.5 * more_mps2.max(0.0);
        self.moving_obstacles()
            .any(|it| it.distance_from(&nearest_w, Some(&moving_w)).distance_m < limit_m)
    }

    /// Whether the straight way from `at_w` to `to_w`, world frame, leads through an obstacle that does not move. m
    ///
    /// A way so long and so near to one that [`WAY_PLACES_MAX`] places do not reach its end counts as one through it:
    /// no place has shown that its rest is free.
    ///
    /// Real time: no allocation; the distances of at most so many places from all obstacles.
    pub(super) fn is_way_through_obstacle(&self, at_w: &Vector3<f64>, to_w: &Vector3<f64>) -> bool {
        let way_w = to_w - at_w;
        let length_m = way_w.norm();
        let mut gone_m = 0.0;
        // No obstacle is nearer than its distance: so far the way is free.
        for _ in 0..WAY_PLACES_MAX {
            let place_w = at_w + way_w * (gone_m / length_m.max(f64::MIN_POSITIVE));
            let free_m = self.rest_distance_m(&place_w);
            if free_m < 0.0 || gone_m >= length_m {
                return free_m < 0.0;
            }
            gone_m = (gone_m + free_m.max(WAY_SPACING_M)).min(length_m);
        }
        true
    }

    /// Least distance from the obstacles that do not move; infinite without one. m
    fn rest_distance_m(&self, at_w: &Vector3<f64>) -> f64 {
        let at_rest = self.obstacles.iter().filter(|obstacle| !obstacle.is_moving());
        at_rest.map(|obstacle| obstacle.distance(at_w).distance_m).fold(f64::INFINITY, f64::min)
    }

    /// Whether the obstacle that moves comes within the margin of one who stays at `at_w`, as it moves now.
    pub(super) fn is_approached(&self, at_w: &Vector3<f64>) -> bool {
        let Some((from_w, to_w)) = self.moving.place(0.0).zip(self.moving.place(APPROACH_S)) else {
            return false;
        };
        let along = nearest_along(&from_w, &to_w, at_w);
        let nearest_w = from_w + along.clamp(0.0, 1.0) * (to_w - from_w);
        let comes_near = |obstacle: &Obstacle| {
            obstacle.distance_from(at_w, Some(&nearest_w)).distance_m < self.table.margin_m
        };
        self.moving_obstacles().any(comes_near)
    }

    /// Whether the obstacle that moves could come that near within a landing if it turned towards `at_w`.
    pub(super) fn may_be_approached(&self, at_w: &Vector3<f64>) -> bool {
        let (moving_w, speed_mps) = (self.moving.place(0.0), self.moving.speed_mps());
        let may_turn = |speed_mps: &f64| self.may_accelerate() && *speed_mps > STANDS_MPS;
        let Some(speed_mps) = speed_mps.filter(may_turn) else { return false };
        let is_within = |obstacle: &Obstacle| {
            let distance_m = obstacle.distance_from(at_w, moving_w.as_ref()).distance_m;
            distance_m < self.table.margin_m + speed_mps * APPROACH_S
        };
        self.moving_obstacles().any(is_within)
    }

    /// Whether a vehicle that stands at `at_w` is inside of an obstacle now, or climbs into one in its take-off.
    pub(super) fn bars_start(&self, at_w: &Vector3<f64>) -> bool {
        let moving_w = self.moving.place(0.0);
        let least_m = |obstacle: &Obstacle| {
            obstacle.distance_in_climb(at_w, CLIMB_M, moving_w.as_ref()).distance_m
        };
        self.is_approached(at_w) || self.obstacles.iter().any(|obstacle| least_m(obstacle) < 0.0)
    }

    /// The plan begins `lead_s` after now, at a position of this covariance. m^2
    pub(super) fn begin_after(&mut self, lead_s: f64, covariance_w: Matrix3<f64>) {
        (self.lead_s, self.covariance_w) = (lead_s, covariance_w);
    }

    /// Whether the margin grows with the covariance of the position.
    pub(super) fn follows_covariance(&self) -> bool {
        self.table.margin_sd > 0.0
    }

    fn moving_obstacles(&self) -> impl Iterator<Item = &Obstacle> {
        self.obstacles.iter().filter(|obstacle| obstacle.is_moving())
    }

    /// Number of walls and obstacles; one that moves counts twice, the second time where its mean velocity leads.
    pub(super) fn count(&self) -> usize {
        let again = if self.may_accelerate() { self.moving_obstacles().count() } else { 0 };
        self.wall_count() + self.obstacles.len() + again
    }

    fn wall_count(&self) -> usize {
        self.room.map_or(0, |_| Room::WALLS)
    }

    /// The obstacle among walls and obstacles; `None` for a wall.
    fn obstacle(&self, i: usize) -> Option<&Obstacle> {
        let k = i.checked_sub(self.wall_count())?;
        self.obstacles.get(k).or_else(|| self.moving_obstacles().nth(k - self.obstacles.len()))
    }

    /// Whether `i` is the obstacle that moves where its mean velocity leads.
    fn is_by_mean(&self, i: usize) -> bool {
        i >= self.wall_count() + self.obstacles.len()
    }

    /// Distance from wall or obstacle `i`, `ahead_s` after the beginning of the plan.
    fn distance(&self, i: usize, at_w: &Vector3<f64>, ahead_s: f64) -> SignedDistance {
        match (self.obstacle(i), &self.room) {
            (Some(obstacle), _) if obstacle.is_moving() => {
                let (it, ahead_s) = (&self.moving, self.lead_s + ahead_s);
                let moving_w =
                    if self.is_by_mean(i) { it.place_by_mean(ahead_s) } else { it.place(ahead_s) };
                obstacle.distance_from(at_w, moving_w.as_ref())
            }
            (Some(obstacle), _) => obstacle.distance(at_w),
            (None, Some(room)) => room.wall_distance(i, at_w),
            (None, None) => {
                SignedDistance { distance_m: f64::INFINITY, gradient_w: Vector3::zeros() }
            }
        }
    }

    /// Distance at `at_w` or where the vehicle would rest, `way_w` further, whichever is nearer to wall `i`, and
    /// whether it is the latter. An obstacle is evaded, not waited for: only `at_w` counts.
    fn least_distance(
        &self,
        i: usize,
        at_w: &Vector3<f64>,
        way_w: &Vector3<f64>,
        ahead_s: f64,
    ) -> (SignedDistance, bool) {
        let here = self.distance(i, at_w, ahead_s);
        if self.obstacle(i).is_some() {
            return (here, false);
        }
        let at_rest = self.distance(i, &(at_w + way_w), ahead_s);
        if at_rest.distance_m < here.distance_m { (at_rest, true) } else { (here, false) }
    }

    /// Whether `i` is a wall far beyond its margin, as nearly all are in nearly all plans; needs no gradient.
    fn is_far_wall(&self, i: usize, at_w: &Vector3<f64>, ahead_s: f64) -> bool {
        let Some(room) = self.room.as_ref().filter(|_| i < Room::WALLS) else { return false };
        let (row, distance_m) = room.wall_distance_m(i, at_w);
        self.still_margin_m(self.covariance_w[(row, row)], ahead_s) - distance_m < -NEAR_M
    }

    fn is_moving(&self, i: usize) -> bool {
        self.obstacle(i).is_some_and(Obstacle::is_moving)
    }

    /// Least distance from all, and from those that do not move; beside it, whether one is nearer than its margin. m
    fn least_m(&self, at_w: &Vector3<f64>, ahead_s: f64) -> ([f64; 2], bool) {
        (0..self.count()).fold(([f64::INFINITY; 2], false), |([least_m, still_m], is_near), i| {
            let distance = self.distance(i, at_w, ahead_s);
            let distance_m = distance.distance_m;
            let still_m = if self.is_moving(i) { still_m } else { still_m.min(distance_m) };
            let is_near = is_near || distance_m < self.margin_m(i, &distance.gradient_w, ahead_s);
            ([least_m.min(distance_m), still_m], is_near)
        })
    }

    /// How near the poses of a plan come, each with its time in s from the beginning; `None` if all are far away. And
    /// whether they stay inside of the room and out of the obstacles at rest: a moving one is evaded, not waited for.
    pub(super) fn clearance(
        &self,
        poses: impl Iterator<Item = (Pose, f64)>,
    ) -> (Option<Clearance>, bool) {
        let mut found = Clearance { distance_m: f64::INFINITY, ahead_s: 0.0, active: 0 };
        let mut is_clear = true;
        for (at, ahead_s) in poses {
            let ([distance_m, still_m], is_near) = self.least_m(&pos_w(&at), ahead_s);
            is_clear &= still_m >= 0.0;
            found.active += u32::from(is_near);
            if distance_m < found.distance_m {
                (found.distance_m, found.ahead_s) = (distance_m, ahead_s);
            }
        }
        ((found.distance_m < NEAR_M).then_some(found), is_clear)
    }

    /// Margin to wall or obstacle `i`, which lies against `gradient_w`, `ahead_s` after the beginning of the plan. m
    fn margin_m(&self, i: usize, gradient_w: &Vector3<f64>, ahead_s: f64) -> f64 {
        let variance = gradient_w.dot(&(self.covariance_w * gradient_w));
        let margin_m = self.still_margin_m(variance, ahead_s);
        if !self.is_moving(i) {
            return margin_m;
        }
        let least_mps2 = self.table.obstacle_accel_mps2;
        let shown_mps2 = if self.is_by_mean(i) { 0.0 } else { self.shown_accel_mps2() };
        margin_m + 0.5 * least_mps2.max(shown_mps2) * (self.lead_s + ahead_s).powi(2)
    }

    /// Acceleration that the obstacle that moves has shown. m/s^2
    fn shown_accel_mps2(&self) -> f64 {
        if self.may_accelerate() { self.moving.acceleration_mps2() } else { 0.0 }
    }

    /// Whether an obstacle that moves may change its velocity: not in older settings and logs.
    fn may_accelerate(&self) -> bool {
        self.table.obstacle_accel_mps2 > 0.0
    }

    fn still_margin_m(&self, variance: f64, ahead_s: f64) -> f64 {
        let sd_m = variance.max(0.0).sqrt();
        self.table.margin_m + self.table.growth_mps * ahead_s + self.table.margin_sd * sd_m
    }
}

/// Where the line from `from_w` to `to_w` is nearest to `place_w`, all in m: 0 at `from_w`, 1 at `to_w`. Seen from
/// above: an obstacle that moves has any height.
fn nearest_along(from_w: &Vector3<f64>, to_w: &Vector3<f64>, place_w: &Vector3<f64>) -> f64 {
    let (way_w, apart_w) = ((to_w - from_w).xy(), (place_w - from_w).xy());
    apart_w.dot(&way_w) / way_w.norm_squared().max(f64::MIN_POSITIVE)
}

#[cfg(test)]
mod tests;
