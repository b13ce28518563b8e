use proptest::prelude::*;

use super::super::tests::{bytes, drone_vectors};
use super::super::write_frame;
use super::*;

#[test]
fn the_vectors_of_the_drone_are_read_and_written() {
    let mut written = Vec::new();
    for (text, packet) in drone_vectors() {
        assert_eq!(DronePacket::decode(&bytes(text)), Ok(packet), "{text}");
        packet.encode(&mut written);
        assert_eq!(written, bytes(text), "{packet:?}");
    }
}

#[test]
fn an_acknowledgement_carries_action_and_number() {
    let mut written = Vec::new();
    for action in [Action::TakeOff, Action::Land] {
        let packet = DronePacket::Ack { action, sequence: 0x01E5 };
        packet.encode(&mut written);
        assert_eq!(DronePacket::decode(&written), Ok(packet));
    }
}

proptest! {
    #[test]
    fn a_status_comes_back_without_what_is_not_read(mut raw: [u8; 24], sequence: u16) {
        raw[10..12].fill(0);
        raw[19..].fill(0);
        let mut frame = Vec::new();
        write_frame(0x88, id::FLIGHT_STATUS, sequence, &raw, &mut frame);
        let mut written = Vec::new();
        DronePacket::decode(&frame).unwrap().encode(&mut written);
        prop_assert_eq!(written, frame);
    }
}
