//! Braking while no poses arrive.
//!
//! Owns when a vehicle that is not seen stops near walls and obstacles. Once the newest pose is too old the gate makes the sticks
//! neutral, and the vehicle coasts. So the plan brakes before, if coasting would lead nearer to something than the margin.

use horizon_model::Model;
use horizon_model::rows::{Pose, Sticks, pose, stick};

use super::{Known, Planner};

/// How long a coasting vehicle is followed: two lags. s
const COAST_S: f64 = 1.3;

/// Where a vehicle that brakes shall be at rest: as far as its present rate leads in this time. s
const REST_AHEAD_S: f64 = 0.3;

impl<M, const NS: usize, const NP: usize, const NR: usize> Planner<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// Whether the plan that begins at `s_0` must lead to rest.
    pub(super) fn must_brake(&self, known: &Known<'_, NS, NP>) -> bool {
        let Some(walls) = &self.walls else { return false };
        if !walls.is_blind(known.position_age_s) {
            return false;
        }
        let first_ahead = known.fifo.known_steps().cast_signed();
        let mut s = self.s_0;
        let mut is_near_after = |u: &Sticks| {
            s = self.model.step(&s, u, known.p_hat, self.dt_s);
            walls.is_near(&self.model.observe(&s))
        };
        let given = (first_ahead..).take(self.u_given.len()).map(|ahead| known.applied(ahead));
        let coast = std::iter::repeat_n(Sticks::zeros(), (COAST_S / self.dt_s) as usize);
        given.chain(coast).any(|u| is_near_after(&u))
    }

    /// Fills the references with a place of rest ahead of `s_0`.
    pub(super) fn refer_to_rest(&mut self, known: &Known<'_, NS, NP>) {
        let s_next = self.model.step(&self.s_0, &Sticks::zeros(), known.p_hat, self.dt_s);
        let from = self.model.observe(&self.s_0);
        let rate = (self.model.observe(&s_next) - from) / self.dt_s;
        let rest = from + rate * REST_AHEAD_S;
        self.s_ref.fill(self.model.moving(&rest, &Pose::zeros(), &self.s_0));
    }

    /// Whether the newest plan braked, and poses arrive again.
    pub(in crate::cycle) fn sees_again(&self, position_age_s: Option<f64>) -> bool {
        self.brakes && self.walls.as_ref().is_some_and(|walls| !walls.is_blind(position_age_s))
    }
}
