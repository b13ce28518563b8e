use super::super::{DronePacket, HostPacket, PacketError, write_any_frame};
use super::*;

#[test]
fn answers_are_read_as_they_are_laid_out_and_no_others() {
    let mut written = Vec::new();
    let mut read = |id, payload: &[u8]| {
        write_any_frame(0xB0, id, 7, payload, &mut written);
        match DronePacket::decode(&written) {
            Ok(DronePacket::Answer { sequence: 7, answer }) => Some(answer),
            Err(PacketError::Unread { .. }) => None,
            other => panic!("{other:?}"),
        }
    };
    let version = Version::read(b"01.04.91.01").unwrap();
    assert_eq!(version.to_string(), "01.04.91.01");
    assert_eq!(read(0x0045, b"\x0001.04.91.01"), Some(Answer::Version(version)));
    assert_eq!(read(0x0045, b"\x0001.04.91.01\0\0"), Some(Answer::Version(version)));
    assert_eq!(read(0x1057, &[0, 10]), Some(Answer::BatteryThreshold(10)));
    assert_eq!(
        read(0x1059, &[0, 0, 0, 0xC8, 0x41]),
        Some(Answer::TiltLimit(25.0_f64.to_radians()))
    );
    // A status that is no success, nothing at all, too long, and no number.
    assert_eq!(read(0x0045, b"\x0101.04.91.01"), None);
    assert_eq!(read(0x0045, &[0]), None);
    assert_eq!(read(0x0045, &[b'0'; 60]), None);
    assert_eq!(read(0x1056, &[0, 10]), None);
    assert_eq!(read(0x1057, &[0]), None);
    assert_eq!(read(0x1059, &[0, 0, 0, 0xC0, 0x7F]), None);
}

#[test]
fn a_query_and_its_answer_carry_one_number() {
    let mut written = Vec::new();
    let version = Version::read(b"01.04.91.01").unwrap();
    for answer in [
        Answer::Version(version),
        Answer::AltitudeLimit(30),
        Answer::BatteryThreshold(10),
        Answer::TiltLimit(25.0_f64.to_radians()),
    ] {
        let query = HostPacket::Query { sequence: 0x0201, query: answer.query() };
        query.encode(&mut written);
        assert_eq!(HostPacket::decode(&written), Ok(query));
        let packet = DronePacket::Answer { sequence: 0x0201, answer };
        packet.encode(&mut written);
        assert_eq!(DronePacket::decode(&written), Ok(packet));
    }
}
