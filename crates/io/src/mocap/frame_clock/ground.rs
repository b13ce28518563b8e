//! What the arrivals on the ground tell of a source's frame numbers: their pace and their offset.
//!
//! Delays are never negative, so that the arrivals of a healthy stream lie on a straight line or above
//! it, and the line is their lower envelope. Its rate is measured between the lowest arrivals of the
//! first and of the last third of a window, as in Tukey's resistant line with minima in place of
//! medians: one punctual frame in each is enough, whatever the others do.
//!
//! The announced rate stands unless the arrivals contradict it. A count of every n-th frame, or of n
//! messages a frame, is a rate that differs by a whole factor, and is believed. Any other pace may as
//! well be a delay that grows, and is not. What is measured in a few seconds is less exact than a right
//! announcement, and replaces it only after a long window.

use super::{Arrival, DRIFT, Line, SAME_COUNT_NS};
use crate::clock::{SpanNs, TimeNs};

/// How far back arrivals count: on the ground a stream that stays late is believed again after it.
const WINDOW: SpanNs = SpanNs::from_ms(30_000);

/// Shortest window that tells a pace.
const WINDOW_MIN: SpanNs = SpanNs::from_ms(2_000);

/// Of each of these spans the lowest arrival is kept.
const SPACING: SpanNs = SpanNs::from_ms(100);

/// Arrivals in a window.
const ARRIVALS_MAX: usize = 300;

/// Rates that make sense. Hz
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=10_000.0;

/// Largest whole factor between the announced and the counted rate.
const FACTOR_MAX: f64 = 8.0;

/// Error of a measured pace by the jitter of two arrivals, times the span between them. ns
const JITTER_NS: f64 = 10e6;

/// Largest difference between a rate and its nominal value, such as 59.94 Hz that is called 60. 1
const DEVIATION_MAX: f64 = 2e-3;

/// Time between two arrivals from which on a measured pace is better than a nominal one. ns
const SPAN_MEASURED_NS: f64 = 15e9;

/// Rounds in which the lowest arrivals are found again with the rate between those of the round before.
const ROUNDS: usize = 3;

/// The arrivals of one count, thinned, and what they tell.
#[derive(Debug)]
pub(super) struct Ground {
    /// Oldest first.
    arrivals: Vec<Arrival>,
    /// When the span of the newest of them began.
    span_at: TimeNs,
    newest: i64,
    announced_hz: f64,
    line: Option<Line>,
    pace: Pace,
}

/// What the arrivals say about the announced rate.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Pace {
    /// Nothing yet: it is believed.
    Announced,
    /// The numbers keep pace with time, perhaps by a whole factor.
    Confirmed,
    /// The measured time per number does not go with it. ns
    Contradicted(f64),
}

impl Ground {
    pub(super) fn new() -> Self {
        Self {
            arrivals: Vec::with_capacity(ARRIVALS_MAX),
            span_at: TimeNs(0),
            newest: 0,
            announced_hz: 0.0,
            line: None,
            pace: Pace::Announced,
        }
    }

    /// The next arrival begins a count.
    pub(super) fn forget(&mut self) {
        self.arrivals.clear();
        self.line = None;
        self.pace = Pace::Announced;
    }

    /// The newest line, also while the pace is contradicted: in flight such a line fits no frame.
    pub(super) fn line(&self) -> Option<Line> {
        self.line
    }

    pub(super) fn is_confirmed(&self) -> bool {
        self.line.is_some() && self.pace == Pace::Confirmed
    }

    pub(super) fn count_hz(&self) -> Option<f64> {
        match self.pace {
            Pace::Announced => None,
            Pace::Confirmed => self.line.map(|line| 1e9 / line.period_ns),
            Pace::Contradicted(period_ns) => Some(1e9 / period_ns),
        }
    }

    /// As [`super::FrameClock::measured_at`], on the ground.
    pub(super) fn measured_at(&mut self, arrival: Arrival, rate_hz: f64) -> Option<TimeNs> {
        if !RATES_HZ.contains(&rate_hz) {
            self.forget();
            return None;
        }
        let goes_on = |line: &Line| {
            // Of numbers at a wrong pace none is where the line expects it.
            let is_near = line.late_ns(arrival).abs() <= SAME_COUNT_NS;
            self.announced_hz.total_cmp(&rate_hz).is_eq()
                && arrival.number > self.newest
                && (is_near || matches!(self.pace, Pace::Contradicted(_)))
        };
        let line = self.line.filter(goes_on).unwrap_or_else(|| {
            self.forget();
            self.announced_hz = rate_hz;
            Line::through(arrival, 1e9 / rate_hz)
        });
        self.newest = arrival.number;
        let period_ns = if self.keep(arrival, line) { self.judge(line) } else { line.period_ns };
        let line = self.envelope(Line { period_ns, as_of: arrival.at, ..line });
        self.line = Some(line);
        let is_known = !matches!(self.pace, Pace::Contradicted(_));
        is_known.then(|| line.measured_at(arrival))
    }

    /// Takes in an arrival; whether it began a span.
    fn keep(&mut self, arrival: Arrival, line: Line) -> bool {
        let is_in_span = arrival.at.since(self.span_at) < SPACING;
        if let Some(last) = self.arrivals.last_mut().filter(|_| is_in_span) {
            if line.late_ns(arrival) < line.late_ns(*last) {
                *last = arrival;
            }
            return false;
        }
        self.arrivals.retain(|old| arrival.at.since(old.at) < WINDOW);
        if self.arrivals.len() == ARRIVALS_MAX {
            self.arrivals.remove(0);
        }
        self.arrivals.push(arrival);
        self.span_at = arrival.at;
        true
    }

    /// The time per number that follows from the arrivals, and with it the pace. ns
    fn judge(&mut self, line: Line) -> f64 {
        let Some((measured_ns, span_ns)) = self.rate(line) else { return line.period_ns };
        let announced_ns = 1e9 / self.announced_hz;
        let factor = measured_ns / announced_ns;
        let is_slower = factor >= 1.0;
        let whole = if is_slower { factor.round() } else { factor.recip().round() };
        let nominal_ns = if is_slower { announced_ns * whole } else { announced_ns / whole };
        let deviation = (measured_ns / nominal_ns - 1.0).abs();
        let jitter = JITTER_NS / span_ns;
        // A rate that is not positive makes a factor that is not, or NaN.
        if whole <= FACTOR_MAX && factor > 0.0 && deviation <= DEVIATION_MAX + jitter {
            self.pace = Pace::Confirmed;
            let is_measured = deviation > jitter && span_ns >= SPAN_MEASURED_NS;
            if is_measured { measured_ns } else { nominal_ns }
        } else {
            self.pace = Pace::Contradicted(measured_ns);
            line.period_ns
        }
    }

    /// Time per number between the lowest arrivals of the first and of the last third, and the time
    /// between them; `None` while the window is short. ns
    fn rate(&self, mut line: Line) -> Option<(f64, f64)> {
        let (first, last) = (self.arrivals.first()?, self.arrivals.last()?);
        let length = last.at.since(first.at);
        if length < WINDOW_MIN {
            return None;
        }
        let is_early = |one: &&Arrival| one.at.since(first.at).0 <= length.0 / 3;
        let is_recent = |one: &&Arrival| last.at.since(one.at).0 <= length.0 / 3;
        let mut span_ns = 0.0;
        for _ in 0..ROUNDS {
            let delay =
                |a: &&Arrival, b: &&Arrival| line.late_ns(**a).total_cmp(&line.late_ns(**b));
            let early = self.arrivals.iter().filter(is_early).min_by(delay)?;
            let recent = self.arrivals.iter().filter(is_recent).min_by(delay)?;
            span_ns = recent.at.since(early.at).0 as f64;
            line.period_ns = span_ns / recent.number.saturating_sub(early.number) as f64;
        }
        Some((line.period_ns, span_ns))
    }

    /// `line` at the height of the lowest arrival, drift allowed for.
    fn envelope(&self, line: Line) -> Line {
        let drift_ns = |since: TimeNs| DRIFT * line.as_of.since(since).0 as f64;
        let level_ns = |one: &Arrival| line.late_ns(*one) + drift_ns(one.at);
        let lowest_ns = self.arrivals.iter().map(level_ns).fold(f64::INFINITY, f64::min);
        Line { offset_ns: line.offset_ns + lowest_ns, ..line }
    }
}
