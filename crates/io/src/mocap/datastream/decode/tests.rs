use super::super::tests::{body, packet};
use super::*;
use crate::mocap::datastream::{encode, id};

type Read<'a> = &'a dyn Fn(&[u8]) -> bool;

/// The body of the only object of a packet.
fn object(fill: impl FnOnce(&mut encode::Packet<'_>)) -> Vec<u8> {
    // Head of the packet, then identity and length of the object.
    packet(fill)[16..].to_vec()
}

#[test]
fn the_root_of_several_subjects_and_segments_is_found_by_name_and_parent() {
    // Two subjects; the second has a child before its root.
    let mut info = Vec::new();
    for (subject, name) in [(3_u32, "wand"), (8, "tello")] {
        let mut body = subject.to_le_bytes().to_vec();
        body.extend(u32::try_from(name.len()).unwrap().to_le_bytes());
        body.extend(name.as_bytes());
        body.extend(2_u32.to_le_bytes());
        for (parent, segment) in [(2_u32, 1_u32), (0, 2)] {
            body.extend([parent, segment].into_iter().flat_map(u32::to_le_bytes));
            body.extend([0; 24]);
            body.extend([1, 0, 0, 0, b's']);
        }
        info.push(body);
    }
    let root = |body: &[u8]| root_segment(body, b"tello").unwrap();
    assert_eq!(root(&info[0]), None);
    assert_eq!(root(&info[1]), Some(Segment { subject: 8, segment: 2 }));
}

#[test]
fn every_body_is_read_whole_or_not_at_all() {
    let wanted = Segment { subject: 1, segment: 1 };
    let bodies: [(Vec<u8>, Read<'_>); 5] = [
        (object(|p| p.object_enums(&[1, 2])), &|body| object_enums(body, |_| ()).is_ok()),
        (object(|p| p.frame_info(7)), &|body| frame_number(body).is_ok()),
        (object(|p| p.stream_info(100.0)), &|body| rate_hz(body).is_ok()),
        (object(|p| p.latency_info(&[("x", 0.1), ("y", 0.2)])), &|body| latency_s(body).is_ok()),
        (object(|p| p.segments(id::GLOBAL_SEGMENTS, 1, &body())), &|body| {
            global_segment(body, wanted).is_ok()
        }),
    ];
    for (number, (whole, is_read)) in bodies.iter().enumerate() {
        assert!(is_read(whole), "body {number}");
        // The period of the frames is what is read first of its body.
        let end = if number == 2 { 8 } else { whole.len() };
        for length in 0..end {
            assert!(!is_read(&whole[..length]), "{length} bytes of body {number}");
        }
        let longer = [whole.as_slice(), &[0]].concat();
        assert_eq!(is_read(&longer), number == 2, "a byte more than body {number}");
    }
}

#[test]
fn a_period_that_is_not_positive_has_no_rate() {
    for (ticks, expected) in [
        (1_350_000_i64, Ok(100.0)),
        (1, Ok(135e6)),
        (0, Err(PacketError::Period { ticks: 0 })),
        (-1, Err(PacketError::Period { ticks: -1 })),
    ] {
        assert_eq!(rate_hz(&ticks.to_le_bytes()), expected);
    }
}

#[test]
fn latencies_of_all_stages_are_one_sum() {
    let body = object(|packet| packet.latency_info(&[("x", 0.5), ("y", 0.25), ("z", -0.125)]));
    assert_eq!(latency_s(&body), Ok(0.625));
}

#[test]
fn a_segment_of_another_subject_is_not_the_wanted_one() {
    let body = object(|packet| packet.segments(id::GLOBAL_SEGMENTS, 1, &body()));
    let at = |subject, segment| global_segment(&body, Segment { subject, segment }).unwrap();
    assert_eq!(at(1, 1).map(|at| at.pos_w), Some([1.0, -2.0, 1.3]));
    assert_eq!((at(2, 1), at(1, 2)), (None, None));
}
