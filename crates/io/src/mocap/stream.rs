//! From the bytes of one connection to the sightings of one object, whatever the source.
//!
//! Owns what all sources have in common: the order of frames, their measurement times and their statistics.
//! Pure, so that virtual time and sockets use it.

use core::net::SocketAddrV4;
use std::time::Duration;

use horizon_model::rows::{Pose, pos_w};
use tello_flight::cycle::SIGHTING_AGE_MAX;

use super::protocol::SelectedProtocol;
use super::source::{SourceError, SourceFrame};
use super::source_clock::SourceClock;
use super::{MocapCounters, MocapSettings, Sighting};
use crate::clock::{SpanNs, TimeNs};

/// A datagram is overtaken by a few others at most; a number further back begins a new count.
const OVERTAKEN_MAX: i64 = 20;

/// Two places of one frame further apart are those of two objects. m
const ONE_PLACE_M: f64 = 0.1;
/// As much more for each frame between them: 3 m/s at 30 Hz. m
const FRAME_MOVE_M: f64 = 0.1;
/// Age of a frame of unknown time when it came: more than a tick is late.
const UNDATED_AGE: SpanNs = SpanNs(SIGHTING_AGE_MAX.0 + SpanNs::from_ms(1_000).0);

/// How long two objects of one name are unseen: which of them is the vehicle is not known.
const DOUBLED: SpanNs = SpanNs::from_ms(500);

/// The bytes of one connection, read for one object.
#[derive(Debug)]
pub struct MocapStream {
    source: SelectedProtocol,
    order: FrameOrder,
}

/// Order of the frames so far, against which the next one is checked.
#[derive(Debug)]
struct FrameOrder {
    last_frame: Option<i64>,
    /// Its pose, world frame. m, rad
    last_pose: Option<Pose>,
    clock: SourceClock,
    /// When the newest frame with a known time was measured, also on an earlier connection.
    measured_at: TimeNs,
    /// When the last sighting came, also on an earlier connection.
    received_at: Option<TimeNs>,
    /// When a frame, or two frames shortly after each other, last placed the object twice.
    doubled_at: Option<TimeNs>,
}

impl MocapStream {
    /// A stream at its beginning.
    pub fn new(settings: &MocapSettings) -> Self {
        let order = FrameOrder {
            last_frame: None,
            last_pose: None,
            clock: SourceClock::new(),
            measured_at: TimeNs(0),
            received_at: None,
            doubled_at: None,
        };
        Self { source: settings.source(), order }
    }

    /// Sets whether the vehicle may be in the air; at first it is not. What the ground taught about the
    /// source's clock is held in the air, and learned anew after it.
    pub fn set_airborne(&mut self, is_airborne: bool) {
        self.order.clock.set_airborne(is_airborne);
    }

    /// Calls `on_sighting` for each new frame that `bytes` complete, a datagram or any piece of a
    /// byte stream, and counts what is dropped: malformed messages, other objects, repeated frames
    /// and frames that a later one overtook.
    ///
    /// # Errors
    /// The stream makes no sense from here on: [`restart`](Self::restart) with a new connection.
    pub fn push(
        &mut self,
        bytes: &[u8],
        received_at: TimeNs,
        counters: &MocapCounters,
        mut on_sighting: impl FnMut(Sighting),
    ) -> Result<(), SourceError> {
        let Self { source, order } = self;
        source.push(bytes, counters, &mut |frame| {
            if let Some(sighting) = order.take(frame, received_at, counters) {
                on_sighting(sighting);
            }
        })
    }

    /// Appends what is to be sent to the server now, once.
    pub fn take_requests(&mut self, to: &mut Vec<u8>) {
        self.source.protocol.take_requests(to);
    }

    /// Prepares what is to be sent without having been asked for: once when a connection begins, then about
    /// once a second, for NatNet four times.
    pub fn beat(&mut self) {
        self.source.protocol.beat();
    }

    /// Time between two [`beat`](Self::beat)s.
    pub(super) fn beat_period(&self) -> Duration {
        self.source.protocol.beat_period()
    }

    /// The multicast group that frames come by, once the server named it.
    pub(super) fn group(&self) -> Option<SocketAddrV4> {
        self.source.protocol.group()
    }

    /// Starts over with a new connection: half a message and the number of the last frame are forgotten.
    /// So is, on the ground, when frames are due; in flight the new connection has to go on with them.
    pub fn restart(&mut self) {
        self.source.restart();
        self.order.last_frame = None;
        self.order.clock.restart();
    }
}

impl FrameOrder {
    /// The sighting of `frame`, if it is a new one.
    fn take(
        &mut self,
        frame: SourceFrame,
        received_at: TimeNs,
        counters: &MocapCounters,
    ) -> Option<Sighting> {
        let SourceFrame { number, rate_hz, latency, pose, .. } = frame;
        let back = self.last_frame.map(|last| last.saturating_sub(number));
        if let Some(back @ 0..=OVERTAKEN_MAX) = back {
            if back == 0 { &counters.repeated } else { &counters.overtaken }.count();
            let one_place_m = ONE_PLACE_M + back as f64 * FRAME_MOVE_M;
            let is_elsewhere =
                |(last, now): (Pose, Pose)| (pos_w(&now) - pos_w(&last)).norm() > one_place_m;
            if self.last_pose.zip(pose).is_some_and(is_elsewhere) {
                counters.doubled.count();
                self.doubled_at = Some(received_at);
            }
            return None;
        }
        (self.last_frame, self.last_pose) = (Some(number), pose);
        let sent_at = received_at.after(SpanNs(latency.0.saturating_neg()));
        let known = self.clock.measured_at(&frame, sent_at);
        counters.note_clock(self.clock.is_confirmed(), self.clock.count_hz());
        self.measured_at = known.map_or(self.measured_at, |at| self.measured_at.max(at));
        // No younger than the newest frame with a known time, and too old to be used, also by a tick that began before
        // it came: beside frames with a known time it would count as new.
        let too_old = received_at.after(SpanNs(UNDATED_AGE.0.saturating_neg()));
        let measured_at = known.unwrap_or(self.measured_at.min(too_old)).min(received_at);
        let is_doubled = self.doubled_at.is_some_and(|at| received_at.since(at) < DOUBLED);
        let sighting = Sighting {
            frame: number,
            measured_at,
            received_at,
            pose: pose.filter(|_| !is_doubled),
        };
        let is_known = known.is_some();
        counters.note(&sighting, is_known, self.received_at.replace(received_at), rate_hz);
        Some(sighting)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RECEIVED_AT: TimeNs = TimeNs(500_000_000);

    fn relay() -> MocapStream {
        MocapStream::new(&MocapSettings::relay("tello").unwrap())
    }

    /// Sightings in `text`, received at 500 ms.
    fn frames(stream: &mut MocapStream, text: &str, counters: &MocapCounters) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        stream
            .push(text.as_bytes(), RECEIVED_AT, counters, |sighting| sightings.push(sighting))
            .unwrap();
        sightings
    }

    #[test]
    fn only_new_frames_of_the_object_pass_and_the_rest_is_counted() {
        let mut stream = relay();
        let counters = MocapCounters::default();
        let text = "1 100.0 tello 0 1 2 3 0 0 0.5\n\
                    1 100.0 wand 0 9 9 9 0 0 0\n\
                    \n\
                    1 100.0 tello 0 1 2 3 0 0 0.5\n\
                    2 100.0 tello 1 0 0 0 0 0 0\n";
        let pose = Some(Pose::new(1.0, 2.0, 3.0, 0.5));
        let expected = [
            Sighting { frame: 1, measured_at: RECEIVED_AT, received_at: RECEIVED_AT, pose },
            Sighting { frame: 2, measured_at: RECEIVED_AT, received_at: RECEIVED_AT, pose: None },
        ];
        assert_eq!(frames(&mut stream, text, &counters), expected);
        let counts = [&counters.messages, &counters.malformed, &counters.other_object]
            .map(crate::Counter::get);
        assert_eq!((counts, counters.repeated.get()), ([5, 1, 1], 1));
    }

    #[test]
    fn a_line_over_the_limit_counts_as_malformed() {
        let mut stream = relay();
        let counters = MocapCounters::default();
        let text = format!("{}\n2 100.0 tello 0 1 2 3 0 0 0.5\n", "x".repeat(5000));
        assert_eq!(frames(&mut stream, &text, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 1);
    }

    fn line(frame: i64, rate_hz: f64) -> String {
        format!("{frame} {rate_hz} tello 0 1 2 3 0 0 0.5\n")
    }

    fn ages_ms(sightings: &[Sighting]) -> Vec<f64> {
        let age_s = |s: &Sighting| s.received_at.since(s.measured_at).seconds();
        sightings.iter().map(|sighting| (1e3 * age_s(sighting)).round()).collect()
    }

    /// A stream whose frame 1010 came at 0 ms, at 100 Hz: frame 1060 is due at 500 ms.
    fn begun(counters: &MocapCounters) -> MocapStream {
        let mut stream = relay();
        stream.push(line(1010, 100.0).as_bytes(), TimeNs(0), counters, |_| ()).unwrap();
        stream
    }

    #[test]
    fn a_burst_carries_the_ages_of_its_frames() {
        let counters = MocapCounters::default();
        let mut stream = begun(&counters);
        let burst: String = [1020, 1060].map(|frame| line(frame, 100.0)).concat();
        assert_eq!(ages_ms(&frames(&mut stream, &burst, &counters)), [400.0, 0.0]);
    }

    #[test]
    fn a_new_connection_is_a_new_count_on_the_ground_only() {
        for (is_airborne, age_ms) in [(false, 0.0), (true, 400.0)] {
            let counters = MocapCounters::default();
            let mut stream = begun(&counters);
            stream.set_airborne(is_airborne);
            stream.restart();
            let sightings = frames(&mut stream, &line(1020, 100.0), &counters);
            assert_eq!(ages_ms(&sightings), [age_ms], "{is_airborne}");
        }
    }

    #[test]
    fn a_frame_of_unknown_time_is_too_old_to_be_used() {
        let counters = MocapCounters::default();
        let mut stream = begun(&counters);
        stream.set_airborne(true);
        stream.restart();
        // Frame 1059 was measured at 490 ms; then the server counts from 1 again.
        let text = [1059, 1, 2, 1900].map(|frame| line(frame, 100.0)).concat();
        assert_eq!(ages_ms(&frames(&mut stream, &text, &counters)), [10.0, 1100.0, 1100.0, 1100.0]);
        // Also beside frames of a known time.
        let text = [1060, 7, 1061, 8].map(|frame| line(frame, 100.0)).concat();
        assert_eq!(ages_ms(&frames(&mut stream, &text, &counters)), [0.0, 1100.0, 0.0, 1100.0]);
        let report = counters.report();
        assert_eq!((report.frames, report.undated), (9, 5));
        assert!((report.latency_max_s - 0.01).abs() < 1e-4, "{report:?}");
        // Nothing is known of a source that never reported its rate.
        let (mut stream, counters) = (relay(), MocapCounters::default());
        assert_eq!(ages_ms(&frames(&mut stream, &line(1, 0.0), &counters)), [1100.0]);
        assert!(!counters.report().has_clock);
    }

    #[test]
    fn of_two_objects_of_one_name_none_is_seen_until_one_of_them_has_gone() {
        let (mut stream, counters) = (relay(), MocapCounters::default());
        let mut seen = |from: i64, to: i64, beside_m: Option<f64>| {
            let mut seen = 0;
            for frame in from..to {
                let at = TimeNs(0).after(SpanNs::from_ms(10 * frame));
                let beside =
                    beside_m.map(|x_m| format!("{frame} 100.0 tello 0 {x_m} 2 3 0 0 0.5\n"));
                let text = line(frame, 100.0) + &beside.unwrap_or_default();
                let take = |sighting: Sighting| seen += i64::from(sighting.pose.is_some());
                stream.push(text.as_bytes(), at, &counters, take).unwrap();
            }
            seen
        };
        assert_eq!(seen(0, 100, None), 100);
        // A source that sends some frames twice, the object 2 cm further on.
        assert_eq!(seen(100, 200, Some(1.02)), 100);
        assert_eq!(seen(200, 300, Some(1.5)), 1, "the first cannot be known");
        assert_eq!(seen(300, 400, None), 51);
    }

    #[test]
    fn a_second_source_that_is_a_few_numbers_ahead_replaces_no_frames_unseen() {
        // (numbers ahead, further on in m, poses seen of 100)
        for (ahead, further_m, expected) in [(3, 0.35, 100), (3, 0.45, 1), (20, 2.2, 1)] {
            let (mut stream, counters) = (relay(), MocapCounters::default());
            let mut seen = 0;
            for frame in 0..100 {
                let (number, x_m) = (frame + ahead, 1.0 + further_m);
                let text = format!("{number} 100.0 tello 0 {x_m} 2 3 0 0 0.5\n");
                let at = TimeNs(0).after(SpanNs::from_ms(10 * frame));
                let take = |sighting: Sighting| seen += i64::from(sighting.pose.is_some());
                stream.push((text + &line(frame, 100.0)).as_bytes(), at, &counters, take).unwrap();
            }
            assert_eq!(seen, expected, "{ahead} ahead, {further_m} m further on");
            assert_eq!(counters.overtaken.get(), 100);
        }
    }

    #[test]
    fn two_seconds_on_the_ground_confirm_the_rate() {
        let (mut stream, counters) = (relay(), MocapCounters::default());
        for frame in 0..=210 {
            let at = TimeNs(0).after(SpanNs::from_ms(10 * frame));
            stream.push(line(frame, 100.0).as_bytes(), at, &counters, |_| ()).unwrap();
            let report = counters.report();
            assert_eq!(report.has_clock, frame >= 200, "frame {frame}");
            assert_eq!(report.count_hz, (frame >= 200).then_some(100.0), "frame {frame}");
        }
    }

    #[test]
    fn a_server_that_restarted_may_count_its_frames_anew() {
        let mut stream = relay();
        let counters = MocapCounters::default();
        let line = "7 100.0 tello 0 1 2 3 0 0 0.5\n";
        assert_eq!(frames(&mut stream, &format!("{line}7 100.0 te"), &counters).len(), 1);
        stream.restart();
        assert_eq!(frames(&mut stream, line, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 0);
    }

    #[test]
    fn a_frame_that_was_overtaken_is_dropped_and_a_new_count_is_not() {
        let mut stream = relay();
        let counters = MocapCounters::default();
        let text: String = [100, 99, 101, 101, 81, 80, 81, 82]
            .map(|frame| format!("{frame} 100.0 tello 0 1 2 3 0 0 0.5\n"))
            .concat();
        let seen: Vec<i64> =
            frames(&mut stream, &text, &counters).iter().map(|sighting| sighting.frame).collect();
        // 81 is 20 behind 101, 80 is 21.
        assert_eq!(seen, [100, 101, 80, 81, 82]);
        assert_eq!((counters.overtaken.get(), counters.repeated.get()), (2, 1));
    }
}
