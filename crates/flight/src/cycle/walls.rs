//! Walls and obstacles in the plan.
//!
//! Owns the distances that the controller's soft constraints (`plan_walls.rs`) need: of the planned pose from walls and
//! obstacles, and of the position to which the vehicle would coast with neutral sticks from the walls, so that a
//! flight that ends in neutral sticks tends to come to rest inside. Three predictions of the moving obstacle count. The
//! supervisor's queries about positions and paths: `occupancy.rs`.

mod occupancy;
mod plan_walls;
mod table;

use horizon_model::rows::{Pose, pos_w};
use horizon_model::setting::SettingError;
use nalgebra::{Matrix3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::moving_obstacle::MovingObstacle;
use crate::obstacle::{self, SignedDistance};
use crate::{Obstacle, ObstacleTable, Room};
pub(super) use occupancy::climb_beside_m;
pub(super) use plan_walls::PlanWalls;
pub use table::WallTable;

/// Distance beyond the margin of a wall or obstacle from which on it is left out of the constraints of a pose. m
const BEYOND_MARGIN_M: f64 = 1.0;

/// Least distance of a plan from all walls and obstacles from which on no [`Clearance`] is reported. m
const CLEARANCE_MAX_M: f64 = 1.0;

/// A position of the moving obstacle that is nearer to the vehicle is that of the vehicle's markers: two rigid bodies
/// do not come so near to each other. m
const MARKER_CONFUSION_M: f64 = 0.25;

/// A person who stops comes as far as the present velocity leads in this time: 0.23 m from 0.9 m/s at 1.8 m/s^2. s
const STOP_S: f64 = 0.25;

/// The room and what stands in it, as the plan sees them.
#[derive(Debug, Clone)]
pub(super) struct Walls {
    constraints: Vec<ObstacleConstraint>,
    table: WallTable,
    /// The moving obstacle by the newest tick.
    moving: MovingObstacle,
    /// Time from now to the beginning of the plan. s
    lead_s: f64,
    /// Covariance of the predicted position, world frame. m^2
    covariance_w: Matrix3<f64>,
}

/// A wall or obstacle that the plan keeps away from: one soft constraint.
#[derive(Debug, Clone, Copy)]
enum ObstacleConstraint {
    /// A wall of the room, by its number below [`Room::WALLS`].
    Wall(Room, usize),
    /// An obstacle that does not move.
    Fixed(Obstacle),
    /// The moving obstacle by one of its predictions.
    Moving(Obstacle, Prediction),
}

/// Prediction of the moving obstacle.
#[derive(Debug, Clone, Copy)]
enum Prediction {
    /// By its present velocity.
    Velocity,
    /// By its low-pass filtered velocity.
    MeanVelocity,
    /// It stops: [`STOP_S`].
    Stop,
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
        table.check().map_err(|error| error.under("mpc.walls"))?;
        let walls = room
            .into_iter()
            .flat_map(|room| (0..Room::WALLS).map(move |i| ObstacleConstraint::Wall(room, i)));
        let may_accelerate = table.obstacle_accel_mps2 > 0.0;
        let of = |obstacle: &Obstacle| {
            if obstacle.is_moving() {
                ObstacleConstraint::Moving(*obstacle, Prediction::Velocity)
            } else {
                ObstacleConstraint::Fixed(*obstacle)
            }
        };
        let moving = obstacles.iter().find(|obstacle| may_accelerate && obstacle.is_moving());
        let by = |prediction| moving.map(|moving| ObstacleConstraint::Moving(*moving, prediction));
        let constraints = walls
            .chain(obstacles.iter().map(of))
            .chain(by(Prediction::MeanVelocity))
            .chain(by(Prediction::Stop))
            .collect();
        Ok(Some(Self {
            constraints,
            table: table.clone(),
            moving: MovingObstacle::default(),
            lead_s: 0.0,
            covariance_w: Matrix3::zeros(),
        }))
    }

    /// Follows the moving obstacle by a period of `dt_s`, in which its position `seen_w` was measured or not at all,
    /// beside the vehicle at `vehicle_w`, world frame, m: a position so near to the vehicle is that of its own markers.
    pub(super) fn follow_obstacle(
        &mut self,
        seen_w: Option<[f64; 3]>,
        vehicle_w: Option<Vector3<f64>>,
        dt_s: f64,
    ) {
        let is_vehicle = |at_w: &[f64; 3]| {
            vehicle_w.is_some_and(|vehicle_w| {
                (vehicle_w - Vector3::from(*at_w)).norm() < MARKER_CONFUSION_M
            })
        };
        self.moving.follow(seen_w.filter(|at_w| !is_vehicle(at_w)), dt_s);
    }

    /// Whether there is a moving obstacle that is not seen; see [`MovingObstacle::is_unseen`].
    pub(super) fn is_moving_unseen(&self) -> bool {
        self.moving.is_unseen() && self.moving_obstacle().is_some()
    }

    /// The plan begins `lead_s` after now, at a position of this covariance. m^2
    pub(super) fn begin_after(&mut self, lead_s: f64, covariance_w: Matrix3<f64>) {
        (self.lead_s, self.covariance_w) = (lead_s, covariance_w);
    }

    /// Whether the margin grows with the covariance of the position.
    pub(super) fn follows_covariance(&self) -> bool {
        self.table.margin_sd > 0.0
    }

    /// Number of soft constraints of a planned pose.
    pub(super) fn count(&self) -> usize {
        self.constraints.len()
    }

    fn fixed_obstacles(&self) -> impl Iterator<Item = &Obstacle> {
        self.constraints.iter().filter_map(|constraint| match constraint {
            ObstacleConstraint::Fixed(obstacle) => Some(obstacle),
            ObstacleConstraint::Wall(..) | ObstacleConstraint::Moving(..) => None,
        })
    }

    fn moving_obstacle(&self) -> Option<&Obstacle> {
        self.constraints.iter().find_map(|constraint| match constraint {
            ObstacleConstraint::Moving(obstacle, _) => Some(obstacle),
            ObstacleConstraint::Wall(..) | ObstacleConstraint::Fixed(_) => None,
        })
    }

    /// Distance from the wall or obstacle of `constraint`, `ahead_s` after the beginning of the plan.
    fn distance(
        &self,
        constraint: &ObstacleConstraint,
        at_w: &Vector3<f64>,
        ahead_s: f64,
    ) -> SignedDistance {
        let ahead_s = self.lead_s + ahead_s;
        match constraint {
            ObstacleConstraint::Wall(room, i) => room.wall_distance(*i, at_w),
            ObstacleConstraint::Fixed(obstacle) => obstacle.distance(at_w),
            ObstacleConstraint::Moving(obstacle, prediction) => {
                let moving_w = match prediction {
                    Prediction::Velocity => self.moving.position(ahead_s),
                    Prediction::MeanVelocity => self.moving.position_by_mean(ahead_s),
                    Prediction::Stop => self.moving.position(ahead_s.min(STOP_S)),
                };
                obstacle.distance_from(at_w, moving_w.as_ref())
            }
        }
    }

    /// The lesser distance of two positions from the wall or obstacle, and whether it is that of the second one:
    /// `at_w`, and the position `coasting_w` further where the vehicle would rest, which counts for walls only. The
    /// plan may coast towards an obstacle that it is going to evade.
    fn least_distance(
        &self,
        constraint: &ObstacleConstraint,
        at_w: &Vector3<f64>,
        coasting_w: &Vector3<f64>,
        ahead_s: f64,
    ) -> (SignedDistance, bool) {
        let here = self.distance(constraint, at_w, ahead_s);
        let ObstacleConstraint::Wall(..) = constraint else { return (here, false) };
        let at_rest = self.distance(constraint, &(at_w + coasting_w), ahead_s);
        if at_rest.distance_m < here.distance_m { (at_rest, true) } else { (here, false) }
    }

    /// Whether `constraint` is that of a wall far beyond its margin, as nearly all walls are in nearly all plans; needs
    /// no gradient.
    fn is_far_wall(
        &self,
        constraint: &ObstacleConstraint,
        at_w: &Vector3<f64>,
        ahead_s: f64,
    ) -> bool {
        let ObstacleConstraint::Wall(room, i) = constraint else { return false };
        let (row, distance_m) = room.wall_distance_m(*i, at_w);
        self.still_margin_m(self.covariance_w[(row, row)], ahead_s) - distance_m < -BEYOND_MARGIN_M
    }

    /// Clearance of the poses of a plan, each with its time from the beginning in s, `None` if all are far away; and
    /// whether the poses stay inside of the room and out of the obstacles at rest. The moving obstacle does not count
    /// for the latter: the plan evades it, and the vehicle does not brake for it.
    pub(super) fn clearance(
        &self,
        poses: impl Iterator<Item = (Pose, f64)>,
    ) -> (Option<Clearance>, bool) {
        let mut found = Clearance { distance_m: f64::INFINITY, ahead_s: 0.0, active: 0 };
        let mut is_clear = true;
        for (at, ahead_s) in poses {
            let at_w = pos_w(&at);
            let mut is_near = false;
            for constraint in &self.constraints {
                let SignedDistance { distance_m, gradient_w } =
                    self.distance(constraint, &at_w, ahead_s);
                is_near |= distance_m < self.margin_m(constraint, &gradient_w, ahead_s);
                is_clear &=
                    distance_m >= 0.0 || matches!(constraint, ObstacleConstraint::Moving(..));
                if distance_m < found.distance_m {
                    (found.distance_m, found.ahead_s) = (distance_m, ahead_s);
                }
            }
            found.active += u32::from(is_near);
        }
        ((found.distance_m < CLEARANCE_MAX_M).then_some(found), is_clear)
    }

    /// Margin of `constraint`, from which `gradient_w` leads away, `ahead_s` after the beginning of the plan. m
    fn margin_m(
        &self,
        constraint: &ObstacleConstraint,
        gradient_w: &Vector3<f64>,
        ahead_s: f64,
    ) -> f64 {
        let variance = gradient_w.dot(&(self.covariance_w * gradient_w));
        let margin_m = self.still_margin_m(variance, ahead_s);
        let shown_mps2 = match constraint {
            ObstacleConstraint::Wall(..) | ObstacleConstraint::Moving(_, Prediction::Stop) => {
                return margin_m;
            }
            ObstacleConstraint::Fixed(_) => return margin_m + self.table.vehicle_radius_m,
            ObstacleConstraint::Moving(_, Prediction::Velocity) => self.shown_accel_mps2(),
            ObstacleConstraint::Moving(_, Prediction::MeanVelocity) => 0.0,
        };
        let least_mps2 = self.table.obstacle_accel_mps2;
        margin_m + 0.5 * least_mps2.max(shown_mps2) * (self.lead_s + ahead_s).powi(2)
    }

    /// Acceleration that the moving obstacle has shown; 0 in older settings and logs. m/s^2
    fn shown_accel_mps2(&self) -> f64 {
        if self.may_accelerate() { self.moving.acceleration_mps2() } else { 0.0 }
    }

    /// Whether the moving obstacle may change its velocity: not in older settings and logs.
    fn may_accelerate(&self) -> bool {
        self.table.obstacle_accel_mps2 > 0.0
    }

    /// Margin of a wall or obstacle that does not move, with this variance of the position towards it, m^2. m
    fn still_margin_m(&self, variance: f64, ahead_s: f64) -> f64 {
        let sd_m = variance.max(0.0).sqrt();
        self.table.margin_m + self.table.growth_mps * ahead_s + self.table.margin_sd * sd_m
    }
}

#[cfg(test)]
mod tests;
