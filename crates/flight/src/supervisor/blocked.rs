//! Plans that lead outside of the room or into an obstacle, and for how long: the leaky sum b of `docs/model.md`,
//! section 6.

use super::evidence::Evidence;
use super::since::{elapsed_s, exceeds};
use super::{BRAKE_S, Supervisor};

/// How long plans may be blocked in sum, a fifth of the time without a blocked one subtracted. s
const BLOCKED_MAX_S: f64 = 3.0;

/// Part of the time without a blocked plan that is taken off the time of blocked ones.
const BLOCKED_FORGIVEN: f64 = 0.2;

impl Supervisor {
    /// Updates when and for how long plans were blocked.
    pub(super) fn remember_blocked(&mut self, e: &Evidence) {
        if self.was_steering && e.is_plan_clear == Some(false) {
            self.blocked_ns = Some(e.t_ns);
        }
        let period_s =
            self.remembered_ns.replace(e.t_ns).map_or(0.0, |t_ns| elapsed_s(t_ns, e.t_ns));
        self.blocked_s = if self.is_blocked(e) {
            self.blocked_s + period_s
        } else {
            (self.blocked_s - BLOCKED_FORGIVEN * period_s).max(0.0)
        };
    }

    /// Whether a plan that was flown just now leads out of the room or into an obstacle.
    pub(super) fn is_blocked(&self, e: &Evidence) -> bool {
        self.is_steered() && self.blocked_ns.is_some_and(|at_ns| elapsed_s(at_ns, e.t_ns) < BRAKE_S)
    }

    /// Whether plans were blocked for too long in sum.
    pub(super) fn is_blocked_long(&self) -> bool {
        exceeds(self.blocked_s, BLOCKED_MAX_S)
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::*;
    use super::super::*;

    #[test]
    fn plans_that_are_blocked_again_and_again_end_the_flight() {
        let blocked = Evidence { is_plan_clear: Some(false), ..ALOFT };
        let clear = Evidence { is_plan_clear: Some(true), ..ALOFT };
        let mut bench = Bench::flying();
        for _ in 0..4 {
            // Known a tick later, blocked for 0.8 s in sum, then clear for a second: 0.6 s remain of each.
            bench.pass(5, &blocked);
            assert!(bench.run(14, &clear).may_steer());
        }
        let ruling = bench.run(9, &blocked);
        assert!(faults(ruling).contains(&Fault::BlockedLong), "{ruling:?}");
        assert_eq!(bench.run(20, &clear).phase, Phase::Landing);
        let mut seldom = Bench::flying();
        for _ in 0..20 {
            seldom.pass(5, &blocked);
            assert!(seldom.run(60, &clear).may_steer(), "a fifth of the time is forgiven");
        }
    }
}
