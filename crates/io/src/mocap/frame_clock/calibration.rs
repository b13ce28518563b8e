//! Offset and skew of a source's frame numbers, estimated from the arrivals on the ground.
//!
//! The announced rate stands unless the arrivals contradict it. A count of every n-th frame, or of n messages a
//! frame, is a rate that differs by a whole factor, and is accepted. So is a rate that is wrong by some thousandths,
//! once the window is long enough to show it. Any other rate may as well be a delay that grows, and is refused. A rate
//! that is measured in a few seconds is less exact than a right announcement, and replaces it only after a long window.

use super::arrivals::Arrivals;
use super::bounds::{Bounds, DEVIATION_MAX, JITTER_NS};
use super::{Arrival, Line, SAME_COUNT_NS, SKEW_MAX};
use crate::clock::{SpanNs, TimeNs};

/// Shortest window by which a rate is measured.
const WINDOW_MIN: SpanNs = SpanNs::from_ms(2_000);

/// Rates that make sense, up to that of stamps in microseconds. Hz
const RATES_HZ: std::ops::RangeInclusive<f64> = 1.0..=1e6;

/// Largest whole factor between the announced and the counted rate. 1
const FACTOR_MAX: f64 = 8.0;

/// Jitter of two arrivals of a window that is straight. ns
const JITTER_MIN_NS: f64 = 3e6;

/// Time between two arrivals from which on a measured rate that differs from the nominal one is better. ns
const SPAN_MEASURED_NS: f64 = 3e9;

/// The arrivals of one count, thinned, and the line that they make.
#[derive(Debug)]
pub(super) struct Calibration {
    arrivals: Arrivals,
    pub(super) newest: i64,
    pub(super) announced_hz: f64,
    /// Time per number as announced, whole factor included. ns
    nominal_ns: f64,
    /// The newest line, also while the rate is contradicted: in flight such a line fits no frame.
    pub(super) line: Option<Line>,
    rate_check: RateCheck,
}

/// Comparison of the announced rate with the arrivals.
#[derive(Debug, Clone, Copy, PartialEq)]
enum RateCheck {
    /// Not compared yet: the announced rate counts.
    Announced,
    /// The numbers come at the announced rate, perhaps by a whole factor.
    Confirmed,
    /// Within the jitter the announced rate may hold or not; decided by a longer window. Measured time per number. ns
    Doubtful(f64),
    /// The measured time per number contradicts the announced rate. ns
    Contradicted(f64),
}

impl Calibration {
    pub(super) fn new() -> Self {
        Self {
            arrivals: Arrivals::new(),
            newest: 0,
            announced_hz: 0.0,
            nominal_ns: 0.0,
            line: None,
            rate_check: RateCheck::Announced,
        }
    }

    /// The next arrival begins a count.
    pub(super) fn forget(&mut self) {
        self.arrivals.clear();
        self.line = None;
        self.rate_check = RateCheck::Announced;
    }

    /// The arrivals up to now, which a flight goes on with.
    pub(super) fn arrivals_mut(&mut self) -> &mut Arrivals {
        &mut self.arrivals
    }

    /// Bounds within which a flight may correct the time per number; `None`: not at all.
    pub(super) fn bounds(&self) -> Option<Bounds> {
        let line = self.line.filter(|_| !matches!(self.rate_check, RateCheck::Contradicted(_)))?;
        let mut bounds = Bounds::around(self.nominal_ns);
        let fit = self.arrivals.fit_rate(line, WINDOW_MIN);
        if let Some(fit) = fit.filter(|fit| fit.curvature_ns.abs() <= JITTER_NS) {
            bounds.narrow(fit.period_ns, fit.span_ns);
        }
        Some(bounds)
    }

    pub(super) fn is_confirmed(&self) -> bool {
        self.line.is_some() && self.rate_check == RateCheck::Confirmed
    }

    pub(super) fn count_hz(&self) -> Option<f64> {
        match self.rate_check {
            RateCheck::Announced => None,
            RateCheck::Confirmed => self.line.map(|line| 1e9 / line.period_ns),
            RateCheck::Doubtful(period_ns) | RateCheck::Contradicted(period_ns) => {
                Some(1e9 / period_ns)
            }
        }
    }

    /// As [`super::FrameClock::measured_at`], on the ground.
    pub(super) fn measured_at(&mut self, arrival: Arrival, rate_hz: f64) -> Option<TimeNs> {
        if !RATES_HZ.contains(&rate_hz) {
            self.forget();
            return None;
        }
        let goes_on = |line: &Line| {
            // Frames whose numbers have another rate do not lie on the line.
            let is_near = line.late_ns(arrival).abs() <= SAME_COUNT_NS;
            self.announced_hz.total_cmp(&rate_hz).is_eq()
                && arrival.number > self.newest
                && (is_near || matches!(self.rate_check, RateCheck::Contradicted(_)))
        };
        let line = self.line.filter(goes_on).unwrap_or_else(|| {
            self.forget();
            self.announced_hz = rate_hz;
            self.nominal_ns = 1e9 / rate_hz;
            Line::through(arrival, self.nominal_ns)
        });
        self.newest = arrival.number;
        let is_new_span = self.arrivals.add(arrival, line);
        let period_ns = if is_new_span { self.estimate_period(line) } else { line.period_ns };
        let line = self.envelope(Line { period_ns, as_of: arrival.at, ..line });
        self.line = Some(line);
        let is_known = !matches!(self.rate_check, RateCheck::Contradicted(_));
        is_known.then(|| line.measured_at(arrival))
    }

    /// The time per number that follows from the arrivals; sets the rate check. ns
    fn estimate_period(&mut self, line: Line) -> f64 {
        let Some(fit) = self.arrivals.fit_rate(line, WINDOW_MIN) else { return line.period_ns };
        let (measured_ns, span_ns) = (fit.period_ns, fit.span_ns);
        let announced_ns = 1e9 / self.announced_hz;
        let factor = measured_ns / announced_ns;
        let is_slower = factor >= 1.0;
        let whole = if is_slower { factor.round() } else { factor.recip().round() };
        let nominal_ns = if is_slower { announced_ns * whole } else { announced_ns / whole };
        let deviation = (measured_ns / nominal_ns - 1.0).abs();
        let jitter = fit.curvature_ns.abs().clamp(JITTER_MIN_NS, JITTER_NS) / span_ns;
        // A rate that is not positive makes a factor that is not, or NaN.
        if whole <= FACTOR_MAX && factor > 0.0 && deviation <= DEVIATION_MAX + jitter {
            // A flight corrects no rate beyond the limit: so a flight begins once jitter does not hide one.
            let is_within = deviation + jitter <= DEVIATION_MAX;
            self.rate_check =
                if is_within { RateCheck::Confirmed } else { RateCheck::Doubtful(measured_ns) };
            self.nominal_ns = nominal_ns;
            let is_measured = deviation > jitter && span_ns >= SPAN_MEASURED_NS;
            if is_measured { measured_ns } else { nominal_ns }
        } else {
            self.rate_check = RateCheck::Contradicted(measured_ns);
            line.period_ns
        }
    }

    /// `line` at the height of the lowest arrival, drift allowed for.
    fn envelope(&self, line: Line) -> Line {
        let drift_ns = |since: TimeNs| SKEW_MAX * line.as_of.since(since).0 as f64;
        let level_ns = |one: &Arrival| line.late_ns(*one) + drift_ns(one.at);
        let lowest_ns = self.arrivals.iter().map(level_ns).fold(f64::INFINITY, f64::min);
        Line { offset_ns: line.offset_ns + lowest_ns, ..line }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After `seconds` of a count with `count_hz` numbers a second that is announced as one of `announced_hz`.
    fn counted(announced_hz: f64, count_hz: f64, seconds: f64) -> (Calibration, Option<TimeNs>) {
        let mut calibration = Calibration::new();
        let mut measured_at = None;
        #[expect(clippy::cast_possible_truncation, reason = "some thousand frames")]
        let frames = (seconds * count_hz).round() as i64;
        for number in 0..=frames {
            #[expect(clippy::cast_possible_truncation, reason = "some seconds")]
            let at = TimeNs((1e9 * number as f64 / count_hz).round() as i64);
            measured_at = calibration.measured_at(Arrival { number, at }, announced_hz);
        }
        (calibration, measured_at)
    }

    #[test]
    fn a_rate_that_makes_no_sense_gives_no_time_and_forgets_the_count() {
        for (rate_hz, is_known) in [
            (1.0, true),
            (1.0_f64.next_down(), false),
            (1e6, true),
            (1e6_f64.next_up(), false),
            (f64::NAN, false),
            (-100.0, false),
        ] {
            let (mut calibration, _) = counted(100.0, 100.0, 3.0);
            let at = TimeNs(3_010_000_000);
            let measured_at = calibration.measured_at(Arrival { number: 301, at }, rate_hz);
            assert_eq!(measured_at.is_some(), is_known, "{rate_hz} Hz");
            assert!(!calibration.is_confirmed(), "{rate_hz} Hz");
        }
    }

    #[test]
    fn a_rate_is_confirmed_after_two_seconds() {
        assert!(!counted(100.0, 100.0, 1.99).0.is_confirmed());
        let (calibration, measured_at) = counted(100.0, 100.0, 2.0);
        assert!(calibration.is_confirmed() && calibration.bounds().is_some());
        assert_eq!(measured_at, Some(TimeNs(2_000_000_000)));
        assert!((calibration.count_hz().unwrap() - 100.0).abs() < 1e-6);
    }

    #[test]
    fn a_whole_factor_up_to_eight_is_accepted_and_another_rate_is_not() {
        for (announced_hz, count_hz, is_accepted) in [
            (50.0, 400.0, true),
            (50.0, 450.0, false),
            (400.0, 50.0, true),
            (450.0, 50.0, false),
            (100.0, 100.4, true),
            (100.0, 130.0, false),
        ] {
            let (calibration, measured_at) = counted(announced_hz, count_hz, 6.0);
            let trouble = format!("{count_hz} of {announced_hz} Hz");
            assert_eq!(calibration.is_confirmed(), is_accepted, "{trouble}");
            assert_eq!(measured_at.is_some(), is_accepted, "{trouble}");
            assert_eq!(calibration.bounds().is_some(), is_accepted, "{trouble}");
            assert!((calibration.count_hz().unwrap() / count_hz - 1.0).abs() < 1e-3, "{trouble}");
        }
    }
}
