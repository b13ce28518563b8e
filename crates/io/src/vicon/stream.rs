//! From the bytes of one connection to the sightings of one object, whatever the source.
//!
//! Owns what all sources share: the order of frames, their measurement times and their statistics.
//! Pure, so that virtual time and sockets share it.

use super::frame_clock::FrameClock;
use super::source::{Frame, Source, SourceError};
use super::{Sighting, ViconCounters, ViconSettings};
use crate::clock::{SpanNs, TimeNs};

/// A datagram is overtaken by a few others at most; a number further back begins a new count.
const OVERTAKEN_MAX: i64 = 20;

/// The bytes of one connection, read for one object.
#[derive(Debug)]
pub struct ViconStream {
    source: Box<dyn Source>,
    order: Order,
}

/// What the frames so far tell about the next one.
#[derive(Debug, Default)]
struct Order {
    last_frame: Option<i64>,
    frame_clock: FrameClock,
    /// When the last sighting came, also on an earlier connection.
    received_at: Option<TimeNs>,
}

impl ViconStream {
    /// A stream at its beginning.
    pub fn new(settings: &ViconSettings) -> Self {
        Self { source: settings.source(), order: Order::default() }
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
        counters: &ViconCounters,
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
        self.source.take_requests(to);
    }

    /// Starts over with a new connection: half a message and the frames so far are forgotten.
    pub fn restart(&mut self) {
        self.source.restart();
        self.order = Order { received_at: self.order.received_at, ..Order::default() };
    }
}

impl Order {
    /// The sighting of `frame`, if it is a new one.
    fn take(
        &mut self,
        frame: Frame,
        received_at: TimeNs,
        counters: &ViconCounters,
    ) -> Option<Sighting> {
        let Frame { number, rate_hz, latency, pose } = frame;
        let back = self.last_frame.map(|last| last.saturating_sub(number));
        match back {
            Some(0) => {
                counters.repeated.count();
                return None;
            }
            Some(1..=OVERTAKEN_MAX) => {
                counters.overtaken.count();
                return None;
            }
            _ => self.last_frame = Some(number),
        }
        let sent_at = received_at.after(SpanNs(latency.0.saturating_neg()));
        let measured_at = self.frame_clock.measured_at(number, rate_hz, sent_at);
        let sighting = Sighting { frame: number, measured_at, received_at, pose };
        counters.note(&sighting, self.received_at.replace(received_at), rate_hz);
        Some(sighting)
    }
}

#[cfg(test)]
mod tests {
    use tello_model::rows::Pose;

    use super::*;

    const RECEIVED_AT: TimeNs = TimeNs(500_000_000);

    fn relay() -> ViconStream {
        ViconStream::new(&ViconSettings::relay("tello").unwrap())
    }

    /// Sightings in `text`, received at 500 ms.
    fn frames(stream: &mut ViconStream, text: &str, counters: &ViconCounters) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        stream
            .push(text.as_bytes(), RECEIVED_AT, counters, |sighting| sightings.push(sighting))
            .unwrap();
        sightings
    }

    #[test]
    fn only_new_frames_of_the_object_pass_and_the_rest_is_counted() {
        let mut stream = relay();
        let counters = ViconCounters::default();
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
    fn a_line_beyond_the_limit_counts_as_malformed() {
        let mut stream = relay();
        let counters = ViconCounters::default();
        let text = format!("{}\n2 100.0 tello 0 1 2 3 0 0 0.5\n", "x".repeat(5000));
        assert_eq!(frames(&mut stream, &text, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 1);
    }

    #[test]
    fn a_burst_carries_the_ages_of_its_frames_until_a_restart() {
        let mut stream = relay();
        let counters = ViconCounters::default();
        let line = |frame: i64, rate_hz: f64| format!("{frame} {rate_hz} tello 0 1 2 3 0 0 0.5\n");
        let ages_ms = |sightings: Vec<Sighting>| -> Vec<f64> {
            let age_s = |s: &Sighting| s.received_at.since(s.measured_at).seconds();
            sightings.iter().map(|sighting| (1e3 * age_s(sighting)).round()).collect()
        };
        stream.push(line(10, 100.0).as_bytes(), TimeNs(0), &counters, |_| ()).unwrap();
        let burst: String = [20, 60].map(|frame| line(frame, 100.0)).concat();
        assert_eq!(ages_ms(frames(&mut stream, &burst, &counters)), [400.0, 0.0]);
        assert_eq!(ages_ms(frames(&mut stream, &line(999, -1.0), &counters)), [0.0], "no rate");
        stream.push(line(100, 100.0).as_bytes(), TimeNs(0), &counters, |_| ()).unwrap();
        stream.restart();
        assert_eq!(ages_ms(frames(&mut stream, &line(110, 100.0), &counters)), [0.0]);
    }

    #[test]
    fn a_server_that_restarted_may_count_its_frames_anew() {
        let mut stream = relay();
        let counters = ViconCounters::default();
        let line = "7 100.0 tello 0 1 2 3 0 0 0.5\n";
        assert_eq!(frames(&mut stream, &format!("{line}7 100.0 te"), &counters).len(), 1);
        stream.restart();
        assert_eq!(frames(&mut stream, line, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 0);
    }

    #[test]
    fn a_frame_that_was_overtaken_is_dropped_and_a_new_count_is_not() {
        let mut stream = relay();
        let counters = ViconCounters::default();
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
