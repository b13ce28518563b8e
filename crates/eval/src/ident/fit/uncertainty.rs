//! How far the parameters of a fit may be off, row by row.

use horizon_estim::{Laplace, NORMAL_HALF_WIDTH, Spread, UndecidedDelay};
use horizon_model::Model;
use horizon_model::rows::{pose, stick};
use nalgebra::SMatrix;

use super::Identification;
use crate::ident::acceptance::has_rested;
use crate::ident::report::ParameterRow;
use crate::ident::warnings::{PIECES_PER_PARAMETER, is_set_by_prior};

/// Rows of the parameters, and their covariance if each row has one by the logs.
type Rows = (Vec<ParameterRow>, Option<Vec<Vec<f64>>>);

impl<M, const NS: usize, const NP: usize> Identification<'_, M, NS, NP>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP> + Send + Sync + 'static,
{
    /// The parameter's normal distribution around the estimate, at the present dead times where the search left these
    /// open; NaN where there is none.
    fn laplace(&self) -> Spread<NP> {
        let laplace = Laplace::with_dead_times(&self.ident, &self.influences);
        let p = self.ident.parameter();
        // Fewer pieces cannot show how they vary.
        let is_clustered = self.spans.len() >= PIECES_PER_PARAMETER * NP;
        match laplace {
            Ok(laplace) if is_clustered => laplace.spread(p),
            Ok(laplace) => laplace.plain_spread(p),
            Err(_) => Spread::normal(p, &SMatrix::repeat(f64::NAN)),
        }
    }

    /// The rows by the spread of the resamples if they count, else by Laplace's approximation; those of sticks that
    /// rested by the prior, since what their axes did is noise.
    pub(super) fn parameter_rows(&self, resampled: Option<Spread<NP>>) -> Rows {
        let undecided: SMatrix<f64, NP, NP> =
            self.undecided.iter().map(UndecidedDelay::covariance).sum();
        let laplace = self.laplace();
        let by_laplace = laplace.widened(&undecided);
        let by_data = resampled.map_or(by_laplace, |spread| spread.widened(&undecided));
        let input_rms = self.input_rms();
        let row = |row: usize| {
            let name = M::PARAMETER[row].name;
            if has_rested(name, &input_rms) {
                return self.prior_row(row);
            }
            // The bootstrap resamples logs, not the prior: its spread means nothing for a row that the prior sets.
            let is_prior = is_set_by_prior(laplace.std[row], self.prior_std[row]);
            let spread = if is_prior { by_laplace } else { by_data };
            let [lower, upper] = &self.bounds;
            let value = self.ident.parameter()[row];
            ParameterRow {
                name,
                unit: M::PARAMETER[row].unit,
                value,
                std: spread.std[row],
                std_laplace: laplace.std[row],
                lower: spread.lower[row],
                upper: spread.upper[row],
                // A row that is stopped by its bound is equal to it.
                is_at_bound: value <= lower[row] || value >= upper[row],
            }
        };
        let is_rested = |row: &horizon_model::Row| has_rested(row.name, &input_rms);
        let covariance = covariance(&by_data).filter(|_| !M::PARAMETER.iter().any(is_rested));
        ((0..NP).map(row).collect(), covariance)
    }

    /// The row of a parameter of which nothing is known but its prior.
    fn prior_row(&self, row: usize) -> ParameterRow {
        let (value, std) = (self.job.table.map.p_prior[row], self.prior_std[row]);
        let half = NORMAL_HALF_WIDTH * std;
        ParameterRow {
            name: M::PARAMETER[row].name,
            unit: M::PARAMETER[row].unit,
            value,
            std,
            std_laplace: std,
            lower: value - half,
            upper: value + half,
            is_at_bound: false,
        }
    }
}

/// Covariance, row by row; `None` if it is not finite.
fn covariance<const NP: usize>(spread: &Spread<NP>) -> Option<Vec<Vec<f64>>> {
    let covariance = spread.covariance();
    let is_finite = covariance.iter().all(|entry| entry.is_finite());
    is_finite.then(|| covariance.row_iter().map(|row| row.iter().copied().collect()).collect())
}

#[cfg(test)]
mod tests {
    use nalgebra::SVector;

    use super::*;

    #[test]
    fn a_covariance_is_made_of_deviations_and_correlations() {
        let expected = SMatrix::<f64, 2, 2>::new(4.0, -0.9, -0.9, 0.25);
        let spread = Spread::normal(&SVector::from([1.0, 2.0]), &expected);
        let rows = covariance(&spread).unwrap();
        for (i, j) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let gap = (rows[i][j] - expected[(i, j)]).abs();
            assert!(gap < 1e-14, "({i}, {j}): {}", rows[i][j]);
        }
        let unknown = Spread::normal(&SVector::from([1.0, 2.0]), &SMatrix::repeat(f64::NAN));
        assert_eq!(covariance(&unknown), None);
    }
}
