//! Errors of forecasts by horizon.
//!
//! Owns the samples and their summaries. Which of them count is decided by the caller.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};

/// Errors of forecasts at the horizons of 1, 2, .. steps.
#[derive(Debug, Clone, PartialEq)]
pub struct ForecastErrors {
    by_horizon: Vec<Samples>,
}

/// Absolute errors at one horizon.
#[derive(Debug, Clone, PartialEq, Default)]
struct Samples {
    /// m
    horizontal: Vec<f64>,
    /// m
    vertical: Vec<f64>,
    /// rad
    heading: Vec<f64>,
}

/// Summary of the absolute errors at one horizon.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizonErrors {
    /// Horizon. steps
    pub steps: usize,
    /// Distance in x and y. m
    pub horizontal: ErrorSummary,
    /// Along z. m
    pub vertical: ErrorSummary,
    /// Heading, the short way round. rad
    pub heading: ErrorSummary,
}

/// Summary of absolute errors, in their unit; NaN without samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ErrorSummary {
    /// Root of the mean square. Unit of the errors
    pub rmse: f64,
    /// Median; the upper one of an even number. Unit of the errors
    pub median: f64,
    /// Number of samples.
    pub count: usize,
}

impl ForecastErrors {
    /// No samples at horizons of up to `horizon_steps`.
    pub fn new(horizon_steps: usize) -> Self {
        Self { by_horizon: vec![Samples::default(); horizon_steps] }
    }

    /// Adds one forecast's error (m, rad) at the horizon of `index + 1` steps, which is among those asked for at
    /// construction. Constant cost, but the samples grow.
    pub fn push(&mut self, index: usize, error: &Pose) {
        let samples = &mut self.by_horizon[index];
        samples.horizontal.push(error[pose::X].hypot(error[pose::Y]));
        samples.vertical.push(error[pose::Z].abs());
        samples.heading.push(wrap(error[pose::THETA]).abs());
    }

    /// Adds the samples of another flight, judged to the same horizon.
    pub fn extend(&mut self, other: &Self) {
        for (own, other) in self.by_horizon.iter_mut().zip(&other.by_horizon) {
            own.horizontal.extend(&other.horizontal);
            own.vertical.extend(&other.vertical);
            own.heading.extend(&other.heading);
        }
    }

    /// Summary at a horizon of `steps`; `None` at 0 and beyond the longest one of the construction.
    pub fn at(&self, steps: usize) -> Option<HorizonErrors> {
        let samples = self.by_horizon.get(steps.checked_sub(1)?)?;
        Some(HorizonErrors {
            steps,
            horizontal: summarize(&samples.horizontal),
            vertical: summarize(&samples.vertical),
            heading: summarize(&samples.heading),
        })
    }

    /// Summaries at every horizon, shortest first: the curve of a figure.
    pub fn curve(&self) -> Vec<HorizonErrors> {
        (1..=self.by_horizon.len()).filter_map(|steps| self.at(steps)).collect()
    }
}

fn summarize(errors: &[f64]) -> ErrorSummary {
    let count = errors.len();
    let mean_square = errors.iter().map(|error| error.powi(2)).sum::<f64>() / count as f64;
    let mut sorted = errors.to_vec();
    sorted.sort_by(f64::total_cmp);
    let median = sorted.get(count / 2).copied().unwrap_or(f64::NAN);
    ErrorSummary { rmse: mean_square.sqrt(), median, count }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_of_several_flights_are_pooled() {
        let mut errors = ForecastErrors::new(1);
        errors.push(0, &Pose::new(3.0, 4.0, -1.0, 0.1));
        let mut other = ForecastErrors::new(1);
        other.push(0, &Pose::new(0.0, 1.0, 0.0, -0.3));
        errors.extend(&other);
        let at = errors.at(1).unwrap();
        assert_eq!(at.horizontal.count, 2);
        assert!((at.horizontal.rmse - 13.0_f64.sqrt()).abs() < 1e-12, "{at:?}");
        assert!((at.heading.median - 0.3).abs() < 1e-12, "{at:?}");
        assert!(ForecastErrors::new(1).at(1).unwrap().vertical.rmse.is_nan());
    }

    #[test]
    fn a_heading_is_off_by_the_short_way_round() {
        let mut errors = ForecastErrors::new(1);
        for theta in [6.2, -6.2, 0.1 + std::f64::consts::TAU, -0.3] {
            errors.push(0, &Pose::new(0.0, 0.0, 0.0, theta));
        }
        let ErrorSummary { median, rmse, count } = errors.at(1).unwrap().heading;
        let short = std::f64::consts::TAU - 6.2;
        assert!((median - 0.1).abs() < 1e-12 && count == 4, "{median}");
        let expected = ((2.0 * short * short + 0.01 + 0.09) / 4.0).sqrt();
        assert!((rmse - expected).abs() < 1e-12, "{rmse}, not {expected}");
    }

    #[test]
    fn a_curve_is_every_horizon_in_turn() {
        let mut errors = ForecastErrors::new(3);
        for (index, error) in [(0, 0.1), (2, 0.4), (2, 0.2), (2, 0.3)] {
            errors.push(index, &Pose::new(0.0, 0.0, error, 0.0));
        }
        let curve = errors.curve();
        let counts: Vec<_> = curve.iter().map(|at| (at.steps, at.vertical.count)).collect();
        assert_eq!(counts, [(1, 1), (2, 0), (3, 3)]);
        assert!((curve[2].vertical.median - 0.3).abs() < 1e-12, "{curve:?}");
        assert!(errors.at(0).is_none() && errors.at(4).is_none());
    }

    #[test]
    fn an_error_that_is_not_a_number_is_not_averaged_away() {
        let mut errors = ForecastErrors::new(1);
        errors.push(0, &Pose::repeat(f64::NAN));
        errors.push(0, &Pose::zeros());
        let at = errors.at(1).unwrap();
        assert!([at.horizontal.rmse, at.vertical.rmse, at.heading.rmse].iter().all(|e| e.is_nan()));
    }
}
