mod bodies;

use horizon_model::rows::{Pose, pose};
use proptest::prelude::*;

use super::packet::MAGIC;
use super::*;
use crate::mocap::axes::Axes;
use crate::mocap::protocol::SelectedProtocol;
use crate::mocap::source::SourceFrame;
use crate::mocap::{Body, MocapCounters};

/// Bytes of a hexadecimal text.
pub(super) fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<u32> = hex.chars().filter_map(|c| c.to_digit(16)).collect();
    digits.chunks(2).map(|pair| u8::try_from(pair[0] * 16 + pair[1]).unwrap()).collect()
}

/// Offers 2, 5, 9 and 100004.
const HELLO: &str =
    "01002b1a 1c000000 a1860100 14000000 04000000 02000000 05000000 09000000 a4860100";

pub(super) const PUSH: &str = "01002b1a 09000000 a2860100 01000000 01";

/// Frame 1000, subject 1 `tello` with root segment 1, 1000, -2000, 1300 mm, not turned.
pub(super) const FRAME: &str = "01002b1a ca000000
    05000000 04000000 e8030000
    02000000 42000000 01000000 05000000 74656c6c6f 01000000 00000000 01000000
    000000000000000000000000000000000000000000000000 05000000 74656c6c6f 00000000 00000000
    09000000 6c000000 01000000 01000000 01000000
    0000000000408f40 0000000000409fc0 0000000000509440
    000000000000f03f 0000000000000000 0000000000000000
    0000000000000000 000000000000f03f 0000000000000000
    0000000000000000 0000000000000000 000000000000f03f";

pub(super) fn body() -> Body<'static> {
    Body { name: b"tello", pos_v: [1.0, -2.0, 1.3], angles: [0.0; 3] }
}

/// Frames, requests and result of a client for `tello`.
struct Received {
    frames: Vec<SourceFrame>,
    requests: Vec<u8>,
    result: Result<(), SourceError>,
    counters: MocapCounters,
}

fn receive<'a>(pieces: impl IntoIterator<Item = &'a [u8]>) -> Received {
    let protocol = Box::new(DatastreamProtocol::default());
    let mut source = SelectedProtocol::new(protocol, "tello", Axes::ours());
    let mut received = Received {
        frames: Vec::new(),
        requests: Vec::new(),
        result: Ok(()),
        counters: MocapCounters::default(),
    };
    for piece in pieces {
        let mut on_frame = |frame| received.frames.push(frame);
        received.result = source.push(piece, &received.counters, &mut on_frame);
        source.protocol.take_requests(&mut received.requests);
        if received.result.is_err() {
            break;
        }
    }
    received
}

pub(super) fn packet(fill: impl FnOnce(&mut encode::Packet<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::packet(&mut bytes, fill);
    bytes
}

#[test]
fn the_greeting_is_answered_with_the_documented_bytes() {
    let received = receive([bytes(HELLO).as_slice()]);
    assert_eq!(received.requests, bytes(&format!("{HELLO}{PUSH}")));
    assert_eq!((received.result, received.frames), (Ok(()), vec![]));
}

#[test]
fn everything_useful_is_asked_for_and_nothing_else() {
    let offered = [1, 2, 3, 5, 8, 9, 23, 26, 28, 37, 42, 100_004];
    let received = receive([packet(|packet| packet.object_enums(&offered)).as_slice()]);
    let mut expected = packet(|packet| packet.object_enums(&[1, 2, 5, 9, 26, 37, 100_004]));
    expected.extend(bytes(PUSH));
    assert_eq!(received.requests, expected);
}

#[test]
fn the_documented_frame_is_read_and_written_byte_by_byte() {
    let frame = bytes(FRAME);
    assert_eq!(frame.len(), 210);
    let written = packet(|packet| {
        packet.frame_info(1000);
        packet.subject_info(1, b"tello");
        packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
    });
    assert_eq!(written, frame);
    let received = receive([frame.as_slice()]);
    let pose = Some(Pose::new(1.0, -2.0, 1.3, 0.0));
    let expected =
        SourceFrame { number: 1000, rate_hz: 0.0, stamp: None, latency: SpanNs(0), pose };
    assert_eq!((received.result, received.frames), (Ok(()), vec![expected]));
}

#[test]
fn rate_latency_and_the_heading_of_a_tilted_body_are_read() {
    let tilted = Body { angles: [0.1, 0.2, 0.3], ..body() };
    let frame = packet(|packet| {
        packet.stream_info(100.0);
        packet.application_info();
        packet.latency_info(&[("camera", 0.002), ("tracking", 0.0015)]);
        // Before the subject that it belongs to.
        packet.segments(id::GLOBAL_SEGMENTS, 1, &tilted);
        packet.subject_info(1, b"tello");
        packet.frame_info(7);
        packet.contents(&[(id::SUBJECT_INFO, 1)]);
    });
    let received = receive([frame.as_slice()]);
    let [SourceFrame { number: 7, rate_hz, latency, pose: Some(pose), .. }] = *received.frames
    else {
        panic!("{:?}", received.frames)
    };
    assert!((rate_hz - 100.0).abs() < 1e-9, "{rate_hz}");
    assert_eq!(latency, SpanNs(3_500_000));
    let matrix = crate::mocap::matrix_of_angles(tilted.angles);
    assert!((pose[pose::THETA] - matrix[3].atan2(matrix[0])).abs() < 1e-12, "{pose}");
}

#[test]
fn a_latency_that_cannot_be_is_not_believed() {
    for stages in [[("x", -0.1)], [("x", 5.0)], [("x", f64::NAN)], [("x", f64::INFINITY)]] {
        let frame = packet(|packet| {
            packet.latency_info(&stages);
            packet.frame_info(7);
        });
        assert_eq!(receive([frame.as_slice()]).frames[0].latency, SpanNs(0), "{stages:?}");
    }
}

#[test]
fn a_subject_that_is_left_out_is_not_seen_and_a_removed_one_is_unknown() {
    let info = packet(|packet| packet.subject_info(1, b"tello"));
    let seen = packet(|packet| {
        packet.frame_info(1);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
    });
    let occluded = packet(|packet| packet.frame_info(2));
    let zeros = packet(|packet| {
        packet.frame_info(3);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &Body { pos_v: [0.0; 3], ..body() });
    });
    let removed = packet(|packet| {
        packet.subject_info(1, b"tello2");
        packet.frame_info(4);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
    });
    let received = receive([&*info, &*seen, &*occluded, &*zeros, &*removed]);
    let is_seen: Vec<_> = received.frames.iter().map(|f| (f.number, f.pose.is_some())).collect();
    // At the origin, but with a matrix: that is a pose.
    assert_eq!(is_seen, [(1, true), (2, false), (3, true), (4, false)]);
    assert_eq!(received.counters.other_object.get(), 1);
}

#[test]
fn a_subject_of_nothing_but_zeros_is_lost_and_another_rotation_is_refused() {
    let frame = |matrix: [f64; 9]| {
        let mut frame = bytes(FRAME);
        let numbers = frame.len() - 9 * 8;
        frame.truncate(numbers - 3 * 8);
        frame.extend([0.0_f64; 3].into_iter().chain(matrix).flat_map(f64::to_le_bytes));
        frame
    };
    let level = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];
    let mirrored = [1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 0.0, 1.0];
    for (matrix, expected, malformed) in [
        (level, Some(true), 0),
        ([0.0; 9], Some(false), 0),
        (mirrored, None, 1),
        (level.map(|r| 0.9 * r), None, 1),
        ([f64::NAN; 9], None, 1),
    ] {
        let received = receive([frame(matrix).as_slice()]);
        let seen = received.frames.first().map(|frame| frame.pose.is_some());
        assert_eq!((seen, received.counters.malformed.get()), (expected, malformed), "{matrix:?}");
    }
}

#[test]
fn a_subject_that_is_called_in_no_text_is_compared_byte_by_byte() {
    // A U+FFFD is what a text would have in place of the byte.
    for (name, is_named) in
        [(&b"tello"[..], true), (b"tell\xf6", false), ("tell\u{fffd}".as_bytes(), false)]
    {
        let frame = packet(|packet| {
            packet.frame_info(1);
            packet.subject_info(1, name);
            packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
        });
        let received = receive([frame.as_slice()]);
        assert_eq!(received.frames[0].pose.is_some(), is_named, "{name:?}");
        assert_eq!(received.counters.other_object.get(), u64::from(!is_named));
    }
}

#[test]
fn of_a_refused_frame_nothing_is_left_for_the_next_one() {
    let frame = |length: u8| {
        let mut frame = packet(|packet| {
            packet.frame_info(1000);
            packet.subject_info(1, b"tello");
            packet.subject_info(2, b"wand");
            packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
            packet.segments(id::GLOBAL_SEGMENTS, 2, &body());
        });
        // One segment is announced, or more than there are.
        let at = frame.len() - 104;
        assert_eq!(frame[at], 1);
        frame[at] = length;
        frame
    };
    let received = receive([[frame(2), frame(1)].concat().as_slice()]);
    let counters = &received.counters;
    assert_eq!((counters.malformed.get(), counters.doubled.get()), (1, 0));
    assert!(
        matches!(*received.frames, [SourceFrame { pose: Some(_), .. }]),
        "{:?}",
        received.frames
    );
}

#[test]
fn of_two_subjects_with_the_name_none_is_ours() {
    let frame = |twins: u32| {
        packet(|packet| {
            packet.frame_info(1000);
            (1..=twins).for_each(|subject| packet.subject_info(subject, b"tello"));
            packet.segments(id::GLOBAL_SEGMENTS, 1, &body());
        })
    };
    for (twins, is_seen) in [(1, true), (2, false)] {
        let received = receive([&*frame(twins)]);
        let [only] = &received.frames[..] else { panic!("{:?}", received.frames) };
        assert_eq!(only.pose.is_some(), is_seen, "{twins}");
        assert_eq!(received.counters.doubled.get(), u64::from(!is_seen));
    }
}

#[test]
fn packets_cut_at_every_byte_and_several_in_one_piece_are_read() {
    let stream: Vec<u8> = [HELLO, FRAME, FRAME].iter().flat_map(|hex| bytes(hex)).collect();
    for cut in 0..stream.len() {
        let (left, right) = stream.split_at(cut);
        let received = receive([left, right]);
        assert_eq!((received.result, received.frames.len()), (Ok(()), 2), "cut at {cut}");
    }
    assert_eq!(receive(stream.chunks(1)).frames.len(), 2);
}

#[test]
fn a_frame_truncated_anywhere_inside_its_packet_is_refused_and_the_next_one_read() {
    let frame = bytes(FRAME);
    for length in 0..frame.len() - 8 {
        let mut stream = MAGIC.to_le_bytes().to_vec();
        stream.extend(u32::try_from(length).unwrap().to_le_bytes());
        stream.extend(&frame[8..8 + length]);
        stream.extend(&frame);
        let received = receive([stream.as_slice()]);
        assert_eq!(received.result, Ok(()), "{length} bytes");
        assert!(received.frames.last().unwrap().pose.is_some(), "{length} bytes");
        // Whole objects are a packet, too: none, FrameInfo, FrameInfo and SubjectInfo.
        let is_whole = [0, 12, 86].contains(&length);
        assert_eq!(received.counters.malformed.get() == 0, is_whole, "{length} bytes");
    }
}

#[test]
fn what_is_no_datastream_is_given_up_with_a_reason() {
    let relay = b"1000 100.0 tello 0 1 2 3 0 0 0\n";
    assert!(matches!(receive([&relay[..]]).result, Err(SourceError::Magic { .. })));
    let long = bytes("01002b1a 00001000");
    let error = SourceError::TooLong { length: 1 << 20, max: (1 << 20) - 8 };
    assert_eq!(receive([long.as_slice()]).result, Err(error));
    let poor = packet(|packet| packet.object_enums(&[id::SUBJECT_INFO, id::FRAME_INFO]));
    assert_eq!(receive([poor.as_slice()]).result, Err(SourceError::NotOffered { id: 9 }));
    let y_up = bytes("01002b1a 09000000 25000000 01000000 01");
    assert_eq!(receive([y_up.as_slice()]).result, Err(SourceError::UpIsY));
}

proptest! {
    #[test]
    fn random_objects_give_finite_poses_or_nothing(
        objects in prop::collection::vec(
            (
                prop::sample::select(vec![1_u32, 2, 5, 8, 9, 26, 37, 42, 100_001, 100_004, 7]),
                prop::collection::vec(prop_oneof![Just(0_u8), Just(1), any::<u8>()], 0..120),
            ),
            0..6,
        ),
    ) {
        let mut stream = packet(|packet| packet.subject_info(1, b"tello"));
        let mut rest = Vec::new();
        for (id, body) in objects {
            rest.extend(id.to_le_bytes());
            rest.extend(u32::try_from(body.len()).unwrap().to_le_bytes());
            rest.extend(body);
        }
        stream.extend(MAGIC.to_le_bytes());
        stream.extend(u32::try_from(rest.len()).unwrap().to_le_bytes());
        stream.extend(rest);
        for frame in receive([stream.as_slice()]).frames {
            prop_assert!(frame.pose.is_none_or(|pose| pose.iter().all(|value| value.is_finite())));
            prop_assert!(frame.rate_hz.is_finite() && frame.latency.0 >= 0);
        }
    }

    #[test]
    fn a_frame_with_any_byte_changed_is_survived(at in 8..210_usize, byte: u8) {
        let mut frame = bytes(FRAME);
        frame[at] = byte;
        for frame in receive([frame.as_slice()]).frames {
            prop_assert!(frame.pose.is_none_or(|pose| pose.iter().all(|value| value.is_finite())));
        }
    }

    #[test]
    fn random_bytes_are_survived_in_bounded_memory(
        pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..300), 0..5),
        is_packet: bool,
    ) {
        let mut stream = if is_packet { bytes("01002b1a") } else { Vec::new() };
        stream.extend(pieces.concat());
        receive(stream.chunks(37));
        let mut packets = Packets::default();
        packets.push(&stream, |_| Ok(())).ok();
        prop_assert!(packets.capacity() <= 2 * stream.len() + 64, "{}", packets.capacity());
    }
}
