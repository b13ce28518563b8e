//! The hover after a take-off, before control starts.
//!
//! Owns where the vehicle stood, and when the hover ends: the firmware holds the vehicle meanwhile, unless a draught or
//! a floor without texture carries it away. Before the end of its own climb a drone ignores sticks.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};

use super::Supervisor;
use super::condition_timer::elapsed_s;
use super::evidence::Evidence;

/// Horizontal distance from the position of the take-off at which control starts once the climb has ended. m
const DRIFT_MAX_M: f64 = 0.3;

/// A vehicle that was so far from where it stood in so many ticks was touched, or rises. m, rad
const MOVED_M: f64 = 0.03;
const MOVED_RAD: f64 = 0.15;
const MOVED_TICKS: u32 = 5;

/// A vehicle that does not rise by so much in this time, longer than between poses of 4 Hz, has ended its climb. m, s
const CLIMB_RISE_M: f64 = 0.03;
const CLIMB_ENDED_S: f64 = 0.3;

/// Where the vehicle stood before its take-off, and whether its climb has ended.
#[derive(Debug, Clone, Default)]
pub(super) struct HoverAfterTakeOff {
    /// Where the vehicle stood, world frame. m, rad
    stood: Option<Pose>,
    /// When the take-off was confirmed; `None` if the flight began in the air. ns
    risen_ns: Option<i64>,
    /// Ticks since the order in which the vehicle was further than [`MOVED_M`] or [`MOVED_RAD`] from `stood`.
    moved_ticks: u32,
    /// Whether control has to start as soon as the climb has ended: the vehicle drifts away, or somebody comes near.
    is_urgent: bool,
    has_ended: bool,
    /// A height in the climb, and when the vehicle came there. m, ns
    climbed: Option<(f64, i64)>,
}

impl HoverAfterTakeOff {
    /// The take-off begins at `stood`.
    pub(super) fn begin(&mut self, stood: Option<Pose>) {
        self.stood = stood;
    }

    /// The take-off is confirmed.
    pub(super) fn confirm(&mut self, t_ns: i64) {
        self.risen_ns = Some(t_ns);
    }

    /// Whether the vehicle has moved since the take-off was ordered.
    pub(super) fn was_moved(&self) -> bool {
        self.moved_ticks >= MOVED_TICKS
    }

    /// Whether control may start. After a take-off `settle_s` have to pass, or the climb to end of a vehicle that has
    /// drifted away or is approached.
    pub(super) fn is_over(&self) -> bool {
        self.risen_ns.is_none() || self.has_ended
    }

    /// Takes the pose of the tick at `t_ns`, if it is fresh, and whether somebody comes near or is not seen.
    ///
    /// Real time: no allocation, constant cost.
    fn update(&mut self, t_ns: i64, pose: Option<Pose>, is_endangered: bool, settle_s: f64) {
        if let Some((stood, now)) = self.stood.zip(pose) {
            let moved_w = (now - stood).fixed_rows::<3>(pose::X).into_owned();
            let turned_rad = wrap(now[pose::THETA] - stood[pose::THETA]);
            let is_elsewhere = is_elsewhere(moved_w.norm(), turned_rad);
            self.moved_ticks = self.moved_ticks.saturating_add(u32::from(is_elsewhere));
            self.is_urgent |= moved_w.xy().norm() > DRIFT_MAX_M || is_endangered;
        }
        let is_level = self.update_height(t_ns, pose);
        self.has_ended |= self.risen_ns.is_some_and(|risen_ns| {
            self.is_urgent && is_level || elapsed_s(risen_ns, t_ns) >= settle_s
        });
    }

    /// Takes the height. Returns whether the vehicle has ended its climb.
    fn update_height(&mut self, t_ns: i64, pose: Option<Pose>) -> bool {
        let Some(z_m) = pose.map(|at| at[pose::Z]) else { return false };
        let stays = |(before_m, _): &(f64, i64)| z_m - before_m < CLIMB_RISE_M;
        let climbed = self.climbed.filter(stays).unwrap_or((z_m, t_ns));
        self.climbed = Some(climbed);
        let (_, since_ns) = climbed;
        elapsed_s(since_ns, t_ns) >= CLIMB_ENDED_S
    }
}

/// Whether a vehicle that is `moved_m` and `turned_rad` from where it stood was touched, or rises. m, rad
fn is_elsewhere(moved_m: f64, turned_rad: f64) -> bool {
    moved_m > MOVED_M || turned_rad.abs() > MOVED_RAD
}

impl Supervisor {
    /// Updates what is known of the hover.
    pub(super) fn update_hover_after_take_off(&mut self, e: &Evidence) {
        let pose = e.pose.filter(|_| !self.is_pose_stale(e));
        self.hover.update(e.t_ns, pose, e.obstacles.is_near_or_unseen(), self.table.settle_s);
    }
}

#[cfg(test)]
mod tests {
    use super::super::evidence::{ObstacleApproach, Phase};
    use super::super::tests::*;
    use super::*;

    /// Tenths of a second from the order to take off to control by a vehicle that the climb carries by `drift_m`.
    fn steered_after(drift_m: f64) -> Option<usize> {
        let mut fixture = Fixture::taking_off();
        let drifted = Pose::new(drift_m, 0.0, 1.0, 0.0);
        let aloft = Evidence { pose: Some(drifted), ..ALOFT };
        (0..60).find(|_| fixture.tick(&aloft).may_steer())
    }

    #[test]
    fn control_starts_after_its_time_or_sooner_when_the_vehicle_drifts() {
        let at_rest = steered_after(0.0).unwrap();
        assert_eq!(steered_after(DRIFT_MAX_M), Some(at_rest), "the limit itself");
        let carried = steered_after(DRIFT_MAX_M.next_up()).unwrap();
        let sooner_s = 0.1 * f64::from(u32::try_from(at_rest - carried).unwrap());
        assert!((sooner_s - (TABLE.settle_s - CLIMB_ENDED_S)).abs() < 1e-9, "{at_rest}, {carried}");
        assert_eq!(steered_after(f64::NAN), None, "no position");
    }

    /// Whether a vehicle that stood at the heading `stood_rad` and was at `at` in so many ticks was moved.
    fn was_moved(stood_rad: f64, at: Pose, ticks: u32) -> bool {
        let mut hover = HoverAfterTakeOff::default();
        hover.begin(Some(Pose::new(0.0, 0.0, 0.0, stood_rad)));
        for _ in 0..ticks {
            hover.update(CALM.t_ns, Some(at), false, 1.0);
        }
        hover.was_moved()
    }

    #[test]
    fn a_vehicle_was_moved_if_it_was_elsewhere_in_five_ticks() {
        let beside = |x_m: f64| Pose::new(x_m, 0.0, 0.0, 3.0);
        assert!(was_moved(3.0, beside(MOVED_M.next_up()), 5));
        assert!(!was_moved(3.0, beside(MOVED_M), 99) && !was_moved(3.0, beside(0.2), 4));
    }

    #[test]
    fn a_vehicle_was_moved_if_it_was_turned_in_five_ticks() {
        let turned = |theta_rad: f64| Pose::new(0.0, 0.0, 0.0, theta_rad);
        assert!(was_moved(0.0, turned(-0.151), 5) && !was_moved(0.0, turned(-0.151), 4));
        assert!(!was_moved(0.0, turned(0.149), 99));
        assert!(was_moved(3.0, turned(-3.1), 5) && !was_moved(3.0, turned(-3.2), 99), "wrapped");
    }

    #[test]
    fn a_vehicle_at_the_limits_of_position_and_heading_is_not_elsewhere() {
        // No wrapped angle equals the limit: `wrap` returns multiples of 2^-51.
        for turned_rad in [MOVED_RAD, -MOVED_RAD] {
            assert!(!is_elsewhere(MOVED_M, turned_rad));
            assert!(is_elsewhere(0.0, turned_rad.signum() * MOVED_RAD.next_up()));
        }
        assert!(is_elsewhere(MOVED_M.next_up(), 0.0));
    }

    #[test]
    fn a_vehicle_that_is_approached_is_steered_when_its_climb_has_ended_and_stays_so() {
        let mut fixture = Fixture::taking_off();
        fixture.pass(2, &ALOFT);
        let near = with_obstacles(ALOFT, |it| it.approach = ObstacleApproach::Predicted);
        let after = (0..60).find(|_| fixture.tick(&near).may_steer());
        assert_eq!(after, Some(1), "0.3 s after its height was first seen");
        let rises = Evidence { pose: Some(Pose::new(0.0, 0.0, 1.3, 0.0)), ..ALOFT };
        assert!(fixture.tick(&rises).may_steer(), "it evades upwards");
    }

    #[test]
    fn a_pose_that_is_stale_shows_no_end_of_a_climb() {
        let mut fixture = Fixture::taking_off();
        let blind = Evidence { pose: CALM.pose, pose_age_s: Some(0.6), ..ALOFT };
        assert_eq!(fixture.tick(&blind).phase, Phase::Flying, "by the drone's report");
        fixture.pass(8, &with_obstacles(blind, |it| it.approach = ObstacleApproach::Predicted));
        for k in 0..3 {
            let rising = Some(Pose::new(0.0, 0.0, 0.5 + 0.04 * f64::from(k), 0.0));
            assert!(!fixture.tick(&Evidence { pose: rising, ..ALOFT }).may_steer(), "tick {k}");
        }
    }

    #[test]
    fn a_vehicle_that_drifts_in_its_climb_is_steered_when_that_has_ended() {
        // 0.33 m/s until 1.5 s after it was confirmed, by poses of 20 ms.
        let steered_ms = |climb_s: f64, settle_s: f64| {
            let mut hover = HoverAfterTakeOff::default();
            hover.begin(Some(Pose::zeros()));
            hover.confirm(0);
            (0..500_i32).map(|k| 20 * k).find(|ms| {
                let t_s = 1e-3 * f64::from(*ms);
                let at = Pose::new(0.5, 0.0, 0.5 + 0.33 * t_s.min(climb_s), 0.0);
                let e = Evidence { pose: Some(at), t_ns: i64::from(*ms) * 1_000_000, ..ALOFT };
                hover.update(e.t_ns, e.pose, false, settle_s);
                hover.is_over()
            })
        };
        let level_ms = steered_ms(1.5, 4.0).unwrap();
        assert!((1700..=1820).contains(&level_ms), "{level_ms} ms");
        assert_eq!(steered_ms(9.0, 2.0), Some(2000), "a climb that does not end");
    }

    #[test]
    fn a_vehicle_that_rises_by_the_limit_itself_still_climbs() {
        for (risen_m, is_over) in [(CLIMB_RISE_M.next_down(), true), (CLIMB_RISE_M, false)] {
            let mut hover = HoverAfterTakeOff::default();
            hover.begin(Some(Pose::new(1.0, 0.0, 0.0, 0.0)));
            hover.confirm(0);
            let mut over_at = |z_m: f64, t_ns: i64| {
                let pose = Some(Pose::new(0.0, 0.0, z_m, 0.0));
                hover.update(t_ns, pose, false, 9.0);
                hover.is_over()
            };
            assert!(!over_at(0.0, 0));
            assert_eq!(over_at(risen_m, 300_000_000), is_over, "{risen_m} m");
        }
    }

    #[test]
    fn a_drift_is_measured_from_where_the_vehicle_stood() {
        for (x_m, y_m, is_over) in [(1.2, -2.2, false), (1.0, -2.31, true), (0.69, -2.0, true)] {
            let mut hover = HoverAfterTakeOff::default();
            hover.begin(Some(Pose::new(1.0, -2.0, 0.0, 0.0)));
            hover.confirm(0);
            let at = Some(Pose::new(x_m, y_m, 1.0, 0.0));
            let [early, later] = [0, 300_000_000].map(|t_ns| Evidence { pose: at, t_ns, ..ALOFT });
            hover.update(early.t_ns, early.pose, false, 1.0);
            assert!(!hover.is_over(), "nothing shows that it does not climb");
            hover.update(later.t_ns, later.pose, false, 1.0);
            assert_eq!(hover.is_over(), is_over, "{x_m}, {y_m} m");
        }
    }
}
