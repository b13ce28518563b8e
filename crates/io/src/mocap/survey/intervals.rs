//! Steps from frame to frame: of arrivals, of frame numbers, or of the source's time stamps.

use std::collections::VecDeque;

use super::super::statistics::GAP_PERIODS;

/// How many of the newest steps the usual one is the median of.
const NEWEST_MAX: usize = 1024;

/// The usual step is found anew with each of the first ones, then once in so many.
const FIRST: u64 = 64;

/// A step of at least so many usual ones, 1, and of at least [`STEP_MAX`] in the unit of the steps, begins another
/// count: it is not added to the sums.
const COUNT_MAX: f64 = 1e4;
const STEP_MAX: f64 = 10.0;

/// Sums of all steps so far, in memory of a fixed size. Their unit is that of the steps: s, or 1 for frame numbers.
#[derive(Debug, Clone, Default)]
pub(super) struct Intervals {
    newest: VecDeque<f64>,
    /// Median of the newest.
    usual: f64,
    /// Number of steps that were added.
    pub(super) count: u64,
    sum: f64,
    squares: f64,
    /// The steps in usual ones, each rounded: frames that there should have been.
    due: f64,
    /// Number of gaps.
    pub(super) gaps: u64,
    /// Longest step. In the unit of the steps
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

    /// Mean step between frames that follow each other; `None` while it is unknown, or if most steps are none.
    pub(super) fn usual(&self) -> Option<f64> {
        let usual = self.sum / self.due;
        let is_even = self.usual > 0.2 * self.mean();
        (is_even && self.due > 0.0 && usual > 0.0).then_some(usual)
    }

    /// How many frames are missing between those that came.
    pub(super) fn missing(&self) -> u64 {
        horizon_model::whole(self.due - self.count as f64) as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ten steps of one.
    fn even() -> Intervals {
        let mut intervals = Intervals::default();
        for _ in 0..10 {
            assert!(!intervals.take(1.0));
        }
        intervals
    }

    #[test]
    fn a_step_above_two_and_a_half_usual_ones_is_a_gap() {
        for (step, is_gap) in [(2.5, false), (2.5_f64.next_up(), true), (-3.0, false)] {
            let mut intervals = even();
            assert_eq!(
                (intervals.take(step), intervals.gaps),
                (is_gap, u64::from(is_gap)),
                "{step}"
            );
        }
    }

    #[test]
    fn frames_that_are_missing_are_counted_and_the_usual_step_is_that_of_a_frame() {
        let mut intervals = even();
        intervals.take(3.0);
        assert_eq!((intervals.missing(), intervals.count), (2, 11));
        assert_eq!(intervals.usual(), Some(1.0));
        assert!((intervals.mean() - 13.0 / 11.0).abs() < 1e-12 && intervals.max >= 3.0);
        let deviation = f64::sqrt(19.0 / 11.0 - (13.0_f64 / 11.0).powi(2));
        assert!((intervals.deviation() - deviation).abs() < 1e-12);
        // Steps that are short are frames too many, of which none is missing.
        intervals.take(0.1);
        assert_eq!(intervals.missing(), 1);
    }

    #[test]
    fn a_step_to_another_count_is_not_added() {
        for (usual, step, is_added) in [
            (1.0, 9_999.0, true),
            (1.0, 10_000.0, false),
            (1.0, -10_000.0, false),
            (1e-4, 9.0, true),
        ] {
            let mut intervals = Intervals::default();
            for _ in 0..10 {
                intervals.take(usual);
            }
            intervals.take(step);
            assert_eq!(intervals.count, 10 + u64::from(is_added), "{step} of {usual}");
        }
    }

    #[test]
    fn no_steps_and_steps_of_zero_have_no_usual_step() {
        let mut intervals = Intervals::default();
        assert_eq!((intervals.usual(), intervals.missing()), (None, 0));
        assert!(intervals.mean() == 0.0 && intervals.deviation() == 0.0);
        for _ in 0..10 {
            intervals.take(0.0);
        }
        assert_eq!((intervals.usual(), intervals.missing()), (None, 0));
    }
}
