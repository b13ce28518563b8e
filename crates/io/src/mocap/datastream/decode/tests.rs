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
fn the_root_of_several_subjects_and_segments_is_found_by_its_parent() {
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
    let [wand, tello] = [3, 8].map(|subject| Some(Segment { subject, segment: 2 }));
    assert_eq!(subject(&info[0]), Some((&b"wand"[..], wand)));
    assert_eq!(subject(&info[1]), Some((&b"tello"[..], tello)));
    // A subject of no segments.
    let mut body = object(|packet| packet.subject_info(7, b"box"));
    body[11] = 0;
    assert_eq!(subject(&body), Some((&b"box"[..], None)));
}

#[test]
fn every_body_is_read_whole_or_not_at_all() {
    let bodies: [(Vec<u8>, Read<'_>); 5] = [
        (object(|p| p.object_enums(&[1, 2])), &|body| object_enums(body, |_| ()).is_some()),
        (object(|p| p.frame_info(7)), &|body| frame_number(body).is_some()),
        (object(|p| p.stream_info(100.0)), &|body| rate_hz(body).is_some()),
        (object(|p| p.latency_info(&[("x", 0.1), ("y", 0.2)])), &|body| latency_s(body).is_some()),
        (object(|p| p.segments(id::GLOBAL_SEGMENTS, 1, &body())), &|body| {
            global_segments(body, |_, _| ()).is_some()
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
    for (ticks, expected) in [(1_350_000_i64, Some(100.0)), (1, Some(135e6)), (0, None), (-1, None)]
    {
        assert_eq!(rate_hz(&ticks.to_le_bytes()), expected);
    }
}

#[test]
fn latencies_of_all_stages_are_one_sum() {
    let body = object(|packet| packet.latency_info(&[("x", 0.5), ("y", 0.25), ("z", -0.125)]));
    assert_eq!(latency_s(&body), Some(0.625));
}

#[test]
fn each_segment_comes_with_its_subject_and_its_place_in_metres() {
    let body = object(|packet| packet.segments(id::GLOBAL_SEGMENTS, 5, &body()));
    let mut segments = Vec::new();
    global_segments(&body, |segment, at| segments.push((segment, at.pos_v))).unwrap();
    assert_eq!(segments, [(Segment { subject: 5, segment: 1 }, [1.0, -2.0, 1.3])]);
}
