//! A way to us that becomes shorter in flight, as where a busy network becomes free.
//!
//! Frames are then earlier than the line predicts, by a constant time, and their numbers go on without a gap: no other
//! count does that. After half a second in which they keep to a parallel line, that one takes the old one's place.
//! Frames at another pace, or behind a gap that could hide a delay, are not followed, nor is more than 0.25 s below the
//! line of the take-off: numbers that run ahead of time would hide a delay that grows.

use super::line_confirmation::LineConfirmation;
use super::{Arrival, Line};

/// How late they may be by the parallel line, and how early: more would be another pace. ns
const LATE_MAX_NS: f64 = 20e6;
const EARLY_MAX_NS: f64 = 10e6;

/// By how much a way becomes shorter in a flight at most. ns
const SHORTER_MAX_NS: f64 = 250e6;

/// Longest gap between two frames, by their numbers. ns
const GAP_MAX_NS: f64 = 100e6;

/// What is known of a shorter way.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ShorterWay {
    /// A line below that of the flight, while frames keep to it.
    next: Option<Parallel>,
    /// How far the line is below that of the take-off. ns
    shorter_ns: f64,
}

#[derive(Debug, Clone, Copy)]
struct Parallel {
    confirmation: LineConfirmation,
    /// Number of the newest frame.
    newest: i64,
}

impl ShorterWay {
    /// A frame has come that `line` explains.
    pub(super) fn restart(&mut self) {
        self.next = None;
    }

    /// Takes in a frame that comes too early for the line that counts since `begin`, beside the present `line`, on
    /// which the newest frame has the number `before`; the line of the shorter way, once that is confirmed.
    pub(super) fn observe(
        &mut self,
        arrival: Arrival,
        [begin, line]: [Line; 2],
        before: i64,
    ) -> Option<Line> {
        let follows = |number: i64| {
            let gap_ns = arrival.number.saturating_sub(number) as f64 * line.period_ns;
            arrival.number > number && gap_ns <= GAP_MAX_NS.max(2.0 * line.period_ns)
        };
        let is_near = |confirmation: &LineConfirmation| {
            (-EARLY_MAX_NS..=LATE_MAX_NS).contains(&confirmation.late_ns(arrival))
        };
        let newest = self.next.map_or(before, |known| known.newest);
        let early_ns = -begin.late_ns(arrival);
        if !follows(newest) || early_ns < 0.0 || self.shorter_ns + early_ns > SHORTER_MAX_NS {
            self.next = None;
            return None;
        }
        let known = self.next.map(|known| known.confirmation).filter(is_near);
        let begin_confirmation = || LineConfirmation::begin(line.lowered_to(arrival), arrival.at);
        let confirmation = known.unwrap_or_else(begin_confirmation).with(arrival);
        self.next = Some(Parallel { confirmation, newest: arrival.number });
        let confirmed = confirmation.confirmed(arrival)?;
        self.next = None;
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
        let mut way = ShorterWay::default();
        let see = |(number, early_ms): (i64, i64)| {
            let at = TimeNs(1_000_000_000).after(SpanNs::from_ms(10 * number - early_ms));
            way.observe(Arrival { number, at }, [line(); 2], 0)
        };
        frames.into_iter().find_map(see)
    }

    #[test]
    fn a_way_that_becomes_shorter_is_confirmed_after_half_a_second() {
        assert!(after((1..=50).map(|number| (number, 80))).is_none(), "490 ms");
        let confirmed = after((1..=51).map(|number| (number, 80))).unwrap();
        let on_it = Arrival { number: 51, at: TimeNs(1_430_000_000) };
        assert!(confirmed.late_ns(on_it).abs() < 1e-6, "{confirmed:?}");
        // Jitter: the lowest frame counts. By 8 ms per second, as where a load goes down.
        let confirmed = after((1..=51).map(|k| (k, if k == 7 { 90 } else { 80 }))).unwrap();
        assert!((confirmed.late_ns(on_it) - 10e6).abs() < 1e-3, "{confirmed:?}");
        assert!(after((1..=52).map(|number| (number, 60 + number * 8 / 100))).is_some());
    }

    #[test]
    fn another_count_or_another_pace_is_not_followed() {
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
