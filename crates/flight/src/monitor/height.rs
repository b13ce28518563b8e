//! The drone's own height beside that of the poses.
//!
//! Owns the difference of both since the take-off. The drone measures its height from a level of its own, by air
//! pressure and by the distance to the surface below it: slow drift is forgotten. The height counts once it has risen
//! in this flight. If it changes from one report to the next by more than a vehicle climbs, while the poses stay, the
//! surface below has changed (a table, an edge), or the report is wrong.

use horizon_model::check::maximum;
use horizon_model::rows::pose;

use super::{Agreement, Doubt, Sample};
use crate::forgetting::decay;

/// Time constant with which a difference is forgotten. s
const FORGET_S: f64 = 30.0;
/// Limit of the difference without forgetting, since the take-off, over `limit_m`. 1
const WHOLE_FLIGHT_RATIO: f64 = 1.5;
/// Rise by the drone that shows that it reports its height. m
const SHOWN_RISE_M: f64 = 0.3;

/// Least change of the drone's height from one report to the next, 0.1 s later, that is a step of the surface below: no
/// vehicle climbs at 3.5 m/s. m
const FLOOR_STEP_MIN_M: f64 = 0.35;
/// Largest change of the poses' height during such a step. m
const POSE_STAYS_M: f64 = 0.2;
/// After a longer time without a pose a change of the drone's height counts as one of the vehicle. s
const UNSEEN_MAX_S: f64 = 0.3;

/// Difference below which the vehicle is above the floor again, whatever the sum of the steps is. m
const ABOVE_FLOOR_M: f64 = 0.2;

/// By how much the drone's height may differ from the rise when it first shows one: a Tello's reads low from the
/// take-off on, by an offset that differs from flight to flight. m
const OFFSET_MAX_M: f64 = 0.75;

/// Comparison of the height by the poses with the drone's. An offset is the height by the poses less the drone's.
#[derive(Debug, Clone, Default)]
pub(super) struct HeightMonitor {
    limit_m: f64,
    dt_s: f64,
    /// Offset on the ground, in flight low-pass filtered. m
    offset_m: Option<f64>,
    /// Offset on the ground, in flight only corrected for a drone whose height reads low from the take-off on. m
    offset_on_ground_m: f64,
    /// Height by the drone on the ground. m
    drone_height_on_ground_m: Option<f64>,
    /// Heights by poses and drone when the drone's changed last. m
    before: Option<(f64, f64)>,
    /// Time since the newest pose. s
    unseen_s: f64,
    /// Height of the surface below the vehicle over the floor: the sum of its steps. m
    floor_m: f64,
    /// Whether the drone's height has risen in this flight.
    has_shown_height: bool,
    /// Newest difference of both heights. m
    error_m: f64,
    doubt: Doubt,
}

impl HeightMonitor {
    pub(super) fn new(limit_m: f64, dt_s: f64) -> Self {
        Self { limit_m, dt_s, ..Self::default() }
    }

    /// Takes a tick on the ground, which shows the offset.
    pub(super) fn reset_on_ground(&mut self, sample: &Sample) {
        if let Some((z_m, height_m)) = heights(sample) {
            self.offset_m = Some(z_m - height_m);
            self.offset_on_ground_m = z_m - height_m;
            self.drone_height_on_ground_m = Some(height_m);
        }
        (self.before, self.floor_m) = (None, 0.0);
        self.has_shown_height = false;
        self.error_m = 0.0;
        self.doubt = Doubt::default();
    }

    /// Takes a tick in flight; how both heights compare, and by how much they differ. m
    pub(super) fn update(&mut self, sample: &Sample) -> (Agreement, f64) {
        let (Some((z_m, height_m)), Some(offset_m), Some(height_on_ground_m)) =
            (heights(sample), self.offset_m, self.drone_height_on_ground_m)
        else {
            self.wait(sample);
            return (Agreement::Unknown, self.error_m);
        };
        self.unseen_s = 0.0;
        self.floor_m += self.floor_step_m(z_m, height_m);
        let rise_m = z_m - self.offset_on_ground_m - height_on_ground_m;
        let is_first = !self.has_shown_height && height_m - height_on_ground_m >= SHOWN_RISE_M;
        self.has_shown_height |= is_first;
        if !self.has_shown_height {
            return (Agreement::Unknown, 0.0);
        }
        let excess_m = z_m - height_m - offset_m;
        let reads_low = is_first && rise_m >= SHOWN_RISE_M && excess_m.abs() <= OFFSET_MAX_M;
        let shift_m = if reads_low { excess_m } else { 0.0 };
        let offset_m = offset_m + shift_m;
        self.offset_on_ground_m += shift_m;
        let difference_m = z_m - height_m - offset_m;
        if difference_m.abs() < ABOVE_FLOOR_M {
            self.floor_m = 0.0;
        }
        // The vehicle may be above the floor again before the drone's report shows it.
        let least_m = |a_m: f64, b_m: f64| if a_m.abs() <= b_m.abs() { a_m } else { b_m };
        let error_m = least_m(difference_m, difference_m - self.floor_m);
        self.error_m = error_m.abs();
        // One wrong report must not shift the offset for the rest of the flight.
        let followed_m = error_m.clamp(-2.0 * self.limit_m, 2.0 * self.limit_m);
        self.offset_m = Some(offset_m + followed_m * (1.0 - decay(self.dt_s, FORGET_S)));
        let of_flight_m = z_m - height_m - self.offset_on_ground_m;
        let error_of_flight_m = least_m(of_flight_m, of_flight_m - self.floor_m).abs();
        let compared_m = maximum(error_of_flight_m / WHOLE_FLIGHT_RATIO, self.error_m);
        (self.doubt.update(compared_m, self.limit_m, self.dt_s), self.error_m)
    }

    /// Takes a tick in flight in which one of both heights is missing.
    fn wait(&mut self, sample: &Sample) {
        if sample.pose.is_none() {
            self.doubt.wait(self.dt_s);
            self.unseen_s += self.dt_s;
        }
        if sample.drone.is_none() || self.unseen_s > UNSEEN_MAX_S {
            // The vehicle may fall by more than a step in the time without a report, or without a pose.
            self.before = None;
        }
    }

    /// Step of the surface below the vehicle with this report of the drone, positive upwards; 0 without a step. m
    fn floor_step_m(&mut self, z_m: f64, height_m: f64) -> f64 {
        let Some((z_before_m, before_m)) = self.before.replace((z_m, height_m)) else { return 0.0 };
        if height_m.total_cmp(&before_m).is_eq() {
            // The report has not changed: the heights before stay.
            self.before = Some((z_before_m, before_m));
            return 0.0;
        }
        let (risen_m, moved_m) = (height_m - before_m, z_m - z_before_m);
        let is_step = risen_m.abs() >= FLOOR_STEP_MIN_M && moved_m.abs() < POSE_STAYS_M;
        if is_step { moved_m - risen_m } else { 0.0 }
    }
}

/// Heights by the pose and by the drone; `None` if one is missing. m
fn heights(sample: &Sample) -> Option<(f64, f64)> {
    Some((sample.pose?[pose::Z], sample.drone?.height_m?))
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::{Pose, Sticks};

    use super::*;
    use crate::monitor::DroneMotion;

    const DT_S: f64 = 0.02;

    #[test]
    fn a_height_that_reads_low_from_the_take_off_on_is_compared_with_what_follows() {
        let found = |by_drone_m: fn(f64) -> f64| {
            let mut monitor = at_rest();
            let mut found = Agreement::Unknown;
            for k in 0..250 {
                let z_m = 0.01 * f64::from(k.min(100));
                let height_m = 0.25 + (10.0 * by_drone_m(z_m)).floor() / 10.0;
                found = found.max(monitor.update(&sample(Some(z_m), Some(height_m))).0);
            }
            (found, monitor)
        };
        let (low, mut monitor) = found(|z_m| (z_m - 0.58).max(0.0));
        assert_eq!(low, Agreement::Agrees);
        assert!(
            (0..100).any(|_| monitor.update(&sample(Some(2.0), Some(0.65))).0 > Agreement::Agrees)
        );
        assert_eq!(found(|z_m| 2.0 * z_m).0, Agreement::Disagrees, "another scale");
    }

    #[test]
    fn a_table_below_is_no_height_of_the_vehicle_and_a_fall_is() {
        let mut monitor = risen();
        let see = |monitor: &mut HeightMonitor, z_m: f64, height_m: f64| {
            let seen = sample(Some(z_m), Some(height_m));
            for _ in 0..4 {
                monitor.update(&seen);
            }
            monitor.update(&seen)
        };
        // A table of 0.7 m, over which it stays for 4 s, and off it again.
        for (height_m, times) in [(0.75, 1), (0.05, 40), (0.75, 40)] {
            for k in 0..times {
                let (agreement, error_m) =
                    see(&mut monitor, 0.5 + 0.002 * f64::from(k % 7), height_m);
                assert_eq!(agreement, Agreement::Agrees, "{height_m} m");
                assert!(error_m < 0.02, "{height_m} m: {error_m} m");
            }
        }
        // A report that is 2 m off for a second, again and again.
        for k in 0..400 {
            let wrong_m = if k % 40 < 10 { 2.0 } else { 0.0 };
            let (agreement, error_m) = see(&mut monitor, 0.5, 0.75 + wrong_m);
            assert_eq!(agreement, Agreement::Agrees, "{k}: {error_m} m");
        }
        // After a time without reports such a step may be a fall.
        let mut fallen = monitor.clone();
        fallen.update(&Sample { drone: None, ..sample(Some(0.5), None) });
        let mut unseen = monitor.clone();
        for _ in 0..20 {
            unseen.update(&sample(None, Some(0.75)));
        }
        for mut monitor in [fallen, unseen] {
            let mut found = Agreement::Unknown;
            for _ in 0..20 {
                found = found.max(see(&mut monitor, 0.5, 0.75 - 1.3).0);
            }
            assert_eq!(found, Agreement::Disagrees);
        }
        // A box as high as the least step, crossed again and again: some of its edges are steps, some are not.
        for k in 0..8000 {
            let t_s = f64::from(k) * DT_S;
            let z_m = 0.5 + 0.03 * (1.7 * t_s).sin();
            let box_m = if t_s.rem_euclid(8.0) < 1.0 { 0.36 } else { 0.0 };
            let height_m = (10.0 * (z_m + 0.25 - box_m)).round() / 10.0;
            let found = monitor.update(&sample(Some(z_m), Some(height_m)));
            assert_eq!(found.0, Agreement::Agrees, "{t_s} s: {found:?}");
        }
        // The poses stay while the drone sinks by 0.1 m in each report.
        let mut found = Agreement::Unknown;
        for k in 0..40 {
            found = found.max(see(&mut monitor, 0.5, 0.75 - 0.1 * f64::from(k.min(9))).0);
        }
        assert_eq!(found, Agreement::Disagrees);
    }

    fn sample(z_m: Option<f64>, height_m: Option<f64>) -> Sample {
        Sample {
            pose: z_m.map(|z_m| Pose::new(0.0, 0.0, z_m, 0.0)),
            drone: Some(DroneMotion { horizontal_d_mps: None, height_m, heading_rad: None }),
            u_applied: Sticks::zeros(),
            link_is_up: true,
        }
    }

    /// A monitor with a limit of 0.5 m, at rest at z = 0 with the drone's own height at 0.25 m.
    fn at_rest() -> HeightMonitor {
        let mut monitor = HeightMonitor::new(0.5, DT_S);
        monitor.reset_on_ground(&sample(Some(0.0), Some(0.25)));
        monitor
    }

    /// In flight, both heights 0.5 m above the ground.
    fn risen() -> HeightMonitor {
        let mut monitor = at_rest();
        assert_eq!(monitor.update(&sample(Some(0.5), Some(0.75))), (Agreement::Agrees, 0.0));
        monitor
    }

    #[test]
    fn a_drone_counts_from_the_least_rise_on_and_goes_on_to_count() {
        let rise_m = 0.25 + SHOWN_RISE_M;
        for (height_m, expected) in [
            (rise_m - 1e-9, Agreement::Unknown),
            (rise_m + 1e-9, Agreement::Agrees),
            (0.25 - 1.0, Agreement::Unknown),
        ] {
            let mut monitor = at_rest();
            let z_m = height_m - 0.25;
            assert_eq!(monitor.update(&sample(Some(z_m), Some(height_m))).0, expected, "{z_m} m");
        }
        // Its height stays on the ground while the poses rise.
        let mut monitor = at_rest();
        for k in 0..200 {
            let z_m = 0.01 * f64::from(k);
            let found = monitor.update(&sample(Some(z_m), Some(0.25)));
            assert_eq!(found, (Agreement::Unknown, 0.0), "{z_m} m");
        }
        let low = sample(Some(0.0), Some(0.25));
        assert_eq!(risen().update(&low).0, Agreement::Agrees, "down again");
        let mut landed = risen();
        landed.reset_on_ground(&low);
        assert_eq!(landed.update(&low).0, Agreement::Unknown, "on the ground");
    }

    #[test]
    fn a_difference_of_either_sign_is_in_doubt_above_the_limit() {
        for (z_m, expected) in [
            (1.0, Agreement::Agrees),
            (1.0_f64.next_up(), Agreement::Doubtful),
            (0.0, Agreement::Agrees),
            (-f64::EPSILON, Agreement::Doubtful),
            (f64::NAN, Agreement::Doubtful),
        ] {
            let (found, error_m) = risen().update(&sample(Some(z_m), Some(0.75)));
            assert_eq!(found, expected, "{z_m} m");
            assert!(error_m.is_nan() || (error_m - 0.5).abs() < 1e-12, "{error_m} m");
        }
    }

    #[test]
    fn one_report_of_any_height_shifts_the_offset_by_little() {
        let mut monitor = risen();
        monitor.update(&sample(Some(0.5), Some(300.0)));
        let (found, error_m) = monitor.update(&sample(Some(0.5), Some(0.75)));
        assert!(found < Agreement::Disagrees && error_m < 0.01, "{found:?}, {error_m} m");
    }

    #[test]
    fn without_one_of_both_heights_nothing_is_known_and_the_newest_error_stays() {
        let mut monitor = risen();
        let found = monitor.update(&sample(Some(0.75), Some(0.75)));
        assert_eq!(found, (Agreement::Agrees, 0.25));
        for (z_m, height_m) in [(None, Some(0.75)), (Some(0.5), None)] {
            assert_eq!(monitor.update(&sample(z_m, height_m)), (Agreement::Unknown, 0.25));
        }
        let mut without_ground = HeightMonitor::new(0.5, DT_S);
        let found = without_ground.update(&sample(Some(9.0), Some(1.0)));
        assert_eq!(found, (Agreement::Unknown, 0.0));
    }
}
