//! Reference of a flight, by which it is judged: an outline or targets in order, and the distance at which a target
//! counts as reached.

use horizon_model::angle::unwrap_near;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::SettingError;
use horizon_model::whole;
use nalgebra::Vector2;
use tello_flight::{CircleTable, Mission, MissionTable, SplineTable, TargetTable, TrajectoryTable};

use tello_flight::cycle::FlightTable;

use super::corner::{Corner, corners};

/// The line to follow and the poses to reach.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferencePath {
    /// Corners of the polyline that distances are taken to. m, rad
    pub outline: Vec<Pose>,
    /// Poses to reach, one after the other. m, rad
    pub targets: Vec<Pose>,
    /// Number of targets that the mission itself counts: of a curve its ends.
    pub targets_count: usize,
    /// A target counts as reached within this norm over x, y, z and theta. m and rad
    pub reach: f64,
    /// Whether the last target counts only when the controller has reached the end of its mission, since poses do not
    /// show how much of it was flown: a trajectory over time, a curve within `reach` of one place.
    pub ends_with_mission: bool,
    /// How often the path is flown; the targets are those of all laps.
    pub laps: usize,
    /// How often its outline goes round: the laps, or the turns of a circle, of which the last may be a part. 1
    pub rounds: f64,
}

/// How far a pose is from the nearest point of an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Offset {
    /// Horizontal distance. m
    pub distance_m: f64,
    /// Height above that point. m
    pub height_m: f64,
}

impl ReferencePath {
    /// The reference path that `flight` is to fly.
    ///
    /// # Errors
    /// A mission that breaks its rules.
    pub fn of(flight: &FlightTable) -> Result<Self, SettingError> {
        let mission = Mission::new(&flight.mission, flight.cycle.dt_s)
            .map_err(|error| error.under("mission"))?;
        let outline = mission.outline();
        let laps = flight.mission.laps() as usize;
        let mut rounds = laps as f64;
        let (targets, reach) = match &flight.mission {
            // Their outlines are the polylines through what is to be reached.
            MissionTable::Targets(table) => (outline.clone(), table.reach),
            MissionTable::Waypoints(table) => (outline.clone(), table.follow.reach),
            MissionTable::Spline(SplineTable { follow, .. })
            | MissionTable::Trajectory(TrajectoryTable { follow, .. }) => {
                (quarters(&outline, laps), follow.reach)
            }
            MissionTable::Circle(CircleTable { follow, turns, .. }) => {
                rounds = turns * laps as f64;
                (quarters(&outline, laps * whole(turns.ceil())), follow.reach)
            }
        };
        let targets_count = mission.targets_count();
        let ends_with_mission = matches!(flight.mission, MissionTable::Trajectory(_));
        let mut path =
            Self { outline, targets, targets_count, reach, ends_with_mission, laps, rounds };
        let stays = |pair: &[Pose]| matches!(pair, [from, to] if path.is_within(from, to));
        path.ends_with_mission |= path.is_curve() && path.targets.windows(2).any(stays);
        Ok(path)
    }

    /// `flight` with nothing to do but to fly to its first target and to stay there for `hold_s`.
    ///
    /// # Errors
    /// As [`ReferencePath::of`].
    pub fn hold_first(flight: &FlightTable, hold_s: f64) -> Result<FlightTable, SettingError> {
        let Self { targets, reach, .. } = Self::of(flight)?;
        let targets = targets.first().map(|first| (*first).into()).into_iter().collect();
        let mut flight = flight.clone();
        flight.mission = MissionTable::Targets(TargetTable { reach, targets });
        flight.cycle.supervisor.finish_hold_s = hold_s;
        Ok(flight)
    }

    /// Whether it is a curve, of which the mission counts the ends alone: `targets` are places on it.
    pub(crate) fn is_curve(&self) -> bool {
        self.targets.len() != self.targets_count
    }

    /// Its corners, none of them passed yet; a curve has none.
    pub fn corners(&self) -> Vec<Corner> {
        if self.is_curve() { Vec::new() } else { corners(&self.targets) }
    }

    /// The outline of the first round: rounds are closed, and lie on each other. Less than a round is all of it.
    pub(crate) fn lap_outline(&self) -> Vec<Pose> {
        let sides = self.outline.len().saturating_sub(1);
        let of_round = whole((sides as f64 / self.rounds.max(1.0)).round());
        self.outline.iter().take(of_round + 1).copied().collect()
    }

    /// Horizontal distance and height of the pose `at` (world frame, m and rad) from the nearest point of the outline.
    ///
    /// Cost linear in the corners, no allocation.
    pub fn offset(&self, at: &Pose) -> Offset {
        offset(&self.outline, at)
    }

    /// The lap, from 0, in which the vehicle is that has reached `reached` of `count` targets.
    pub fn lap(&self, reached: usize, count: usize) -> usize {
        let lap = reached.saturating_sub(1) * self.laps / count.saturating_sub(1).max(1);
        lap.min(self.laps.saturating_sub(1))
    }

    /// Whether the pose `at` (world frame, m and rad) is within reach of the target of this index; false beyond the
    /// last. The distance is the norm of the difference over x, y, z (m) and theta (rad, the short way).
    pub fn is_reached(&self, target: usize, at: &Pose) -> bool {
        self.targets.get(target).is_some_and(|target| self.is_within(target, at))
    }

    fn is_within(&self, target: &Pose, at: &Pose) -> bool {
        let mut way = target - at;
        way[pose::THETA] = unwrap_near(way[pose::THETA], 0.0);
        way.norm() <= self.reach
    }
}

/// The offset of the pose `at` from the polyline through the corners of `outline`, both in the world frame, m and rad.
/// Infinite without a corner. The thesis samples the outline every 0.02 m instead, which reads up to 0.01 m more for a
/// vehicle on the line and 0.0005 m more beside it at 0.1 m.
///
/// Cost linear in the corners, no allocation.
pub fn offset(outline: &[Pose], at: &Pose) -> Offset {
    struct Nearest {
        squared_m2: f64,
        z_m: f64,
    }
    let at_w = horizontal(at);
    let mut nearest = Nearest { squared_m2: f64::INFINITY, z_m: f64::NAN };
    let mut meet = |point_w: Vector2<f64>, z_m: f64| {
        let squared_m2 = (at_w - point_w).norm_squared();
        if squared_m2 < nearest.squared_m2 {
            nearest = Nearest { squared_m2, z_m };
        }
    };
    if let Some(first) = outline.first() {
        meet(horizontal(first), first[pose::Z]);
    }
    for side in outline.windows(2) {
        let [from, to] = side else { continue };
        let way_w = horizontal(to) - horizontal(from);
        // On a side without horizontal length every fraction is the same point; its end counts.
        let fraction = (at_w - horizontal(from)).dot(&way_w) / way_w.norm_squared();
        let fraction = if fraction.is_nan() { 1.0 } else { fraction.clamp(0.0, 1.0) };
        let z_m = from[pose::Z] + fraction * (to[pose::Z] - from[pose::Z]);
        meet(horizontal(from) + fraction * way_w, z_m);
    }
    Offset { distance_m: nearest.squared_m2.sqrt(), height_m: at[pose::Z] - nearest.z_m }
}

/// The horizontal part of a pose. m
pub fn horizontal(at: &Pose) -> Vector2<f64> {
    Vector2::new(at[pose::X], at[pose::Y])
}

/// Begin, end and three poses between them, in each round: a closed curve must be flown to be finished.
fn quarters(outline: &[Pose], rounds: usize) -> Vec<Pose> {
    let (last, count) = (outline.len().saturating_sub(1), 4 * rounds);
    (0..=count).filter_map(|quarter| outline.get(quarter * last / count).copied()).collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use tello_flight::Start;
    use tello_io::config;

    use super::*;

    fn path(outline: &[[f64; 4]]) -> ReferencePath {
        let outline: Vec<Pose> = outline.iter().map(|corner| Pose::from(*corner)).collect();
        ReferencePath {
            targets_count: outline.len(),
            targets: outline.clone(),
            ends_with_mission: false,
            laps: 1,
            rounds: 1.0,
            outline,
            reach: 0.2,
        }
    }

    #[test]
    fn a_curve_has_places_to_pass_that_its_mission_does_not_count() {
        let eight =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions/figure_eight.json");
        let (table, mission) = config::fly(None, Some(&eight)).unwrap();
        let reference =
            ReferencePath::of(&config::flight(&table, mission, Start::Airborne)).unwrap();
        assert_eq!((reference.targets.len(), reference.targets_count), (5, 2));
        assert!(reference.is_curve() && !reference.ends_with_mission);
        assert!(reference.corners().is_empty());
    }

    #[test]
    fn what_stays_in_one_place_ends_with_its_mission_and_every_turn_of_a_circle_has_places() {
        let (table, _) = config::fly(None, None).unwrap();
        let of = |mission: serde_json::Value| {
            let mission = serde_json::from_value(mission).unwrap();
            ReferencePath::of(&config::flight(&table, mission, Start::Airborne)).unwrap()
        };
        let circle = |radius_m: f64, turns: f64| {
            of(serde_json::json!({ "circle": {
                "centre": [0.0, 0.0, 1.2, 0.0], "radius_m": radius_m, "turns": turns,
                "limits": { "speed_max_mps": 0.5, "accel_max_mps2": 0.5 }
            } }))
        };
        let (wide, narrow) = (circle(0.6, 2.5), circle(0.05, 3.0));
        assert_eq!((wide.targets.len(), wide.ends_with_mission), (13, false));
        assert_eq!((narrow.targets.len(), narrow.ends_with_mission), (13, true));
        // One turn of several ends where it began.
        for several in [&wide, &narrow] {
            let turn = several.lap_outline();
            assert!((turn[turn.len() - 1] - turn[0]).norm() < 0.01, "{:?}", several.rounds);
            assert!(turn.len() < several.outline.len() / 2);
        }
        let half = circle(0.6, 0.5);
        assert_eq!(half.lap_outline(), half.outline);
        let rows = vec![[0.0, 0.0, 0.0, 1.3, 0.0], [30.0, 0.0, 0.0, 1.3, 0.0]];
        assert!(
            of(serde_json::json!({ "trajectory": { "points": { "rows": rows } } }))
                .ends_with_mission
        );
    }

    #[test]
    fn one_lap_of_several_begins_and_ends_at_the_same_corner() {
        let lap = [[0.0; 4], [1.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0], [0.0; 4]];
        let once = path(&lap);
        let thrice = [&lap[..], &lap[1..], &lap[1..]].concat();
        let thrice = ReferencePath { laps: 3, rounds: 3.0, ..path(&thrice) };
        assert_eq!(thrice.lap_outline(), once.outline);
        assert_eq!(once.lap_outline(), once.outline);
        assert!(path(&[]).lap_outline().is_empty());
    }

    #[test]
    fn the_offset_is_to_the_nearest_point_of_all_sides() {
        let ramp = path(&[[0.0, 0.0, 1.0, 0.0], [2.0, 0.0, 2.0, 0.0], [2.0, 2.0, 2.0, 0.0]]);
        for (at, distance_m, height_m) in [
            ([0.5, 0.1, 1.5, 0.0], 0.1, 0.25),
            ([-0.3, 0.4, 1.0, 0.0], 0.5, 0.0),
            ([2.3, -0.4, 1.0, 0.0], 0.5, -1.0),
            ([1.7, 1.0, 2.1, 3.0], 0.3, 0.1),
        ] {
            let offset = ramp.offset(&Pose::from(at));
            assert!((offset.distance_m - distance_m).abs() < 1e-12, "{at:?}: {offset:?}");
            assert!((offset.height_m - height_m).abs() < 1e-12, "{at:?}: {offset:?}");
        }
    }

    #[test]
    fn a_point_and_a_vertical_side_have_offsets_too() {
        let point = path(&[[1.0, 1.0, 1.3, 0.0]]).offset(&Pose::new(1.3, 1.4, 1.2, 0.0));
        assert!((point.distance_m - 0.5).abs() < 1e-12 && (point.height_m + 0.1).abs() < 1e-12);
        let lift = path(&[[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 2.0, 0.0]]);
        assert!((lift.offset(&Pose::new(0.3, 0.4, 1.5, 0.0)).distance_m - 0.5).abs() < 1e-12);
    }

    #[test]
    fn reach_is_the_norm_over_four_rows_with_theta_on_the_circle() {
        let reference = path(&[[0.0, 0.0, 1.0, 3.1]]);
        for (at, is_reached) in [
            ([0.2, 0.0, 1.0, 3.1], true),
            ([0.15, 0.0, 1.15, 3.1], false),
            ([0.0, 0.0, 1.0, -3.1], true),
            ([0.0, 0.0, 1.0, 2.8], false),
            ([f64::NAN, 0.0, 1.0, 3.1], false),
        ] {
            assert_eq!(reference.is_reached(0, &Pose::from(at)), is_reached, "{at:?}");
        }
        assert!(!reference.is_reached(1, &Pose::new(0.0, 0.0, 1.0, 3.1)));
    }
}
