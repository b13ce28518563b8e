//! Descent of all dead times to the minima of their profiles, and the restart of a search from the prior.
//!
//! With a wrong dead time the minimum of the cost may lie at a parameter far from the truth. A solve that begins there
//! with the right dead time may stay in a local minimum there. A solve from the prior does not.

use horizon_model::Model;

use super::profile::{LocalMinimum, integrate};
use super::search::{
    COST_TOLERANCE_SCAN, COST_TOLERANCE_SOLVE, GroupProfile, SCAN_END_FACTOR, Search, SearchStop,
};

/// Outcome of a descent from some dead times.
pub(super) struct Descent {
    pub(super) profiles: Vec<GroupProfile>,
    /// Least cost at the dead times where the descent began, and where it ended. 1
    start_cost: f64,
    /// 1
    pub(super) cost: f64,
}

impl Descent {
    /// Whether the descent ended higher than it began: solves at other dead times ended in local minima.
    pub(super) fn has_diverged(&self) -> bool {
        self.cost > self.start_cost * (1.0 + COST_TOLERANCE_SOLVE)
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Moves each group to the minimum of its profile, from the present dead times, which are solved with the cost
    /// `start_cost`.
    pub(super) fn descend(&mut self, start_cost: f64) -> Result<Descent, SearchStop> {
        let start_s = *self.dead_time_s;
        let start = self.ident.clone();
        let rise_max = SCAN_END_FACTOR * self.significant_rise(start_cost);
        let (mut profiles, mut minima) = (Vec::new(), Vec::new());
        for points in self.scan(&start, rise_max)? {
            let (at_s, gradients): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
            let (profile, minimum) = integrate(&at_s, &gradients);
            profiles.push(profile.above_lowest());
            minima.push(minimum);
        }
        self.ident.restart_at(&start);
        let cost = self.refine(&mut minima)?;
        let refined = profiles.into_iter().zip(&minima);
        let profiles = refined
            .map(|(curve, LocalMinimum { at_s, .. })| GroupProfile { curve, at_s: *at_s })
            .collect();
        let descent = Descent { profiles, start_cost, cost };
        if !descent.has_diverged() {
            return Ok(descent);
        }
        // The groups depend on each other: one after the other, from the start on.
        *self.dead_time_s = start_s;
        self.ident.restart_at(&start);
        let profiles = self.coordinate_descent(&self.settings.grid().collect::<Vec<_>>())?;
        Ok(Descent { profiles, start_cost, cost: self.solve()? })
    }

    /// Moves to the dead time, the same for all groups, with the least cost of a solve from the prior, if that cost is
    /// less than `cost`; else nothing moves. Returns whether it moved.
    ///
    /// Cost: a solve from the prior per dead time of the grid.
    pub(super) fn start_from_prior(&mut self, cost: f64) -> Result<bool, SearchStop> {
        let (found_s, found) = (*self.dead_time_s, self.ident.clone());
        let (mut least, mut best_s) = (cost * (1.0 - COST_TOLERANCE_SOLVE), None);
        for at_s in self.settings.grid().collect::<Vec<_>>() {
            self.restart_all_at(at_s);
            match self.solve_to(|of_settings| of_settings.max(COST_TOLERANCE_SCAN)) {
                Ok(cost) if cost < least => (least, best_s) = (cost, Some(at_s)),
                // A failure at one dead time is no failure of the others.
                Ok(_) | Err(SearchStop::Error(_)) => {}
                Err(SearchStop::Late) => return Err(SearchStop::Late),
            }
        }
        if let Some(at_s) = best_s {
            self.restart_all_at(at_s);
        } else {
            *self.dead_time_s = found_s;
            self.ident.restart_at(&found);
        }
        Ok(best_s.is_some())
    }

    /// Sets one dead time for all groups, and the iterate to its start from the prior.
    fn restart_all_at(&mut self, at_s: f64) {
        (0..self.groups.len()).for_each(|group| self.set_dead_time(group, at_s));
        self.ident.start();
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;
    use horizon_model::rows::Sticks;

    use super::super::tests::{flights, settings, with_search};
    use super::*;

    #[test]
    fn a_descent_that_ends_higher_than_the_solves_are_exact_has_diverged() {
        let has_diverged =
            |cost| Descent { profiles: Vec::new(), start_cost: 2.0, cost }.has_diverged();
        assert_eq!(
            [1.0, 2.0, 2.0 + 1.9e-7, 2.0 + 2.1e-7].map(has_diverged),
            [false, false, false, true]
        );
    }

    #[test]
    fn a_start_from_the_prior_moves_to_a_dead_time_that_costs_less_and_else_nowhere() {
        let recordings = flights(Sticks::repeat(0.3), 0.015, 0.0, 1);
        for (start_s, moves) in [(0.3, false), (0.5, true)] {
            with_search(&recordings, 50, Sticks::repeat(start_s), &settings(), |search| {
                let cost = search.solve().ok().unwrap();
                let p = *search.ident.parameter();
                assert_eq!(search.start_from_prior(cost).ok().unwrap(), moves, "{start_s} s");
                // The fifth candidate behind 0.
                let gap_s = amax(&(*search.dead_time_s - Sticks::repeat(0.3)));
                assert!(gap_s < 1e-12, "{}", search.dead_time_s);
                // From the prior on, or where the search was.
                assert_eq!(*search.ident.parameter() == p, !moves, "{start_s} s");
            });
        }
    }
}
