use serde_json::json;
use tello_io::clock::SpanNs;

use super::*;

fn packet(packet: DronePacket) -> Vec<u8> {
    let mut bytes = Vec::new();
    packet.encode(&mut bytes);
    bytes
}

fn at(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

/// The status of a state line at a time.
fn state(line: &str, motor: &mut Motor, ms: i64) -> Status {
    match read_state(line.as_bytes(), motor, at(ms)) {
        BenchEventKind::Status(status) => status,
        other => panic!("{line}: {other:?}"),
    }
}

#[test]
fn every_packet_is_the_command_of_its_name_in_the_text_sdk() {
    for (packet, text) in [
        (Packet::Hello, "command"),
        (Packet::Version(3), "command"),
        (Packet::Ports(8890), "port 8890 11111"),
        (Packet::Sticks(Sticks::new(0.5, 0.0, 0.0, -0.25)), "rc 50 0 -25 0"),
        (Packet::TakeOff(1), "takeoff"),
        (Packet::Land(2), "land"),
        (Packet::Emergency, "emergency"),
    ] {
        let bytes = packet.encode(Protocol::Text, TimeOfDay::default());
        assert_eq!(String::from_utf8(bytes).unwrap(), text);
    }
}

#[test]
fn every_packet_is_read_again_in_the_binary_protocol_with_its_number() {
    let u = Sticks::new(0.5, 0.0, 0.0, -0.25);
    let time = TimeOfDay::default();
    for (packet, host, named) in [
        (Packet::Hello, HostPacket::ConnReq { video_port: 6038 }, ("hello", None)),
        (Packet::Ports(1), HostPacket::ConnReq { video_port: 6038 }, ("port", None)),
        (Packet::Sticks(u), HostPacket::Sticks { u, is_fast: false, time }, ("sticks", None)),
        (
            Packet::TakeOff(7),
            HostPacket::Action { action: Action::TakeOff, sequence: 7 },
            ("take_off", Some(7)),
        ),
        (
            Packet::Land(8),
            HostPacket::Action { action: Action::Land, sequence: 8 },
            ("land", Some(8)),
        ),
        (Packet::Emergency, HostPacket::EmergencyStop, ("emergency", None)),
        (
            Packet::Version(9),
            HostPacket::Query { sequence: 9, query: Query::Version },
            ("version", Some(9)),
        ),
    ] {
        assert_eq!(HostPacket::decode(&packet.encode(Protocol::Binary, time)), Ok(host));
        assert_eq!(packet.name(), named);
    }
}

#[test]
fn a_drone_on_the_ground_may_run_its_motors() {
    let read = |status| match read(&packet(DronePacket::Status { sequence: 0, status }), BINARY) {
        BenchEventKind::Status(status) => (status.is_flying, status.is_running),
        other => panic!("{other:?}"),
    };
    let ground = FlightStatus::new(false);
    assert_eq!(read(FlightStatus::new(true)), (true, true));
    assert_eq!(read(ground), (false, false));
    assert_eq!(read(FlightStatus { flags: ground.flags | MOTORS_ON, ..ground }), (false, true));
}

const BINARY: Protocol = Protocol::Binary;

#[test]
fn an_acknowledgement_names_its_order() {
    for (action, name) in [(Action::Land, "land"), (Action::TakeOff, "take_off")] {
        let bytes = packet(DronePacket::Ack { action, sequence: 5 });
        let BenchEventKind::Ack { packet, sequence: 5 } = read(&bytes, BINARY) else {
            panic!("{name}")
        };
        assert_eq!(packet, name);
    }
}

#[test]
fn a_reply_is_a_text_in_the_text_sdk_alone() {
    let text = |protocol| read(b"ok\r\n", protocol);
    assert!(matches!(text(Protocol::Text), BenchEventKind::Reply(reply) if reply == "ok"));
    assert!(matches!(text(BINARY), BenchEventKind::Other(bytes) if bytes == "6f6b0d0a"));
    assert!(
        matches!(read(b"\xff\x00", Protocol::Text), BenchEventKind::Other(bytes) if bytes == "ff00")
    );
}

#[test]
fn a_distance_to_the_floor_that_can_be_measured_is_a_flight() {
    for (tof, is_flying) in [
        ("10", false),
        ("30", false),
        ("31", true),
        ("1000", true),
        ("1001", false),
        ("6553", false),
    ] {
        let status = state(&format!("tof:{tof};h:40;bat:70;"), &mut Motor::default(), 0);
        assert_eq!((status.is_flying, status.is_running), (is_flying, is_flying), "{tof} cm");
        assert_eq!((status.height_m, status.battery_pct), (Some(0.4), Some(70.0)));
    }
    let none = state("bat:70;", &mut Motor::default(), 0);
    assert_eq!((none.is_flying, none.height_m, none.velocity_d_mps), (false, None, None));
}

#[test]
fn motors_run_for_three_seconds_after_their_time_grew() {
    let mut motor = Motor::default();
    let mut runs = |line: &str, ms| state(line, &mut motor, ms).is_running;
    assert!(!runs("time:14;", 0), "the first time is no growth");
    assert!(!runs("time:14;", 1000));
    assert!(runs("time:15;", 2000));
    assert!(runs("bat:3;", 3000), "a line without a time");
    assert!(runs("time:15;", 4999));
    assert!(!runs("time:15;", 5000));
    assert!(!runs("time:2;", 6000), "of a drone that started anew");
    assert!(runs("time:3;", 7000));
}

#[test]
fn a_velocity_has_all_its_axes_or_is_absent() {
    let velocity = |line: &str| state(line, &mut Motor::default(), 0).velocity_d_mps;
    assert_eq!(velocity("vgx:10;vgy:-20;vgz:30;"), Some([1.0, -2.0, 3.0]));
    assert_eq!(velocity("vgx:1;vgz:3;"), None);
    let garbage = read_state(b"\xcc\x01", &mut Motor::default(), at(0));
    assert!(matches!(garbage, BenchEventKind::Other(bytes) if bytes == "cc01"));
}

#[test]
fn the_record_shows_what_the_drone_reports_in_the_units_of_the_drone() {
    let status =
        serde_json::to_value(state("yaw:-57;tof:89;vgx:1;vgy:0;vgz:-2;", &mut Motor::default(), 0));
    let status = status.unwrap();
    assert_eq!((&status["yaw_deg"], &status["tof_cm"]), (&json!(-57.0), &json!(89.0)));
    assert_eq!(status["velocity_mps"], json!([0.1, 0.0, -0.2]));
    let log = DronePacket::LogData { sequence: 0, tick: 5, yaw_rad: 0.5 };
    let heading = serde_json::to_value(read(&packet(log), BINARY)).unwrap();
    assert_eq!(heading, json!({ "heading": 28.648 }));
}
