//! Plans that lead outside of the room or into an obstacle, and for how long: the leaky sum `t_b` of `docs/model.md`,
//! section 6; and vehicles that do not get past an obstacle.

use horizon_model::rows::pos_w;
use nalgebra::Vector3;

use super::braking::ControlMode;
use super::condition_timer::elapsed_s;
use super::evidence::{Evidence, PlanClearance};
use super::{BRAKE_S, Supervisor};

/// How long plans may be blocked in sum, a fifth of the time without a blocked one subtracted. s
const BLOCKED_MAX_S: f64 = 3.0;

/// A vehicle that has stayed within this distance of a position for so long, with an obstacle between the vehicle and a
/// reference that stands, does not get past the obstacle. One that evades it at 0.2 m/s moves further. m, s
const STUCK_M: f64 = 0.4;
const STUCK_S: f64 = 3.0;

/// Largest motion of a reference that stands. m
const REFERENCE_MOTION_MAX_M: f64 = 0.1;

/// How long the straight path may be free in between: a vehicle may oscillate before an edge. s
const FREE_S: f64 = 0.3;

/// What has blocked the vehicle lately.
#[derive(Debug, Clone, Default)]
pub(super) struct Blockage {
    /// When a plan that was flown led out of the room or into an obstacle. ns
    plan_ns: Option<i64>,
    /// An obstacle at rest between the vehicle and its reference; `None`: there is none.
    stuck: Option<Stuck>,
}

/// Since when, and for which positions of vehicle and reference, an obstacle at rest has been between both while the
/// reference stood. World frame. m, ns
#[derive(Debug, Clone, Copy)]
struct Stuck {
    at_w: Vector3<f64>,
    reference_w: Vector3<f64>,
    since_ns: i64,
    newest_ns: i64,
}

impl Supervisor {
    /// Updates since when the vehicle has stayed before an obstacle. What keeps it there for another reason does not
    /// count: a person, an outage, an obstacle that moves or is not seen.
    pub(super) fn update_stuck_detection(&mut self, e: &Evidence) {
        let is_steered_by_controller =
            self.control != ControlMode::Off && !e.is_by_hand() && !self.timers.braking.holds();
        let is_free = e.outage.is_none() && !e.obstacles.is_unseen;
        let Some(motion) = e.motion.filter(|_| is_steered_by_controller && is_free) else {
            self.blockage.stuck = None;
            return;
        };
        let at_w = pos_w(&motion.pose);
        let before = self.blockage.stuck.filter(|stuck| (at_w - stuck.at_w).norm() <= STUCK_M);
        self.blockage.stuck = match e.obstacles.reference_behind_w {
            Some(reference_w) => {
                let stands = |stuck: &Stuck| {
                    (reference_w - stuck.reference_w).norm() <= REFERENCE_MOTION_MAX_M
                };
                let new = Stuck { at_w, reference_w, since_ns: e.t_ns, newest_ns: e.t_ns };
                Some(Stuck { newest_ns: e.t_ns, ..before.filter(stands).unwrap_or(new) })
            }
            None => before.filter(|stuck| elapsed_s(stuck.newest_ns, e.t_ns) <= FREE_S),
        };
    }

    /// Updates when and for how long plans were blocked.
    pub(super) fn update_blocked_timer(&mut self, e: &Evidence) {
        if self.control != ControlMode::Off && e.plan == PlanClearance::Blocked {
            self.blockage.plan_ns = Some(e.t_ns);
        }
        self.timers.blocked.update(self.is_blocked(e), e.t_ns);
    }

    /// Whether a plan that was flown just now leads out of the room or into an obstacle.
    pub(super) fn is_blocked(&self, e: &Evidence) -> bool {
        self.is_flying()
            && self.blockage.plan_ns.is_some_and(|at_ns| elapsed_s(at_ns, e.t_ns) < BRAKE_S)
    }

    /// Whether plans were blocked for too long in sum, or the vehicle does not get past an obstacle.
    pub(super) fn is_blocked_long(&self, e: &Evidence) -> bool {
        let is_stuck = |stuck: Stuck| elapsed_s(stuck.since_ns, e.t_ns) >= STUCK_S;
        self.timers.blocked.exceeds(BLOCKED_MAX_S) || self.blockage.stuck.is_some_and(is_stuck)
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;
    use nalgebra::Vector3;

    use super::super::tests::*;
    use super::super::*;

    /// The controller steers a vehicle that swings by `amplitude_m` before an obstacle, its reference at `to_m`.
    fn swings(k: u32, amplitude_m: f64, to_m: f64) -> Evidence {
        let x_m = amplitude_m * f64::from(k % 10) / 10.0;
        let pose = Pose::new(x_m, 0.0, 1.0, 0.0);
        let motion = Some(EstimatedMotion { pose, rate: Pose::zeros() });
        let reference_behind_w = Some(Vector3::new(to_m, 0.0, 1.0));
        with_obstacles(Evidence { motion, speed_mps: 0.1, ..ALOFT }, |it| {
            it.reference_behind_w = reference_behind_w;
        })
    }

    /// Ticks of 0.1 s until `of` ends the flight; `None` in 10 s.
    fn ends_at(of: impl Fn(u32) -> Evidence) -> Option<u32> {
        let mut fixture = Fixture::flying();
        (0..100).find(|k| faults(fixture.tick(&of(*k))).contains(&Fault::BlockedLong))
    }

    #[test]
    fn a_vehicle_that_does_not_get_past_an_obstacle_lands() {
        let stuck = |k| swings(k, 0.4, 1.0);
        let at = ends_at(stuck).unwrap();
        assert!((30..=32).contains(&at), "{at}");
        let seldom_free = |k| {
            let is_free = k % 7 > 3;
            let reference_behind_w = stuck(k).obstacles.reference_behind_w.filter(|_| !is_free);
            with_obstacles(stuck(k), |it| it.reference_behind_w = reference_behind_w)
        };
        assert!(ends_at(seldom_free).is_some());
    }

    #[test]
    fn a_vehicle_that_moves_on_or_waits_for_another_reason_is_not_stuck() {
        let stuck = |k| swings(k, 0.4, 1.0);
        let outage =
            Outage { for_s: 0.1, is_held: false, if_applied: [stuck(0).motion.unwrap(); 2] };
        assert_eq!(ends_at(|k| swings(k, 1.0, 2.0)), None, "it moves");
        assert_eq!(
            ends_at(|k| swings(k, 0.4, 1.0 + 0.02 * f64::from(k))),
            None,
            "the reference moves"
        );
        assert_eq!(
            ends_at(|k| Evidence { hand: HandInput::Steering, ..stuck(k) }),
            None,
            "a person steers"
        );
        assert_eq!(ends_at(|k| with_obstacles(stuck(k), |it| it.is_unseen = true)), None);
        assert_eq!(ends_at(|k| Evidence { outage: Some(outage), ..stuck(k) }), None, "an outage");
        assert_eq!(ends_at(|k| Evidence { motion: None, ..stuck(k) }), None);
        // Held for a second in every two, in which nothing is steered.
        let is_stale = |k: u32| k % 20 > 9;
        let pose_age_s = |k| Some(if is_stale(k) { 0.7 } else { 0.01 });
        assert_eq!(ends_at(|k| Evidence { pose_age_s: pose_age_s(k), ..stuck(k) }), None, "a hold");
        let often_free = |k| {
            let is_free = k % 10 > 4;
            let reference_behind_w = stuck(k).obstacles.reference_behind_w.filter(|_| !is_free);
            with_obstacles(stuck(k), |it| it.reference_behind_w = reference_behind_w)
        };
        assert_eq!(ends_at(often_free), None, "the path is free again");
    }

    #[test]
    fn plans_that_are_blocked_again_and_again_end_the_flight() {
        let blocked = Evidence { plan: PlanClearance::Blocked, ..ALOFT };
        let clear = Evidence { plan: PlanClearance::Clear, ..ALOFT };
        let mut fixture = Fixture::flying();
        for _ in 0..4 {
            // Known a tick later, blocked for 0.8 s in sum, then clear for a second: 0.6 s remain of each.
            fixture.pass(5, &blocked);
            assert!(fixture.run(14, &clear).may_steer());
        }
        let decision = fixture.run(9, &blocked);
        assert!(faults(decision).contains(&Fault::BlockedLong), "{decision:?}");
        assert_eq!(fixture.run(20, &clear).phase, Phase::Landing);
        let mut seldom = Fixture::flying();
        for _ in 0..20 {
            seldom.pass(5, &blocked);
            assert!(seldom.run(60, &clear).may_steer(), "a fifth of the time is subtracted");
        }
    }
}
