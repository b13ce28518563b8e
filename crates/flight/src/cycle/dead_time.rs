//! The dead times of this flight.
//!
//! Owns when the motion suffices to correct them, and by how much. Roll and pitch show them best: radio,
//! motion capture and firmware delay all axes together. Throttle and yaw follow them until their own motion shows
//! their own dead time.

use horizon_model::rows::{Sticks, stick};

use crate::link::DeadTimeErrors;
use crate::{DeadTimeError, LinkTable};

/// Estimated error from which on the dead times are corrected. periods
const ERROR_MIN: f64 = 0.75;

/// Estimated error over its standard deviation from which on the dead times are corrected. 1
const CERTAINTY_MIN: f64 = 1.0;

/// Number of outages after which a shortened dead time returns to the configured one: a dead time that is too short
/// makes the vehicle oscillate, and the link monitor takes the oscillation for outages, in which no dead time is
/// corrected.
const OUTAGES_MAX: u32 = 4;

/// Standard deviation of the error over that of the prior below which the commands have changed enough to show it. 1
const EXCITED_MAX: f64 = 0.6;

/// How long the error must be negative before a dead time that is shorter than configured by [`SHORT_STEPS`] becomes
/// shorter still: a gust just before a stick acts looks like a short dead time. periods, steps
const SHORT_PERIODS: u32 = 150;
const SHORT_STEPS: i32 = 2;

/// Error that remains at the largest correction above which the dead time is too long to fly with. s
const LEFT_MAX_S: f64 = 0.08;

/// [`LEFT_MAX_S`] of throttle and yaw, whose axes answer sooner and oscillate later. s
const LEFT_OWN_MAX_S: f64 = 0.15;

/// Least number of periods from one correction of an axis to the next.
const PERIODS_BETWEEN: u32 = 5;

/// Corrections of the dead times of a flight, and the errors that remain.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DeadTimeChange {
    /// Correction of the configured dead time of each stick before `dead_time_min_ratio` limits it. steps
    pub steps: [i32; stick::COUNT],
    /// Correction that is applied: `dead_time_min_ratio` of each configured dead time remains. s
    pub change_s: Sticks,
    /// Remaining error of roll and pitch by the latest motion that shows it; `None` before. s
    pub error: Option<DeadTimeError>,
    /// Remaining error of the throttle by its own motion; `None` before that shows it. s
    pub throttle_error: Option<DeadTimeError>,
    /// Remaining error of yaw by its own motion; `None` before that shows it. s
    pub yaw_error: Option<DeadTimeError>,
}

impl DeadTimeChange {
    /// Corrections plus remaining errors: by how much the dead times differ from the configured ones. Axes without an
    /// error of their own take that of roll and pitch; `None` if no motion has shown the latter. s
    pub(super) fn found_s(&self) -> Option<Sticks> {
        let common_s = self.error?.mean_s;
        let mut found_s = self.change_s.add_scalar(common_s);
        for (axis, error) in [(stick::THROTTLE, self.throttle_error), (stick::YAW, self.yaw_error)]
        {
            found_s[axis] = self.change_s[axis] + error.map_or(common_s, |error| error.mean_s);
        }
        Some(found_s)
    }
}

/// Correction of the dead times, whole periods. After [`OUTAGES_MAX`] outages a shortened dead time returns to the
/// configured one.
#[derive(Debug)]
pub(super) struct DeadTime {
    dt_s: f64,
    sd_prior_s: f64,
    /// Largest correction. steps
    steps_max: i32,
    /// Of roll and pitch.
    horizontal: Correction,
    throttle: Correction,
    yaw: Correction,
    /// Number of outages that began while the dead time of roll and pitch was shorter than configured.
    outages: u32,
}

/// Correction of one axis.
#[derive(Debug)]
struct Correction {
    /// Largest reduction that `dead_time_min_ratio` allows. s
    reduction_max_s: f64,
    /// Least correction: the whole steps of that reduction, negative. steps
    steps_min: i32,
    /// Present correction of the configured dead time. steps
    steps: i32,
    /// Periods since the newest correction.
    periods_since: u32,
    /// Periods in which the error has asked for a dead time shorter by more than [`SHORT_STEPS`].
    short_periods: u32,
    /// The newest error known well enough; `None` before, and after a step that followed from another axis.
    error: Option<DeadTimeError>,
}

impl DeadTime {
    /// Largest correction that `table` allows. steps
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "0..=0.5 s of periods"
    )]
    pub(super) fn steps_of(table: &LinkTable, dt_s: f64) -> u32 {
        (table.dead_time_change_s / dt_s).round() as u32
    }

    /// No correction yet of dead times that are configured as `dead_time_s`. `dt_s` > 0 is the period.
    pub(super) fn new(table: &LinkTable, dead_time_s: &Sticks, dt_s: f64) -> Self {
        let LinkTable { sd_dead_time_s, dead_time_min_ratio, .. } = *table;
        #[expect(clippy::cast_possible_truncation, reason = "at most 2 s of periods")]
        let whole = |steps: f64| steps as i32;
        let steps_max = Self::steps_of(table, dt_s).cast_signed();
        let correction = |axis: usize| {
            let reduction_max_s = (1.0 - dead_time_min_ratio) * dead_time_s[axis];
            let steps_min = -steps_max.min(whole(reduction_max_s / dt_s + 1e-9));
            Correction {
                reduction_max_s,
                steps_min,
                steps: 0,
                periods_since: 0,
                short_periods: 0,
                error: None,
            }
        };
        Self {
            dt_s,
            sd_prior_s: sd_dead_time_s,
            steps_max,
            horizontal: correction(stick::PITCH),
            throttle: correction(stick::THROTTLE),
            yaw: correction(stick::YAW),
            outages: 0,
        }
    }

    /// The correction; `None` if the dead times stay as they are configured.
    pub(super) fn change(&self) -> Option<DeadTimeChange> {
        let Self { dt_s, steps_max, horizontal, throttle, yaw, .. } = self;
        let mut steps = [horizontal.steps; stick::COUNT];
        let mut reduction_max_s = Sticks::repeat(horizontal.reduction_max_s);
        for (axis, own) in [(stick::THROTTLE, throttle), (stick::YAW, yaw)] {
            steps[axis] = own.steps.min(*steps_max);
            reduction_max_s[axis] = own.reduction_max_s;
        }
        let asked_s = Sticks::from(steps.map(f64::from)) * *dt_s;
        (*steps_max > 0).then(|| DeadTimeChange {
            steps,
            change_s: asked_s.sup(&-reduction_max_s),
            error: horizontal.error,
            throttle_error: throttle.error,
            yaw_error: yaw.error,
        })
    }

    /// Whether a stick acts later than the largest correction allows for.
    pub(super) fn is_too_long(&self) -> bool {
        let Self { steps_max, horizontal, throttle, yaw, .. } = self;
        let is_late = |axis: &Correction, left_max_s: f64| {
            axis.steps >= *steps_max && axis.error.is_some_and(|error| error.mean_s > left_max_s)
        };
        *steps_max > 0
            && (is_late(horizontal, LEFT_MAX_S)
                || is_late(throttle, LEFT_OWN_MAX_S)
                || is_late(yaw, LEFT_OWN_MAX_S))
    }

    /// Largest correction. steps
    pub(super) fn steps_max(&self) -> i32 {
        self.steps_max
    }

    /// The link has gone down.
    pub(super) fn note_outage(&mut self) {
        if self.horizontal.steps < 0 {
            self.outages = self.outages.saturating_add(1);
        }
    }

    /// Ends a return that has reached the configured dead time: corrections are allowed again. Whether it ends now.
    pub(super) fn end_return_if_done(&mut self) -> bool {
        let is_back = self.outages >= OUTAGES_MAX && self.horizontal.steps >= 0;
        if is_back {
            self.outages = 0;
        }
        is_back
    }

    /// Corrects the dead times after a period that left `errors`, each by one step at most; whether any has changed.
    ///
    /// Throttle and yaw take the step of roll and pitch as long as they have no error of their own. During a return
    /// they take it if they had the same correction.
    pub(super) fn correct(&mut self, errors: Option<DeadTimeErrors>) -> bool {
        let Self { dt_s, sd_prior_s, steps_max, horizontal, throttle, yaw, outages } = self;
        if horizontal.steps >= 0 && *outages < OUTAGES_MAX {
            *outages = 0;
        }
        let is_returning = *outages >= OUTAGES_MAX;
        let excited = |error: Option<DeadTimeError>| {
            error.filter(|error| error.sd_s <= EXCITED_MAX * *sd_prior_s)
        };
        let [error, throttle_error, yaw_error] = [
            errors.map(|all| all.horizontal),
            errors.and_then(|all| all.throttle),
            errors.and_then(|all| all.yaw),
        ]
        .map(excited);
        let steps_before = horizontal.steps;
        let step = if is_returning {
            horizontal.step_back()
        } else {
            horizontal.step_towards(error, *steps_max, *dt_s)
        };
        let mut is_changed = step != 0;
        for (axis, error) in [(throttle, throttle_error), (yaw, yaw_error)] {
            if error.is_none() && (!is_returning || axis.steps == steps_before) {
                axis.follow(step);
            }
            is_changed |= axis.step_towards(error, *steps_max, *dt_s) != 0;
        }
        is_changed
    }
}

impl Correction {
    /// Makes the step that `error` asks for if it may be made: -1, 0 or 1. steps
    fn step_towards(&mut self, error: Option<DeadTimeError>, steps_max: i32, dt_s: f64) -> i32 {
        self.periods_since = self.periods_since.saturating_add(1);
        let Some(error) = error else {
            self.short_periods = self.short_periods.saturating_sub(1);
            return 0;
        };
        let DeadTimeError { mean_s, sd_s } = error;
        let step = if mean_s > 0.0 { 1 } else { -1 };
        let is_short = self.steps == -SHORT_STEPS && step < 0;
        let is_clear = mean_s.abs() >= (ERROR_MIN * dt_s).max(CERTAINTY_MIN * sd_s);
        self.short_periods =
            if is_short && is_clear { self.short_periods.saturating_add(1) } else { 0 };
        let is_shown = !is_short || self.short_periods >= SHORT_PERIODS;
        let range = self.steps_min..=steps_max;
        let after = self.steps.clamp(self.steps_min, steps_max) + step;
        if is_clear && is_shown && range.contains(&after) && self.periods_since >= PERIODS_BETWEEN {
            self.periods_since = 0;
            self.steps = after;
            let mean_s = mean_s - f64::from(step) * dt_s;
            self.error = Some(DeadTimeError { mean_s, sd_s });
            return step;
        }
        self.error = Some(error);
        0
    }

    /// Makes the `step` of roll and pitch. The error so far is that of another dead time.
    fn follow(&mut self, step: i32) {
        if step != 0 {
            self.error = None;
            self.steps += step;
        }
    }

    /// Makes a step back to the configured dead time, 0 or 1. The error so far is that of another dead time.
    fn step_back(&mut self) -> i32 {
        self.periods_since = self.periods_since.saturating_add(1);
        if self.periods_since < PERIODS_BETWEEN || self.steps >= 0 {
            return 0;
        }
        (self.periods_since, self.error) = (0, None);
        self.steps += 1;
        1
    }
}

#[cfg(test)]
mod tests;
