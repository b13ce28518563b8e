//! Where the vehicle may be: a box in the world frame.
//!
//! Owns what "inside" means, for a pose and for a vehicle in motion, and when a vehicle is outside or about to leave.
//! What follows from leaving the room stands in `fault.rs`.

use horizon_model::check::{maximum, minimum};
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::{SettingError, in_range};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Supervisor;
use super::evidence::{EstimatedMotion, Evidence, PlanClearance};
use crate::obstacle::SignedDistance;

/// A vehicle on the ground is no higher than this above the floor of the room: it may stand on a
/// table. m
pub const GROUND_MAX_M: f64 = 1.0;

/// A take-off climbs 0.8 to 1.2 m by itself. m
pub const CLIMB_MAX_M: f64 = 1.2;

/// Largest distance of a wall from the origin: more are millimetres, or a geofence that no flight reaches. m
const WALL_MAX_M: f64 = 500.0;

/// Largest width of a room: more are centimetres. m
const WIDTH_MAX_M: f64 = 100.0;

/// Longest time in which a vehicle of this kind comes to rest: more are milliseconds. s
const STOP_MAX_S: f64 = 10.0;

/// The rows that have walls.
const WALLED: [usize; 3] = [pose::X, pose::Y, pose::Z];

/// The room, as written in JSON: lower and upper end of each axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoomTable {
    /// World x. m, each -500..=500, the first below the second by at most 100
    pub x_m: [f64; 2],
    /// World y. m, each -500..=500, the first below the second by at most 100
    pub y_m: [f64; 2],
    /// World z, floor and ceiling. m, each -500..=500, the first below the second by at most 100
    pub z_m: [f64; 2],
    /// Distance from neutral sticks to rest over the speed: dead time and time constant of the vehicle.
    /// s, 0..=10
    pub stop_s: f64,
}

impl RoomTable {
    /// Lower and upper end along x, y and z. World frame. m
    pub fn walls_m(&self) -> [[f64; 2]; 3] {
        [self.x_m, self.y_m, self.z_m]
    }
}

/// Checked [`RoomTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Room {
    /// Ends of each row of [`WALLED`]. m
    walls_m: [[f64; 2]; WALLED.len()],
    stop_s: f64,
}

impl TryFrom<&RoomTable> for Room {
    type Error = SettingError;

    fn try_from(table: &RoomTable) -> Result<Self, SettingError> {
        let walls_m = table.walls_m();
        for (key, [low_m, high_m]) in ["x_m", "y_m", "z_m"].into_iter().zip(walls_m) {
            for end_m in [low_m, high_m] {
                if !(-WALL_MAX_M..=WALL_MAX_M).contains(&end_m) {
                    let rule = format!("-{WALL_MAX_M}..={WALL_MAX_M}, in metres");
                    return Err(SettingError::new(key, end_m, rule));
                }
            }
            if low_m >= high_m {
                let given = format!("[{low_m}, {high_m}]");
                return Err(SettingError::new(key, given, "the first number below the second"));
            }
            if high_m - low_m > WIDTH_MAX_M {
                let given = format!("[{low_m}, {high_m}]");
                let rule = format!("at most {WIDTH_MAX_M} apart, in metres");
                return Err(SettingError::new(key, given, rule));
            }
        }
        Ok(Self { walls_m, stop_s: in_range("stop_s", table.stop_s, 0.0..=STOP_MAX_S)? })
    }
}

impl Room {
    /// Whether x, y and z of `at` are inside; a position that is not finite is not. World frame. m
    ///
    /// Real time: no allocation, constant cost.
    pub fn contains(&self, at: &Pose) -> bool {
        self.walls().all(|(row, [low_m, high_m])| (low_m..=high_m).contains(&at[row]))
    }

    /// Whether a vehicle with this motion that gets neutral sticks now would come to rest outside, or
    /// whether that cannot be determined.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn is_left_by(&self, motion: &EstimatedMotion) -> bool {
        !self.contains(&(motion.pose + motion.rate * self.stop_s))
    }

    /// Whether something that stands there may be a vehicle before its take-off: inside, at most on a table, and the
    /// take-off ends below the ceiling.
    ///
    /// Real time: no allocation, constant cost.
    pub fn may_start_at(&self, at: &Pose) -> bool {
        let [.., [floor_m, ceiling_m]] = self.walls_m;
        let is_low = at[pose::Z] <= floor_m + GROUND_MAX_M;
        self.contains(at) && is_low && at[pose::Z] + CLIMB_MAX_M <= ceiling_m
    }

    /// How far `at` is outside, along the worst axis; zero inside. m
    ///
    /// Real time: no allocation, constant cost.
    pub fn excess_m(&self, at: &Pose) -> f64 {
        self.walls()
            .map(|(row, [low_m, high_m])| (low_m - at[row]).max(at[row] - high_m))
            .fold(0.0, maximum)
    }

    /// Distance to the nearest wall, negative outside. m
    ///
    /// Real time: no allocation, constant cost.
    pub fn clearance_m(&self, at: &Pose) -> f64 {
        self.walls()
            .map(|(row, [low_m, high_m])| minimum(at[row] - low_m, high_m - at[row]))
            .fold(f64::INFINITY, minimum)
    }

    /// Number of walls: two for each axis.
    pub(crate) const WALLS: usize = 2 * WALLED.len();

    /// Distance from wall `i` of [`Room::WALLS`], negative outside.
    pub(crate) fn wall_distance(&self, i: usize, at_w: &Vector3<f64>) -> SignedDistance {
        let (axis, distance_m) = self.wall_distance_m(i, at_w);
        let mut gradient_w = Vector3::zeros();
        gradient_w[axis] = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
        SignedDistance { distance_m, gradient_w }
    }

    /// The axis of wall `i` of [`Room::WALLS`], and the distance from the wall, negative outside. m
    #[inline]
    pub(crate) fn wall_distance_m(&self, i: usize, at_w: &Vector3<f64>) -> (usize, f64) {
        let axis = i / 2;
        let [low_m, high_m] = self.walls_m[axis];
        (axis, if i.is_multiple_of(2) { at_w[axis] - low_m } else { high_m - at_w[axis] })
    }

    /// Distance from neutral sticks to rest at this speed. m
    pub fn stop_m(&self, speed_mps: f64) -> f64 {
        speed_mps * self.stop_s
    }

    fn walls(&self) -> impl Iterator<Item = (usize, [f64; 2])> {
        WALLED.into_iter().zip(self.walls_m)
    }
}

impl Supervisor {
    /// Whether the vehicle would come to rest outside of the room with neutral sticks. Where a controller with plans
    /// that know the walls steers, this does not count: during a hold wind carries the vehicle on, and after the hold
    /// the controller plans anew.
    pub(super) fn would_leave(&self, e: &Evidence) -> bool {
        if !e.is_by_hand() && e.plan != PlanClearance::Unknown {
            return false;
        }
        self.room.zip(e.motion).is_some_and(|(room, motion)| room.is_left_by(&motion))
    }

    /// Whether the newest position is fresh and outside of the room.
    pub(super) fn is_outside(&self, e: &Evidence) -> bool {
        let fresh = e.pose.filter(|_| !self.is_pose_stale(e));
        self.room.zip(fresh).is_some_and(|(room, at)| !room.contains(&at))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: RoomTable =
        RoomTable { x_m: [-2.0, 3.0], y_m: [-1.0, 1.0], z_m: [0.0, 2.5], stop_s: 0.8 };

    fn room() -> Room {
        Room::try_from(&TABLE).unwrap()
    }

    #[test]
    fn the_walls_belong_to_the_room_and_nan_does_not() {
        for (at, is_inside) in [
            ([0.0, 0.0, 1.0], true),
            ([-2.0, 1.0, 2.5], true),
            ([3.01, 0.0, 1.0], false),
            ([0.0, -1.01, 1.0], false),
            ([0.0, 0.0, -0.01], false),
            ([0.0, f64::NAN, 1.0], false),
        ] {
            let [x, y, z] = at;
            assert_eq!(room().contains(&Pose::new(x, y, z, 9.0)), is_inside, "{at:?}");
        }
        assert!(room().clearance_m(&Pose::new(0.0, f64::NAN, 1.0, 0.0)).is_nan());
    }

    #[test]
    fn what_cannot_stop_inside_leaves_and_what_moves_inwards_does_not() {
        // 0.8 s at 1 m/s: the wall at x = 3 is left from 2.2 m on.
        for (x_m, rate_mps, leaves) in [
            (2.19, 1.0, false),
            (2.21, 1.0, true),
            (2.9, -1.0, false),
            (3.1, -1.0, false),
            (-1.3, -1.0, true),
            (0.0, f64::NAN, true),
        ] {
            let motion = EstimatedMotion {
                pose: Pose::new(x_m, 0.0, 1.0, 0.0),
                rate: Pose::new(rate_mps, 0.0, 0.0, 0.0),
            };
            assert_eq!(room().is_left_by(&motion), leaves, "{x_m} m, {rate_mps} m/s");
        }
    }

    #[test]
    fn a_start_is_on_the_floor_or_on_a_table() {
        for (z_m, may_start) in [(0.05, true), (1.0, true), (1.01, false), (-0.1, false)] {
            assert_eq!(room().may_start_at(&Pose::new(0.0, 0.0, z_m, 0.0)), may_start, "{z_m} m");
        }
        assert!(!room().may_start_at(&Pose::new(0.0, 1.2, 0.1, 0.0)));
    }

    #[test]
    fn a_take_off_needs_room_below_the_ceiling() {
        let under = |ceiling_m: f64| {
            let table = RoomTable { z_m: [-0.2, ceiling_m], ..TABLE };
            Room::try_from(&table).unwrap().may_start_at(&Pose::new(0.0, 0.0, 0.5, 0.0))
        };
        assert!(under(1.7) && !under(1.69));
    }

    #[test]
    fn the_clearance_is_that_of_the_nearest_wall() {
        for (at, clearance_m) in
            [([0.0, 0.0, 0.75], 0.75), ([2.875, 0.0, 1.0], 0.125), ([0.0, -1.25, 1.0], -0.25)]
        {
            let [x, y, z] = at;
            let gap_m = room().clearance_m(&Pose::new(x, y, z, 9.0)) - clearance_m;
            assert!(gap_m.abs() < 1e-12, "{at:?}: {gap_m}");
        }
    }

    #[test]
    fn the_excess_is_that_of_the_worst_axis() {
        for (at, excess_m) in
            [([0.0, 0.0, 1.0], 0.0), ([3.5, 1.2, 1.0], 0.5), ([-2.1, 0.0, 2.9], 0.4)]
        {
            let [x, y, z] = at;
            let found_m = room().excess_m(&Pose::new(x, y, z, 0.0));
            assert!((found_m - excess_m).abs() < 1e-12, "{at:?}: {found_m} m");
        }
    }

    #[test]
    fn the_distance_to_rest_grows_with_the_speed() {
        for (speed_mps, stop_m) in [(0.0, 0.0), (0.5, 0.4), (2.0, 1.6)] {
            let found_m = room().stop_m(speed_mps);
            assert!((found_m - stop_m).abs() < 1e-12, "{speed_mps} m/s: {found_m} m");
        }
    }

    #[test]
    fn a_room_without_an_inside_is_refused() {
        let refused = |table| Room::try_from(&table).unwrap_err().to_string();
        let error = refused(RoomTable { y_m: [1.0, 1.0], ..TABLE });
        assert_eq!(error, "y_m = [1, 1]: expected the first number below the second");
        let error = refused(RoomTable { z_m: [0.0, f64::NAN], ..TABLE });
        assert!(error.starts_with("z_m = NaN"), "{error}");
        for (stop_s, given) in [(-1.0, "-1"), (800.0, "800"), (f64::NAN, "NaN")] {
            let error = refused(RoomTable { stop_s, ..TABLE });
            assert_eq!(error, format!("stop_s = {given}: expected 0.0..=10.0"));
        }
    }

    #[test]
    fn walls_in_millimetres_or_centimetres_are_refused() {
        for (x_m, given) in [([-2000.0, 2000.0], "-2000"), ([0.0, 500.1], "500.1")] {
            let error = Room::try_from(&RoomTable { x_m, ..TABLE }).unwrap_err().to_string();
            assert_eq!(error, format!("x_m = {given}: expected -500..=500, in metres"));
        }
        let y_m = [-250.0, 250.0];
        let error = Room::try_from(&RoomTable { y_m, ..TABLE }).unwrap_err().to_string();
        assert_eq!(error, "y_m = [-250, 250]: expected at most 100 apart, in metres");
        for far in [[-500.0, -400.0], [400.0, 500.0]] {
            assert!(Room::try_from(&RoomTable { x_m: far, ..TABLE }).is_ok());
        }
    }
}
