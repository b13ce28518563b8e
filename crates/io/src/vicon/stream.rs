//! From the bytes of one relay connection to the sightings of one object.
//!
//! Pure, so that virtual time and sockets share it.

use super::frame_clock::FrameClock;
use super::lines::Lines;
use super::relay::{RelayPose, parse_line};
use super::{Sighting, ViconCounters};
use crate::clock::TimeNs;

/// The bytes of one connection, read for one object.
#[derive(Debug)]
pub struct RelayStream {
    object: String,
    lines: Lines,
    /// Frame of the newest line of the object.
    last_frame: Option<i64>,
    frame_clock: FrameClock,
}

impl RelayStream {
    /// A stream at its beginning.
    pub fn new(object: &str) -> Self {
        Self {
            object: object.to_owned(),
            lines: Lines::default(),
            last_frame: None,
            frame_clock: FrameClock::default(),
        }
    }

    /// Calls `on_sighting` for each new frame of the object that `chunk` completes, and counts what
    /// is dropped: malformed lines, other objects, repeated frames.
    ///
    /// No allocation, except for the message of a malformed line.
    pub fn push(
        &mut self,
        chunk: &[u8],
        received_at: TimeNs,
        counters: &ViconCounters,
        mut on_sighting: impl FnMut(Sighting),
    ) {
        let Self { object, lines, last_frame, frame_clock } = self;
        lines.push(chunk, |line| {
            counters.lines.count();
            let Some(Ok(line)) = line.map(parse_line) else {
                counters.malformed.count();
                return;
            };
            if line.object != object {
                counters.other_object.count();
            } else if *last_frame == Some(line.frame) {
                counters.repeated.count();
            } else {
                *last_frame = Some(line.frame);
                let RelayPose { frame, rate_hz, pose, .. } = line;
                let measured_at = frame_clock.measured_at(frame, rate_hz, received_at);
                on_sighting(Sighting { frame, measured_at, received_at, pose });
            }
        });
    }

    /// Starts over with a new connection: a half line and the frames so far are forgotten.
    pub fn restart(&mut self) {
        self.lines.clear();
        self.last_frame = None;
        self.frame_clock = FrameClock::default();
    }
}

#[cfg(test)]
mod tests {
    use tello_model::rows::Pose;

    use super::*;

    const RECEIVED_AT: TimeNs = TimeNs(500_000_000);

    /// Sightings in `text`, received at 500 ms.
    fn frames(stream: &mut RelayStream, text: &str, counters: &ViconCounters) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        stream.push(text.as_bytes(), RECEIVED_AT, counters, |sighting| sightings.push(sighting));
        sightings
    }

    #[test]
    fn only_new_frames_of_the_object_pass_and_the_rest_is_counted() {
        let mut stream = RelayStream::new("tello");
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
        let counts =
            [&counters.lines, &counters.malformed, &counters.other_object].map(crate::Counter::get);
        assert_eq!((counts, counters.repeated.get()), ([5, 1, 1], 1));
    }

    #[test]
    fn a_line_beyond_the_limit_counts_as_malformed() {
        let mut stream = RelayStream::new("tello");
        let counters = ViconCounters::default();
        let text = format!("{}\n2 100.0 tello 0 1 2 3 0 0 0.5\n", "x".repeat(5000));
        assert_eq!(frames(&mut stream, &text, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 1);
    }

    #[test]
    fn a_burst_carries_the_ages_of_its_frames_until_a_restart() {
        let mut stream = RelayStream::new("tello");
        let counters = ViconCounters::default();
        let line = |frame: i64, rate_hz: f64| format!("{frame} {rate_hz} tello 0 1 2 3 0 0 0.5\n");
        let ages_ms = |sightings: Vec<Sighting>| -> Vec<f64> {
            let age_s = |s: &Sighting| s.received_at.since(s.measured_at).seconds();
            sightings.iter().map(|sighting| (1e3 * age_s(sighting)).round()).collect()
        };
        stream.push(line(10, 100.0).as_bytes(), TimeNs(0), &counters, |_| ());
        let burst: String = [20, 60].map(|frame| line(frame, 100.0)).concat();
        assert_eq!(ages_ms(frames(&mut stream, &burst, &counters)), [400.0, 0.0]);
        assert_eq!(ages_ms(frames(&mut stream, &line(59, -1.0), &counters)), [0.0], "no rate");
        stream.push(line(100, 100.0).as_bytes(), TimeNs(0), &counters, |_| ());
        stream.restart();
        assert_eq!(ages_ms(frames(&mut stream, &line(110, 100.0), &counters)), [0.0]);
    }

    #[test]
    fn a_server_that_restarted_may_count_its_frames_anew() {
        let mut stream = RelayStream::new("tello");
        let counters = ViconCounters::default();
        let line = "7 100.0 tello 0 1 2 3 0 0 0.5\n";
        assert_eq!(frames(&mut stream, &format!("{line}7 100.0 te"), &counters).len(), 1);
        stream.restart();
        assert_eq!(frames(&mut stream, line, &counters).len(), 1);
        assert_eq!(counters.malformed.get(), 0);
    }
}
