use proptest::prelude::*;

use super::super::tests::{at, bytes, host_vectors, sticks};
use super::*;

#[test]
fn the_vectors_of_the_host_are_read_and_written() {
    let mut written = Vec::new();
    for (text, packet) in host_vectors() {
        assert_eq!(HostPacket::decode(&bytes(text)), Ok(packet), "{text}");
        packet.encode(&mut written);
        assert_eq!(written, bytes(text), "{packet:?}");
    }
}

#[test]
fn the_long_form_of_the_time_is_read() {
    let text = "ccd800536050000100000420000108080012003a00920002007933";
    let expected = sticks([0.0; 4], false, at(8, 18, 58, 0x0292));
    assert_eq!(HostPacket::decode(&bytes(text)), Ok(expected));
}

#[test]
fn a_word_beyond_full_deflection_is_refused() {
    let mut written = Vec::new();
    write_frame(0x60, id::STICKS, 0, &[0; 11], &mut written);
    let error = HostPacket::decode(&written).unwrap_err();
    assert_eq!(error, PacketError::Payload { id: id::STICKS, length: 11 });
}

#[test]
fn the_sticks_are_limited_before_they_become_integers() {
    let mut written = Vec::new();
    // -2 became full positive deflection in the thesis' program.
    for (u, expected) in [(-2.0, -1.0), (2.0, 1.0), (f64::NAN, 0.0), (f64::INFINITY, 1.0)] {
        sticks([u; 4], false, TimeOfDay::default()).encode(&mut written);
        let read = HostPacket::decode(&written).unwrap();
        assert_eq!(read, sticks([expected; 4], false, TimeOfDay::default()), "{u}");
    }
}

proptest! {
    #[test]
    fn whole_steps_of_a_stick_come_back_unchanged(steps in prop::array::uniform4(-660_i16..=660)) {
        let u = Sticks::from(steps.map(|steps| f64::from(steps) / 660.0));
        let packet = HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() };
        let mut written = Vec::new();
        packet.encode(&mut written);
        prop_assert_eq!(HostPacket::decode(&written), Ok(packet));
    }
}
