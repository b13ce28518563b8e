//! What the builders of settings have in common: defaults that follow from the rows of a model.

use horizon_model::{Domain, Row};

use crate::levenberg::LmTable;

impl Default for LmTable {
    /// A trusted start, and the minimum to 1e-9 of cost and iterate within 100 steps.
    fn default() -> Self {
        Self {
            damping_start: 1e-6,
            cost_tolerance: 1e-9,
            step_tolerance: 1e-9,
            iterations_max: 100,
        }
    }
}

/// What estimator and identification are given alike: a method for each setting, and the check of all.
macro_rules! fit_setters {
    ($settings:ty) => {
        /// Weight of each observation residual. 1 / unit of the row, 0 or 1e-6..=1e6
        #[must_use]
        pub fn c_o(mut self, c_o: [f64; NO]) -> Self {
            self.table.c_o = c_o.into();
            self
        }

        /// Weight of each transition residual, which is divided by the period. s / unit of the row, 1e-6..=1e6
        #[must_use]
        pub fn c_s(mut self, c_s: [f64; NS]) -> Self {
            self.table.c_s = c_s.into();
            self
        }

        /// Weight of the prior on each parameter. 1 / unit of the row, 0 or 1e-6..=1e6
        #[must_use]
        pub fn c_p(mut self, c_p: [f64; NP]) -> Self {
            self.table.c_p = c_p.into();
            self
        }

        /// Lower and upper bound of each parameter, `p_prior` between them. Unit of each row
        #[must_use]
        pub fn bounds(mut self, p_lb: [f64; NP], p_ub: [f64; NP]) -> Self {
            self.bounds = Some((p_lb, p_ub));
            self
        }

        /// Loss of each observation and of each transition.
        #[must_use]
        pub fn losses(mut self, observation: LossTable, transition: LossTable) -> Self {
            (self.table.observation_loss, self.table.transition_loss) = (observation, transition);
            self
        }

        /// Start of the damping, tolerances and limit of iterations of the Levenberg-Marquardt method.
        #[must_use]
        pub fn solver(mut self, solver: LmTable) -> Self {
            self.table.solver = solver;
            self
        }

        /// The settings, checked against the rows of `model`.
        ///
        /// # Errors
        /// The first value that breaks its rule, by its key in a file.
        pub fn build<M, const NU: usize>(mut self, _model: &M) -> Result<$settings, SettingError>
        where
            M: Model<NS, NU, NO, NP>,
        {
            let wide = || wide(&M::PARAMETER);
            let given = |(lo, hi): ([f64; NP], [f64; NP])| (lo.into(), hi.into());
            (self.table.p_lb, self.table.p_ub) = self.bounds.map_or_else(wide, given);
            self.table.check::<M, NS, NU, NO, NP>()
        }
    };
}
pub(crate) use fit_setters;

/// Bounds that are hardly any, within the domain of each row.
pub(crate) fn wide(rows: &[Row]) -> (Vec<f64>, Vec<f64>) {
    let bounds = |row: &Row| match row.domain {
        Domain::Real => (-1e9, 1e9),
        Domain::Positive => (1e-9, 1e9),
        Domain::Fraction => (0.0, 0.999),
    };
    rows.iter().map(bounds).unzip()
}

#[cfg(test)]
mod tests {
    use horizon_model::setting::bounds;

    use super::*;

    #[test]
    fn wide_bounds_are_valid_for_every_domain() {
        let rows = [Row::linear("a", "m"), Row::positive("b", "s"), Row::fraction("c")];
        let (lo, hi) = wide(&rows);
        assert!(bounds(("lo", &lo), ("hi", &hi), &rows).is_ok());
        assert_eq!(lo.len(), 3);
    }
}
