//! When a frame was measured, by the source's time stamp if it sends one, else by the frame's number.
//!
//! A time stamp grows as time does whatever the rate is, and goes on where the rate changes in flight. But
//! stamps are wrong more often than numbers: constant, coarse, of a clock that is set. So they are a second count
//! beside the numbers, of microseconds, which has to prove itself on the ground as numbers have to.

use super::frame_clock::FrameClock;
use super::source::SourceFrame;
use crate::clock::{SpanNs, TimeNs};

/// Counts of a stamp per second. Hz
const STAMPS_HZ: f64 = 1e6;

/// A stamp that is back by less is one of a coarse or noisy clock, and passed over on the ground. us
const BACK_MAX_US: i64 = 1_000_000;

/// The clocks of one source.
#[derive(Debug)]
pub(super) struct SourceClock {
    by_number: FrameClock,
    by_stamp: FrameClock,
    newest_us: Option<i64>,
    is_airborne: bool,
    /// Whether stamps were proven at the take-off.
    uses_stamps: bool,
}

impl SourceClock {
    /// Clocks on the ground that have seen nothing. All of their memory.
    pub(super) fn new() -> Self {
        let (by_number, by_stamp) = (FrameClock::new(), FrameClock::new());
        Self { by_number, by_stamp, newest_us: None, is_airborne: false, uses_stamps: false }
    }

    /// As [`FrameClock::set_airborne`].
    pub(super) fn set_airborne(&mut self, is_airborne: bool) {
        if is_airborne && !self.is_airborne {
            self.uses_stamps = self.by_stamp.is_confirmed();
        }
        self.is_airborne = is_airborne;
        self.by_number.set_airborne(is_airborne);
        self.by_stamp.set_airborne(is_airborne);
    }

    /// As [`FrameClock::restart`].
    pub(super) fn restart(&mut self) {
        self.newest_us = None;
        self.by_number.restart();
        self.by_stamp.restart();
    }

    /// As [`FrameClock::measured_at`].
    pub(super) fn measured_at(&mut self, frame: &SourceFrame, sent_at: TimeNs) -> Option<TimeNs> {
        let by_number = self.by_number.measured_at(frame.number, frame.rate_hz, sent_at);
        let by_stamp = frame.stamp.and_then(|stamp| self.by_stamp(stamp, sent_at));
        let uses_stamps =
            if self.is_airborne { self.uses_stamps } else { self.by_stamp.is_confirmed() };
        by_stamp.filter(|_| uses_stamps).or(by_number)
    }

    fn by_stamp(&mut self, stamp: SpanNs, sent_at: TimeNs) -> Option<TimeNs> {
        let us = stamp.0 / 1000;
        let is_back = |newest: i64| (0..BACK_MAX_US).contains(&newest.saturating_sub(us));
        if !self.is_airborne && self.newest_us.is_some_and(is_back) {
            return None;
        }
        self.newest_us = Some(us);
        self.by_stamp.measured_at(us, STAMPS_HZ, sent_at)
    }

    /// Whether frames have times, at a rate that their arrivals confirmed on the ground.
    pub(super) fn is_confirmed(&self) -> bool {
        self.by_number.is_confirmed() || self.by_stamp.is_confirmed()
    }

    /// Frame numbers per second as measured on the ground; `None` before two seconds. Hz
    pub(super) fn count_hz(&self) -> Option<f64> {
        self.by_number.count_hz()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How late frames of 240 Hz are after a take-off at 5 s, by the stamp of each time. ms, s
    fn late_ms(
        stamp: impl Fn(f64) -> Option<f64>,
        delay_s: impl Fn(f64) -> f64,
    ) -> Vec<Option<f64>> {
        let mut clock = SourceClock::new();
        let mut late_ms = Vec::new();
        // From 10 s on every fourth frame, numbered on, as at 60 Hz.
        let mut time_s = 0.0;
        for number in 0..4000 {
            clock.set_airborne(time_s > 5.0);
            let stamp = stamp(time_s).map(SpanNs::from_seconds);
            let frame =
                SourceFrame { number, rate_hz: 240.0, stamp, latency: SpanNs(0), pose: None };
            let at = TimeNs(0).after(SpanNs::from_seconds(time_s + delay_s(time_s)));
            let measured_at = clock.measured_at(&frame, at);
            if time_s > 5.0 {
                late_ms.push(measured_at.map(|measured_at| 1e3 * at.since(measured_at).seconds()));
            }
            time_s += if time_s < 10.0 { 1.0 / 240.0 } else { 1.0 / 60.0 };
        }
        late_ms
    }

    #[expect(clippy::ref_option, reason = "what iterators pass")]
    fn is_fresh(late_ms: &Option<f64>) -> bool {
        late_ms.is_some_and(|late_ms| late_ms < 1.0)
    }

    #[test]
    fn stamps_go_on_where_the_rate_changes() {
        assert!(late_ms(|s| Some(1e9 + s), |_| 0.0).iter().all(is_fresh));
        // A delay of the network stays one.
        let late_ms = late_ms(Some, |s| if s > 7.0 { 0.3 } else { 0.0 });
        assert!(
            late_ms[600..].iter().all(|late_ms| late_ms.is_some_and(|late_ms| late_ms > 290.0))
        );
    }

    #[test]
    fn stamps_that_are_none_count_for_nothing() {
        let stamps: [fn(f64) -> Option<f64>; 5] = [
            |_| None,
            |_| Some(7.0),
            // In another unit, at no steady rate, set back each second.
            |s| Some(1e3 * s),
            |s| Some(s * s),
            |s| Some(100.0 - 2.0 * s.floor() + s),
        ];
        for (index, stamp) in stamps.into_iter().enumerate() {
            let late_ms = late_ms(stamp, |_| 0.0);
            // As by numbers: until the rate changes, and late after it.
            assert!(late_ms[..1190].iter().all(is_fresh), "{index}");
            assert!(!late_ms[1300..].iter().any(is_fresh), "{index}");
        }
    }

    #[test]
    fn a_clock_of_the_source_that_is_set_in_flight_leaves_the_numbers() {
        let late_ms = late_ms(|s| Some(if s > 7.0 { s + 60.0 } else { s }), |_| 0.0);
        assert!(late_ms[..1190].iter().all(is_fresh));
    }
}
