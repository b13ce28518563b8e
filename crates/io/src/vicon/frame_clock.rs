//! When a frame was measured, from its number.
//!
//! Bytes that a stalled network delivers late carry old frames, though they have just arrived. Frame
//! numbers keep pace with time, so that the fastest frame of a connection tells when each of the
//! others should have come. The shortest delay itself, some milliseconds, stays unknown.
//!
//! A relay may count lines instead of frames, or announce a rate that is not its own. Then frames look
//! ever older; a burst does not last that long, and such numbers are no longer believed.

use crate::clock::{SpanNs, TimeNs};

/// Ratio of a time to what the clocks of mocap system and host may drift apart in it: 100 us per s.
const TIME_PER_DRIFT: i64 = 10_000;

/// Delay that a healthy connection shows in bursts only.
const LATE: SpanNs = SpanNs::from_ms(250);

/// Arrivals that are [`LATE`] for so long are no burst: the count begins anew.
const BURST_MAX: SpanNs = SpanNs::from_ms(1_000);

/// A count that has to begin anew twice in this time is not believed again.
const TRUST_PERIOD: SpanNs = SpanNs::from_ms(10_000);

/// The frame numbers of one connection against the host's clock.
#[derive(Debug, Default)]
pub(super) struct FrameClock {
    newest: Option<Newest>,
    /// Since when every frame came late.
    late_since: Option<TimeNs>,
    /// When the count last began anew because frames did not keep pace with time.
    renewed_at: Option<TimeNs>,
    is_distrusted: bool,
}

#[derive(Debug, Clone, Copy)]
struct Newest {
    frame: i64,
    rate_hz: f64,
    received_at: TimeNs,
    /// When frame zero would have arrived with the shortest delay so far, drift allowed for.
    zero_at: TimeNs,
}

impl FrameClock {
    /// When `frame` was measured, never later than `received_at`.
    ///
    /// It equals `received_at` for the first frame of a count, which is the first of all and any whose
    /// number goes back or leaves out more than a second, or whose `rate_hz` (finite) is a new one.
    /// Without a positive rate it always does, and with numbers that do not keep pace with time.
    pub(super) fn measured_at(&mut self, frame: i64, rate_hz: f64, received_at: TimeNs) -> TimeNs {
        let measured_at = self.by_count(frame, rate_hz, received_at);
        if received_at.since(measured_at) <= LATE {
            self.late_since = None;
            return measured_at;
        }
        let late_since = *self.late_since.get_or_insert(received_at);
        if received_at.since(late_since) < BURST_MAX {
            return measured_at;
        }
        let renewed_at = self.renewed_at.replace(received_at);
        self.is_distrusted = renewed_at.is_some_and(|at| received_at.since(at) < TRUST_PERIOD);
        self.newest = None;
        self.late_since = None;
        received_at
    }

    /// The same as far as the count is believed.
    fn by_count(&mut self, frame: i64, rate_hz: f64, received_at: TimeNs) -> TimeNs {
        if rate_hz <= 0.0 || self.is_distrusted {
            self.newest = None;
            return received_at;
        }
        #[expect(clippy::cast_possible_truncation, reason = "beyond 292 years it saturates")]
        let since_zero = SpanNs((frame as f64 * 1e9 / rate_hz).round() as i64);
        let mut zero_at = TimeNs(received_at.0.saturating_sub(since_zero.0));
        if let Some(newest) = self.newest.filter(|newest| newest.is_followed_by(frame, rate_hz)) {
            let drift = SpanNs(received_at.since(newest.received_at).0 / TIME_PER_DRIFT);
            zero_at = zero_at.min(newest.zero_at.after(drift));
        }
        self.newest = Some(Newest { frame, rate_hz, received_at, zero_at });
        zero_at.after(since_zero).min(received_at)
    }
}

impl Newest {
    /// Whether `frame` belongs to the same count: at most one second further.
    fn is_followed_by(self, frame: i64, rate_hz: f64) -> bool {
        let frames = frame.saturating_sub(self.frame);
        self.rate_hz.total_cmp(&rate_hz).is_eq() && frames >= 0 && frames as f64 <= rate_hz
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn ms(ms: i64) -> TimeNs {
        TimeNs(0).after(SpanNs::from_ms(ms))
    }

    /// Delays of the frames (number, arrival in ms) beyond the shortest, at 50 Hz. ms
    fn delays_ms(frames: impl IntoIterator<Item = (i64, i64)>) -> Vec<f64> {
        let mut clock = FrameClock::default();
        let delay = |(frame, at)| ms(at).since(clock.measured_at(frame, 50.0, ms(at))).seconds();
        frames.into_iter().map(delay).map(|delay_s| delay_s * 1e3).collect()
    }

    fn assert_near(actual_ms: &[f64], expected_ms: &[f64]) {
        let is_near = |(actual, expected): (&f64, &f64)| {
            // Drift of 100 us per second over the seconds of these tests.
            (actual - expected).abs() < 0.2
        };
        assert_eq!(actual_ms.len(), expected_ms.len());
        assert!(actual_ms.iter().zip(expected_ms).all(is_near), "{actual_ms:?}");
    }

    #[test]
    fn frames_on_time_were_measured_when_received() {
        let frames: Vec<_> = (0..1000).map(|k| (7_000_000 + k, 300 + 20 * k)).collect();
        assert!(delays_ms(frames).iter().all(|delay| delay.abs() < 1e-9));
    }

    #[test]
    fn a_burst_after_a_stall_is_as_old_as_its_frames() {
        let burst = [(0, 5), (1, 25), (2, 445), (3, 445), (12, 445), (22, 445), (23, 465)];
        assert_near(&delays_ms(burst), &[0.0, 0.0, 400.0, 380.0, 200.0, 0.0, 0.0]);
    }

    #[test]
    fn a_stall_that_leaves_frames_out_makes_nothing_old() {
        assert_near(&delays_ms([(0, 0), (1, 20), (51, 1020), (52, 1040)]), &[0.0; 4]);
    }

    #[test]
    fn a_first_frame_that_was_late_is_corrected_by_the_next() {
        assert_near(&delays_ms([(0, 90), (1, 90), (2, 90), (3, 90), (4, 80 + 5)]), &[0.0; 5]);
        assert_near(&delays_ms([(0, 90), (4, 90), (5, 190)]), &[0.0, 0.0, 80.0]);
    }

    #[test]
    fn a_new_count_begins_without_a_past() {
        let fresh = [(100, 0), (99, 500), (149, 2000), (200, 9000)];
        // Back by one; exactly a second further, half a second late; more than a second further.
        assert_near(&delays_ms(fresh), &[0.0, 0.0, 500.0, 0.0]);
        let mut clock = FrameClock::default();
        for (frame, rate_hz) in [(0, 50.0), (1, 100.0), (2, 50.0), (3, 0.0), (4, 50.0), (5, -1.0)] {
            let at = ms(1000 * frame);
            assert_eq!(clock.measured_at(frame, rate_hz, at), at, "frame {frame} at {rate_hz} Hz");
        }
    }

    #[test]
    fn numbers_that_do_not_keep_pace_with_time_are_soon_not_believed() {
        // Half the announced rate: each second the frames look half a second older.
        let delays_ms = delays_ms((0..500).map(|k| (k, 40 * k)));
        assert!(delays_ms.iter().all(|delay| *delay < 760.0), "{delays_ms:?}");
        assert!(delays_ms[100..].iter().all(|delay| delay.abs() < 1e-9), "{delays_ms:?}");
    }

    #[test]
    fn one_pause_of_the_count_is_forgiven_after_a_second() {
        let paused = (0..200).map(|k| (k, if k < 100 { 20 * k } else { 20 * k + 400 }));
        let delays_ms = delays_ms(paused);
        assert_near(&delays_ms[..100], &[0.0; 100]);
        assert_near(&delays_ms[100..150], &[400.0; 50]);
        assert_near(&delays_ms[151..], &[0.0; 49]);
    }

    #[test]
    fn clocks_that_drift_apart_do_not_age_the_frames() {
        // The mocap system is slower by 80 us per second; an hour would add up to 288 ms.
        let mut clock = FrameClock::default();
        for frame in 0..180_000 {
            let at = TimeNs(frame * 20_001_600);
            assert_eq!(clock.measured_at(frame, 50.0, at), at, "frame {frame}");
        }
    }

    proptest! {
        #[test]
        fn no_frame_was_measured_after_it_came(
            frames in prop::collection::vec(
                prop_oneof![
                    (any::<i64>(), -1e3_f64..1e3, any::<i64>()),
                    (0..60_i64, Just(50.0), 0..2_000_000_000_i64),
                ],
                0..50,
            ),
        ) {
            let mut clock = FrameClock::default();
            for (frame, rate_hz, at) in frames {
                let measured_at = clock.measured_at(frame, rate_hz, TimeNs(at));
                prop_assert!(measured_at <= TimeNs(at), "{frame} at {rate_hz} Hz: {measured_at:?}");
            }
        }
    }
}
