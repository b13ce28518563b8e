//! To which state of the estimator a pose belongs.
//!
//! Owns what the age of a pose means: a pose that was measured periods ago observes the state of that time, and what is
//! left of its age, less than a period, is corrected at the estimated rate of that time.

use horizon_estim::Observed;
use horizon_model::rows::{Pose, PoseRate, pose};

use super::{Cycle, JUST_ENDED, Vehicle};
use crate::time::TimeNs;

/// Rows that are measured together.
const GROUPS: [&[usize]; 2] = [&[pose::X, pose::Y, pose::Z], &[pose::THETA]];

/// What a tick has seen.
pub(super) struct TickObservations {
    /// The rows of the state at the tick.
    pub(super) newest: Observed<{ pose::COUNT }>,
    /// All new rows as they would be at the tick: the earlier ones moved on with the estimate.
    pub(super) at_tick: Observed<{ pose::COUNT }>,
}

/// The age of a pose, in the states of the estimator.
struct Age {
    /// Whole periods; 0 is the state that the tick is about to estimate.
    back: usize,
    /// The rest: less than a period, where the window is long enough. s
    rest_s: f64,
}

impl Age {
    /// `age_s` >= 0 in periods `dt_s`, beside a window of `states` >= 1.
    fn of(age_s: f64, dt_s: f64, states: usize) -> Self {
        // The oldest state of the window is about to leave it.
        let back_max = (states - 1).max(1);
        let back = horizon_model::whole(age_s / dt_s).min(back_max);
        Self { back, rest_s: (age_s - back as f64 * dt_s).min(dt_s) }
    }
}

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// Hands the rows that were measured a period ago or earlier to their own states in the window.
    ///
    /// A pose is not moved to the tick by the estimate that it makes: that is a feedback, from which the velocity
    /// oscillates where poses are three periods old. Within a period the pose is interpolated between two states,
    /// `o(t_j) = o(t) + (t_j - t) (g(s_j) - g(s_j-1)) / dt`. What is left of the error of the measurement time is its
    /// product with the velocity: 1 mm at 1 m/s and 1 ms.
    pub(super) fn assign_to_states(
        &mut self,
        observed: Observed<{ pose::COUNT }>,
        now: TimeNs,
        is_new: [bool; 2],
    ) -> TickObservations {
        let mut seen = TickObservations { newest: observed, at_tick: observed };
        if !self.uses_measurement_time || !self.mhe.is_started() || !is_new.contains(&true) {
            return seen;
        }
        let rate_at_tick = self.rate_at_tick();
        let measured_at = [self.memory.position_at, self.memory.heading_at];
        for ((rows, at), is_new) in GROUPS.into_iter().zip(measured_at).zip(is_new) {
            let Some(at) = at.filter(|_| is_new) else { continue };
            let age = Age::of(now.since(at).seconds().max(0.0), self.dt_s, self.mhe.window().len());
            let (rate_then, moved_since) = if age.back == 0 {
                (rate_at_tick, Pose::zeros())
            } else {
                let moved_since = self.moved_since(age.back) + rate_at_tick * self.dt_s;
                (self.rate_before(age.back), moved_since)
            };
            // As measured at the state of `age.back` periods ago, and as it would be at the tick.
            let o = observed.o + rate_then * age.rest_s;
            let at_tick = o + moved_since;
            for row in rows {
                seen.newest.o[*row] = o[*row];
                seen.newest.is_present[*row] &= age.back == 0;
                seen.at_tick.o[*row] = at_tick[*row];
            }
            // The newest state of the window is that of a period ago.
            if let Some(window_age) = age.back.checked_sub(1) {
                let mut earlier = Observed { o, is_present: [false; pose::COUNT] };
                for row in rows {
                    earlier.is_present[*row] = true;
                }
                let added = self.mhe.observe_earlier(window_age, &earlier);
                debug_assert!(added.is_ok(), "filtered poses are finite: {added:?}");
            }
        }
        seen
    }

    /// Mean rate in the period that ends with the tick, by the model. Rows of the pose per second
    fn rate_at_tick(&self) -> PoseRate {
        let u_applied = self.outage_input().unwrap_or_else(|| self.fifo.applied(JUST_ENDED));
        self.rate_of(self.mhe.s_hat(), &u_applied)
    }

    /// Mean rate in the period before the state `back` >= 1 periods ago; zero before the first. Rows of the pose per
    /// second
    fn rate_before(&self, back: usize) -> PoseRate {
        let window = self.mhe.window();
        let state = window.len() - back;
        let [s, s_before] = [state, state.saturating_sub(1)].map(|k| &window[k]);
        (self.model.observe(s) - self.model.observe(s_before)) / self.dt_s
    }

    /// How far the estimate moved from `back` >= 1 periods ago to the newest one.
    fn moved_since(&self, back: usize) -> Pose {
        let window = self.mhe.window();
        self.model.observe(self.mhe.s_hat()) - self.model.observe(&window[window.len() - back])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cycle::build;
    use crate::cycle::sense::tests::{fly_by, table};

    #[test]
    fn an_age_is_whole_periods_and_a_rest_within_the_window() {
        // Periods that sum without rounding. s
        const DT_S: f64 = 0.25;
        for (age_s, states, back, rest_s) in [
            (0.0, 6, 0, 0.0),
            (0.125, 6, 0, 0.125),
            (0.25_f64.next_down(), 6, 0, 0.25_f64.next_down()),
            (0.25, 6, 1, 0.0),
            (0.625, 6, 2, 0.125),
            // The oldest of six states; what is older is at most a period older.
            (1.25, 6, 5, 0.0),
            (1.375, 6, 5, 0.125),
            (9.0, 6, 5, DT_S),
            // The first states: one period back there is the one that the estimate starts from.
            (0.625, 2, 1, DT_S),
            (0.375, 1, 1, 0.125),
        ] {
            let age = Age::of(age_s, DT_S, states);
            assert_eq!((age.back, age.rest_s), (back, rest_s), "{age_s} s of {states} states");
        }
    }

    #[test]
    fn poses_that_are_periods_old_do_not_hold_the_estimate_back() {
        // At 0.5 m/s, in a tick of 20 ms: an observation of the tick would be 22 mm and 30 mm behind.
        for age_ns in [45_000_000, 59_000_000] {
            let ages_ns = [age_ns];
            let ages_ns: Vec<&[i64]> = vec![&ages_ns; 150];
            let error_m = |uses_measurement_time| {
                let mut table = table();
                table.cycle.uses_measurement_time = uses_measurement_time;
                let outcomes = fly_by(build(&table).unwrap(), &ages_ns);
                outcomes[149].s_hat[pose::X] - (-2.0 + 0.5 * 0.02 * 149.0)
            };
            let [with_m, without_m] = [true, false].map(error_m);
            // The sticks of the cycle do not move this vehicle, so the estimated velocity is not exact.
            let is_held_back = without_m < -0.02;
            assert!(is_held_back && with_m.abs() < 0.2 * without_m.abs(), "{with_m} {without_m}");
        }
    }
}
