//! A source that changes its rate in flight, and says so.
//!
//! A frame that announces another rate than the one before it may begin a count at another pace, or nothing. By
//! the old line its predecessor has a time; from there a new line leads on at the new rate. It takes the old
//! one's place after half a second in which all frames announced that rate and came within 20 ms of the new line,
//! while the old one does not explain them any more. A delay that grows makes no such line: the source would have
//! to announce, in the same frame, the rate at which its frames arrive from then on. A change
//! without an announcement is not followed.

use super::{Arrival, Line};
use crate::clock::{SpanNs, TimeNs};

/// How long frames have to keep to the new line.
const PROOF: SpanNs = SpanNs::from_ms(500);

/// How many of them there have to be.
const FRAMES_MIN: u32 = 5;

/// Distance from the new line within which they are. ns
const NEAR_NS: f64 = 20e6;

/// The rate that frames announce, and the line of another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct RateChange {
    announced_hz: f64,
    next: Option<Next>,
}

#[derive(Debug, Clone, Copy)]
struct Next {
    announced_hz: f64,
    /// `None`: a frame was not where it should have been.
    line: Option<Line>,
    since: TimeNs,
    frames: u32,
    /// How far below the line the lowest of them is. ns, <= 0
    lowest_ns: f64,
}

impl RateChange {
    /// No change as yet of what was announced on the ground.
    pub(super) fn new(announced_hz: f64) -> Self {
        Self { announced_hz, next: None }
    }

    /// Takes in a frame that comes after the number `before` on `line`; the line of a new rate, once that is
    /// proven and this frame is not on time by the old one.
    pub(super) fn see(
        &mut self,
        arrival: Arrival,
        rate_hz: f64,
        line: Line,
        before: i64,
        is_on_time: bool,
    ) -> Option<Line> {
        if rate_hz.total_cmp(&self.announced_hz).is_eq() || rate_hz <= 0.0 {
            self.next = None;
            return None;
        }
        let is_same = |next: &Next| next.announced_hz.total_cmp(&rate_hz).is_eq();
        let mut next = self.next.filter(is_same).unwrap_or_else(|| {
            let from = line.from(before);
            let period_ns = from.period_ns * self.announced_hz / rate_hz;
            let (since, line) = (arrival.at, Some(Line { period_ns, ..from }));
            Next { announced_hz: rate_hz, line, since, frames: 0, lowest_ns: 0.0 }
        });
        let is_near = |line: &Line| line.late_ns(arrival).abs() <= NEAR_NS;
        next.line = next.line.filter(is_near);
        let late_ns = next.line.map_or(0.0, |line| line.late_ns(arrival));
        next.lowest_ns = next.lowest_ns.min(late_ns);
        next.frames = next.frames.saturating_add(1);
        self.next = Some(next);
        let is_proven = arrival.at.since(next.since) >= PROOF && next.frames >= FRAMES_MIN;
        let proven = next.line.filter(|_| is_proven && !is_on_time)?;
        *self = Self::new(rate_hz);
        let offset_ns = proven.offset_ns + next.lowest_ns;
        Some(Line { offset_ns, as_of: arrival.at, touched_at: arrival.at, ..proven })
    }
}
