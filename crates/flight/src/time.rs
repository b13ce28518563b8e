//! Time as a number: moments and lengths of time, stamped by the caller, who has a clock.

use std::time::Duration;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Nanoseconds in a second.
pub const NS_PER_S: i64 = 1_000_000_000;

/// A moment. Monotonic, ns since the start of the log.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct TimeNs(pub i64);

/// A length of time. ns, negative if it runs backwards.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(transparent)]
pub struct SpanNs(pub i64);

impl TimeNs {
    /// Time from `earlier` to `self`; saturates at the ends of `i64`.
    pub fn since(self, earlier: Self) -> SpanNs {
        SpanNs(self.0.saturating_sub(earlier.0))
    }

    /// The moment `span` later; saturates at the ends of `i64`.
    #[must_use]
    pub fn after(self, span: SpanNs) -> Self {
        Self(self.0.saturating_add(span.0))
    }

    /// Time since the start of the log. s
    pub fn seconds(self) -> f64 {
        SpanNs(self.0).seconds()
    }
}

impl SpanNs {
    /// A span of whole milliseconds.
    pub const fn from_ms(ms: i64) -> Self {
        Self(ms.saturating_mul(1_000_000))
    }

    /// The span of so many seconds, to the nearest nanosecond; beyond what 64 bits hold the longest one, 0 for NaN.
    pub fn from_seconds(seconds: f64) -> Self {
        #[expect(clippy::cast_possible_truncation, reason = "a cast saturates")]
        Self((seconds * NS_PER_S as f64).round() as i64)
    }

    /// The span. s
    pub fn seconds(self) -> f64 {
        self.0 as f64 / NS_PER_S as f64
    }

    /// The span to sleep; zero if it is negative.
    pub fn duration(self) -> Duration {
        Duration::from_nanos(u64::try_from(self.0).unwrap_or(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spans_are_differences_of_moments() {
        let (early, late) = (TimeNs(1_000_000_000), TimeNs(1_250_000_000));
        assert_eq!(late.since(early), SpanNs::from_ms(250));
        assert_eq!(early.after(SpanNs::from_ms(250)), late);
        assert!((late.since(early).seconds() - 0.25).abs() < 1e-15);
        assert!((early.since(late).seconds() + 0.25).abs() < 1e-15);
        assert_eq!(early.since(late).duration(), Duration::ZERO);
    }

    #[test]
    fn extreme_moments_saturate() {
        assert_eq!(TimeNs(i64::MAX).since(TimeNs(i64::MIN)), SpanNs(i64::MAX));
        assert_eq!(TimeNs(i64::MAX).after(SpanNs(1)), TimeNs(i64::MAX));
    }

    #[test]
    fn moments_are_plain_numbers_in_json() {
        assert_eq!(serde_json::to_string(&TimeNs(42)).unwrap(), "42");
        assert_eq!(serde_json::from_str::<TimeNs>("42").unwrap(), TimeNs(42));
    }
}
