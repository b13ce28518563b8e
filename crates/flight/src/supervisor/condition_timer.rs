//! Limits, and for how long a condition holds.

use crate::forgetting::{LEAK_RATIO, LeakySum};

/// Whether `value` is above `limit`, in the same unit; NaN is.
pub(super) fn exceeds(value: f64, limit: f64) -> bool {
    value.is_nan() || value > limit
}

/// Time from `since_ns` to `t_ns`. s
pub(super) fn elapsed_s(since_ns: i64, t_ns: i64) -> f64 {
    t_ns.saturating_sub(since_ns) as f64 / 1e9
}

/// Times for how long a condition holds without a break.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct HoldTimer {
    /// When the condition began to hold; `None` while it does not. ns
    since_ns: Option<i64>,
}

impl HoldTimer {
    /// Notes at `t_ns` whether the condition holds.
    pub(super) fn update(&mut self, holds: bool, t_ns: i64) {
        self.since_ns = holds.then(|| self.since_ns.unwrap_or(t_ns));
    }

    /// Whether it holds.
    pub(super) fn holds(self) -> bool {
        self.since_ns.is_some()
    }

    /// For how long it has held at `t_ns`; `None` if it does not. s
    pub(super) fn elapsed_s(self, t_ns: i64) -> Option<f64> {
        self.since_ns.map(|since_ns| elapsed_s(since_ns, t_ns))
    }

    /// Whether it has held for `for_s` at `t_ns`.
    pub(super) fn has_lasted(self, t_ns: i64, for_s: f64) -> bool {
        self.elapsed_s(t_ns).is_some_and(|lasted_s| lasted_s >= for_s)
    }
}

/// Times for how long a condition has held in sum, [`LEAK_RATIO`] of the time subtracted in which it did not.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LeakyTimer {
    sum_s: LeakySum,
    /// Time of the update before. ns
    at_ns: Option<i64>,
}

impl LeakyTimer {
    /// Notes at `t_ns` whether the condition holds.
    pub(super) fn update(&mut self, holds: bool, t_ns: i64) {
        self.update_weighted(if holds { 1.0 } else { 0.0 }, t_ns);
    }

    /// Notes at `t_ns` how much the time counts in which the condition holds; 0: it does not hold.
    pub(super) fn update_weighted(&mut self, weight: f64, t_ns: i64) {
        let period_s = self.at_ns.replace(t_ns).map_or(0.0, |at_ns| elapsed_s(at_ns, t_ns));
        if weight > 0.0 {
            self.sum_s.add(weight * period_s);
        } else {
            self.sum_s.leak(LEAK_RATIO * period_s);
        }
    }

    /// Sets a sum above `max_s` to that.
    pub(super) fn limit(&mut self, max_s: f64) {
        self.sum_s.limit(max_s);
    }

    /// Whether the sum is above `for_s`.
    pub(super) fn exceeds(self, for_s: f64) -> bool {
        self.sum_s.value() > for_s
    }
}

/// Times for how long a condition has been reported: from the first to the newest of consecutive reports that confirm
/// it. The time after the newest report does not count: one wrong report alone lasts 0 s.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ReportTimer {
    since: HoldTimer,
    newest_ns: i64,
}

impl ReportTimer {
    /// Notes whether the condition holds by the report of the time `reported_ns`, which may be the report of the call
    /// before; `None`: there is no report, and the time begins anew.
    pub(super) fn update(&mut self, holds: bool, reported_ns: Option<i64>) {
        self.newest_ns = reported_ns.unwrap_or(self.newest_ns);
        self.since.update(holds && reported_ns.is_some(), self.newest_ns);
    }

    /// Whether it was reported for `for_s`, to a millisecond: the time of a report follows from its age.
    pub(super) fn has_lasted(self, for_s: f64) -> bool {
        self.since.has_lasted(self.newest_ns, for_s - 1e-3)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_condition_is_reported_from_its_first_to_its_newest_report() {
        const MS: i64 = 1_000_000;
        let mut reported = ReportTimer::default();
        let mut lasts = |holds, reported_ms: Option<i64>| {
            reported.update(holds, reported_ms.map(|t_ms| t_ms * MS));
            reported.has_lasted(1.0)
        };
        // Twice a second, and once more for the first: nothing is known between them.
        assert_eq!(
            [0, 0, 500, 1000].map(|t_ms| lasts(true, Some(t_ms))),
            [false, false, false, true]
        );
        assert!(!lasts(false, Some(1100)) && !lasts(true, Some(1200)) && !lasts(true, Some(2100)));
        assert!(lasts(true, Some(2200)));
        assert!(!lasts(true, None) && !lasts(true, Some(2300)), "without a report it begins anew");
    }

    #[test]
    fn a_sum_forgets_five_times_as_slowly_as_it_grows() {
        let mut leaky = LeakyTimer::default();
        let mut keep = |holds, t_s: i64| {
            leaky.update(holds, t_s * 1_000_000_000);
            [2.9, 3.1].map(|for_s| leaky.exceeds(for_s))
        };
        assert_eq!(keep(true, 5), [false, false], "the first tick has no time");
        assert_eq!(keep(true, 9), [true, true]);
        assert_eq!(keep(false, 14), [true, false]);
        assert_eq!(keep(false, 30), [false, false]);
        assert_eq!(keep(true, 33), [true, false], "not below zero");
        assert!(!leaky.exceeds(3.0), "the limit itself");
        leaky.limit(2.0);
        assert!(!leaky.exceeds(2.0) && leaky.exceeds(1.9));
    }

    #[test]
    fn a_limit_is_exceeded_above_it_and_by_nan() {
        for (value, is_above) in [(0.9, false), (1.0, false), (1.1, true), (f64::NAN, true)] {
            assert_eq!(exceeds(value, 1.0), is_above, "{value}");
        }
    }

    #[test]
    fn a_condition_lasts_from_its_first_tick_on_and_a_break_begins_it_anew() {
        let mut since = HoldTimer::default();
        let lasted = [(true, 0), (true, 400), (false, 500), (true, 600), (true, 1000)].map(
            |(holds, t_ms)| {
                let t_ns = t_ms * 1_000_000;
                since.update(holds, t_ns);
                since.has_lasted(t_ns, 0.4)
            },
        );
        assert_eq!(lasted, [false, true, false, false, true]);
        assert!((elapsed_s(1_500_000_000, 3_000_000_000) - 1.5).abs() < 1e-12);
    }
}
