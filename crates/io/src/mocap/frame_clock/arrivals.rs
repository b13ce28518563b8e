//! The newest arrivals of one count, thinned, and their lower envelope.
//!
//! Delays are never negative, so that the arrivals of a healthy stream lie on a straight line or above
//! it, and the line is their lower envelope. Its period is measured between the lowest arrivals of the
//! first and of the last third of a window, as in Tukey's resistant line with minima in place of
//! medians: one punctual frame in each is enough, whatever the others do. The lowest arrival of the
//! second third shows whether the line is straight.

use super::{Arrival, Line};
use crate::clock::{SpanNs, TimeNs};

/// How far back arrivals count.
const WINDOW: SpanNs = SpanNs::from_ms(30_000);

/// Of each of these spans the lowest arrival is kept.
const SPACING: SpanNs = SpanNs::from_ms(100);

/// Arrivals in a window.
const ARRIVALS_MAX: usize = 300;

/// Rounds in which the lowest arrivals are found again with the rate between those of the round before.
const ROUNDS: usize = 3;

/// The arrivals of one count, at most [`ARRIVALS_MAX`].
#[derive(Debug, Clone, Default)]
pub(super) struct Arrivals {
    /// Oldest first.
    kept: Vec<Arrival>,
    /// When the span of the newest of them began.
    span_at: TimeNs,
}

/// The line through the lowest arrivals at both ends of a window.
#[derive(Debug, Clone, Copy)]
pub(super) struct RateFit {
    pub(super) early: Arrival,
    pub(super) recent: Arrival,
    /// Time per number between the two. ns
    pub(super) period_ns: f64,
    /// Time between them. ns
    pub(super) span_ns: f64,
    /// Distance of the lowest arrival of the second third above the line; infinite if there is none. ns
    pub(super) curvature_ns: f64,
}

impl Arrivals {
    pub(super) fn new() -> Self {
        Self { kept: Vec::with_capacity(ARRIVALS_MAX), span_at: TimeNs(0) }
    }

    pub(super) fn clear(&mut self) {
        self.kept.clear();
    }

    /// Oldest first.
    pub(super) fn iter(&self) -> impl Iterator<Item = &Arrival> {
        self.kept.iter()
    }

    /// Adds an arrival, or replaces the newest by one of the same span that is less late. Returns whether `arrival`
    /// began a span.
    pub(super) fn add(&mut self, arrival: Arrival, line: Line) -> bool {
        let is_in_span = arrival.at.since(self.span_at) < SPACING;
        if let Some(last) = self.kept.last_mut().filter(|_| is_in_span) {
            if line.late_ns(arrival) < line.late_ns(*last) {
                *last = arrival;
            }
            return false;
        }
        self.kept.retain(|old| arrival.at.since(old.at) < WINDOW);
        if self.kept.len() == ARRIVALS_MAX {
            self.kept.remove(0);
        }
        self.kept.push(arrival);
        self.span_at = arrival.at;
        true
    }

    /// Line through the lowest arrivals, beginning with the period of `line`; `None` while the window is shorter
    /// than `least`.
    pub(super) fn fit_rate(&self, mut line: Line, least: SpanNs) -> Option<RateFit> {
        let (first, last) = (self.kept.first()?, self.kept.last()?);
        let length = last.at.since(first.at);
        if length < least {
            return None;
        }
        let is_early = |one: &&Arrival| one.at.since(first.at).0 <= length.0 / 3;
        let is_recent = |one: &&Arrival| last.at.since(one.at).0 <= length.0 / 3;
        let (mut early, mut recent) = (*first, *last);
        for _ in 0..ROUNDS {
            let delay =
                |a: &&Arrival, b: &&Arrival| line.late_ns(**a).total_cmp(&line.late_ns(**b));
            early = *self.kept.iter().filter(is_early).min_by(delay)?;
            recent = *self.kept.iter().filter(is_recent).min_by(delay)?;
            line.period_ns = early.period_to_ns(recent);
        }
        let line = Line::through(early, line.period_ns);
        let between = self.kept.iter().filter(|one| !is_early(one) && !is_recent(one));
        let curvature_ns = between.map(|one| line.late_ns(*one)).fold(f64::INFINITY, f64::min);
        let span_ns = recent.at.since(early.at).0 as f64;
        Some(RateFit { early, recent, period_ns: line.period_ns, span_ns, curvature_ns })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrival(number: i64, ms: i64) -> Arrival {
        Arrival { number, at: TimeNs(0).after(SpanNs::from_ms(ms)) }
    }

    /// Ten milliseconds a number.
    fn line() -> Line {
        Line::through(arrival(0, 0), 1e7)
    }

    fn numbers(arrivals: &Arrivals) -> Vec<i64> {
        arrivals.iter().map(|one| one.number).collect()
    }

    #[test]
    fn of_each_tenth_of_a_second_the_least_late_arrival_is_kept() {
        let mut arrivals = Arrivals::new();
        assert!(arrivals.add(arrival(0, 5), line()), "the first begins a span");
        assert!(!arrivals.add(arrival(2, 25), line()), "as late");
        assert_eq!(numbers(&arrivals), [0]);
        assert!(!arrivals.add(arrival(3, 34), line()), "less late");
        assert_eq!(numbers(&arrivals), [3]);
        // The span counts from where it began, at 5 ms.
        assert!(!arrivals.add(arrival(9, 104), line()));
        assert!(arrivals.add(arrival(10, 105), line()));
        assert_eq!(numbers(&arrivals), [3, 10]);
    }

    #[test]
    fn arrivals_of_half_a_minute_ago_are_dropped() {
        let mut arrivals = Arrivals::new();
        for number in [0, 10] {
            arrivals.add(arrival(number, 10 * number), line());
        }
        arrivals.add(arrival(2_999, 29_999), line());
        assert_eq!(numbers(&arrivals), [0, 10, 2_999]);
        arrivals.add(arrival(3_010, 30_100), line());
        assert_eq!(numbers(&arrivals), [2_999, 3_010]);
    }

    #[test]
    fn a_window_shows_its_rate_from_its_least_length_on_and_how_straight_it_is() {
        // In the second third every frame is late by 4 ms.
        let late_ms = |number: i64| if (40..=50).contains(&number) { 4 } else { 0 };
        let window = |last: i64| {
            let mut arrivals = Arrivals::new();
            for number in (0..=last).step_by(10) {
                arrivals.add(arrival(number, 10 * number + late_ms(number)), line());
            }
            arrivals
        };
        let least = SpanNs::from_ms(900);
        assert!(window(80).fit_rate(line(), least).is_none());
        let fit = window(90).fit_rate(line(), least).unwrap();
        assert!(
            (fit.period_ns - 1e7).abs() < 1e-3 && (fit.curvature_ns - 4e6).abs() < 1.0,
            "{fit:?}"
        );
        assert!(Arrivals::new().fit_rate(line(), SpanNs(0)).is_none(), "nothing has arrived");
    }
}
