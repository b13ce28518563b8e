//! Steps from frame to frame: of arrivals, of frame numbers, or of the source's time stamps.

use std::collections::VecDeque;

/// How many of the newest steps the usual one is the median of.
const NEWEST_MAX: usize = 1024;

/// The usual step is found anew with each of the first ones, then once in so many.
const FIRST: u64 = 64;

/// A step of more usual ones is a gap.
pub(super) const GAP_PERIODS: f64 = 2.5;

/// A step of at least so many usual ones, and of at least [`STEP_MAX`], begins another count: it is not added to the
/// sums.
const COUNT_MAX: f64 = 1e4;
const STEP_MAX: f64 = 10.0;

/// Sums of all steps so far, in memory of a fixed size.
#[derive(Debug, Clone, Default)]
pub(super) struct Intervals {
    newest: VecDeque<f64>,
    /// Median of the newest.
    usual: f64,
    pub(super) count: u64,
    sum: f64,
    squares: f64,
    /// The steps in usual ones, each rounded: frames that there should have been.
    due: f64,
    pub(super) gaps: u64,
    pub(super) max: f64,
}

impl Intervals {
    /// Takes in a step; whether it is a gap.
    pub(super) fn take(&mut self, step: f64) -> bool {
        if self.newest.len() == NEWEST_MAX {
            self.newest.pop_front();
        }
        self.newest.push_back(step);
        if self.count < FIRST || self.count.is_multiple_of(FIRST) {
            self.usual = self.median();
        }
        self.max = self.max.max(step);
        let periods = if self.usual > 0.0 { step / self.usual } else { 1.0 };
        let is_gap = periods > GAP_PERIODS;
        self.gaps += u64::from(is_gap);
        if periods.abs() < COUNT_MAX || step.abs() < STEP_MAX {
            self.count += 1;
            self.sum += step;
            self.squares += step * step;
            self.due += periods.round();
        }
        is_gap
    }

    fn median(&self) -> f64 {
        let mut newest: Vec<f64> = self.newest.iter().copied().collect();
        newest.sort_unstable_by(f64::total_cmp);
        newest.get(newest.len() / 2).copied().unwrap_or(0.0)
    }

    /// Mean, gaps included; 0 of none.
    pub(super) fn mean(&self) -> f64 {
        self.sum / self.count.max(1) as f64
    }

    /// Standard deviation.
    pub(super) fn deviation(&self) -> f64 {
        (self.squares / self.count.max(1) as f64 - self.mean().powi(2)).max(0.0).sqrt()
    }

    /// Mean step between frames that follow each other; `None` while nothing tells it, or if most steps are none.
    pub(super) fn usual(&self) -> Option<f64> {
        let usual = self.sum / self.due;
        let is_even = self.usual > 0.2 * self.mean();
        (is_even && self.due > 0.0 && usual > 0.0).then_some(usual)
    }

    /// How many frames are missing between those that came.
    pub(super) fn missing(&self) -> u64 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a whole count"
        )]
        let missing = (self.due - self.count as f64).max(0.0) as u64;
        missing
    }
}
