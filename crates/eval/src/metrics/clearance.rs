//! How near a flight came to walls and obstacles.

use horizon_model::check::minimum;
use horizon_model::rows::{Pose, pos_w};
use horizon_model::setting::SettingError;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_flight::cycle::CycleTable;
use tello_flight::{Obstacle, Room, obstacles};

/// The room and what stands in it.
#[derive(Debug, Clone)]
pub struct Surroundings {
    room: Option<Room>,
    obstacles: Vec<Obstacle>,
}

/// Least distances of a flight; null without a room, without obstacles or before the first pose.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub struct LeastClearance {
    /// To a wall of the room, negative outside. m
    pub wall_m: Option<f64>,
    /// To the surface of an obstacle, negative inside. m
    pub obstacle_m: Option<f64>,
}

impl Surroundings {
    /// The surroundings that settings name.
    ///
    /// # Errors
    /// A room or an obstacle that breaks its rule.
    pub fn of(cycle: &CycleTable) -> Result<Self, SettingError> {
        let room = cycle.supervisor.room.as_ref().map(Room::try_from).transpose();
        let room = room.map_err(|error| error.under("cycle.supervisor.room"))?;
        let obstacles = obstacles(&cycle.obstacles).map_err(|error| error.under("cycle"))?;
        Ok(Self { room, obstacles })
    }

    /// The distances at the pose `at` (m, rad), while the obstacle that moves is at `moving_w` (m), both in the world
    /// frame. Cost linear in the obstacles.
    pub fn at(&self, at: &Pose, moving_w: Option<[f64; 3]>) -> LeastClearance {
        let moving_w = moving_w.map(Vector3::from);
        let distance = |one: &Obstacle| one.distance_from(&pos_w(at), moving_w.as_ref()).distance_m;
        let distances = self.obstacles.iter().map(distance).filter(|one| one.is_finite());
        LeastClearance {
            wall_m: self.room.map(|room| room.clearance_m(at)),
            obstacle_m: distances.reduce(minimum),
        }
    }

    /// The obstacles.
    pub fn obstacles(&self) -> &[Obstacle] {
        &self.obstacles
    }

    /// Outlines of the obstacles from above, x and y of the corners in the world frame. m
    pub fn outlines(&self) -> Vec<Vec<(f64, f64)>> {
        self.obstacles.iter().map(Obstacle::outline).collect()
    }
}

impl LeastClearance {
    /// The smaller ones of both.
    pub fn add(&mut self, other: Self) {
        let least = |a: Option<f64>, b: Option<f64>| a.into_iter().chain(b).reduce(minimum);
        self.wall_m = least(self.wall_m, other.wall_m);
        self.obstacle_m = least(self.obstacle_m, other.obstacle_m);
    }
}

#[cfg(test)]
mod tests {
    use tello_flight::{ObstacleTable, RoomTable};

    use super::*;

    #[test]
    fn the_least_distances_are_kept() {
        let room = RoomTable { x_m: [-2.0, 2.0], y_m: [-3.0, 3.0], z_m: [0.0, 2.5], stop_s: 1.0 };
        let pole = ObstacleTable::Cylinder { centre_m: [1.0, 0.0], radius_m: 0.2, z_m: [0.0, 2.0] };
        let surroundings = Surroundings {
            room: Some(Room::try_from(&room).unwrap()),
            obstacles: obstacles(&[pole]).unwrap(),
        };
        let mut least = LeastClearance::default();
        for x in [0.0, 1.5, -1.0] {
            least.add(surroundings.at(&Pose::new(x, 0.0, 1.2, 0.0), None));
        }
        let [wall_m, obstacle_m] = [least.wall_m, least.obstacle_m].map(Option::unwrap);
        assert!((wall_m - 0.5).abs() < 1e-12 && (obstacle_m - 0.3).abs() < 1e-12, "{least:?}");
        let outside = surroundings.at(&Pose::new(2.25, 0.0, 1.2, 0.0), None);
        assert_eq!(outside.wall_m, Some(-0.25));
    }
}
