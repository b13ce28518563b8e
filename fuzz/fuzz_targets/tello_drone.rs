//! Datagrams of the drone: what is understood survives a round trip.
#![no_main]

mod frame;

use libfuzzer_sys::fuzz_target;
use tello_io::tello::protocol::DronePacket;

fuzz_target!(|bytes: &[u8]| {
    if let Ok(packet) = DronePacket::decode(&frame::datagram(bytes)) {
        let mut written = Vec::new();
        packet.encode(&mut written);
        let again = DronePacket::decode(&written);
        assert!(again.is_ok(), "{packet:?} was written as {written:02x?}: {again:?}");
    }
});
