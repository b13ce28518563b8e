//! A source that changes its rate in flight, and announces it.
//!
//! A frame that announces another rate than the one before it may begin a count at that rate, or nothing. By
//! the old line its predecessor has a time; from there, or from the frame if that comes within a period of either
//! rate, a new line leads on at the new rate. It takes the old one's place after half a second in which all frames
//! announced that rate and came within 20 ms of the new line, while the old one does not explain them any more. A
//! delay that grows makes no such line: the source would have to announce, in the same frame, the rate at which its
//! frames arrive from then on. A change without an announcement is not followed.

use super::line_confirmation::LineConfirmation;
use super::{Arrival, Line};

/// Largest distance of a frame from the new line. ns
const NEAR_NS: f64 = 20e6;

/// The announced rate, and the line of another one.
#[derive(Debug, Clone, Copy)]
pub(super) struct RateChange {
    announced_hz: f64,
    candidate: Option<Candidate>,
}

/// The line of a newly announced rate.
#[derive(Debug, Clone, Copy)]
struct Candidate {
    announced_hz: f64,
    /// Of the line; `None`: a frame was too far from it.
    confirmation: Option<LineConfirmation>,
}

impl RateChange {
    /// No change yet of the rate that was announced on the ground.
    pub(super) fn new(announced_hz: f64) -> Self {
        Self { announced_hz, candidate: None }
    }

    /// Takes in a frame that comes after the number `before` on `line`; the line of a new rate, once that is
    /// confirmed and this frame is not on time by the old one.
    pub(super) fn observe(
        &mut self,
        arrival: Arrival,
        rate_hz: f64,
        line: Line,
        before: i64,
        is_on_time: bool,
    ) -> Option<Line> {
        if rate_hz.total_cmp(&self.announced_hz).is_eq() || rate_hz <= 0.0 {
            self.candidate = None;
            return None;
        }
        let is_same = |one: &Candidate| one.announced_hz.total_cmp(&rate_hz).is_eq();
        let mut candidate = self.candidate.filter(is_same).unwrap_or_else(|| {
            let from = line.with_origin(before);
            let period_ns = from.period_ns * self.announced_hz / rate_hz;
            let line = Line { period_ns, ..from };
            // The first frame of the new rate comes within a period of either rate after the last of the old one.
            let late_ns = line.late_ns(arrival);
            let late_max_ns = (from.period_ns - period_ns).max(0.0);
            let is_within = (-period_ns..=late_max_ns + NEAR_NS).contains(&late_ns);
            let shift_ns = if is_within { late_ns.min(late_max_ns) } else { 0.0 };
            let line = Line { offset_ns: line.offset_ns + shift_ns, ..line };
            Candidate {
                announced_hz: rate_hz,
                confirmation: Some(LineConfirmation::begin(line, arrival.at)),
            }
        });
        let is_near =
            |confirmation: &LineConfirmation| confirmation.late_ns(arrival).abs() <= NEAR_NS;
        candidate.confirmation =
            candidate.confirmation.filter(is_near).map(|confirmation| confirmation.with(arrival));
        self.candidate = Some(candidate);
        let confirmed = candidate.confirmation?.confirmed(arrival).filter(|_| !is_on_time)?;
        *self = Self::new(rate_hz);
        Some(confirmed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::{SpanNs, TimeNs};

    /// At 200 Hz, frame 0 at time zero; from there on 50 frames per second are announced.
    const BEFORE_HZ: f64 = 200.0;
    const AFTER_HZ: f64 = 50.0;

    fn line() -> Line {
        Line::through(Arrival { number: 0, at: TimeNs(0) }, 1e9 / BEFORE_HZ)
    }

    /// The line after these frames of the new rate, each 20 ms later than the one before, and `late_ms`.
    fn after(numbers: impl Iterator<Item = i64>, rate_hz: f64, late_ms: i64) -> Option<Line> {
        let mut change = RateChange::new(BEFORE_HZ);
        let see = |number: i64| {
            let at = TimeNs(0).after(SpanNs::from_ms(20 * number + late_ms));
            change.observe(Arrival { number, at }, rate_hz, line(), 0, false)
        };
        numbers.map(see).last().flatten()
    }

    #[test]
    fn a_new_line_is_confirmed_after_half_a_second_and_five_frames() {
        assert!(after(1..=25, AFTER_HZ, 0).is_none(), "480 ms after the first");
        let confirmed = after(1..=26, AFTER_HZ, 0).unwrap();
        assert!((confirmed.period_ns - 20e6).abs() < 1e-6, "{confirmed:?}");
        assert!(confirmed.late_ns(Arrival { number: 26, at: TimeNs(520_000_000) }).abs() < 1e-6);
        assert!(after([1, 2, 3, 26].into_iter(), AFTER_HZ, 0).is_none(), "four frames");
        assert!(after([1, 2, 3, 4, 26].into_iter(), AFTER_HZ, 0).is_some());
    }

    #[test]
    fn frames_lie_within_20_ms_of_the_new_line_and_its_lowest_frame_is_on_it() {
        for (late_ms, is_confirmed) in [(20, true), (21, false), (-20, true), (-21, false)] {
            let confirmed = after(1..=26, AFTER_HZ, late_ms);
            assert_eq!(confirmed.is_some(), is_confirmed, "{late_ms} ms");
        }
        let early = after(1..=26, AFTER_HZ, -15).unwrap();
        assert!((early.offset_ns + 15e6).abs() < 1e-6, "{early:?}");
    }

    #[test]
    fn what_announces_no_rate_or_the_old_one_changes_nothing() {
        for rate_hz in [BEFORE_HZ, 0.0, -AFTER_HZ, f64::NAN] {
            assert!(after(1..=60, rate_hz, 0).is_none(), "{rate_hz} Hz");
        }
        let mut change = RateChange::new(BEFORE_HZ);
        for number in 1..=60 {
            let at = TimeNs(0).after(SpanNs::from_ms(20 * number));
            let found = change.observe(Arrival { number, at }, AFTER_HZ, line(), 0, true);
            assert!(found.is_none(), "on time by the old line");
        }
    }
}
