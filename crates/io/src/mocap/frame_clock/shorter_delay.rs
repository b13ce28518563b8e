//! A minimum delay that becomes shorter in flight, as where a busy network becomes free.
//!
//! Frames are then earlier than the line predicts, by a constant time, and their numbers go on without a gap: no other
//! count does that. After half a second in which the frames keep to a parallel line, it replaces the line of the
//! flight. Frames at another rate, or behind a gap that could hide a delay, are not followed, nor is a line more than
//! 0.25 s below that of the take-off: numbers that run ahead of time would hide a delay that grows.

use super::line_confirmation::LineConfirmation;
use super::{Arrival, Line};

/// How late and how early frames may be by the parallel line: more would be another rate. ns
const LATE_MAX_NS: f64 = 20e6;
const EARLY_MAX_NS: f64 = 10e6;

/// Largest decrease of the minimum delay in a flight. ns
const SHORTER_MAX_NS: f64 = 250e6;

/// Longest gap between two frames, by their numbers. ns
const GAP_MAX_NS: f64 = 100e6;

/// Detection of a shorter minimum delay.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ShorterDelay {
    /// A line below that of the flight, while frames keep to it.
    candidate: Option<ParallelLine>,
    /// How far the line is below that of the take-off. ns
    shorter_ns: f64,
}

/// A line parallel to that of the flight.
#[derive(Debug, Clone, Copy)]
struct ParallelLine {
    confirmation: LineConfirmation,
    /// Number of the newest frame.
    newest: i64,
}

impl ShorterDelay {
    /// A frame has come that the line of the flight explains.
    pub(super) fn restart(&mut self) {
        self.candidate = None;
    }

    /// Takes in a frame that comes too early for the line that counts since `begin`, beside the present `line`, on
    /// which the newest frame has the number `before`; the line of the shorter delay, once that is confirmed.
    pub(super) fn observe(
        &mut self,
        arrival: Arrival,
        begin: Line,
        line: Line,
        before: i64,
    ) -> Option<Line> {
        let follows = |number: i64| {
            let gap_ns = arrival.number.saturating_sub(number) as f64 * line.period_ns;
            arrival.number > number && gap_ns <= GAP_MAX_NS.max(2.0 * line.period_ns)
        };
        let is_near = |confirmation: &LineConfirmation| {
            (-EARLY_MAX_NS..=LATE_MAX_NS).contains(&confirmation.late_ns(arrival))
        };
        let newest = self.candidate.map_or(before, |known| known.newest);
        let early_ns = -begin.late_ns(arrival);
        if !follows(newest) || early_ns < 0.0 || self.shorter_ns + early_ns > SHORTER_MAX_NS {
            self.candidate = None;
            return None;
        }
        let known = self.candidate.map(|known| known.confirmation).filter(is_near);
        let begin_confirmation = || LineConfirmation::begin(line.lowered_to(arrival), arrival.at);
        let confirmation = known.unwrap_or_else(begin_confirmation).with(arrival);
        self.candidate = Some(ParallelLine { confirmation, newest: arrival.number });
        let confirmed = confirmation.confirmed(arrival)?;
        self.candidate = None;
        self.shorter_ns += confirmed.late_ns(arrival) - begin.late_ns(arrival);
        Some(confirmed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{SpanNs, TimeNs};

    /// At 100 Hz, frame 0 at one second.
    fn line() -> Line {
        Line::through(Arrival { number: 0, at: TimeNs(1_000_000_000) }, 10e6)
    }

    /// The line after these frames, each that many ms earlier than by [`line`].
    fn after(frames: impl IntoIterator<Item = (i64, i64)>) -> Option<Line> {
        let mut shorter = ShorterDelay::default();
        let see = |(number, early_ms): (i64, i64)| {
            let at = TimeNs(1_000_000_000).after(SpanNs::from_ms(10 * number - early_ms));
            shorter.observe(Arrival { number, at }, line(), line(), 0)
        };
        frames.into_iter().find_map(see)
    }

    #[test]
    fn a_shorter_delay_is_confirmed_after_half_a_second() {
        assert!(after((1..=50).map(|number| (number, 80))).is_none(), "490 ms");
        let confirmed = after((1..=51).map(|number| (number, 80))).unwrap();
        let on_it = Arrival { number: 51, at: TimeNs(1_430_000_000) };
        assert!(confirmed.late_ns(on_it).abs() < 1e-6, "{confirmed:?}");
        // With jitter the lowest frame counts.
        let confirmed = after((1..=51).map(|k| (k, if k == 7 { 90 } else { 80 }))).unwrap();
        assert!((confirmed.late_ns(on_it) - 10e6).abs() < 1e-3, "{confirmed:?}");
        // A delay that shrinks by 8 ms per second, as when a load ends.
        assert!(after((1..=52).map(|number| (number, 60 + number * 8 / 100))).is_some());
    }

    #[test]
    fn another_count_or_another_rate_is_not_followed() {
        assert!(after((1..=80).map(|number| (number, 251))).is_none(), "too early");
        assert!(after((1..=80).map(|number| (number, -1))).is_none(), "late");
        assert!(after((12..=80).map(|number| (number, 80))).is_none(), "behind a gap");
        assert!(after((-80..=0).map(|number| (number, 80))).is_none(), "began anew");
        assert!(after((1..=80).map(|number| (number, 60 + number / 2))).is_none(), "105 Hz");
        // What has waited comes at once.
        assert!(after((1..=40).map(|number| (number, 10 * number))).is_none(), "a burst");
        let lossy = (1..=80).filter(|number| number % 9 == 1).map(|number| (number, 80));
        assert!(after(lossy).is_some(), "gaps of 90 ms");
    }
}
