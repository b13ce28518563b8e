//! By how much the vehicle goes away from its reference, and how long the mission takes.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pos_w, pose};

use crate::Mission;

/// Duration of the mission over the planned one from which on its overtime counts. 1
const PLANNED_RATIO_MAX: f64 = 2.0;

/// Factor on the distance while the moving obstacle blocks the path to the reference, or came near. 1
const BLOCKED_FACTOR: f64 = 0.5;

/// A reference that turns back to a missed waypoint leaves a vehicle that flies on: dead time and braking. s
const TURN_BACK_S: f64 = 2.0;

/// A vehicle within this of the height of its reference, or above it, has not sunk. m
const AT_HEIGHT_M: f64 = 0.1;

/// Progress of the mission so far.
#[derive(Debug, Clone, Default)]
pub(super) struct Progress {
    /// Time in which the controller steered, braking included. s
    flown_s: f64,
    /// Number of targets reached.
    targets_reached: usize,
    /// Least distance and turn since the reference was chosen; `None` before the first.
    least: Option<SmallestError>,
    /// Whether the distance counted by half in the tick before.
    was_blocked: bool,
    /// Whether the reference led back to a missed waypoint, and until when that counts, in `flown_s`. s
    was_returning: bool,
    turns_until_s: f64,
    /// Greatest height since the vehicle was last level with its reference. World frame. m
    top_m: Option<f64>,
}

/// Least distance from the reference, and least angle to its heading. m, rad
#[derive(Debug, Clone, Copy)]
struct SmallestError {
    distance_m: f64,
    turn_rad: f64,
}

/// By how much the vehicle has gone away from its reference: distance and turn less the least ones since the reference,
/// or the constant target, was chosen.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct TrackingError {
    /// Growth of the distance. m, >= 0
    pub(super) position_growth_m: f64,
    /// Growth of the angle between the headings. rad, >= 0
    pub(super) heading_growth_rad: f64,
    /// Height of the reference over the vehicle. m
    pub(super) height_deficit_m: f64,
    /// By how much the vehicle has sunk below its reference: no more than it is below, nor than it has come down. m
    pub(super) sink_depth_m: f64,
}

/// Why a vehicle may be off its reference.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct TrackingExemption {
    /// An obstacle that does not move is near: a plan that evades the obstacle may lead down.
    pub(super) is_beside_fixed: bool,
    /// The moving obstacle is in the path to the reference.
    pub(super) is_path_blocked: bool,
    /// The moving obstacle came near within the last seconds: the vehicle may still evade it, or return.
    pub(super) was_approached: bool,
}

impl TrackingExemption {
    /// Whether there is any reason.
    pub(super) fn is_any(self) -> bool {
        self.is_beside_fixed || self.is_path_blocked || self.was_approached
    }

    /// Factor on the distance from the reference. 1
    fn distance_factor(self) -> f64 {
        if self.is_path_blocked || self.was_approached { BLOCKED_FACTOR } else { 1.0 }
    }
}

impl TrackingError {
    /// How the vehicle at `pose_hat` keeps to the place `held` while it comes down.
    pub(super) fn in_descent(pose_hat: &Pose, held: &Pose, exemption: TrackingExemption) -> Self {
        let apart_w = held - pose_hat;
        Self {
            position_growth_m: exemption.distance_factor() * pos_w(&apart_w).xy().norm(),
            heading_growth_rad: wrap(apart_w[pose::THETA]).abs(),
            ..Self::default()
        }
    }
}

/// The reference of `mission`, or its constant target; `None` before the mission has one. World frame. m, rad
pub(super) fn tracked_reference(mission: &Mission) -> Option<Pose> {
    mission.reference().or_else(|| mission.is_pointwise().then(|| *mission.target()))
}

impl Progress {
    /// Counts one period of `dt_s` in which the controller steered, braking included.
    pub(super) fn count_flown(&mut self, dt_s: f64) {
        self.flown_s += dt_s;
    }

    /// By how much the mission takes longer than it may; negative before, and at its end. s
    pub(super) fn overtime_s(&self, mission: &Mission) -> f64 {
        if mission.is_finished() {
            return f64::NEG_INFINITY;
        }
        self.flown_s - PLANNED_RATIO_MAX * mission.planned_s()
    }

    /// The reference was chosen anew, for a vehicle that may be far away from it.
    pub(super) fn reset_smallest_error(&mut self) {
        self.least = None;
    }

    /// Restarts distances and sinking at the present pose: a person steers, or the flight is in another phase.
    pub(super) fn restart(&mut self) {
        self.reset_smallest_error();
        self.top_m = None;
    }

    /// How the vehicle at `pose_hat` tracks its reference. While the moving obstacle is in the path, or came near, the
    /// growth of the distance counts by half. When the obstacle leaves the path, the least distance is set to the
    /// present one.
    pub(super) fn tracking_error(
        &mut self,
        mission: &Mission,
        pose_hat: &Pose,
        exemption: TrackingExemption,
    ) -> TrackingError {
        let Some(reference) = tracked_reference(mission) else { return TrackingError::default() };
        if mission.is_pointwise() && self.targets_reached != mission.targets_reached() {
            self.targets_reached = mission.targets_reached();
            self.reset_smallest_error();
        }
        self.note_return(mission.is_returning());
        let apart_w = reference - pose_hat;
        let now = SmallestError {
            distance_m: apart_w.fixed_rows::<3>(pose::X).norm(),
            turn_rad: wrap(apart_w[pose::THETA]).abs(),
        };
        let least = self.smallest_error_since_choice(now, exemption.is_path_blocked);
        let height_deficit_m = apart_w[pose::Z];
        let sink_depth_m = self.sink_depth_m(pose_hat[pose::Z], height_deficit_m);
        TrackingError {
            position_growth_m: exemption.distance_factor() * (now.distance_m - least.distance_m),
            heading_growth_rad: now.turn_rad - least.turn_rad,
            height_deficit_m,
            sink_depth_m: if exemption.is_beside_fixed { 0.0 } else { sink_depth_m },
        }
    }

    /// Notes whether the reference leads back to a missed waypoint. For [`TURN_BACK_S`] from then on the present
    /// distance is the least one.
    fn note_return(&mut self, is_returning: bool) {
        let was_returning = std::mem::replace(&mut self.was_returning, is_returning);
        if is_returning && !was_returning {
            self.turns_until_s = self.flown_s + TURN_BACK_S;
        }
        if let Some(least) = &mut self.least
            && self.flown_s < self.turns_until_s
        {
            // The next `min` takes the present distance.
            least.distance_m = f64::INFINITY;
        }
    }

    /// Least distance and turn since the reference was chosen, of those before and `now`; the distance only since the
    /// moving obstacle has left the path.
    fn smallest_error_since_choice(
        &mut self,
        now: SmallestError,
        is_blocked: bool,
    ) -> SmallestError {
        let was_blocked = std::mem::replace(&mut self.was_blocked, is_blocked);
        let mut before = self.least.unwrap_or(now);
        if was_blocked && !is_blocked {
            before.distance_m = now.distance_m;
        }
        let least = SmallestError {
            distance_m: before.distance_m.min(now.distance_m),
            turn_rad: before.turn_rad.min(now.turn_rad),
        };
        self.least = Some(least);
        least
    }

    /// By how much a vehicle at the height `z_m` (world frame), `height_deficit_m` below its reference, has sunk. m
    fn sink_depth_m(&mut self, z_m: f64, height_deficit_m: f64) -> f64 {
        let top_m = self
            .top_m
            .filter(|_| height_deficit_m > AT_HEIGHT_M)
            .map_or(z_m, |top_m| top_m.max(z_m));
        self.top_m = Some(top_m);
        height_deficit_m.min(top_m - z_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mission(text: &str) -> Mission {
        Mission::new(&serde_json::from_str(text).unwrap(), 0.02).unwrap()
    }

    #[test]
    fn a_path_is_left_by_the_distance_to_its_reference() {
        let mut mission = mission(include_str!("../../../../configs/missions/square.json"));
        let mut progress = Progress::default();
        let far = mission.first_pose() + Pose::new(3.0, 4.0, 0.0, 9.0);
        assert!(
            progress.tracking_error(&mission, &far, TrackingExemption::default()).position_growth_m
                <= 0.0,
            "before it was seen"
        );
        mission.advance(&far);
        assert!(
            progress.tracking_error(&mission, &far, TrackingExemption::default()).position_growth_m
                < 0.1,
            "the reference begins at the vehicle"
        );
        let away = far + Pose::new(2.0, 0.0, 0.0, 0.0);
        let position_growth_m = progress
            .tracking_error(&mission, &away, TrackingExemption::default())
            .position_growth_m;
        assert!((position_growth_m - 2.0).abs() < 0.1, "{position_growth_m} m");
        progress.reset_smallest_error();
        assert!(
            progress
                .tracking_error(&mission, &away, TrackingExemption::default())
                .position_growth_m
                <= 0.0,
            "it may come back from there"
        );
    }

    #[test]
    fn a_constant_target_is_left_by_going_away_again() {
        let mission = mission(include_str!("../../../../configs/targets/square.json"));
        let mut progress = Progress::default();
        let at = |x_m: f64| mission.first_pose() + Pose::new(x_m, 0.0, 0.0, 0.0);
        for (x_m, tracking_m) in [(5.0, 0.0), (3.0, 0.0), (3.5, 0.5), (2.0, 0.0), (6.0, 4.0)] {
            let found_m = progress
                .tracking_error(&mission, &at(x_m), TrackingExemption::default())
                .position_growth_m;
            assert!((found_m - tracking_m).abs() < 1e-9, "{x_m} m: {found_m} m");
        }
    }

    #[test]
    fn a_vehicle_that_spins_turns_away_from_its_target_and_one_that_turns_to_it_does_not() {
        let mission = mission(include_str!("../../../../configs/targets/square.json"));
        let mut progress = Progress::default();
        let turned = |rad: f64| mission.first_pose() + Pose::new(0.0, 0.0, 0.0, rad);
        for (rad, heading_growth_rad) in
            [(3.0, 0.0), (1.0, 0.0), (0.2, 0.0), (-0.5, 0.3), (-3.0, 2.8), (-6.0, 0.083)]
        {
            let found_rad = progress
                .tracking_error(&mission, &turned(rad), TrackingExemption::default())
                .heading_growth_rad;
            assert!((found_rad - heading_growth_rad).abs() < 1e-3, "{rad} rad: {found_rad} rad");
        }
    }

    #[test]
    fn an_obstacle_in_the_path_lets_half_of_the_distance_count_and_what_it_left_is_the_least() {
        let mission = mission(include_str!("../../../../configs/targets/square.json"));
        let mut progress = Progress::default();
        let mut position_growth_m = |x_m: f64, is_path_blocked: bool| {
            let exemption = TrackingExemption { is_path_blocked, ..Default::default() };
            let at = mission.first_pose() + Pose::new(x_m, 0.0, 0.0, 0.0);
            progress.tracking_error(&mission, &at, exemption).position_growth_m
        };
        for (x_m, is_blocked, expected_m) in [
            (0.0, false, 0.0),
            (1.0, true, 0.5),
            (4.0, true, 2.0),
            (2.0, true, 1.0),
            (2.0, false, 0.0),
            (3.0, false, 1.0),
            (0.5, false, 0.0),
            (2.0, false, 1.5),
        ] {
            let found_m = position_growth_m(x_m, is_blocked);
            assert!((found_m - expected_m).abs() < 1e-9, "{x_m} m, {is_blocked}: {found_m} m");
        }
    }

    #[test]
    fn an_approach_lets_half_of_the_distance_count_and_changes_no_least_one() {
        let mission = mission(include_str!("../../../../configs/targets/square.json"));
        let mut progress = Progress::default();
        let mut position_growth_m = |x_m: f64, was_approached: bool| {
            let exemption = TrackingExemption { was_approached, ..Default::default() };
            let at = mission.first_pose() + Pose::new(x_m, 0.0, 0.0, 0.0);
            progress.tracking_error(&mission, &at, exemption).position_growth_m
        };
        for (x_m, was_approached, expected_m) in
            [(0.0, false, 0.0), (1.0, true, 0.5), (2.0, true, 1.0), (2.0, false, 2.0)]
        {
            let found_m = position_growth_m(x_m, was_approached);
            assert!((found_m - expected_m).abs() < 1e-9, "{x_m} m, {was_approached}: {found_m} m");
        }
    }

    #[test]
    fn a_vehicle_that_comes_down_keeps_to_a_place_at_any_height() {
        let held = Pose::new(1.0, 1.0, 0.6, 3.0);
        let at = Pose::new(1.3, 1.4, 1.2, -3.0);
        let heading_growth_rad = 2.0 * std::f64::consts::PI - 6.0;
        for (is_evading, position_growth_m) in [(false, 0.5), (true, 0.25)] {
            let exemption = TrackingExemption { is_path_blocked: is_evading, ..Default::default() };
            let found = TrackingError::in_descent(&at, &held, exemption);
            assert!((found.position_growth_m - position_growth_m).abs() < 1e-12, "{found:?}");
            assert!((found.heading_growth_rad - heading_growth_rad).abs() < 1e-12, "{found:?}");
            assert_eq!((found.height_deficit_m, found.sink_depth_m), (0.0, 0.0));
        }
    }

    #[test]
    fn a_vehicle_has_sunk_by_what_it_comes_down_below_its_reference_and_no_more() {
        let mission = mission(include_str!("../../../../configs/targets/square.json"));
        let mut progress = Progress::default();
        let over = |z_m: f64| mission.first_pose() + Pose::new(0.0, 0.0, z_m, 0.0);
        // From above it may come down to its target; a climb to it is no sinking.
        for (z_m, sink_depth_m) in
            [(1.0, 0.0), (0.0, 0.0), (-0.5, 0.5), (-0.6, 0.6), (0.0, 0.0), (0.3, 0.0)]
        {
            let found_m = progress
                .tracking_error(&mission, &over(z_m), TrackingExemption::default())
                .sink_depth_m
                .max(0.0);
            assert!((found_m - sink_depth_m).abs() < 1e-9, "{z_m} m: {found_m} m");
        }
        progress.restart();
        for (z_m, sink_depth_m) in [(-0.8, 0.0), (-0.5, 0.0), (-0.7, 0.2)] {
            let found_m = progress
                .tracking_error(&mission, &over(z_m), TrackingExemption::default())
                .sink_depth_m;
            assert!((found_m - sink_depth_m).abs() < 1e-9, "{z_m} m: {found_m} m");
        }
    }

    #[test]
    fn a_vehicle_may_fly_on_for_two_seconds_when_its_reference_turns_back() {
        let mut mission = mission(include_str!("../../../../configs/missions/square.json"));
        let mut progress = Progress::default();
        // Along the path, but far outside of the corner.
        let mut at = mission.first_pose();
        for _ in 0..2000 {
            if mission.is_returning() {
                break;
            }
            mission.advance(&at);
            at = mission.reference().unwrap_or(at);
            if mission.targets_reached() == 1 && at[pose::Y] > -1.8 {
                at += Pose::new(-0.3, 0.3, 0.0, 0.0);
            }
            progress.count_flown(0.02);
        }
        assert!(mission.is_returning());
        let mut position_growth_m = |count: u32| {
            let ahead = (0..count).map(|_| {
                at += Pose::new(0.02, 0.0, 0.0, 0.0);
                progress.count_flown(0.02);
                progress
                    .tracking_error(&mission, &at, TrackingExemption::default())
                    .position_growth_m
            });
            ahead.last().unwrap_or_default()
        };
        assert!(position_growth_m(99) <= 0.0, "it brakes");
        assert!((position_growth_m(50) - 1.0).abs() < 0.1, "and does not come back");
    }

    #[test]
    fn overtime_begins_after_twice_the_planned_time() {
        let mission = mission(include_str!("../../../../configs/missions/square.json"));
        let mut progress = Progress::default();
        let planned_s = mission.planned_s();
        assert!((20.0..40.0).contains(&planned_s), "{planned_s} s");
        progress.count_flown(2.0 * planned_s + 3.0);
        assert!((progress.overtime_s(&mission) - 3.0).abs() < 1e-9);
    }
}
