//! All subjects of a frame, as a survey takes them.

use super::*;

/// Bodies and heads as they come.
#[derive(Debug, Default)]
struct Taken {
    bodies: Vec<(String, Option<[f64; 3]>)>,
    heads: Vec<Head>,
    refused: u64,
}

impl FrameVisitor for Taken {
    fn message(&mut self) {}

    fn refuse(&mut self, _why: Refusal) {
        self.refused += 1;
    }

    fn body(&mut self, name: Name<'_>, at: Option<&Placement>) {
        let name = str::from_utf8(name.text.unwrap()).unwrap().to_owned();
        self.bodies.push((name, at.map(|at| at.pos_v)));
    }

    fn frame(&mut self, head: Head) {
        self.heads.push(head);
    }
}

fn push(protocol: &mut DatastreamProtocol, packet: &[u8]) -> (Taken, u64) {
    let mut taken = Taken::default();
    protocol.push(packet, &mut taken).unwrap();
    let refused = taken.refused;
    (taken, refused)
}

#[test]
fn every_subject_of_a_frame_is_reported_seen_or_not() {
    let bytes = packet(|packet| {
        packet.subject_info(1, b"tello");
        packet.subject_info(2, b"wand");
        packet.stream_info(100.0);
        packet.latency_info(&[("camera", 0.002)]);
        packet.frame_info(7);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
    });
    let (taken, malformed) = push(&mut DatastreamProtocol::default(), &bytes);
    let seen = ("tello".to_owned(), Some([1.0, -2.0, 1.3]));
    assert_eq!(taken.bodies, [seen, ("wand".to_owned(), None)]);
    let [head] = *taken.heads else { panic!("{:?}", taken.heads) };
    assert_eq!((head.number, head.latency, malformed), (7, SpanNs::from_ms(2), 0));
    assert!((head.rate_hz - 100.0).abs() < 1e-9, "{}", head.rate_hz);
}

#[test]
fn subjects_and_rate_are_remembered_until_the_connection_ends() {
    let mut protocol = DatastreamProtocol::default();
    let info = packet(|packet| {
        packet.subject_info(1, b"tello");
        packet.stream_info(100.0);
    });
    let (taken, _) = push(&mut protocol, &info);
    assert!(taken.heads.is_empty(), "no frame without its number");
    let frame = packet(|packet| {
        packet.frame_info(8);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &Body { pos_v: [0.5; 3], ..body() });
    });
    let (taken, _) = push(&mut protocol, &frame);
    assert_eq!(taken.bodies, [("tello".to_owned(), Some([0.5; 3]))]);
    protocol.restart();
    let (taken, _) = push(&mut protocol, &frame);
    assert!(taken.bodies.is_empty());
    assert_eq!(taken.heads.first().map(|head| head.rate_hz), Some(0.0));
}

#[test]
fn a_frame_with_a_malformed_object_counts_and_gives_no_frame() {
    let mut bytes = packet(|packet| packet.frame_info(7));
    // Head of the packet, identity of the object, then its length: a byte less than there is.
    bytes[12] = 3;
    let (taken, malformed) = push(&mut DatastreamProtocol::default(), &bytes);
    assert_eq!((taken.heads.len(), malformed), (0, 1));
}
