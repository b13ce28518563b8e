//! Periods in which the loop did not run.
//!
//! Owns which sticks the sender sent in the meantime. Whether missed periods end the flight is decided by the
//! supervisor.

use horizon_estim::Observed;
use horizon_model::rows::Sticks;

use super::{Cycle, Inbox, JUST_ENDED_AFTER_PUSH, Vehicle, Watch};
use crate::drone::CONTROL_SILENCE_NEUTRAL;

/// Largest number of missed periods that are caught up, 4 s: the sender lands the drone after 1 s of silence.
const SKIPPED_MAX: u64 = 200;

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// Catches up after missed periods: the sender repeated the last commands, then sent neutral ones.
    pub(super) fn catch_up(&mut self, inbox: &Inbox, watch: &mut dyn Watch) {
        for missed in 1..=inbox.skipped.min(SKIPPED_MAX) {
            self.plausibility.begin_tick();
            self.filter.update(None);
            let is_repeated = missed as f64 * self.dt_s < CONTROL_SILENCE_NEUTRAL.seconds();
            self.fifo.push(&if is_repeated { *self.fifo.newest() } else { Sticks::zeros() });
            self.monitor_missed(self.fifo.applied(JUST_ENDED_AFTER_PUSH));
            self.planner.age_plan();
            self.planner.follow_obstacle(None, None);
            if self.mhe.is_started() {
                let missing = Observed::missing();
                let (u_applied, _) = self.follow_link(JUST_ENDED_AFTER_PUSH, &missing);
                let solved = self.mhe.update(&u_applied, &missing, &mut || watch.is_late());
                self.memory.has_estimator_failed = solved.is_err();
                if self.memory.is_on_mission {
                    self.progress.count_flown(self.dt_s);
                    self.advance_mission();
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::Lagged;
    use horizon_model::rows::{lag, motion, stick};

    use super::*;
    use crate::cycle::Unwatched;
    use crate::cycle::build;
    use crate::cycle::sense::tests::table;

    type LaggedCycle = Cycle<Lagged, { motion::COUNT }, { lag::COUNT }, { motion::CONTROLLABLE }>;

    /// Whether the sticks of before act `back` periods before the coming one on an axis without dead time, after a
    /// pause of `skipped` periods; else neutral ones do.
    fn acts(skipped: u64, back: isize) -> bool {
        let mut table = table();
        table.cycle.dead_time_s = vec![0.0; stick::COUNT];
        let mut cycle: LaggedCycle = build::cycle(Lagged::default(), &table).unwrap();
        (0..20).for_each(|_| cycle.fifo.push(&Sticks::repeat(0.5)));
        let inbox = Inbox { skipped, ..Inbox::new() };
        cycle.catch_up(&inbox, &mut Unwatched::default());
        let u = cycle.fifo.applied(-back)[stick::PITCH];
        assert!(u.abs() < 1e-12 || (u - 0.5).abs() < 1e-12, "{u}");
        u > 0.0
    }

    #[test]
    fn the_last_sticks_were_repeated_for_less_than_the_time_after_which_the_sender_is_neutral() {
        // 0.1 s are five periods.
        assert_eq!([0, 1, 4].map(|skipped| acts(skipped, 1)), [true; 3]);
        assert_eq!([5, 6, 30].map(|skipped| acts(skipped, 1)), [false; 3]);
        assert_eq!([1, 2, 3].map(|back| acts(6, back)), [false, false, true]);
    }

    #[test]
    fn a_pause_of_any_length_is_caught_up_in_a_bounded_time() {
        assert!(!acts(u64::MAX, 1));
    }
}
