//! When a frame was measured, from its number.
//!
//! One-way clock synchronization: the frame numbers are the source's clock. Bytes that a stalled network delivers
//! late carry old frames, though they have just arrived. Delays are never negative, so the lower envelope of the
//! arrivals over the numbers is a straight line, the arrival with the minimum delay. Its offset and its skew (the
//! relative error of its period) are estimated from the lowest arrivals, as in Moon, Skelly and Towsley 1999,
//! "Estimation and removal of clock skew from network delay measurements". A frame above the line is late by its
//! distance. The minimum delay itself, some milliseconds, cannot be observed one way.
//!
//! The line is estimated on the ground ([`calibration`]) and held in flight ([`held_line`]): a line that is estimated
//! anew while the stream is late would make old poses look fresh. In flight the offset follows the drift of the two
//! clocks, and the period the last thousandths of the source's rate. A frame that no line explains has no known time.

mod arrivals;
mod bounds;
mod calibration;
mod held_line;
mod line_confirmation;
mod rate_change;
mod rate_meter;
mod shorter_delay;

use calibration::Calibration;
use held_line::HeldLine;
pub(super) use rate_meter::RateMeter;

use crate::clock::{SpanNs, TimeNs};

/// Largest skew of the clocks of mocap system and host: 100 us per second. 1
const SKEW_MAX: f64 = 100e-6;

/// Usual skew of the clocks: a line that is touched by frames from above rises by no more. 1
const SKEW_USUAL: f64 = 5e-6;

/// A line that no frame has touched for so long may be too low, and rises with [`SKEW_MAX`]. ns
const UNTOUCHED_NS: f64 = 10e9;

/// Largest drift that is corrected at once, after a long silence or lateness. ns
const DRIFT_MAX_NS: f64 = 20e6;

/// Distance from the line beyond which a frame is of another count. ns
const SAME_COUNT_NS: f64 = 5e9;

/// The frame numbers of one source against our clock.
#[derive(Debug)]
pub(super) struct FrameClock {
    calibration: Calibration,
    /// The line in flight; `None` on the ground.
    held: Option<HeldLine>,
}

/// Frame number and its time of arrival less the age that the source reports, by our clock.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    number: i64,
    at: TimeNs,
}

/// Arrival of each frame with the minimum delay: `offset + period (number - origin)`.
#[derive(Debug, Clone, Copy)]
struct Line {
    origin: i64,
    /// Time per number. ns
    period_ns: f64,
    /// When the frame `origin` arrives. ns
    offset_ns: f64,
    /// Up to when the drift is followed.
    as_of: TimeNs,
    /// When a frame last came no later than the line predicts.
    touched_at: TimeNs,
}

impl FrameClock {
    /// A clock on the ground without a frame. Allocates here only.
    pub(super) fn new() -> Self {
        Self { calibration: Calibration::new(), held: None }
    }

    /// Whether the vehicle may be in the air: the line of the ground is held for as long, and forgotten then.
    pub(super) fn set_airborne(&mut self, is_airborne: bool) {
        if is_airborne == self.held.is_some() {
            return;
        }
        self.held = is_airborne.then(|| HeldLine::new(&self.calibration));
        if !is_airborne {
            self.calibration.forget();
        }
    }

    /// A connection ended. On the ground the line of the next one is estimated anew; in flight the next one has to go
    /// on with the same count.
    pub(super) fn restart(&mut self) {
        if self.held.is_none() {
            self.calibration.forget();
        }
    }

    /// When the frame `number` was measured, never later than `sent_at`, its arrival less its age when
    /// it was sent. `rate_hz` is what the source announces.
    ///
    /// `None`: unknown. So on the ground without a rate, or while the numbers do not come at the
    /// announced rate; in flight without a line from before, more than 5 s later than the line predicts,
    /// or so much earlier that neither jitter and drift nor a shorter delay ([`shorter_delay`]) explain it.
    pub(super) fn measured_at(
        &mut self,
        number: i64,
        rate_hz: f64,
        sent_at: TimeNs,
    ) -> Option<TimeNs> {
        let arrival = Arrival { number, at: sent_at };
        match &mut self.held {
            Some(held) => held.measured_at(arrival, rate_hz, self.calibration.arrivals_mut()),
            None => self.calibration.measured_at(arrival, rate_hz),
        }
    }

    /// Whether frames have times, at a rate that their arrivals confirmed on the ground.
    pub(super) fn is_confirmed(&self) -> bool {
        self.calibration.is_confirmed()
    }

    /// Frame numbers per second as measured on the ground; `None` before two seconds. Hz
    pub(super) fn count_hz(&self) -> Option<f64> {
        self.calibration.count_hz()
    }
}

impl Arrival {
    /// Time per number from here to another arrival. ns
    fn period_to_ns(self, other: Self) -> f64 {
        other.at.since(self.at).0 as f64 / other.number.saturating_sub(self.number) as f64
    }
}

impl Line {
    /// The line through one arrival.
    fn through(arrival: Arrival, period_ns: f64) -> Self {
        let Arrival { number, at } = arrival;
        Self { origin: number, period_ns, offset_ns: at.0 as f64, as_of: at, touched_at: at }
    }

    /// The same line, counted from another number.
    fn with_origin(self, origin: i64) -> Self {
        let numbers = origin.saturating_sub(self.origin) as f64;
        Self { origin, offset_ns: self.offset_ns + self.period_ns * numbers, ..self }
    }

    /// How much later than the line a frame is; negative if it is earlier. ns
    fn late_ns(self, Arrival { number, at }: Arrival) -> f64 {
        at.0 as f64 - self.offset_ns - self.period_ns * number.saturating_sub(self.origin) as f64
    }

    /// Time since the line followed the drift, at least 0. ns
    fn age_ns(self, at: TimeNs) -> f64 {
        at.since(self.as_of).0.max(0) as f64
    }

    /// The line at `at` if the source's clock is slower than ours by [`SKEW_USUAL`], and by [`SKEW_MAX`] after
    /// [`UNTOUCHED_NS`] without a frame on the line.
    fn drifted(self, at: TimeNs) -> Self {
        let age_ns = self.age_ns(at);
        let untouched_ns = at.since(self.touched_at).0 as f64 - UNTOUCHED_NS;
        let fast_ns = untouched_ns.clamp(0.0, age_ns);
        let drift_ns = SKEW_MAX * fast_ns + SKEW_USUAL * (age_ns - fast_ns);
        let drift_ns = drift_ns.min(DRIFT_MAX_NS);
        Self { offset_ns: self.offset_ns + drift_ns, as_of: self.as_of.max(at), ..self }
    }

    /// The line, or the one below it that `arrival` lies on.
    fn lowered_to(self, arrival: Arrival) -> Self {
        let late_ns = self.late_ns(arrival);
        if late_ns > 0.0 {
            return self;
        }
        Self { offset_ns: self.offset_ns + late_ns, touched_at: arrival.at, ..self }
    }

    /// When a frame was measured: by the line, never after it was sent.
    fn measured_at(self, arrival: Arrival) -> TimeNs {
        #[expect(clippy::cast_possible_truncation, reason = "beyond 292 years it saturates")]
        let late = SpanNs(self.late_ns(arrival).max(0.0).round() as i64);
        arrival.at.after(SpanNs(late.0.saturating_neg()))
    }
}

#[cfg(test)]
mod tests;
