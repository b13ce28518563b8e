//! The pace of frame numbers, for a report: no time depends on it.

use super::arrivals::Arrivals;
use super::{Arrival, Line};
use crate::clock::{SpanNs, TimeNs};

/// Shortest window that tells a pace.
const WINDOW_MIN: SpanNs = SpanNs::from_ms(900);

/// The lowest arrivals of the newest seconds.
#[derive(Debug, Clone, Default)]
pub(in super::super) struct PaceMeter {
    arrivals: Arrivals,
    first: Option<Arrival>,
    newest: Option<Arrival>,
}

impl PaceMeter {
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
        self.arrivals.keep(arrival, line);
    }

    /// Numbers per second; `None` for a window of less than 0.9 s. Hz
    pub(in super::super) fn hz(&self) -> Option<f64> {
        let line = Self::line(self.first?, self.newest?);
        let pace = self.arrivals.pace(line, WINDOW_MIN)?;
        Some(1e9 / pace.period_ns).filter(|hz| hz.is_finite() && *hz > 0.0)
    }

    fn line(first: Arrival, newest: Arrival) -> Line {
        let period_ns = first.period_to_ns(newest);
        Line::through(first, if period_ns.is_finite() { period_ns } else { 0.0 })
    }
}
