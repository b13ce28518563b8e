use super::super::tests::{NUMBERED, at, documented};
use super::*;
use crate::mocap::qtm::tests;

#[test]
fn the_documented_packet_is_read_byte_by_byte() {
    let (mut bodies, documented) = (Vec::new(), documented());
    let read = frame(&documented[8..], |index, count, at| bodies.push((index, count, at)));
    assert_eq!(read, Some((1_000_000, 1000)));
    assert_eq!(bodies, [(0, 1, Some(NUMBERED))]);
}

#[test]
fn every_truncation_of_a_frame_is_refused() {
    let whole = tests::frame(1, &[at(1.0), at(2.0)]);
    for length in 8..whole.len() {
        assert_eq!(frame(&whole[8..length], |_, _, _| ()), None, "{length}");
    }
}

#[test]
fn one_number_that_is_none_makes_a_body_one_that_is_not_seen() {
    for index in 0..12 {
        let mut packet = documented();
        packet[40 + 4 * index..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
        let mut bodies = Vec::new();
        frame(&packet[8..], |_, _, at| bodies.push(at)).unwrap();
        assert_eq!(bodies, [None], "number {index}");
    }
}

#[test]
fn a_packet_is_at_least_its_head_and_at_most_a_mebibyte_long() {
    let announce = |size: usize| {
        let size = u32::try_from(size).unwrap();
        Packets::default().push(&[size, 3].map(u32::to_le_bytes).concat(), |_, _| Ok(()))
    };
    for (size, is_accepted) in [
        (HEAD_BYTES - 1, false),
        (HEAD_BYTES, true),
        (0xF0, true),
        (HEAD_BYTES + PACKET_BYTES_MAX, true),
        (HEAD_BYTES + PACKET_BYTES_MAX + 1, false),
        (0x7FFF_FFFF, false),
    ] {
        assert_eq!(announce(size).is_ok(), is_accepted, "{size}");
    }
}
