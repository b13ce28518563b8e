use horizon_model::check::{amax, maximum};
use horizon_model::rows::Pose;
use proptest::prelude::*;

use super::*;
use crate::clock::TimeNs;
use crate::mocap::axes::Axes;
use crate::mocap::protocol::{self, SelectedProtocol};
use crate::mocap::{MocapCounters, Survey};

/// Frame 1000, `tello` at 1000, -2000, 1300 mm, angles 0.01, 0.02, 0.30: the first 80 of 256 bytes.
const DOCUMENTED: [u8; 80] = *b"\xe8\x03\x00\x00\x01\x00\x48\x00\
    tello\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\
    \x00\x00\x00\x00\x00\x40\x8f\x40\x00\x00\x00\x00\x00\x40\x9f\xc0\x00\x00\x00\x00\x00\x50\x94\x40\
    \x7b\x14\xae\x47\xe1\x7a\x84\x3f\x7b\x14\xae\x47\xe1\x7a\x94\x3f\x33\x33\x33\x33\x33\x33\xd3\x3f";

fn body(name: &str) -> Body<'_> {
    Body { name: name.as_bytes(), pos_v: [1.0, -2.0, 1.3], angles: [0.01, 0.02, 0.3] }
}

fn block(frame: u32, bodies: &[Body<'_>], size: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode_block(frame, bodies, size, &mut bytes);
    bytes
}

/// What a stream for `tello` makes of the datagrams: frames and poses, and its counters.
fn read(datagrams: &[Vec<u8>]) -> (Vec<(i64, Option<Pose>)>, MocapCounters) {
    let protocol = Box::new(ObjectStreamProtocol::new(100.0));
    let (frames, counters) =
        protocol::read(&mut SelectedProtocol::new(protocol, "tello", Axes::ours()), datagrams);
    (frames.iter().map(|frame| (frame.number, frame.pose)).collect(), counters)
}

#[test]
fn the_documented_block_is_read_and_written_byte_by_byte() {
    let mut datagram = DOCUMENTED.to_vec();
    datagram.resize(256, 0);
    assert_eq!(block(1000, &[body("tello")], 256), datagram);
    let (frames, counters) = read(&[datagram]);
    let [(1000, Some(pose))] = *frames else { panic!("{frames:?}") };
    // atan2(R10, R00) of Rx(0.01) Ry(0.02) Rz(0.3), by hand.
    let r10 = 0.01_f64.cos() * 0.3_f64.sin() + 0.01_f64.sin() * 0.02_f64.sin() * 0.3_f64.cos();
    let theta = r10.atan2(0.02_f64.cos() * 0.3_f64.cos());
    assert!(amax(&(pose - Pose::new(1.0, -2.0, 1.3, theta))) < 1e-12, "{pose}");
    assert_eq!((counters.messages.get(), counters.malformed.get()), (1, 0));
}

#[test]
fn every_block_size_carries_as_many_objects_as_fit_and_ours_is_found_by_name() {
    for (size, fitting) in [(256, 3), (512, 6), (1024, 13)] {
        let names: Vec<String> = (0..14).map(|k| format!("object {k}")).collect();
        let mut bodies: Vec<Body<'_>> = names.iter().map(|name| body(name)).collect();
        bodies[fitting - 1] = body("tello");
        let mut datagram = Vec::new();
        assert_eq!(encode_block(7, &bodies, size, &mut datagram), fitting);
        assert_eq!(datagram.len(), size);
        let (frames, _) = read(&[datagram]);
        assert!(matches!(*frames, [(7, Some(_))]), "{size}: {frames:?}");
    }
    // Names are compared whole.
    for name in ["tell", "tello2", "Tello", ""] {
        let (frames, counters) = read(&[block(7, &[body(name)], 256)]);
        assert_eq!((frames, counters.other_object.get()), (vec![(7, None)], 1), "{name:?}");
    }
}

#[test]
fn an_object_that_is_lost_is_a_frame_without_a_pose() {
    let zero = Body { pos_v: [0.0; 3], angles: [0.0; 3], ..body("tello") };
    // An empty block is about no other object.
    let cases = [(vec![], 0), (vec![body("wand")], 1), (vec![body("wand"), zero], 0)];
    for (bodies, others) in cases {
        let (frames, counters) = read(&[block(9, &bodies, 512)]);
        assert_eq!(frames, [(9, None)], "{bodies:?}");
        assert_eq!(counters.other_object.get(), others, "{bodies:?}");
    }
}

#[test]
fn of_two_objects_with_the_name_none_is_ours() {
    let twin = Body { pos_v: [2.0, 0.0, 1.0], ..body("tello") };
    let (frames, counters) = read(&[block(1, &[body("tello"), body("wand"), twin], 256)]);
    assert_eq!((frames, counters.doubled.get()), (vec![(1, None)], 1));
}

#[test]
fn a_frame_in_several_blocks_is_lost_only_if_none_has_the_object() {
    let others = [body("a"), body("b"), body("c")];
    let full = |frame| block(frame, &others, 256);
    let (frames, counters) = read(&[full(1), block(1, &[body("tello")], 256), full(2), full(3)]);
    assert!(matches!(*frames, [(1, Some(_)), (2, None)]), "{frames:?}");
    assert_eq!(counters.other_object.get(), 3, "each block of others, once");
    let first = [body("a"), body("tello"), body("c")];
    let (frames, _) = read(&[block(1, &first, 256), block(1, &[body("d")], 256)]);
    assert!(matches!(*frames, [(1, Some(_))]), "{frames:?}");
    // A pose waits for no other block.
    let (frames, _) = read(&[block(1, &first, 256)]);
    assert!(matches!(*frames, [(1, Some(_))]), "{frames:?}");
    let (frames, counters) = read(&[block(1, &first, 256), block(2, &first, 256)]);
    assert!(matches!(*frames, [(1, Some(_)), (2, Some(_))]), "{frames:?}");
    assert_eq!(counters.other_object.get(), 0);
}

#[test]
fn items_that_are_no_objects_are_skipped_by_their_size() {
    let mut datagram = vec![7, 0, 0, 0, 2, 3, 10, 0];
    datagram.extend([0xAA; 10]);
    datagram.extend(&block(7, &[body("tello")], 256)[HEAD_BYTES..]);
    let (frames, _) = read(&[datagram]);
    assert!(matches!(*frames, [(7, Some(_))]), "{frames:?}");
}

#[test]
fn numbers_that_are_no_pose_are_refused() {
    let upright = Body { angles: [0.0, std::f64::consts::FRAC_PI_2, 0.0], ..body("tello") };
    let not_finite = Body { pos_v: [f64::NAN, 0.0, 0.0], ..body("tello") };
    let no_angle = Body { angles: [0.0, 0.0, f64::INFINITY], ..body("tello") };
    for bad in [upright, not_finite, no_angle] {
        let (frames, counters) = read(&[block(7, &[bad], 256)]);
        assert_eq!((frames.len(), counters.malformed.get()), (0, 1), "{bad:?}");
        // In a full block, too: it is not lost in that frame.
        let full = block(7, &[body("a"), bad, body("b")], 256);
        let (frames, counters) = read(&[full, block(8, &[], 256)]);
        assert_eq!((frames, counters.malformed.get()), (vec![(8, None)], 1), "{bad:?}");
    }
    // An object of another size, before ours or behind it: its datagram is refused as a whole.
    for item in [0, 1] {
        let mut datagram = block(7, &[body("tello"), body("tello")], 256);
        datagram[HEAD_BYTES + item * (ITEM_HEAD_BYTES + OBJECT_BYTES) + 1] = 71;
        datagram.remove(HEAD_BYTES + (item + 1) * (ITEM_HEAD_BYTES + OBJECT_BYTES) - 1);
        let (frames, counters) = read(&[datagram]);
        assert_eq!((frames.len(), counters.malformed.get()), (0, 1), "{item}");
    }
}

#[test]
fn every_truncation_is_refused() {
    for length in 0..DOCUMENTED.len() {
        assert_eq!(Block::parse(&DOCUMENTED[..length]), None, "{length} bytes");
    }
    assert!(Block::parse(&DOCUMENTED).is_some(), "without its padding the block is whole");
}

proptest! {
    #[test]
    fn random_datagrams_give_finite_poses_or_nothing(
        datagrams in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 0..5),
    ) {
        for pose in read(&datagrams).0.into_iter().filter_map(|(_, pose)| pose) {
            prop_assert!(pose.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn a_block_with_any_numbers_gives_finite_poses_or_nothing(
        numbers in prop::collection::vec(prop_oneof![any::<f64>(), -1e4..1e4], 6),
        at in 5..80_usize, byte: u8,
    ) {
        let mut datagram = DOCUMENTED.to_vec();
        datagram.truncate(32);
        datagram.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
        datagram[at] = byte;
        for pose in read(&[datagram]).0.into_iter().filter_map(|(_, pose)| pose) {
            prop_assert!(pose.iter().all(|value| value.is_finite()));
        }
    }

    #[test]
    fn a_body_comes_back_as_it_was(
        pos_v in prop::array::uniform3(-50.0..50.0), angles in prop::array::uniform3(-3.0..3.0),
        frame: u32,
    ) {
        let sent = Body { name: b"tello", pos_v, angles };
        let datagram = block(frame, &[body("wand"), sent], 512);
        let block = Block::parse(&datagram).unwrap();
        let read = block.objects().nth(1).unwrap();
        prop_assert_eq!((block.frame, read.name, read.angles), (frame, sent.name, angles));
        let gap = read.pos_v.into_iter().zip(pos_v).map(|(a, b)| (a - b).abs()).fold(0.0, maximum);
        prop_assert!(gap < 1e-12, "{gap}");
    }
}

#[test]
fn for_a_list_of_objects_the_blocks_of_a_frame_are_one() {
    // 256 bytes take three objects.
    let [all, rest] = [["a", "b", "c"].map(body), ["d", "e", "f"].map(body)];
    let mut survey = Survey::default();
    let mut source = ObjectStreamProtocol::new(100.0);
    let zero = Body { pos_v: [0.0; 3], angles: [0.0; 3], ..body("z") };
    for (at_ms, datagram) in [
        (0, block(7, &all, 256)),
        (1, block(7, &rest[..1], 256)),
        (10, block(8, &all, 256)),
        (20, block(9, &all, 256)),
        (21, block(9, &[], 256)),
        (30, block(10, &[rest[0], rest[1], zero], 512)),
    ] {
        let now = TimeNs(0).after(SpanNs::from_ms(at_ms));
        survey.take_in(&mut source, &datagram, now);
    }
    let objects = survey.objects.iter();
    let counts: Vec<_> = objects.map(|(name, track)| (&**name, track.frames, track.seen)).collect();
    let [a, b, c] = ["a", "b", "c"].map(|name| (name, 4, 3));
    assert_eq!(counts, [a, b, c, ("d", 4, 2), ("e", 1, 1), ("z", 1, 0)]);
}
