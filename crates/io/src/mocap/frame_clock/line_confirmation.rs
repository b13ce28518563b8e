//! Frames that keep to another line for so long that it may take the place of that of the flight.

use super::{Arrival, Line};
use crate::clock::{SpanNs, TimeNs};

/// How long frames have to keep to the line.
const CONFIRMATION: SpanNs = SpanNs::from_ms(500);

/// How many of them there have to be.
const FRAMES_MIN: u32 = 5;

/// A line and the frames near it. Its owner decides how near.
#[derive(Debug, Clone, Copy)]
pub(super) struct LineConfirmation {
    line: Line,
    since: TimeNs,
    frames: u32,
    /// How far below the line the lowest of them is. ns, <= 0
    lowest_ns: f64,
}

impl LineConfirmation {
    /// No frame yet on `line`, from `since` on.
    pub(super) fn begin(line: Line, since: TimeNs) -> Self {
        Self { line, since, frames: 0, lowest_ns: 0.0 }
    }

    /// As [`Line::late_ns`].
    pub(super) fn late_ns(&self, arrival: Arrival) -> f64 {
        self.line.late_ns(arrival)
    }

    /// The same with one frame more.
    pub(super) fn with(self, arrival: Arrival) -> Self {
        let lowest_ns = self.lowest_ns.min(self.late_ns(arrival));
        Self { frames: self.frames.saturating_add(1), lowest_ns, ..self }
    }

    /// The line through the lowest frame, once it is confirmed by `newest`.
    pub(super) fn confirmed(&self, newest: Arrival) -> Option<Line> {
        let is_confirmed = newest.at.since(self.since) >= CONFIRMATION && self.frames >= FRAMES_MIN;
        let offset_ns = self.line.offset_ns + self.lowest_ns;
        let (as_of, touched_at) = (newest.at, newest.at);
        is_confirmed.then_some(Line { offset_ns, as_of, touched_at, ..self.line })
    }
}
