//! State of the mocap stream: counts of the task that reads it, and their statistics.

use std::fmt::{self, Display, Formatter};
use std::io;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::Serialize;

use super::{Refusal, Sighting, SourceError};
use crate::Counter;
use crate::clock::{SpanNs, TimeNs};

/// Periods between two sightings beyond which something is missing.
pub(super) const GAP_PERIODS: f64 = 2.5;

/// Counters of the bytes and frames of a source. Written by one task, read by others.
#[derive(Debug, Default)]
pub struct MocapCounters {
    /// Connections made, or sockets opened.
    pub connects: Counter,
    /// Complete messages received: lines, datagrams or packets.
    pub messages: Counter,
    /// Messages that were refused.
    pub malformed: Counter,
    /// Messages about other objects only.
    pub other_object: Counter,
    /// Frames in which bodies have no name yet, and none is the object: no frame of ours.
    pub unnamed: Counter,
    /// Messages with the frame number of the message before.
    pub repeated: Counter,
    /// Frames with two objects of the name, or two messages of one frame that place it more than 0.1 m apart.
    pub doubled: Counter,
    /// `other_object`, `unnamed`, `doubled`, `repeated`, `sightings` and `undated` at the newest pose of a known time.
    at_pose: [Counter; 6],
    /// Frames that arrived after a later one, and were dropped.
    pub overtaken: Counter,
    /// Sightings lost because the queue was full.
    pub overflow: Counter,
    /// Sightings, each a new frame.
    pub sightings: Counter,
    /// Sightings without a pose.
    pub unseen: Counter,
    /// Frames whose time of measurement is unknown.
    pub undated: Counter,
    /// Times that no frame came for more than two and a half periods.
    pub gaps: Counter,
    /// Longest time between two frames. ns
    gap_max_ns: Counter,
    /// Sum and maximum of the times from measured to received. ns
    latency_ns: Counter,
    latency_max_ns: Counter,
    /// Times of the first and the newest frame, counted from 1 since 0 is none. ns
    first_ns: Counter,
    newest_ns: Counter,
    has_clock: AtomicBool,
    /// Bits of a number, 0 while it is not known. Hz
    count_hz: AtomicU64,
    /// Bits of a number, 0 while it is not known. Hz
    announced_hz: AtomicU64,
    refused: Mutex<Option<Refusal>>,
    given_up: Mutex<Option<SourceError>>,
    unopened: Mutex<Option<String>>,
}

/// Statistics of a stream up to now.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, JsonSchema)]
pub struct StreamReport {
    /// Frames received.
    pub frames: u64,
    /// Frames per second of the time that they took, gaps included; null before the second. Hz
    pub rate_hz: Option<f64>,
    /// Frames in which the vehicle was not seen.
    pub unseen: u64,
    /// Whether frame numbers or time stamps show when frames were measured: their rate was confirmed by arrivals on
    /// the ground, over 2 s or more.
    pub has_clock: bool,
    /// Frame numbers per second as measured on the ground; null before 2 s. Hz
    pub count_hz: Option<f64>,
    /// Frames whose time of measurement is not known: they are not used.
    pub undated: u64,
    /// Times that no frame came for more than two and a half periods.
    pub gaps: u64,
    /// Longest time between two frames. s
    pub gap_max_s: f64,
    /// Mean time from measured to received beyond the shortest, or as the source reports it, where it is
    /// known. s
    pub latency_mean_s: f64,
    /// Longest time from measured to received, beyond the shortest. s
    pub latency_max_s: f64,
    /// Connections beyond the first, or sockets opened anew after silence.
    pub reconnects: u64,
    /// Messages that were refused.
    pub malformed: u64,
    /// Messages about other objects only.
    pub other_object: u64,
    /// Messages dropped because they had the number of the frame before.
    pub repeated: u64,
    /// Frames with two objects of the name, or two messages of one frame that place it more than 0.1 m apart.
    pub doubled: u64,
    /// Frames dropped because a later one had arrived.
    pub overtaken: u64,
    /// Frames dropped because the queue to the control thread was full.
    pub overflow: u64,
}

/// Numbers of frames since the newest pose of a known time, by reason.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SincePose {
    /// Other objects only.
    pub other_object: u64,
    /// Bodies without a name.
    pub unnamed: u64,
    /// Two objects of the name.
    pub doubled: u64,
    /// Frames with the number of the frame before.
    pub repeated: u64,
    /// Frames with a new number.
    pub frames: u64,
    /// Frames of unknown time.
    pub undated: u64,
}

impl MocapCounters {
    /// The counts now.
    pub fn report(&self) -> StreamReport {
        let frames = self.sightings.get();
        let dated = frames.saturating_sub(self.undated.get());
        let count_hz = f64::from_bits(self.count_hz.load(Ordering::Relaxed));
        let first_ns = self.first_ns.get();
        let took_s = self.newest_ns.get().saturating_sub(first_ns) as f64 * 1e-9;
        StreamReport {
            frames,
            rate_hz: (took_s > 0.0).then(|| (frames.saturating_sub(1)) as f64 / took_s),
            unseen: self.unseen.get(),
            has_clock: self.has_clock(),
            count_hz: (count_hz > 0.0).then_some(count_hz),
            undated: self.undated.get(),
            gaps: self.gaps.get(),
            gap_max_s: self.gap_max_ns.get() as f64 * 1e-9,
            latency_mean_s: self.latency_ns.get() as f64 * 1e-9 / dated.max(1) as f64,
            latency_max_s: self.latency_max_ns.get() as f64 * 1e-9,
            reconnects: self.connects.get().saturating_sub(1),
            malformed: self.malformed.get(),
            other_object: self.other_object.get(),
            repeated: self.repeated.get(),
            doubled: self.doubled.get(),
            overtaken: self.overtaken.get(),
            overflow: self.overflow.get(),
        }
    }

    fn by_reason(&self) -> [&Counter; 6] {
        let Self { other_object, unnamed, doubled, repeated, sightings, undated, .. } = self;
        [other_object, unnamed, doubled, repeated, sightings, undated]
    }

    /// Numbers of frames since the newest pose of a known time, by reason.
    pub fn since_pose(&self) -> SincePose {
        let mut since = self.by_reason().map(Counter::get);
        for (since, before) in since.iter_mut().zip(&self.at_pose) {
            *since = since.saturating_sub(before.get());
        }
        let [other_object, unnamed, doubled, repeated, frames, undated] = since;
        SincePose { other_object, unnamed, doubled, repeated, frames, undated }
    }

    /// Whether it is known when frames were measured, as in [`StreamReport::has_clock`].
    pub fn has_clock(&self) -> bool {
        self.has_clock.load(Ordering::Relaxed)
    }

    /// Counts a message that is refused.
    pub(super) fn refuse(&self, why: Refusal) {
        self.malformed.count();
        *self.refused.lock() = Some(why);
    }

    /// Reason of the newest refusal; `None` before the first.
    pub fn refused(&self) -> Option<Refusal> {
        *self.refused.lock()
    }

    /// Frame rate of the newest frame, as announced or set; `None` before the first. Hz
    pub fn announced_hz(&self) -> Option<f64> {
        let hz = f64::from_bits(self.announced_hz.load(Ordering::Relaxed));
        (hz > 0.0).then_some(hz)
    }

    /// Error for which the newest connection was closed; `None` once a frame was decoded after it.
    pub fn given_up(&self) -> Option<SourceError> {
        self.given_up.lock().clone()
    }

    pub(super) fn give_up(&self, error: SourceError) {
        *self.given_up.lock() = Some(error);
    }

    /// Why the newest connection, port or multicast group could not be opened; `None` if it was, or if nobody listens.
    pub(crate) fn unopened(&self) -> Option<String> {
        self.unopened.lock().clone()
    }

    pub(crate) fn note_opening(&self, opened: Result<(), &io::Error>) {
        let why = match opened {
            Err(error) if error.kind() != io::ErrorKind::ConnectionRefused => {
                Some(error.to_string())
            }
            Ok(()) | Err(_) => None,
        };
        *self.unopened.lock() = why;
    }

    /// Notes whether frames have times, and the frame numbers per second. Hz
    pub(super) fn note_clock(&self, has_clock: bool, count_hz: Option<f64>) {
        // Neither belongs to a certain frame.
        self.has_clock.store(has_clock, Ordering::Relaxed);
        self.count_hz.store(count_hz.unwrap_or(0.0).to_bits(), Ordering::Relaxed);
    }

    /// Counts a frame that came after the one received at `before`, at `rate_hz` if it is positive;
    /// `is_dated`: whether it is known when it was measured.
    pub(super) fn note(
        &self,
        sighting: &Sighting,
        is_dated: bool,
        before: Option<TimeNs>,
        rate_hz: f64,
    ) {
        let Sighting { measured_at, received_at, pose, .. } = sighting;
        self.sightings.count();
        self.announced_hz.store(rate_hz.to_bits(), Ordering::Relaxed);
        *self.given_up.lock() = None;
        if pose.is_none() {
            self.unseen.count();
        } else if is_dated {
            for (at_pose, count) in self.at_pose.iter().zip(self.by_reason()) {
                at_pose.raise(count.get());
            }
        }
        if is_dated {
            let latency_ns = nanoseconds(received_at.since(*measured_at));
            self.latency_ns.add(latency_ns);
            self.latency_max_ns.raise(latency_ns);
        } else {
            self.undated.count();
        }
        let now_ns = nanoseconds(received_at.since(TimeNs(0))).saturating_add(1);
        self.newest_ns.raise(now_ns);
        match before {
            None if self.first_ns.get() == 0 => self.first_ns.raise(now_ns),
            None => {}
            Some(before) => {
                let gap = received_at.since(before);
                self.gap_max_ns.raise(nanoseconds(gap));
                if rate_hz > 0.0 && gap.seconds() * rate_hz > GAP_PERIODS {
                    self.gaps.count();
                }
            }
        }
    }
}

impl Display for StreamReport {
    /// One line; what did not happen is left out.
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Some(rate_hz) = self.rate_hz else { return write!(f, "{} frames", self.frames) };
        let ms = |seconds: f64| 1e3 * seconds;
        write!(
            f,
            "{rate_hz:.1} Hz, latency {:.1} ms mean, {:.1} max, gaps {}, longest {:.0} ms",
            ms(self.latency_mean_s),
            ms(self.latency_max_s),
            self.gaps,
            ms(self.gap_max_s)
        )?;
        let counts = [
            (self.unseen, "unseen"),
            (self.undated, "of unknown time"),
            (self.reconnects, "reconnects"),
            (self.malformed, "malformed"),
            (self.other_object, "of other objects"),
            (self.repeated, "repeated"),
            (self.doubled, "in two places"),
            (self.overtaken, "overtaken"),
            (self.overflow, "overflow"),
        ];
        for (count, what) in counts.into_iter().filter(|(count, _)| *count > 0) {
            write!(f, ", {count} {what}")?;
        }
        Ok(())
    }
}

fn nanoseconds(span: SpanNs) -> u64 {
    u64::try_from(span.0).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::Pose;

    use super::*;

    #[test]
    fn rate_gaps_and_latencies_are_those_of_the_frames() {
        let counters = MocapCounters::default();
        let mut before = None;
        // 50 Hz with one gap of 3 periods and one of 2, each frame 4 ms old, the last one 10 ms.
        for (at_ms, age_ms) in [(100, 4), (120, 4), (180, 4), (220, 4), (240, 10)] {
            let received_at = TimeNs(0).after(SpanNs::from_ms(at_ms));
            let measured_at = received_at.after(SpanNs::from_ms(-age_ms));
            let sighting = Sighting { frame: at_ms, measured_at, received_at, pose: None };
            counters.note(&sighting, true, before, 50.0);
            before = Some(received_at);
        }
        let report = counters.report();
        assert_eq!((report.frames, report.unseen, report.gaps), (5, 5, 1));
        let is_near = |value: f64, expected: f64| (value - expected).abs() < 1e-9;
        assert!(is_near(report.rate_hz.unwrap(), 4.0 / 0.14), "{report:?}");
        assert!(is_near(report.gap_max_s, 0.06), "{report:?}");
        assert!(is_near(report.latency_mean_s, 0.0052), "{report:?}");
        assert!(is_near(report.latency_max_s, 0.01), "{report:?}");
        assert_eq!(
            report.to_string(),
            "28.6 Hz, latency 5.2 ms mean, 10.0 max, gaps 1, longest 60 ms, 5 unseen"
        );
    }

    #[test]
    fn a_stream_without_frames_has_no_rate() {
        let report = MocapCounters::default().report();
        assert_eq!(report, StreamReport::default());
    }

    #[test]
    fn what_frames_had_in_place_of_a_pose_is_counted_from_the_newest_pose_on() {
        let counters = MocapCounters::default();
        let at = TimeNs(5);
        let seen =
            Sighting { frame: 1, measured_at: at, received_at: at, pose: Some(Pose::zeros()) };
        counters.doubled.count();
        counters.note(&seen, true, None, 50.0);
        assert_eq!(counters.since_pose(), SincePose::default());
        counters.other_object.count();
        counters.doubled.count();
        counters.note(&Sighting { pose: None, ..seen }, true, None, 50.0);
        let expected = SincePose { other_object: 1, doubled: 1, frames: 1, ..SincePose::default() };
        assert_eq!(counters.since_pose(), expected, "a frame without a pose begins nothing");
        counters.note(&seen, false, None, 50.0);
        let expected = SincePose { frames: 2, undated: 1, ..expected };
        assert_eq!(counters.since_pose(), expected, "nor does a pose of unknown time");
    }

    #[test]
    fn what_was_wrong_with_an_earlier_connection_is_no_reason_once_a_frame_is_understood() {
        let counters = MocapCounters::default();
        counters.give_up(SourceError::NoVrpn);
        assert_eq!(counters.given_up(), Some(SourceError::NoVrpn));
        let at = TimeNs(5);
        let sighting = Sighting { frame: 1, measured_at: at, received_at: at, pose: None };
        counters.note(&sighting, true, None, 50.0);
        assert_eq!(counters.given_up(), None);
    }
}
