//! The rate of frame numbers, for a report: no time depends on it.

use super::arrivals::Arrivals;
use super::{Arrival, Line};
use crate::clock::{SpanNs, TimeNs};

/// Shortest window by which a rate is measured.
const WINDOW_MIN: SpanNs = SpanNs::from_ms(900);

/// The lowest arrivals of the newest seconds.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct RateMeter {
    arrivals: Arrivals,
    first: Option<Arrival>,
    newest: Option<Arrival>,
}

impl RateMeter {
    /// Takes in a number; one that is not beyond the newest begins anew.
    pub(in super::super) fn take(&mut self, number: i64, at: TimeNs) {
        let arrival = Arrival { number, at };
        if self.newest.is_some_and(|newest| number <= newest.number) {
            self.arrivals.clear();
            self.first = None;
        }
        self.newest = Some(arrival);
        let first = *self.first.get_or_insert(arrival);
        let line = Self::line(first, arrival);
        self.arrivals.add(arrival, line);
    }

    /// Numbers per second; `None` for a window of less than 0.9 s. Hz
    pub(in super::super) fn hz(&self) -> Option<f64> {
        let line = Self::line(self.first?, self.newest?);
        let fit = self.arrivals.fit_rate(line, WINDOW_MIN)?;
        Some(1e9 / fit.period_ns).filter(|hz| hz.is_finite() && *hz > 0.0)
    }

    fn line(first: Arrival, newest: Arrival) -> Line {
        let period_ns = first.period_to_ns(newest);
        Line::through(first, if period_ns.is_finite() { period_ns } else { 0.0 })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(ms: i64) -> TimeNs {
        TimeNs(0).after(SpanNs::from_ms(ms))
    }

    #[test]
    fn a_rate_is_known_after_nine_tenths_of_a_second_and_forgotten_by_a_number_again() {
        let mut meter = RateMeter::default();
        assert_eq!(meter.hz(), None);
        for number in 0..90 {
            meter.take(number, ms(10 * number));
            assert_eq!(meter.hz(), None, "{number}");
        }
        meter.take(90, ms(900));
        let hz = meter.hz().unwrap();
        assert!((hz - 100.0).abs() < 1e-9, "{hz} Hz");
        meter.take(90, ms(910));
        assert_eq!(meter.hz(), None, "the same number");
    }

    #[test]
    fn numbers_that_come_at_one_moment_have_no_rate() {
        let mut meter = RateMeter::default();
        for number in 0..200 {
            meter.take(number, ms(0));
        }
        assert_eq!(meter.hz(), None);
    }
}
