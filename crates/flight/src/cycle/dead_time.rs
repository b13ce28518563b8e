//! The dead times of this flight.
//!
//! Owns when what the motion says suffices to correct them, and by how much. All axes are corrected alike: radio,
//! motion capture and firmware delay them together, and the horizontal ones show it best.

use crate::{DeadTimeError, LinkTable};

/// Estimated error from which on the dead times are corrected. periods
const ERROR_MIN: f64 = 0.75;

/// The same in its own standard deviations.
const CERTAINTY_MIN: f64 = 1.0;

/// Part of the prior standard deviation below which enough commands have changed to tell a delay.
const EXCITED_MAX: f64 = 0.6;

/// Error that is left at the largest correction from which on the dead time is too long to fly with. s
const LEFT_MAX_S: f64 = 0.08;

/// Periods from one correction to the next.
const PERIODS_BETWEEN: u32 = 5;

/// What the dead times of a flight were corrected by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadTimeChange {
    /// Added to each that is configured, as far as `dead_time_min_ratio` lets it. steps
    pub steps: i32,
    /// The same. s
    pub change_s: f64,
    /// What is still missing by the latest motion that shows it; `None` before. s
    pub error: Option<DeadTimeError>,
}

/// Correction of the dead times, whole periods.
#[derive(Debug)]
pub(super) struct DeadTime {
    dt_s: f64,
    sd_prior_s: f64,
    /// Least and largest correction. steps
    steps_min: i32,
    steps_max: i32,
    steps: i32,
    /// Periods since the newest correction.
    since: u32,
    /// The newest error that was excited enough.
    error: Option<DeadTimeError>,
}

impl DeadTime {
    /// No correction yet of a horizontal dead time that is configured as `horizontal_s`. `dt_s` > 0 is the period.
    pub(super) fn new(table: &LinkTable, horizontal_s: f64, dt_s: f64) -> Self {
        let LinkTable { sd_dead_time_s, dead_time_change_s, dead_time_min_ratio, .. } = *table;
        #[expect(clippy::cast_possible_truncation, reason = "at most 2 s of periods")]
        let whole = |steps: f64| steps as i32;
        let steps_max = whole((dead_time_change_s / dt_s).round());
        let given_up_s = (1.0 - dead_time_min_ratio) * horizontal_s;
        Self {
            dt_s,
            sd_prior_s: sd_dead_time_s,
            steps_min: -steps_max.min(whole(given_up_s / dt_s + 1e-9)),
            steps_max,
            steps: 0,
            since: 0,
            error: None,
        }
    }

    /// The correction; `None` if the dead times stay as they are configured.
    pub(super) fn change(&self) -> Option<DeadTimeChange> {
        let Self { dt_s, steps, error, .. } = *self;
        (self.steps_max > 0).then(|| DeadTimeChange {
            steps,
            change_s: f64::from(steps) * dt_s,
            error,
        })
    }

    /// Whether the sticks act later than the largest correction allows for.
    pub(super) fn is_too_long(&self) -> bool {
        let is_largest = self.steps_max > 0 && self.steps == self.steps_max;
        is_largest && self.error.is_some_and(|error| error.mean_s > LEFT_MAX_S)
    }

    /// Largest correction. steps
    pub(super) fn steps_max(&self) -> i32 {
        self.steps_max
    }

    /// By how much the dead times grow after a period that left `error`: one step or none, either way.
    pub(super) fn follow(&mut self, error: Option<DeadTimeError>) -> i32 {
        self.since = self.since.saturating_add(1);
        let is_excited = |error: &DeadTimeError| error.sd_s <= EXCITED_MAX * self.sd_prior_s;
        let Some(error) = error.filter(is_excited) else { return 0 };
        let DeadTimeError { mean_s, sd_s } = error;
        let is_clear = mean_s.abs() >= (ERROR_MIN * self.dt_s).max(CERTAINTY_MIN * sd_s);
        let step = if mean_s > 0.0 { 1 } else { -1 };
        let is_allowed = (self.steps_min..=self.steps_max).contains(&(self.steps + step));
        if is_clear && is_allowed && self.since >= PERIODS_BETWEEN {
            self.since = 0;
            self.steps += step;
            let mean_s = mean_s - f64::from(step) * self.dt_s;
            self.error = Some(DeadTimeError { mean_s, sd_s });
            return step;
        }
        self.error = Some(error);
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;
    const HORIZONTAL_S: f64 = 0.34;

    fn dead_time(change_s: f64) -> DeadTime {
        let text = include_str!("../../../../configs/fly.json");
        let settings: serde_json::Value = serde_json::from_str(text).unwrap();
        let link = settings["cycle"]["link"].clone();
        let table: LinkTable = serde_json::from_value(link).unwrap();
        DeadTime::new(&LinkTable { dead_time_change_s: change_s, ..table }, HORIZONTAL_S, DT_S)
    }

    /// The corrections in 60 periods of a vehicle whose dead time is wrong by `error_s`, known to `sd_s`. steps
    fn corrected(change_s: f64, error_s: f64, sd_s: f64) -> i32 {
        let mut dead_time = dead_time(change_s);
        for period in 0..60 {
            let left_s = error_s - dead_time.change().map_or(0.0, |change| change.change_s);
            let step = dead_time.follow(Some(DeadTimeError { mean_s: left_s, sd_s }));
            assert!(step.abs() <= 1 && (step == 0 || period % PERIODS_BETWEEN as usize == 4));
        }
        dead_time.steps
    }

    #[test]
    fn an_error_is_followed_as_far_as_it_is_known_and_allowed() {
        for (change_s, error_s, sd_s, steps) in [
            (0.3, 0.1, 0.02, 5),
            (0.3, -0.1, 0.02, -5),
            // Within three quarters of a period, or one standard deviation.
            (0.3, 0.014, 0.001, 0),
            (0.3, 0.1, 0.03, 4),
            (0.3, 0.02, 0.03, 0),
            // Two thirds of the prior standard deviation are left: not excited.
            (0.3, 0.1, 0.04, 0),
            (0.06, 0.1, 0.02, 3),
            (0.06, -0.1, 0.02, -3),
            // Half of the dead time stays: at least 8.5 of 17 periods.
            (0.3, -0.3, 0.02, -8),
            (0.0, 0.1, 0.02, 0),
        ] {
            assert_eq!(corrected(change_s, error_s, sd_s), steps, "{error_s} +- {sd_s} s");
        }
    }

    #[test]
    fn a_dead_time_is_too_long_when_much_is_left_of_the_largest_correction() {
        let followed = |change_s: f64, mean_s: f64, sd_s: f64| {
            let mut dead_time = dead_time(change_s);
            let error = Some(DeadTimeError { mean_s, sd_s });
            for _ in 0..100 {
                dead_time.follow(error);
            }
            dead_time.is_too_long()
        };
        assert!(followed(0.3, 0.09, 0.02));
        assert!(!followed(0.3, LEFT_MAX_S, 0.02), "the limit itself");
        assert!(!followed(0.3, 0.07, 0.02) && !followed(0.3, -0.09, 0.02), "little left, or early");
        assert!(!followed(0.5, 0.09, 0.02), "after 20 of 25 steps");
        assert!(
            !followed(0.3, 0.09, 0.05) && !followed(0.0, 0.09, 0.02),
            "unknown, or not corrected"
        );
    }

    #[test]
    fn what_is_left_is_reported_with_the_correction() {
        let mut dead_time = dead_time(0.3);
        assert_eq!(
            dead_time.change(),
            Some(DeadTimeChange { steps: 0, change_s: 0.0, error: None })
        );
        let error = Some(DeadTimeError { mean_s: 0.05, sd_s: 0.02 });
        let stepped = (0..5).map(|_| dead_time.follow(error)).sum::<i32>();
        let DeadTimeChange { steps, change_s, error } = dead_time.change().unwrap();
        assert_eq!((stepped, steps, change_s), (1, 1, DT_S));
        assert!((error.unwrap().mean_s - 0.03).abs() < 1e-12);
        // Motion that says nothing leaves it.
        assert_eq!((dead_time.follow(None), dead_time.change().unwrap().error), (0, error));
        assert_eq!(self::dead_time(0.0).change(), None);
    }
}
