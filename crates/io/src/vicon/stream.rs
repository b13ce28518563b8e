//! From the bytes of one relay connection to the sightings of one object.
//!
//! Pure, so that virtual time and sockets share it.

use super::lines::Lines;
use super::relay::parse_line;
use super::{Sighting, ViconCounters};
use crate::clock::TimeNs;

/// The bytes of one connection, read for one object.
#[derive(Debug)]
pub struct RelayStream {
    object: String,
    lines: Lines,
    /// Frame of the newest line of the object.
    last_frame: Option<i64>,
}

impl RelayStream {
    /// A stream at its beginning.
    pub fn new(object: &str) -> Self {
        Self { object: object.to_owned(), lines: Lines::default(), last_frame: None }
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
        let Self { object, lines, last_frame } = self;
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
                on_sighting(Sighting { frame: line.frame, received_at, pose: line.pose });
            }
        });
    }

    /// Starts over with a new connection: a half line and the last frame number are forgotten.
    pub fn restart(&mut self) {
        self.lines.clear();
        self.last_frame = None;
    }
}

#[cfg(test)]
mod tests {
    use tello_model::rows::Pose;

    use super::*;

    fn frames(stream: &mut RelayStream, text: &str, counters: &ViconCounters) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        stream.push(text.as_bytes(), TimeNs(5), counters, |sighting| sightings.push(sighting));
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
            Sighting { frame: 1, received_at: TimeNs(5), pose },
            Sighting { frame: 2, received_at: TimeNs(5), pose: None },
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
