//! Phase of the control ticks to the frames of the mocap source.
//!
//! Pure: times come as arguments. A tick that begins just before its frame is due and waits for it plans
//! with a pose that is some tenths of a millisecond old, in place of up to a period. The phase is a quantile tracker
//! (stochastic approximation, Robbins and Monro 1951): it settles where one frame of a hundred arrives in the
//! second half of the wait, whatever the jitter of the source. The grid of the ticks moves by at most
//! [`STEP_MAX_NS`] a period, so that the inputs of the model stay evenly spaced.

use tello_flight::Sighting;

use super::{SpanNs, TimeNs};

/// Frames over which the time between two frames is measured before the ticks follow them.
const LEARN_FRAMES: u32 = 100;

/// Largest difference of a period to a whole number of frames that the ticks follow, relative to the period. 1
const RATE_TOLERANCE: f64 = 5e-3;

/// Fraction of the frames that come later than half of the wait. 1
const LATE_FRACTION: f64 = 0.01;

/// `a` of `docs/model.md`, section 5: a late frame moves the phase by `a (1 - LATE_FRACTION)`, a timely one by
/// `a LATE_FRACTION` the other way. The latter, 4 us a period, is twice the drift of two clocks that differ by
/// 100 ppm. ns
const LATE_STEP_NS: f64 = 0.4e6;

/// Largest change of a period. ns
const STEP_MAX_NS: f64 = 0.5e6;

/// Of [`LEARN_FRAMES`] frames so many may be late before the source counts as another one.
const LATE_MAX: u32 = LEARN_FRAMES / 2;

/// From the arrivals of frames to corrections of the tick's grid.
#[derive(Debug)]
pub(super) struct FramePhase {
    period_ns: f64,
    /// How long a tick waits for its frame. ns
    wait_ns: f64,
    cadence: Cadence,
    /// Frames since the last change of [`LockState`].
    frames: u32,
    state: LockState,
    /// Correction of the grid that is still to be made. ns
    pending_ns: f64,
    received_at: Option<TimeNs>,
}

#[derive(Debug, Clone, Copy)]
enum LockState {
    /// The time between two frames is not known, or no divisor of the period.
    Learning,
    /// Looks for the earliest arrival, seen from that of the first frame. ns
    Searching { first_ns: f64, earliest_ns: f64, frame_ns: f64 },
    /// Follows the frames.
    Locked { late: u32, frame_ns: f64 },
}

impl FramePhase {
    pub(super) fn new(period: SpanNs, wait: SpanNs) -> Self {
        Self {
            period_ns: period.0 as f64,
            wait_ns: wait.0 as f64,
            cadence: Cadence::default(),
            frames: 0,
            state: LockState::Learning,
            pending_ns: 0.0,
            received_at: None,
        }
    }

    /// Time from which a frame counts as that of the tick that is due at `due`, and until which to wait for it;
    /// `None` while the frames do not keep pace with the ticks.
    pub(super) fn window(&self, due: TimeNs) -> Option<(TimeNs, TimeNs)> {
        let LockState::Locked { frame_ns, .. } = self.state else { return None };
        Some((due.after(span(-frame_ns / 2.0)), due.after(span(self.wait_ns))))
    }

    /// How much later than a period after `due`, the present tick, the next one shall come, by what arrived
    /// since the one before.
    pub(super) fn correction(&mut self, due: TimeNs, sightings: &[Sighting]) -> SpanNs {
        for sighting in sightings {
            let received_at = Some(sighting.received_at);
            // A stall ends in a burst: its first frame alone shows when frames arrive.
            if received_at > std::mem::replace(&mut self.received_at, received_at) {
                self.observe(sighting, sighting.received_at.since(due).0 as f64);
            }
        }
        let step_ns = self.pending_ns.clamp(-STEP_MAX_NS, STEP_MAX_NS);
        self.pending_ns -= step_ns;
        span(step_ns)
    }

    /// A frame that arrived `late_ns` after a tick was due.
    fn observe(&mut self, sighting: &Sighting, late_ns: f64) {
        self.frames += 1;
        match &mut self.state {
            LockState::Learning => {
                self.cadence.observe(sighting);
                if self.frames < LEARN_FRAMES {
                    return;
                }
                let Some(frame_ns) = self.cadence.divisor_ns(self.period_ns) else { return };
                self.enter(LockState::Searching { first_ns: late_ns, earliest_ns: 0.0, frame_ns });
            }
            LockState::Searching { first_ns, earliest_ns, frame_ns } => {
                *earliest_ns = earliest_ns.min(wrapped(late_ns - *first_ns, *frame_ns));
                if self.frames < LEARN_FRAMES {
                    return;
                }
                let frame_ns = *frame_ns;
                let phase_ns = *first_ns + *earliest_ns - self.wait_ns / 2.0;
                self.pending_ns = wrapped(phase_ns, frame_ns);
                self.enter(LockState::Locked { late: 0, frame_ns });
            }
            // Frames that arrive on the way to another phase show nothing about the one that it leads to.
            LockState::Locked { .. } if self.pending_ns.abs() > STEP_MAX_NS => {}
            LockState::Locked { late, frame_ns } => {
                let is_late = wrapped(late_ns, *frame_ns) > self.wait_ns / 2.0;
                *late += u32::from(is_late);
                let target = if is_late { 1.0 - LATE_FRACTION } else { -LATE_FRACTION };
                let frames_per_tick = (self.period_ns / *frame_ns).round().max(1.0);
                self.pending_ns += LATE_STEP_NS * target / frames_per_tick;
                if self.frames < LEARN_FRAMES {
                    return;
                }
                self.frames = 0;
                if std::mem::take(late) > LATE_MAX {
                    self.cadence = Cadence::default();
                    self.enter(LockState::Learning);
                }
            }
        }
    }

    fn enter(&mut self, state: LockState) {
        (self.state, self.frames) = (state, 0);
    }
}

/// The time between two frames, from their numbers and arrivals.
#[derive(Debug, Default)]
struct Cadence {
    /// Number and arrival.
    first: Option<(i64, TimeNs)>,
    last: Option<(i64, TimeNs)>,
    /// Difference of the numbers of two successive frames that most pairs have (Boyer and Moore's vote).
    stride: i64,
    votes: u32,
}

impl Cadence {
    fn observe(&mut self, sighting: &Sighting) {
        let frame = (sighting.frame, sighting.received_at);
        let stride = self.last.map_or(0, |(last, _)| frame.0.saturating_sub(last));
        if self.last.is_some() && stride <= 0 {
            *self = Self::default();
        }
        if stride > 0 {
            if self.votes == 0 {
                self.stride = stride;
            }
            self.votes = if stride == self.stride { self.votes + 1 } else { self.votes - 1 };
        }
        self.first = self.first.or(Some(frame));
        self.last = Some(frame);
    }

    /// The time between two frames, if a whole number of them makes a period. ns
    fn divisor_ns(&self, period_ns: f64) -> Option<f64> {
        let ((first, begin), (last, end)) = self.first.zip(self.last)?;
        let count = last.saturating_sub(first);
        if count <= 0 || self.stride <= 0 {
            return None;
        }
        let frame_ns = end.since(begin).0 as f64 / count as f64 * self.stride as f64;
        let frames = (period_ns / frame_ns).round();
        let is_divisor =
            frames >= 1.0 && (frames * frame_ns - period_ns).abs() <= RATE_TOLERANCE * period_ns;
        is_divisor.then_some(period_ns / frames)
    }
}

/// `ns` less the multiple of `modulus_ns` that brings it into half of it to either side.
fn wrapped(ns: f64, modulus_ns: f64) -> f64 {
    ns - modulus_ns * (ns / modulus_ns).round()
}

fn span(ns: f64) -> SpanNs {
    #[expect(clippy::cast_possible_truncation, reason = "at most some periods")]
    SpanNs(ns.round() as i64)
}

#[cfg(test)]
mod tests;
