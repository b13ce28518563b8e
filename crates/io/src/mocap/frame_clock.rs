//! When a frame was measured, from its number.
//!
//! Bytes that a stalled network delivers late carry old frames, though they have just arrived. Frame numbers keep
//! pace with time, so that one straight line leads from the numbers to our clock: the arrival of each frame with
//! the shortest delay. A frame above the line is late by its distance. The shortest delay itself, some
//! milliseconds, stays unknown.
//!
//! The line is learned on the ground ([`ground`]) and held in flight ([`flight`]): a line that is learned anew
//! while the stream is late would make old poses look fresh. In flight its offset follows the drift of the two
//! clocks, its pace the last thousandths of the source's rate; a frame that no line explains has no known time.

mod arrivals;
mod bounds;
mod change;
mod earlier;
mod flight;
mod ground;
mod line_confirmation;
mod pace_meter;

use flight::Flight;
use ground::Ground;
pub(super) use pace_meter::PaceMeter;

use crate::clock::{SpanNs, TimeNs};

/// What the clocks of mocap system and host may drift apart per unit of time: 100 us per second. 1
const DRIFT: f64 = 100e-6;

/// What they usually drift apart: a line that frames keep touching from below rises by no more. 1
const DRIFT_USUAL: f64 = 5e-6;

/// A line that no frame has touched for so long may be too low, and rises by [`DRIFT`]. ns
const UNTOUCHED_NS: f64 = 10e9;

/// Most of that drift which is made up for at once, after a long silence or lateness. ns
const DRIFT_MAX_NS: f64 = 20e6;

/// Distance from the line beyond which a frame is of another count. ns
const SAME_COUNT_NS: f64 = 5e9;

/// The frame numbers of one source against our clock.
#[derive(Debug)]
pub(super) struct FrameClock {
    ground: Ground,
    /// The line of the flight; `None` on the ground.
    flight: Option<Flight>,
}

/// A frame and when it was sent, by our clock, shortest delay included.
#[derive(Debug, Clone, Copy)]
struct Arrival {
    number: i64,
    at: TimeNs,
}

/// When each frame arrives with the shortest delay: `offset + period (number - origin)`.
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
    /// A clock on the ground that has seen nothing. All of its memory.
    pub(super) fn new() -> Self {
        Self { ground: Ground::new(), flight: None }
    }

    /// Whether the vehicle may be in the air: what was learned on the ground is held until it is not,
    /// and forgotten then.
    pub(super) fn set_airborne(&mut self, is_airborne: bool) {
        if is_airborne == self.flight.is_some() {
            return;
        }
        self.flight = is_airborne.then(|| Flight::new(&self.ground));
        if !is_airborne {
            self.ground.forget();
        }
    }

    /// A connection ended. On the ground the next one is learned anew; in flight it has to go on with
    /// the same count.
    pub(super) fn restart(&mut self) {
        if self.flight.is_none() {
            self.ground.forget();
        }
    }

    /// When the frame `number` was measured, never later than `sent_at`, its arrival less its age when
    /// it was sent. `rate_hz` is what the source announces.
    ///
    /// `None`: unknown. So on the ground without a rate, or while the numbers do not keep pace with
    /// time as announced; in flight without a line from before, more than 5 s later than the line predicts,
    /// or so much earlier that neither jitter and drift nor a shorter way ([`earlier`]) explain it.
    pub(super) fn measured_at(
        &mut self,
        number: i64,
        rate_hz: f64,
        sent_at: TimeNs,
    ) -> Option<TimeNs> {
        let arrival = Arrival { number, at: sent_at };
        match &mut self.flight {
            Some(flight) => flight.measured_at(arrival, rate_hz, self.ground.arrivals_mut()),
            None => self.ground.measured_at(arrival, rate_hz),
        }
    }

    /// Whether frames have times, at a pace that their arrivals confirmed on the ground.
    pub(super) fn is_confirmed(&self) -> bool {
        self.ground.is_confirmed()
    }

    /// Frame numbers per second as measured on the ground; `None` before two seconds. Hz
    pub(super) fn count_hz(&self) -> Option<f64> {
        self.ground.count_hz()
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
    fn from(self, origin: i64) -> Self {
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

    /// The line at `at` if the source's clock is slower than ours by [`DRIFT_USUAL`], and by [`DRIFT`] after
    /// [`UNTOUCHED_NS`] without a frame on the line.
    fn drifted(self, at: TimeNs) -> Self {
        let age_ns = self.age_ns(at);
        let untouched_ns = at.since(self.touched_at).0 as f64 - UNTOUCHED_NS;
        let fast_ns = untouched_ns.clamp(0.0, age_ns);
        let drift_ns = DRIFT * fast_ns + DRIFT_USUAL * (age_ns - fast_ns);
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
