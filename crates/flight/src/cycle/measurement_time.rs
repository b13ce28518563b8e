//! To which state of the estimator a pose belongs.
//!
//! Owns what the age of a pose means: a pose that was measured periods ago observes the state of that time, and what is
//! left of its age, less than a period, is corrected at the estimated rate of that time.

use horizon_estim::Observed;
use horizon_model::Model;
use horizon_model::rows::{Pose, pose, stick};

use super::{Cycle, JUST_ENDED};
use crate::time::TimeNs;

/// Rows that are measured together.
const GROUPS: [&[usize]; 2] = [&[pose::X, pose::Y, pose::Z], &[pose::THETA]];

/// What a tick has seen.
pub(super) struct Seen {
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

impl<M, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// Hands the rows that were measured a period ago or earlier to their own states in the window.
    ///
    /// A pose is not moved to the tick by the estimate that it makes: that is a feedback, from which the velocity oscillates
    /// where poses are three periods old. Within a period the pose is interpolated between two states,
    /// `o(t_j) = o(t) + (t_j - t) (g(s_j) - g(s_j-1)) / dt`. What is left of the error of the measurement time is its product
    /// with the velocity: 1 mm at 1 m/s and 1 ms.
    pub(super) fn place(
        &mut self,
        observed: Observed<{ pose::COUNT }>,
        now: TimeNs,
        is_new: [bool; 2],
    ) -> Seen {
        let mut seen = Seen { newest: observed, at_tick: observed };
        if !self.uses_measurement_time || !self.mhe.is_started() || !is_new.contains(&true) {
            return seen;
        }
        let rate_at_tick = self.rate_at_tick();
        let measured_at = [self.memory.position_at, self.memory.heading_at];
        for ((rows, at), is_new) in GROUPS.into_iter().zip(measured_at).zip(is_new) {
            let Some(at) = at.filter(|_| is_new) else { continue };
            let age = self.age(now.since(at).seconds().max(0.0));
            let (rate, moved) = if age.back == 0 {
                (rate_at_tick, Pose::zeros())
            } else {
                let moved = self.moved_since(age.back) + rate_at_tick * self.dt_s;
                (self.rate_before(age.back), moved)
            };
            let o = observed.o + rate * age.rest_s;
            let at_tick = o + moved;
            for row in rows {
                seen.newest.o[*row] = o[*row];
                seen.newest.is_present[*row] &= age.back == 0;
                seen.at_tick.o[*row] = at_tick[*row];
            }
            if age.back > 0 {
                let mut earlier = Observed { o, is_present: [false; pose::COUNT] };
                for row in rows {
                    earlier.is_present[*row] = true;
                }
                let added = self.mhe.observe_earlier(age.back - 1, &earlier);
                debug_assert!(added.is_ok(), "filtered poses are finite: {added:?}");
            }
        }
        seen
    }

    fn age(&self, age_s: f64) -> Age {
        // The oldest state of the window is about to leave it.
        let back_max = (self.mhe.window().len() - 1).max(1);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a late pose is none"
        )]
        let back = ((age_s / self.dt_s) as usize).min(back_max);
        Age { back, rest_s: (age_s - back as f64 * self.dt_s).min(self.dt_s) }
    }

    /// Mean rate in the period that ends with the tick, by the model. Rows of the pose per second
    fn rate_at_tick(&self) -> Pose {
        let u_applied = self.link_instead().unwrap_or_else(|| self.fifo.applied(JUST_ENDED));
        self.rate_of(self.mhe.s_hat(), &u_applied)
    }

    /// Mean rate in the period before the state `back` >= 1 periods ago; zero before the first. Rows of the pose per second
    fn rate_before(&self, back: usize) -> Pose {
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
