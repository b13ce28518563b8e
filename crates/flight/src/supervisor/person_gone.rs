//! A person who holds the sticks and leaves them neutral: nobody steers.

use super::Supervisor;
use super::evidence::Evidence;

/// How long the sticks in a person's hand may be neutral while the vehicle is outside of the room or too fast. s
const GONE_IN_DANGER_S: f64 = 5.0;

impl Supervisor {
    /// Updates for how long a person leaves the sticks neutral: in all, and while the vehicle is outside of the room or
    /// too fast.
    pub(super) fn remember_idle_hand(&mut self, e: &Evidence, is_fast: bool) {
        let is_idle = self.is_flying() && e.is_hand_neutral;
        self.timers.hand_neutral.update(is_idle, e.t_ns);
        // Outside of the room poses are rare: without a fresh pose the danger lasts.
        let was_in_danger = self.timers.hand_neutral_in_danger.holds();
        let is_in_danger =
            self.is_outside(e) || is_fast || (was_in_danger && self.is_pose_stale(e));
        self.timers.hand_neutral_in_danger.update(is_idle && is_in_danger, e.t_ns);
    }

    /// Whether a person has left the sticks neutral for too long, which is less time in danger.
    pub(super) fn is_person_gone(&self, e: &Evidence) -> bool {
        self.table.failsafe.person_gone_s.is_some_and(|gone_s| {
            self.timers.hand_neutral.has_lasted(e.t_ns, gone_s)
                || self.timers.hand_neutral_in_danger.has_lasted(e.t_ns, GONE_IN_DANGER_S)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::*;
    use super::super::*;

    #[test]
    fn sticks_that_a_person_leaves_neutral_land_after_their_time_and_outside_of_the_room_after_5_s()
    {
        let idle = Evidence { is_by_hand: true, is_hand_neutral: true, ..ALOFT };
        let steered = Evidence { is_hand_neutral: false, ..idle };
        let outside = Evidence { pose: Some([5.0, 0.0, 1.0, 0.0].into()), ..idle };
        let fast = Evidence { speed_mps: 3.1, ..idle };
        for (e, other, ticks) in [
            (idle, None, 600),
            (outside, Some(Fault::FenceLeft), 50),
            (fast, Some(Fault::TooFast), 50),
        ] {
            let mut bench = Bench::flying();
            assert!(bench.run(ticks, &e).may_steer(), "{ticks} ticks of 0.1 s: {e:?}");
            assert!(bench.tick(&steered).may_steer());
            assert!(bench.run(ticks, &e).may_steer(), "a stick begins the time anew");
            let decision = bench.tick(&e);
            let expected = other.into_iter().chain([Fault::PersonGone]).collect::<Vec<_>>();
            assert_eq!((decision.phase, faults(decision)), (Phase::Landing, expected));
        }
        for away in [outside, fast] {
            let mut bench = Bench::flying();
            assert!(bench.run(300, &idle).may_steer(), "a rest of 30 s inside");
            assert!(bench.run(50, &away).may_steer(), "does not count outside, or too fast");
            assert!(bench.run(1, &idle).may_steer(), "back inside the time ends");
            assert!(bench.run(50, &away).may_steer());
            assert_eq!(bench.tick(&away).phase, Phase::Landing);
        }
        let unseen = Evidence { pose: None, pose_age_s: Some(10.0), ..idle };
        let mut bench = Bench::flying();
        assert!(bench.run(20, &outside).may_steer() && bench.run(30, &unseen).may_steer());
        assert_eq!(
            bench.tick(&outside).phase,
            Phase::Landing,
            "without a pose it counts as outside"
        );
        assert!(Bench::flying().run(100, &unseen).may_steer(), "never seen outside");
        let by_controller = Evidence { is_by_hand: false, is_hand_neutral: false, ..idle };
        assert_eq!(faults(Bench::flying().run(700, &by_controller)), []);
        let mut never = Bench::flying();
        never.supervisor.table.failsafe.person_gone_s = None;
        assert!(never.run(3000, &outside).may_steer(), "without the key, as in older logs");
    }
}
