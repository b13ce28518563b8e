//! Vectors were produced by independent implementations of the protocol, see `docs/protocol.md`.

use proptest::prelude::*;

use super::*;
use crate::clock::{CivilTime, TimeOfDay};

pub(super) fn bytes(hex: &str) -> Vec<u8> {
    let digits = hex.as_bytes().chunks(2).map(|pair| std::str::from_utf8(pair).unwrap());
    digits.map(|pair| u8::from_str_radix(pair, 16).unwrap()).collect()
}

pub(super) fn at(hour: u8, minute: u8, second: u8, millisecond: u16) -> TimeOfDay {
    TimeOfDay { hour, minute, second, millisecond }
}

pub(super) fn sticks(u: [f64; 4], is_fast: bool, time: TimeOfDay) -> HostPacket {
    HostPacket::Sticks { u: Sticks::from(u), is_fast, time }
}

fn action(action: Action, sequence: u16) -> HostPacket {
    HostPacket::Action { action, sequence }
}

/// Vectors of the host that are read and written. Sticks are roll, pitch, yaw, throttle.
pub(super) fn host_vectors() -> Vec<(&'static str, HostPacket)> {
    let (s46, s47, s48) = (at(8, 22, 46, 0), at(8, 22, 47, 0), at(8, 22, 48, 0));
    vec![
        ("636f6e6e5f7265713a9617", HostPacket::ConnReq { video_port: 6038 }),
        ("636f6e6e5f7265713a672b", HostPacket::ConnReq { video_port: 11111 }),
        ("cc58007c68540001006a90", action(Action::TakeOff, 1)),
        ("cc600027685500020000c65b", action(Action::Land, 2)),
        ("656d657267656e6379", HostPacket::EmergencyStop),
        ("cc6000276855000300019310", HostPacket::CancelLanding { sequence: 3 }),
        ("cc58007c685400e5011a0f", action(Action::TakeOff, 0x01E5)),
        ("cc600027685500e60100de28", action(Action::Land, 0x01E6)),
        ("cc680051685800eb011e00eb72", HostPacket::AltitudeLimit { sequence: 0x01EB, limit_m: 30 }),
        (
            "cc7000cb505010f1010034126c98",
            HostPacket::LogHeaderAck { sequence: 0x01F1, header_id: 0x1234 },
        ),
        ("ccb0007f605000000000042000010808162e0000217f", sticks([0.0; 4], false, s46)),
        ("ccb0007f605000000094062000010808162f0000b8c0", sticks([1.0, 0.0, 0.0, 0.0], false, s47)),
        ("ccb0007f605000000000a43400010808162f0000cfeb", sticks([0.0, 1.0, 0.0, 0.0], false, s47)),
        ("ccb0007f6050000000000420a5010808162f00008ecf", sticks([0.0, 0.0, 0.0, 1.0], false, s47)),
        ("ccb0007f605000000000042000d90208162f0000cd26", sticks([0.0, 0.0, 1.0, 0.0], false, s47)),
        (
            "ccb0007f60500000006c610b5bd80208162f00000cd2",
            sticks([-1.0, -1.0, 1.0, -1.0], false, s47),
        ),
        ("ccb0007f605000000000042000011808163000001fa8", sticks([0.0; 4], true, s48)),
        (
            "ccb0007f605000000000042000291d082c35b600a8c6",
            sticks([0.0, 0.0, -1.0, 0.0], true, at(8, 44, 53, 182)),
        ),
        ("cc58007c4856100500782b", HostPacket::Query { sequence: 5, query: Query::AltitudeLimit }),
        ("cc58007c4845000600e962", HostPacket::Query { sequence: 6, query: Query::Version }),
        (
            "ccd00025504600010000ea070b001500080016002e000000a169",
            HostPacket::DateTime {
                sequence: 1,
                time: CivilTime { year: 2026, month: 11, day: 21, time: s46 },
            },
        ),
    ]
}

/// Vectors of the drone that are read and written.
pub(super) fn drone_vectors() -> Vec<(&'static str, DronePacket)> {
    let status = FlightStatus {
        height_dm: 12,
        vel_north_dm_s: 3,
        vel_east_dm_s: -2,
        vel_down_dm_s: -1,
        fly_time_ds: 345,
        battery_pct: 87,
        time_left_ds: 2300,
        battery_mv: 3950,
        ..FlightStatus::new(true)
    };
    vec![
        ("636f6e6e5f61636b3a9617", DronePacket::ConnAck { video_port: 6038 }),
        (
            "cc1801b9885600e1000c000300feffffff5901000057fc086e0f0d0600000000009e6a",
            DronePacket::Status { sequence: 225, status },
        ),
        ("cc680051904600000000008661", DronePacket::DateTimeRequest { sequence: 0 }),
        (
            "cc680051881a0000005a00b155",
            DronePacket::WifiStrength { sequence: 0, strength_pct: 90, disturbance: 0 },
        ),
        (
            "cc88002488501000003412000000000fcd",
            DronePacket::LogHeader { sequence: 0, header_id: 0x1234 },
        ),
        (
            "cc7000cbb056100500000a006e69",
            DronePacket::Answer { sequence: 5, answer: Answer::AltitudeLimit(10) },
        ),
    ]
}

/// Vectors of messages that we neither send nor read: id, sequence number and payload.
const OTHER_VECTORS: [(&str, u16, u16, &[u8]); 1] = [("cc58007c60250000006c95", 0x0025, 0, &[])];

#[test]
fn messages_of_others_are_correct_frames_that_are_not_read() {
    for (text, id, sequence, payload) in OTHER_VECTORS {
        let bytes = bytes(text);
        let frame = Frame::parse(&bytes).unwrap();
        assert_eq!((frame.id, frame.sequence, frame.payload), (id, sequence, payload), "{text}");
        assert_eq!(HostPacket::decode(&bytes), Err(PacketError::Unread { id }));
        assert_eq!(DronePacket::decode(&bytes), Err(PacketError::Unread { id }));
    }
}

#[test]
fn every_truncation_and_every_flipped_bit_is_an_error() {
    let host = host_vectors().into_iter().map(|(text, _)| text);
    let drone = drone_vectors().into_iter().map(|(text, _)| text);
    for text in host.chain(drone).filter(|text| text.starts_with("cc")) {
        let good = bytes(text);
        for length in 0..good.len() {
            assert!(HostPacket::decode(&good[..length]).is_err(), "{length} bytes of {text}");
            assert!(DronePacket::decode(&good[..length]).is_err(), "{length} bytes of {text}");
        }
        for bit in 0..8 * good.len() {
            let mut bad = good.clone();
            bad[bit / 8] ^= 1 << (bit % 8);
            assert!(HostPacket::decode(&bad).is_err(), "bit {bit} of {text}");
            assert!(DronePacket::decode(&bad).is_err(), "bit {bit} of {text}");
        }
        let longer = [good.as_slice(), &[0]].concat();
        let length = longer.len();
        assert_eq!(
            Frame::parse(&longer).unwrap_err(),
            PacketError::Length { stated: length - 1, length }
        );
    }
}

#[test]
fn a_correct_frame_with_a_wrong_payload_is_reported_as_such() {
    let mut written = Vec::new();
    write_frame(0x88, id::FLIGHT_STATUS, 0, &[0; 23], &mut written);
    let error = DronePacket::decode(&written).unwrap_err();
    assert_eq!(error, PacketError::Payload { id: id::FLIGHT_STATUS, length: 23 });
    assert_eq!(error.to_string(), "message 0x0056 does not fit its payload of 23 bytes");
    write_frame(0x68, id::LAND, 0, &[2], &mut written);
    let error = HostPacket::decode(&written).unwrap_err();
    assert_eq!(error, PacketError::Payload { id: id::LAND, length: 1 });
}

proptest! {
    #[test]
    fn random_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
        prop_assert!(HostPacket::decode(&bytes).is_err());
        prop_assert!(DronePacket::decode(&bytes).is_err());
    }

    #[test]
    fn random_payloads_in_correct_frames_are_survived(
        id in prop::sample::select(vec![
            id::WIFI_STRENGTH, id::DATE_TIME, id::STICKS, id::TAKE_OFF, id::LAND,
            id::FLIGHT_STATUS, id::ALTITUDE_LIMIT, id::LOG_HEADER, 0x1051,
        ]),
        short: [u8; 3], word: [u8; 11], status: [u8; 24],
    ) {
        let mut frame = Vec::new();
        write_frame(0x88, id, 7, &short, &mut frame);
        check_frame(&frame)?;
        write_frame(0x88, id, 7, &word, &mut frame);
        check_frame(&frame)?;
        write_frame(0x88, id, 7, &status, &mut frame);
        check_frame(&frame)?;
    }
}

/// Both readers survive, and what is read is written with the same meaning.
fn check_frame(frame: &[u8]) -> Result<(), TestCaseError> {
    let mut written = Vec::new();
    if let Ok(packet) = HostPacket::decode(frame) {
        packet.encode(&mut written);
        prop_assert_eq!(HostPacket::decode(&written), Ok(packet));
    }
    if let Ok(packet) = DronePacket::decode(frame) {
        packet.encode(&mut written);
        prop_assert_eq!(DronePacket::decode(&written), Ok(packet));
    }
    Ok(())
}
