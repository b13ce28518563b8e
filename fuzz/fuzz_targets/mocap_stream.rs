//! The mocap sources, from the bytes of a connection to sightings, in pieces cut anywhere.
//!
//! The first byte chooses the source, unless `MOCAP_SOURCE` (0 to 5) does; the second is the length of the pieces of a
//! connection. Datagrams come behind their lengths (u16, little-endian): those of NatNet are longer than 255 bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tello_io::clock::TimeNs;
use tello_io::mocap::{
    NatnetTable, QtmTable, ServerTable, UdpTable, MocapCounters, MocapSettings, MocapStream, MocapTable, VrpnTable,
};

/// Datagrams behind their lengths; the last one may be shorter than announced.
fn datagrams(mut bytes: &[u8]) -> Vec<&[u8]> {
    let mut all = Vec::new();
    while let [low, high, rest @ ..] = bytes {
        let (datagram, rest) = rest.split_at(rest.len().min(u16::from_le_bytes([*low, *high]).into()));
        all.push(datagram);
        bytes = rest;
    }
    all
}

fuzz_target!(|bytes: &[u8]| {
    let [source, length, bytes @ ..] = bytes else { return };
    #[expect(clippy::disallowed_methods, reason = "how `fuzz/run` chooses the source")]
    let forced = std::env::var("MOCAP_SOURCE").ok().and_then(|source| source.parse().ok());
    let source = forced.unwrap_or(*source);
    let object = String::from("tello");
    let address = String::from("localhost:801");
    let frame = None;
    let pieces = match source % 6 {
        2 | 3 => datagrams(bytes),
        _ => bytes.chunks(usize::from(*length).max(1)).collect(),
    };
    let table = match source % 6 {
        0 => MocapTable::Relay(ServerTable { address, object }),
        1 => MocapTable::Datastream(ServerTable { address, object }),
        2 => {
            let listen = String::from("0.0.0.0:51001");
            MocapTable::Udp(UdpTable { listen, object, rate_hz: 100.0 })
        }
        3 => MocapTable::Natnet(NatnetTable { address, object, rate_hz: None, frame }),
        4 => MocapTable::Qtm(QtmTable { address, object, frame }),
        _ => MocapTable::Vrpn(VrpnTable { address, object, rate_hz: 100.0, frame }),
    };
    let Ok(settings) = MocapSettings::try_from(&table) else { return };
    let mut stream = MocapStream::new(&settings);
    let counters = MocapCounters::default();
    for (now, piece) in (1_i64..).zip(pieces) {
        let seen = |sighting: tello_io::mocap::Sighting| {
            let is_finite = |pose: horizon_model::rows::Pose| pose.iter().all(|row| row.is_finite());
            assert!(sighting.pose.is_none_or(is_finite), "{sighting:?}");
        };
        // On the ground and in flight by turns.
        stream.set_airborne(now % 64 >= 32);
        if stream.push(piece, TimeNs(now * 10_000_000), &counters, seen).is_err() {
            stream.restart();
        }
        stream.beat();
        let mut requests = Vec::new();
        stream.take_requests(&mut requests);
        assert!(requests.len() < 4096, "{} bytes are asked", requests.len());
    }
});
