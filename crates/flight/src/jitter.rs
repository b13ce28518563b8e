//! How punctual the loop is: lateness and length of its ticks, counted in fixed bins.
//!
//! Owns the bins. They are fixed so that histograms of many flights can be added, and so that counting
//! allocates nothing.

use schemars::JsonSchema;
use serde::Serialize;

use crate::cycle::Timing;

/// Upper ends of the bins, inclusive; a last bin holds what is longer. us
const BINS_US: [i64; BINS] =
    [10, 20, 50, 100, 200, 500, 1_000, 2_000, 5_000, 10_000, 15_000, 20_000, 50_000, 100_000];
const BINS: usize = 14;

/// Ticks between two records of the log. ticks
pub const RECORD_EVERY_TICKS: u64 = 50;

/// Counts of lengths of time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
pub struct Histogram {
    /// Upper end of each bin but the last, which has none. us
    upper_us: [i64; BINS],
    /// How many fell into each bin.
    counts: [u64; BINS + 1],
    /// The longest. us
    max_us: i64,
}

/// Punctuality of a flight, from its first tick on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
pub struct Jitter {
    /// Ticks since the start of the log.
    step: u64,
    /// From when a tick was due to when it began.
    pub lateness: Histogram,
    /// From the begin of a tick to its end.
    pub duration: Histogram,
}

/// Nothing counted.
impl Default for Histogram {
    fn default() -> Self {
        Self { upper_us: BINS_US, counts: [0; BINS + 1], max_us: 0 }
    }
}

impl Histogram {
    fn add(&mut self, ns: i64) {
        // A started microsecond counts as a whole one.
        let us = ns.max(0).saturating_add(999) / 1000;
        let bin = BINS_US.partition_point(|upper_us| *upper_us < us);
        if let Some(count) = self.counts.get_mut(bin) {
            *count += 1;
        }
        self.max_us = self.max_us.max(us);
    }

    /// Quantile of the ticks at `fraction`, at the resolution of the bins; zero without any. us
    ///
    /// Real time: no allocation, one pass over the bins.
    pub fn quantile_us(&self, fraction: f64) -> i64 {
        let total: u64 = self.counts.iter().sum();
        let mut so_far = 0;
        for (count, upper_us) in self.counts.iter().zip(BINS_US) {
            so_far += count;
            if so_far as f64 >= fraction * total as f64 {
                return upper_us.min(self.max_us);
            }
        }
        self.max_us
    }

    /// The longest that was counted, exact; zero without any. us
    pub fn max_us(&self) -> i64 {
        self.max_us
    }
}

impl Jitter {
    /// Counts lateness and length of a tick, whose step becomes that of the record.
    ///
    /// Real time: no allocation, constant cost.
    pub fn add(&mut self, timing: &Timing) {
        self.step = timing.step;
        self.lateness.add(timing.late_ns);
        self.duration.add(timing.tick_ns);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_falls_into_the_bin_that_holds_it() {
        let mut histogram = Histogram::default();
        for (ns, bin) in [(-5, 0), (10_000, 0), (10_001, 1), (1_000_000, 6), (1_000_001, 7)] {
            let before = histogram.counts[bin];
            histogram.add(ns);
            assert_eq!(histogram.counts[bin], before + 1, "{ns} ns");
        }
        histogram.add(i64::MAX);
        assert_eq!(histogram.counts[BINS], 1);
        assert_eq!(histogram.counts.iter().sum::<u64>(), 6);
    }

    #[test]
    fn quantiles_are_upper_ends_and_never_beyond_the_longest() {
        let mut histogram = Histogram::default();
        assert_eq!(histogram.quantile_us(0.5), 0);
        for us in 1..=1000 {
            histogram.add(us * 1000);
        }
        assert_eq!(
            [0.5, 0.95, 1.0].map(|fraction| histogram.quantile_us(fraction)),
            [500, 1000, 1000]
        );
        histogram.add(3_000_000);
        assert_eq!((histogram.quantile_us(1.0), histogram.max_us()), (3000, 3000));
    }
}
