//! From some dead times to the minimum of the profile of each group, and where a search begins again.
//!
//! With a wrong dead time the least cost may lie at a parameter far off, and a solve that begins there stays there with
//! the right one, too. From the prior it does not.

use horizon_model::Model;

use super::search::{EXACT, FAR, Found, Halt, ROUGH, Search, integrate};

/// What a descent from some dead times found.
pub(super) struct Descent {
    pub(super) found: Vec<Found>,
    /// Least cost where it began, and where it ended. 1
    start_cost: f64,
    pub(super) cost: f64,
}

impl Descent {
    /// Whether it ended higher than it began: the solves of its candidates were led astray.
    pub(super) fn is_vain(&self) -> bool {
        self.cost > self.start_cost * (1.0 + EXACT)
    }
}

impl<M, const NS: usize, const NU: usize, const NO: usize, const NP: usize>
    Search<'_, M, NS, NU, NO, NP>
where
    M: Model<NS, NU, NO, NP> + Sync,
{
    /// Each group led to the minimum of its profile, from the present dead times and the iterate on.
    pub(super) fn descend(&mut self) -> Result<Descent, Halt> {
        let start_s = *self.dead_time_s;
        let start_cost = self.solve()?;
        let start = self.ident.clone();
        let scanned = self.scan(&start, FAR * self.chance(start_cost))?;
        let (curves, mut minima): (Vec<_>, Vec<_>) = scanned
            .into_iter()
            .map(|points| {
                let (at_s, gradients): (Vec<f64>, Vec<f64>) = points.into_iter().unzip();
                integrate(&at_s, &gradients)
            })
            .unzip();
        self.ident.restart_at(&start);
        let cost = self.refine(&mut minima)?;
        let found = curves
            .into_iter()
            .zip(&minima)
            .map(|(curve, minimum)| Found { curve, at_s: minimum.at_s })
            .collect();
        let descent = Descent { found, start_cost, cost };
        if !descent.is_vain() {
            return Ok(descent);
        }
        // The groups depend on each other: one after the other, from the start on.
        *self.dead_time_s = start_s;
        self.ident.restart_at(&start);
        let found = self.coordinate_descent(&self.settings.grid().collect::<Vec<_>>())?;
        Ok(Descent { found, start_cost, cost: self.solve()? })
    }

    /// Moves to the dead time, the same for all groups, that costs least when solved from the prior, if that is less
    /// than `cost`; else all stays. Returns whether it moved.
    ///
    /// Cost: a solve from the prior per dead time of the grid.
    pub(super) fn start_from_prior(&mut self, cost: f64) -> Result<bool, Halt> {
        let (found_s, found) = (*self.dead_time_s, self.ident.clone());
        let (mut least, mut best_s) = (cost * (1.0 - EXACT), None);
        for at_s in self.settings.grid().collect::<Vec<_>>() {
            self.put_all(at_s);
            match self.solve_to(|of_settings| of_settings.max(ROUGH)) {
                Ok(cost) if cost < least => (least, best_s) = (cost, Some(at_s)),
                // A solve that fails here says nothing of the others.
                Ok(_) | Err(Halt::Error(_)) => {}
                Err(Halt::Late) => return Err(Halt::Late),
            }
        }
        if let Some(at_s) = best_s {
            self.put_all(at_s);
        } else {
            *self.dead_time_s = found_s;
            self.ident.restart_at(&found);
        }
        Ok(best_s.is_some())
    }

    /// Gives all groups one dead time, and the iterate its start from the prior.
    fn put_all(&mut self, at_s: f64) {
        (0..self.groups.len()).for_each(|group| self.put(group, at_s));
        self.ident.start();
    }
}
