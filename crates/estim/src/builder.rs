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
