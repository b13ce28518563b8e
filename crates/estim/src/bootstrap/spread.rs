//! How far an estimate may be off: deviations, intervals, correlations.
//!
//! Owns the summary of resamples and its counterpart from a covariance. Where either comes from is
//! not known here.

use horizon_model::{Matrix, Vector};

/// The central interval that is reported holds this fraction. 1
const LEVEL: f64 = 0.95;

/// Half the width of that interval, of 95 %, of a normal distribution. standard deviations
pub const NORMAL_HALF_WIDTH: f64 = 1.959_963_984_540_054;

/// Factor of a variance in an interval: the residual variance, but at least 1. A residual variance below 1 is the
/// effect of weights that are too small: it must not narrow an interval. 1
pub(crate) fn interval_variance(residual_variance: f64) -> f64 {
    residual_variance.max(1.0)
}

/// Distribution of an estimated parameter, row by row in the unit of the row, with the correlations between rows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spread<const NP: usize> {
    /// Mean. Unit of each row
    pub mean: Vector<NP>,
    /// Standard deviation. Unit of each row, >= 0
    pub std: Vector<NP>,
    /// Lower end of the 95 % interval. Unit of each row
    pub lower: Vector<NP>,
    /// Upper end of the 95 % interval. Unit of each row
    pub upper: Vector<NP>,
    /// Correlation of each pair of rows, -1..=1. A row without spread has none with others. 1
    pub correlation: Matrix<NP, NP>,
}

impl<const NP: usize> Spread<NP> {
    /// Spread of `samples`, in any order; `None` for fewer than two.
    ///
    /// The deviation divides by `n - 1`. The interval runs from the 2.5 % to the 97.5 % quantile; the
    /// order statistic `i` of `n` is the quantile `i / (n + 1)`, so that the next sample falls into the
    /// interval with 95 %, and between order statistics it is linear.
    pub fn of(samples: &[Vector<NP>]) -> Option<Self> {
        if samples.len() < 2 {
            return None;
        }
        let mean = samples.iter().sum::<Vector<NP>>() / samples.len() as f64;
        let scatter = samples.iter().map(|p| (p - mean) * (p - mean).transpose());
        let covariance = scatter.sum::<Matrix<NP, NP>>() / (samples.len() - 1) as f64;
        let mut spread = Self::normal(&mean, &covariance);
        for row in 0..NP {
            let mut values: Vec<f64> = samples.iter().map(|p| p[row]).collect();
            values.sort_by(f64::total_cmp);
            spread.lower[row] = order_statistic_quantile(&values, 0.5 * (1.0 - LEVEL));
            spread.upper[row] = order_statistic_quantile(&values, 0.5 * (1.0 + LEVEL));
        }
        Some(spread)
    }

    /// Spread of the normal distribution around `mean`, with `mean` +- [`NORMAL_HALF_WIDTH`] standard deviations as the
    /// interval.
    ///
    /// | name         | shape   | unit                                          |
    /// |--------------|---------|-----------------------------------------------|
    /// | `mean`       | NP      | that of each row of the parameter             |
    /// | `covariance` | NP x NP | product of the units of row and column        |
    ///
    /// A row without variance has an interval of one value and no correlation. A negative diagonal entry, which no
    /// covariance has, makes deviation and interval of its row NaN. No allocation.
    pub fn normal(mean: &Vector<NP>, covariance: &Matrix<NP, NP>) -> Self {
        let std = covariance.diagonal().map(f64::sqrt);
        let correlation = Matrix::from_fn(|row, col| {
            let scale = std[row] * std[col];
            if row == col {
                1.0
            } else if scale > 0.0 {
                covariance[(row, col)] / scale
            } else {
                0.0
            }
        });
        let half = std * NORMAL_HALF_WIDTH;
        Self { mean: *mean, std, lower: mean - half, upper: mean + half, correlation }
    }

    /// Covariance, of which [`Self::normal`] makes the same deviations and correlations. Product of the units of row
    /// and column. No allocation.
    pub fn covariance(&self) -> Matrix<NP, NP> {
        Matrix::from_fn(|row, col| {
            let correlation = if row == col { 1.0 } else { self.correlation[(row, col)] };
            correlation * (self.std[row] * self.std[col])
        })
    }

    /// This spread with a further cause of error of this `covariance`, independent of the others: each end of an
    /// interval moves outward as that of a normal distribution does. Product of the units of row and column. No
    /// allocation.
    #[must_use]
    pub fn widened(&self, covariance: &Matrix<NP, NP>) -> Self {
        let mut sum = Self::normal(&self.mean, &(self.covariance() + covariance));
        for row in 0..NP {
            let half = NORMAL_HALF_WIDTH * covariance[(row, row)].sqrt();
            sum.lower[row] = self.mean[row] - (self.mean[row] - self.lower[row]).hypot(half);
            sum.upper[row] = self.mean[row] + (self.upper[row] - self.mean[row]).hypot(half);
        }
        sum
    }

    /// Whether the 95 % interval of each row, both ends included, contains that row of `truth`, which is in the unit of
    /// the row; false for NaN. No allocation.
    pub fn contains(&self, truth: &Vector<NP>) -> [bool; NP] {
        std::array::from_fn(|row| (self.lower[row]..=self.upper[row]).contains(&truth[row]))
    }
}

/// The `q` quantile of ascending `values`, of which there is at least one, by the expected ranks `i / (n + 1)` of
/// Weibull (type 6 of Hyndman and Fan, 1996): it predicts the next sample. The usual type 7, with ranks
/// `(i - 1) / (n - 1)`, describes the samples themselves; its intervals are too narrow for few of them.
fn order_statistic_quantile(values: &[f64], q: f64) -> f64 {
    let last = (values.len() - 1) as f64;
    let at = (q * (last + 2.0) - 1.0).clamp(0.0, last);
    let below = horizon_model::whole(at);
    let above = (below + 1).min(values.len() - 1);
    values[below] + (at - at.floor()) * (values[above] - values[below])
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;
    use horizon_model::{Matrix, Vector};

    use super::*;

    #[test]
    fn a_spread_is_that_of_its_samples() {
        // 0, 1, .. 40 and a row that falls half as fast: correlation -1.
        let samples: Vec<_> =
            (0..=40).map(|i| Vector::from([f64::from(i), -0.5 * f64::from(i), 7.0])).collect();
        let spread = Spread::of(&samples).unwrap();
        let close = |got: Vector<3>, expected: [f64; 3]| {
            assert!(amax(&(got - Vector::from(expected))) < 1e-12, "{got} for {expected:?}");
        };
        close(spread.mean, [20.0, -10.0, 7.0]);
        // Variance of n equidistant values: n (n + 1) / 12.
        let std = (41.0 * 42.0 / 12.0_f64).sqrt();
        close(spread.std, [std, 0.5 * std, 0.0]);
        // 42 gaps around 41 samples: the 2.5 % quantile lies 1.05 gaps from the end.
        close(spread.lower, [0.05, -19.975, 7.0]);
        close(spread.upper, [39.95, -0.025, 7.0]);
        let expected = Matrix::<3, 3>::new(1.0, -1.0, 0.0, -1.0, 1.0, 0.0, 0.0, 0.0, 1.0);
        assert!(amax(&(spread.correlation - expected)) < 1e-12, "{}", spread.correlation);
        assert_eq!(spread.contains(&Vector::from([0.02, -19.0, 7.0])), [false, true, true]);
    }

    #[test]
    fn a_further_cause_of_error_widens_intervals_as_that_of_a_normal_distribution() {
        let mean = Vector::from([1.0, -1.0]);
        let (own, more) =
            (Matrix::<2, 2>::new(4.0, 3.0, 3.0, 9.0), Matrix::<2, 2>::new(5.0, -2.0, -2.0, 0.8));
        let (got, expected) =
            (Spread::normal(&mean, &own).widened(&more), Spread::normal(&mean, &(own + more)));
        for (got, expected) in
            [(got.std, expected.std), (got.lower, expected.lower), (got.upper, expected.upper)]
        {
            assert!(amax(&(got - expected)) < 1e-12, "{got} for {expected}");
        }
        assert!(amax(&(got.correlation - expected.correlation)) < 1e-12, "{}", got.correlation);
    }

    #[test]
    fn a_few_samples_span_their_interval_in_any_order() {
        let samples: Vec<_> = [3.0, 1.0, 2.0].into_iter().map(|x| Vector::from([x])).collect();
        let spread = Spread::of(&samples).unwrap();
        assert!((spread.lower.x - 1.0).abs() < 1e-15 && (spread.upper.x - 3.0).abs() < 1e-15);
    }

    #[test]
    fn one_sample_has_no_spread() {
        assert!(Spread::of(&[Vector::from([1.0])]).is_none());
    }

    #[test]
    fn a_normal_spread_has_its_textbook_interval() {
        let covariance = Matrix::<2, 2>::new(4.0, 3.0, 3.0, 9.0);
        let spread = Spread::normal(&Vector::from([1.0, -1.0]), &covariance);
        assert!(amax(&(spread.std - Vector::from([2.0, 3.0]))) < 1e-15);
        assert!((spread.lower.x - (1.0 - 3.919_928)).abs() < 1e-6, "{}", spread.lower);
        assert!((spread.upper.y - (5.879_892 - 1.0)).abs() < 1e-6, "{}", spread.upper);
        assert!((spread.correlation.m12 - 0.5).abs() < 1e-15);
    }
}
