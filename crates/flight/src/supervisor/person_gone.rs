//! A person who holds the sticks and leaves them neutral: nobody steers.

use super::Supervisor;
use super::evidence::{Evidence, HandInput};

/// How long the sticks in a person's hand may be neutral while the vehicle is outside of the room or too fast. s
const GONE_IN_DANGER_S: f64 = 5.0;

impl Supervisor {
    /// Updates for how long a person leaves the sticks neutral: in all, and while the vehicle is outside of the room or
    /// too fast.
    pub(super) fn update_idle_hand_timers(&mut self, e: &Evidence, is_fast: bool) {
        let is_idle = self.is_flying() && e.hand == HandInput::Neutral;
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
    fn neutral_sticks_of_a_person_land_after_their_time_and_outside_of_the_room_after_5_s() {
        let idle = Evidence { hand: HandInput::Neutral, ..ALOFT };
        let steered = Evidence { hand: HandInput::Steering, ..idle };
        let outside = Evidence { pose: Some([5.0, 0.0, 1.0, 0.0].into()), ..idle };
        let fast = Evidence { speed_mps: 3.1, ..idle };
        for (e, other, ticks) in [
            (idle, None, 600),
            (outside, Some(Fault::FenceLeft), 50),
            (fast, Some(Fault::TooFast), 50),
        ] {
            let mut fixture = Fixture::flying();
            assert!(fixture.run(ticks, &e).may_steer(), "{ticks} ticks of 0.1 s: {e:?}");
            assert!(fixture.tick(&steered).may_steer());
            assert!(fixture.run(ticks, &e).may_steer(), "a stick begins the time anew");
            let decision = fixture.tick(&e);
            let expected = other.into_iter().chain([Fault::PersonGone]).collect::<Vec<_>>();
            assert_eq!((decision.phase, faults(decision)), (Phase::Landing, expected));
        }
        for away in [outside, fast] {
            let mut fixture = Fixture::flying();
            assert!(fixture.run(300, &idle).may_steer(), "a rest of 30 s inside");
            assert!(fixture.run(50, &away).may_steer(), "does not count outside, or too fast");
            assert!(fixture.run(1, &idle).may_steer(), "back inside the time ends");
            assert!(fixture.run(50, &away).may_steer());
            assert_eq!(fixture.tick(&away).phase, Phase::Landing);
        }
        let unseen = Evidence { pose: None, pose_age_s: Some(10.0), ..idle };
        let mut fixture = Fixture::flying();
        assert!(fixture.run(20, &outside).may_steer() && fixture.run(30, &unseen).may_steer());
        assert_eq!(
            fixture.tick(&outside).phase,
            Phase::Landing,
            "without a pose it counts as outside"
        );
        assert!(Fixture::flying().run(100, &unseen).may_steer(), "never seen outside");
        let by_controller = Evidence { hand: HandInput::Absent, ..idle };
        assert_eq!(faults(Fixture::flying().run(700, &by_controller)), []);
        let mut never = Fixture::flying();
        never.supervisor.table.failsafe.person_gone_s = None;
        assert!(never.run(3000, &outside).may_steer(), "without the key, as in older logs");
    }
}
