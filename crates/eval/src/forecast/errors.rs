//! Errors of forecasts by horizon.
//!
//! Owns the samples and their summaries. Which of them count is decided by the caller.

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};

/// Errors of forecasts at the horizons of 1, 2, .. steps
#[derive(Debug, Clone, PartialEq)]
pub struct ForecastErrors {
    by_horizon: Vec<Samples>,
}

/// Absolute errors at one horizon.
#[derive(Debug, Clone, PartialEq, Default)]
struct Samples {
    horizontal: Vec<f64>,
    vertical: Vec<f64>,
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

    /// Adds one forecast's error at the horizon of `index + 1` steps, which is among those asked for at
    /// construction.
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

    /// Summary at a horizon of `steps`, of those asked for at construction.
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
