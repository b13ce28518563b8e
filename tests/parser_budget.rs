//! Budget of a received packet: no heap beyond its own length, and none for frames of bodies that are known.
//!
//! An announced length is a claim: a program that trusts it gives a stranger the machine's memory. One test,
//! since a second thread would count into the first one's region.

use std::alloc::System;

use proptest::prelude::*;
use stats_alloc::{INSTRUMENTED_SYSTEM, Region, StatsAlloc};
use tello_io::clock::TimeNs;
use tello_io::manual::Decoder;
use tello_io::mocap::datastream::{encode, id};
use tello_io::mocap::object_stream::encode_block;
use tello_io::mocap::{
    Body, MocapCounters, MocapSettings, MocapStream, MocapTable, NatnetTable, QtmTable,
    ServerTable, Sighting, UdpTable, VrpnTable, format_line, parse_line,
};
use tello_io::tello::protocol::{DronePacket, HostPacket};
use tello_io::tello::text::{Command, StateLine};

#[global_allocator]
static GLOBAL: &StatsAlloc<System> = &INSTRUMENTED_SYSTEM;

/// Room that a message may take beyond the bytes that it quotes: a vector grows to twice what it needs, and
/// to 8 at first.
const ROOM: usize = 64;

/// Heap that `parse` took for `bytes`, freed or not: the least of three times, since the thread of the test harness may
/// call the heap meanwhile. bytes
fn heap_of<T>(bytes: &[u8], parse: impl Fn(&[u8]) -> T) -> usize {
    let once = |_| {
        let region = Region::new(GLOBAL);
        drop(parse(bytes));
        region.change().bytes_allocated
    };
    (0..3).map(once).fold(usize::MAX, usize::min)
}

/// Heap that the first `bytes` of a connection take. bytes
#[expect(clippy::expect_used, reason = "a test may panic")]
fn heap_of_stream(table: &MocapTable, bytes: &[u8]) -> usize {
    let settings = MocapSettings::try_from(table).expect("valid settings");
    let counters = MocapCounters::default();
    let once = |_| {
        let mut stream = MocapStream::new(&settings);
        let region = Region::new(GLOBAL);
        let _is_parsed = stream.push(bytes, TimeNs(0), &counters, |_| {}).is_ok();
        region.change().bytes_allocated
    };
    (0..3).map(once).fold(usize::MAX, usize::min)
}

/// Noise, half of it with a beginning that a parser goes on from.
fn noise() -> impl Strategy<Value = Vec<u8>> {
    let beginnings = [
        &b""[..],
        b"\xcc\x58\x00\x7c\x88",
        b"\xcc\xff\xff\xff",
        b"conn_ack:",
        b"rc 1 2 3 ",
        b"bat:80;tof:",
        b"conn_req:",
        b"1 100.0 tello 0 1 2 3 ",
        b"999999999999999999999 1e999 ",
        b"\x1b[99999999999;",
        b"\x01\x00\x2b\x1a\xff\xff\x0f\x00",
        b"\x01\x00\x2b\x1a\x40\x00\x00\x00\x1a\x00\x00\x00\x38\x00\x00\x00\xff\xff\xff\xff",
        b"\x07\x00\x00\x00\xff\x00\x48\x00tello",
        b"\x01\x00\x20\x01Motive",
        b"\x05\x00\x40\x00\xff\xff\xff\x7f\x01\x00\x00\x00",
        b"\x07\x00\x40\x00\xe8\x03\x00\x00\xff\xff\xff\x7f",
        b"\xff\xff\x0f\x00\x01\x00\x00\x00QTM RT",
        b"vrpn: ver. 07.35  0\0\0\0\0\0\0\0\xf0\x00",
    ];
    let beginning = prop::sample::select(beginnings.to_vec());
    (beginning, prop::collection::vec(any::<u8>(), 0..300))
        .prop_map(|(beginning, rest)| [beginning, &rest].concat())
}

/// Heap calls of ten frames after ten others.
#[expect(clippy::expect_used, reason = "a test may panic")]
fn heap_calls_of_frames(table: &MocapTable, frame: impl Fn(u32, &mut Vec<u8>)) -> usize {
    let settings = MocapSettings::try_from(table).expect("valid settings");
    let counters = MocapCounters::default();
    let frames: Vec<Vec<u8>> = (0..20)
        .map(|number| {
            let mut bytes = Vec::new();
            frame(number, &mut bytes);
            bytes
        })
        .collect();
    let once = |_| {
        let mut stream = MocapStream::new(&settings);
        let mut seen = 0;
        let mut push = |frames: &[Vec<u8>]| {
            for frame in frames {
                let take = |sighting: Sighting| seen += usize::from(sighting.pose.is_some());
                stream.push(frame, TimeNs(0), &counters, take).expect("frames");
            }
        };
        let (first, rest) = frames.split_at(10);
        push(first);
        let region = Region::new(GLOBAL);
        push(rest);
        let change = region.change();
        assert_eq!(seen, 20);
        change.allocations + change.reallocations
    };
    (0..3).map(once).fold(usize::MAX, usize::min)
}

/// Frames of sources that name their bodies in each, with a name that is no text.
fn frames_of_known_bodies_take_no_heap() {
    let [tello, other] = [&b"tello"[..], b"b\xfcrste"].map(|name| Body {
        name,
        pos_v: [1.0, 2.0, 1.5],
        angles: [0.0, 0.0, 0.3],
    });
    let object = String::from("tello");
    let server = ServerTable { address: "localhost:801".into(), object: object.clone() };
    let udp = UdpTable { listen: "0.0.0.0:51001".into(), object, rate_hz: 100.0 };
    let relay = heap_calls_of_frames(&MocapTable::Relay(server.clone()), |number, to| {
        format_line(number.into(), 100.0, "wand", Some(&other), to);
        format_line(number.into(), 100.0, "tello", Some(&tello), to);
    });
    let blocks = heap_calls_of_frames(&MocapTable::Udp(udp), |number, to| {
        encode_block(number, &[other, tello], 512, to);
    });
    let datastream = heap_calls_of_frames(&MocapTable::Datastream(server), |number, to| {
        encode::packet(to, |packet| {
            packet.frame_info(number);
            for (subject, body) in [(1, other), (2, tello)] {
                packet.subject_info(subject, body.name);
                packet.segments(id::GLOBAL_SEGMENTS, subject, &body);
            }
        });
    });
    assert_eq!([relay, blocks, datastream], [0; 3]);
}

#[test]
fn no_parser_takes_more_heap_than_its_packet_is_long() {
    frames_of_known_bodies_take_no_heap();
    proptest!(ProptestConfig::with_cases(2_000), |(bytes in noise())| {
        let limit = 2 * bytes.len() + ROOM;
        let keys = |bytes: &[u8]| {
            let mut decoder = Decoder::default();
            bytes.iter().filter_map(|byte| decoder.feed(*byte)).count()
        };
        let address_of = || String::from("localhost:801");
        let object = String::from("tello");
        let server = ServerTable { address: address_of(), object: object.clone() };
        let natnet = NatnetTable {
            address: address_of(),
            object: object.clone(),
            rate_hz: None,
            frame: None,
        };
        let qtm = QtmTable { address: address_of(), object: object.clone(), frame: None };
        let vrpn =
            VrpnTable { address: address_of(), object: object.clone(), rate_hz: 100.0, frame: None };
        let udp = UdpTable { listen: "0.0.0.0:51001".into(), object, rate_hz: 100.0 };
        let taken = [
            ("relay", heap_of_stream(&MocapTable::Relay(server.clone()), &bytes)),
            ("DataStream", heap_of_stream(&MocapTable::Datastream(server), &bytes)),
            ("object stream", heap_of_stream(&MocapTable::Udp(udp), &bytes)),
            ("NatNet", heap_of_stream(&MocapTable::Natnet(natnet), &bytes)),
            ("QTM", heap_of_stream(&MocapTable::Qtm(qtm), &bytes)),
            ("VRPN", heap_of_stream(&MocapTable::Vrpn(vrpn), &bytes)),
            ("relay line", heap_of(&bytes, |bytes| parse_line(bytes).is_ok())),
            ("packet of the host", heap_of(&bytes, HostPacket::decode)),
            ("packet of the drone", heap_of(&bytes, DronePacket::decode)),
            ("text command", heap_of(&bytes, Command::decode)),
            ("text state", heap_of(&bytes, StateLine::decode)),
            ("keys", heap_of(&bytes, keys)),
        ];
        for (parser, heap) in taken {
            prop_assert!(heap <= limit, "{parser}: {heap} bytes for {}", bytes.len());
        }
    });
}
