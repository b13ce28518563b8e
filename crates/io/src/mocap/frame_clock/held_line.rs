//! The line in flight: held, except for the drift of the clocks and for the last thousandths of its rate.
//!
//! Let P be the time per number of the line and P (1 + e) the true one. Frames then seem to be later by e per
//! second, 4 ms if 240 Hz are announced as 241, and are refused after some ten seconds. A delay that grows
//! steadily looks the same, so the skew e is corrected only where all of this holds: the arrivals of the last seconds
//! lie on one straight line; a line through them and through the first arrival explains them; its period is between
//! the bounds that ground and flight left so far ([`Bounds`]). After T of a healthy stream a growth of more than
//! 10 ms / T (`JITTER_NS` of `bounds.rs`) is outside of these bounds: its frames are reported as late.

use super::arrivals::{Arrivals, RateFit};
use super::bounds::Bounds;
use super::calibration::Calibration;
use super::rate_change::RateChange;
use super::shorter_delay::ShorterDelay;
use super::{Arrival, Line, SAME_COUNT_NS, SKEW_MAX};
use crate::clock::{SpanNs, TimeNs};

/// Distance from the line that jitter explains: within it a frame of a flight is on time. ns
const ON_TIME_NS: f64 = 50e6;

/// Shortest time of the climb after a take-off, before the controller steers. ns
const CLIMB_NS: f64 = 3e9;

/// How far the line may go down in that time: some tenths of a second on the ground may have been too
/// short for it, on a busy machine. ns
const CLIMB_ON_TIME_NS: f64 = 250e6;

/// Shortest window by which a rate is measured in flight.
const WINDOW_MIN: SpanNs = SpanNs::from_ms(5_000);

/// Largest curvature of a line that counts as straight, as a fraction of the correction. 1
const CURVATURE_RATIO_MAX: f64 = 0.25;

/// Curvature that is accepted at any correction. ns
const CURVATURE_SLACK_NS: f64 = 0.5e6;

/// Largest delay of the anchor above the line of the newest arrivals: with a larger one the anchor was late. ns
const ANCHOR_DELAY_MAX_NS: f64 = 3e6;

/// Smaller changes of the rate are left to the drift, which the offset follows. 1
const CHANGE_MIN: f64 = 1.2 * SKEW_MAX;

/// Smaller changes of the time between anchor and newest arrival are explained by jitter. ns
const CHANGE_MIN_NS: f64 = 3e6;

/// The line of the ground, corrected for drift and skew since the take-off.
#[derive(Debug, Clone, Copy)]
pub(super) struct HeldLine {
    /// `None`: no frame had a time before the take-off, so none has one in flight.
    line: Option<Line>,
    /// The line at the take-off, later that at the end of [`CLIMB_NS`]: frames far below it are of
    /// another count.
    begin: Option<Line>,
    is_climbing: bool,
    /// `None`: the rate is held.
    bounds: Option<Bounds>,
    /// The arrival that periods are measured from.
    anchor: Option<Arrival>,
    change: RateChange,
    shorter: ShorterDelay,
    /// Number of the newest frame with a known time.
    newest: i64,
}

impl HeldLine {
    /// A flight that begins with the line of the ground.
    pub(super) fn new(calibration: &Calibration) -> Self {
        let (line, newest) = (calibration.line, calibration.newest);
        Self {
            line,
            begin: line.map(|line| line.with_origin(newest)),
            is_climbing: true,
            bounds: calibration.bounds(),
            anchor: None,
            change: RateChange::new(calibration.announced_hz),
            shorter: ShorterDelay::default(),
            newest,
        }
    }

    /// As [`super::FrameClock::measured_at`], in flight.
    pub(super) fn measured_at(
        &mut self,
        arrival: Arrival,
        rate_hz: f64,
        arrivals: &mut Arrivals,
    ) -> Option<TimeNs> {
        let drifted = self.line?.drifted(arrival.at);
        let is_possible = self.check_arrival(arrival, drifted)?;
        // Only a frame on time shows the drift: a late one stays late while the cause lasts.
        let is_on_time = is_possible && drifted.late_ns(arrival) <= ON_TIME_NS;
        let next = self.change.observe(arrival, rate_hz, drifted, self.newest, is_on_time);
        if let Some(line) = next {
            self.bounds = self.bounds.and(Some(Bounds::around(line.period_ns)));
            return Some(self.begin_on(line, arrival, arrivals));
        }
        if !is_possible {
            let line = self.shorter.observe(arrival, self.begin?, drifted, self.newest)?;
            return Some(self.begin_on(line, arrival, arrivals));
        }
        self.shorter.restart();
        self.newest = arrival.number;
        if is_on_time {
            let line = drifted.lowered_to(arrival);
            self.line = Some(line);
            if arrivals.add(arrival, line) {
                self.correct_skew(arrivals);
            }
        }
        Some(drifted.measured_at(arrival))
    }

    /// Replaces the line by `line`, on which `arrival` lies. Returns the measurement time of `arrival`.
    fn begin_on(&mut self, line: Line, arrival: Arrival, arrivals: &mut Arrivals) -> TimeNs {
        self.line = Some(line);
        self.begin = Some(line.with_origin(arrival.number));
        self.is_climbing = false;
        self.anchor = None;
        self.newest = arrival.number;
        self.shorter.restart();
        arrivals.clear();
        line.measured_at(arrival)
    }

    /// Ends the climb when its time is over. Returns whether jitter and drift, or a delay, explain a frame.
    fn check_arrival(&mut self, arrival: Arrival, drifted: Line) -> Option<bool> {
        let begin = self.begin.as_mut()?;
        if self.is_climbing && begin.age_ns(arrival.at) > CLIMB_NS {
            (*begin, self.is_climbing) = (drifted.with_origin(arrival.number), false);
        }
        let early_ns = if self.is_climbing { CLIMB_ON_TIME_NS } else { ON_TIME_NS };
        let early_max_ns = early_ns + SKEW_MAX * begin.age_ns(arrival.at);
        let is_late = drifted.late_ns(arrival) > SAME_COUNT_NS;
        Some(!is_late && begin.late_ns(arrival) >= -early_max_ns)
    }

    /// Takes over the period of the arrivals, if the source's rate explains it.
    fn correct_skew(&mut self, arrivals: &Arrivals) {
        let (Some(line), Some(begin), Some(bounds)) =
            (&mut self.line, &mut self.begin, &mut self.bounds)
        else {
            return;
        };
        let Some(fit) = arrivals.fit_rate(*line, WINDOW_MIN) else { return };
        let RateFit { early, recent, period_ns, span_ns, curvature_ns } = fit;
        let corrected_ns = (period_ns / line.period_ns - 1.0).abs() * span_ns;
        let curvature_max_ns = CURVATURE_SLACK_NS.max(CURVATURE_RATIO_MAX * corrected_ns);
        // The lowest arrivals are not straight, or their period is outside of the bounds.
        if curvature_ns.abs() > curvature_max_ns || !bounds.contain(period_ns) {
            return;
        }
        let anchor = self.anchor.get_or_insert(early);
        if Line::through(early, period_ns).late_ns(*anchor) > ANCHOR_DELAY_MAX_NS {
            // The anchor arrived late.
            *anchor = early;
        }
        let anchor = *anchor;
        let anchored_period_ns = anchor.period_to_ns(recent);
        let apart_ns = (period_ns / anchored_period_ns - 1.0).abs() * span_ns;
        // The recent arrivals do not agree with the anchor, or the rate since the anchor is outside of the same bounds.
        if apart_ns > curvature_max_ns || !bounds.contain(anchored_period_ns) {
            return;
        }
        let anchored_span_ns = recent.at.since(anchor.at).0 as f64;
        bounds.narrow(anchored_period_ns, anchored_span_ns);
        let change = (anchored_period_ns / line.period_ns - 1.0).abs();
        // The drift of the offset, or jitter, explains the rest.
        if change < CHANGE_MIN.max(CHANGE_MIN_NS / anchored_span_ns) {
            return;
        }
        // The new line is no nearer to its lowest arrival than the old one was.
        let turned = Line::through(anchor, anchored_period_ns);
        let lowest_ns = |line: Line| {
            arrivals.iter().map(|one| line.late_ns(*one)).fold(f64::INFINITY, f64::min)
        };
        let offset_ns = turned.offset_ns + lowest_ns(turned) - lowest_ns(*line);
        *line = Line { origin: anchor.number, period_ns: anchored_period_ns, offset_ns, ..*line };
        begin.period_ns = anchored_period_ns;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD_NS: f64 = 20e6;

    /// A flight that took off at 10 s with the line through that moment.
    fn flight() -> HeldLine {
        let line = Line::through(Arrival { number: 500, at: TimeNs(10_000_000_000) }, PERIOD_NS);
        HeldLine {
            line: Some(line),
            begin: Some(line),
            is_climbing: true,
            bounds: None,
            anchor: None,
            change: RateChange::new(50.0),
            shorter: ShorterDelay::default(),
            newest: 500,
        }
    }

    /// The frame that is due `after_s` after the take-off and comes `late_ms` later.
    fn frame(after_s: i64, late_ms: i64) -> Arrival {
        let at = 10_000_000_000 + 1_000_000_000 * after_s + 1_000_000 * late_ms;
        Arrival { number: 500 + 50 * after_s, at: TimeNs(at) }
    }

    fn is_taken(flight: &mut HeldLine, arrival: Arrival) -> bool {
        flight.measured_at(arrival, 50.0, &mut Arrivals::new()).is_some()
    }

    #[test]
    fn frames_may_be_earlier_in_the_climb_than_after_it_and_late_by_seconds() {
        for (after_s, late_ms, expected) in [
            (1, -249, true),
            (1, -251, false),
            (4, -49, true),
            (4, -52, false),
            (4, 4_900, true),
            (4, 5_100, false),
        ] {
            let taken = is_taken(&mut flight(), frame(after_s, late_ms));
            assert_eq!(taken, expected, "{late_ms} ms at {after_s} s");
        }
    }

    #[test]
    fn after_the_climb_the_line_of_that_moment_counts() {
        let mut flight = flight();
        assert!(is_taken(&mut flight, frame(1, -200)));
        assert!(is_taken(&mut flight, frame(4, -200)) && !flight.is_climbing);
        assert!(is_taken(&mut flight, frame(5, -240)), "40 ms below the line of then");
        assert!(!is_taken(&mut flight, frame(6, -255)), "more than 50 ms");
    }

    #[test]
    fn a_late_frame_is_dated_by_the_line_and_shows_no_drift() {
        let mut flight = flight();
        for (late_ms, shows_drift) in [(51, false), (0, true)] {
            let arrival = frame(4, late_ms);
            let before = flight.line.unwrap();
            let at = flight.measured_at(arrival, 50.0, &mut Arrivals::new()).unwrap();
            assert!((at.0 - frame(4, 0).at.0).abs() < 100_000, "{late_ms} ms: {at:?}");
            assert_eq!(flight.line.unwrap().as_of != before.as_of, shows_drift, "{late_ms} ms");
        }
    }

    #[test]
    fn without_a_line_from_the_ground_no_frame_has_a_time() {
        let mut flight = HeldLine { line: None, begin: None, ..flight() };
        assert!(!is_taken(&mut flight, frame(1, 0)));
    }
}
