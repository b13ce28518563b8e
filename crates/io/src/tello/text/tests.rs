use proptest::prelude::*;

use tello_flight::gate::{Gate, GateTable};

use super::*;

fn decode(text: &str) -> Result<Command, CommandError> {
    Command::decode(text.as_bytes())
}

#[test]
fn sticks_carry_the_signs_and_the_rounding_of_the_sdk() {
    let text = |u: [f64; 4]| Command::Sticks(Sticks::from(u)).to_string();
    // Roll, pitch, yaw, throttle; yaw is counter-clockwise for us.
    assert_eq!(text([0.0; 4]), "rc 0 0 0 0");
    assert_eq!(text([0.1, 0.2, 0.3, 0.4]), "rc 10 20 40 -30");
    assert_eq!(text([-1.0, 1.0, -1.0, -1.0]), "rc -100 100 -100 100");
    assert_eq!(text([0.004, 0.006, -0.006, -0.004]), "rc 0 1 0 1");
    assert_eq!(text([2.0, -3.0, f64::NAN, f64::INFINITY]), "rc 100 -100 100 0");
    let u = Sticks::new(0.1, 0.2, 0.3, 0.4);
    assert_eq!(decode("rc 10 20 40 -30"), Ok(Command::Sticks(u)));
    assert_eq!(decode("rc 101 0 0 0"), Err(CommandError::OutOfRange));
    assert_eq!(decode("rc 1 2 3"), Err(CommandError::Unknown));
}

#[test]
fn what_is_commanded_is_read_again() {
    let mut commands = vec![
        Command::Enter,
        Command::TakeOff,
        Command::Land,
        Command::EmergencyStop,
        Command::Stop,
        Command::Sticks(Sticks::new(0.25, -0.5, 1.0, -0.01)),
        Command::Go { cm: [30, -40, 50] },
        Command::Turn { deg: 90 },
        Command::Turn { deg: -45 },
        Command::Ports { state: 8891, video: 11111 },
        Command::Flip,
        Command::StreamOn,
        Command::Setting,
    ];
    commands.extend(Query::ALL.map(|(query, _)| Command::Query(query)));
    let mut bytes = Vec::new();
    for command in commands {
        command.encode(&mut bytes);
        assert_eq!(Command::decode(&bytes), Ok(command), "{command}");
        bytes.extend(b"\r\n\0");
        assert_eq!(Command::decode(&bytes), Ok(command), "{command} with an end of line");
    }
}

#[test]
fn movements_go_the_right_way_and_have_limits() {
    let go = |forward, left, up| Ok(Command::Go { cm: [forward, left, up] });
    assert_eq!(decode("forward 30"), go(30, 0, 0));
    assert_eq!(decode("back 30"), go(-30, 0, 0));
    assert_eq!(decode("left 20"), go(0, 20, 0));
    assert_eq!(decode("right 500"), go(0, -500, 0));
    assert_eq!(decode("up 21"), go(0, 0, 21));
    assert_eq!(decode("down 21"), go(0, 0, -21));
    assert_eq!(decode("go 50 0 -20 60"), go(50, 0, -20));
    assert_eq!(decode("cw 90"), Ok(Command::Turn { deg: -90 }));
    assert_eq!(decode("ccw 3600"), Ok(Command::Turn { deg: 3600 }));
    for outside in ["up 19", "up 501", "cw 0", "cw 3601", "go 10 10 19 50", "go 50 0 0 9"] {
        assert_eq!(decode(outside), Err(CommandError::OutOfRange), "{outside}");
    }
    for unknown in [
        "",
        "Command",
        "flip",
        "flip up",
        "streamon 1",
        "takeoff now",
        "up",
        "up x",
        "rc",
        "fly",
        "\u{1}",
        "port",
    ] {
        assert_eq!(decode(unknown), Err(CommandError::Unknown), "{unknown:?}");
    }
}

#[test]
fn replies_mean_yes_no_or_a_value() {
    for yes in ["ok", "OK", "ok\r\n", " Ok \0\0"] {
        assert_eq!(Reply::decode(yes.as_bytes()), Some(Reply::Done), "{yes:?}");
    }
    for no in [
        "error",
        "error Motor stop",
        "error Not joystick\r\n",
        "Error. Not valid marker",
        "error, high temp",
        "out of range",
        "forced stop",
        "unknown command: sdk?",
        "unknow command: led",
        "command error: 254",
    ] {
        assert_eq!(Reply::decode(no.as_bytes()), Some(Reply::Refused), "{no:?}");
    }
    for value in ["87", "87\r\n", "100.0", "0s", "61~63C", "okay", "8", "e"] {
        assert_eq!(Reply::decode(value.as_bytes()), Some(Reply::Value), "{value:?}");
    }
    let status = b"\xcc\x18\x01\xb9\x88\x56\x00";
    for no_text in [&status[..], b"", b"\r\n", b"\xff", b"ok\x01", &[0; 40]] {
        assert_eq!(Reply::decode(no_text), None, "{no_text:?}");
    }
}

proptest! {
    #[test]
    fn random_bytes_are_survived(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        Command::decode(&bytes).ok();
        Reply::decode(&bytes);
        StateLine::decode(&bytes);
    }

    #[test]
    fn random_words_are_survived(text in "[a-z]{0,9}( -?[0-9]{0,6}){0,6}|([a-z]{1,4}:-?[0-9.,]{0,9};){0,30}") {
        if let Ok(command) = Command::decode(text.as_bytes()) {
            let mut bytes = Vec::new();
            command.encode(&mut bytes);
            prop_assert_eq!(Command::decode(&bytes), Ok(command));
        }
        Reply::decode(text.as_bytes());
        StateLine::decode(text.as_bytes());
    }

    #[test]
    fn hundredths_of_a_stick_come_back_unchanged(steps in prop::array::uniform4(-100_i16..=100)) {
        let u = Sticks::from(steps.map(|steps| f64::from(steps) / 100.0));
        let mut bytes = Vec::new();
        Command::Sticks(u).encode(&mut bytes);
        prop_assert_eq!(Command::decode(&bytes), Ok(Command::Sticks(u)));
    }
}

#[test]
fn what_the_gate_approves_is_what_arrives() {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 0.25 }, Protocol::Text).unwrap();
    for step in -1400..=1400 {
        let u_proposed = Sticks::from_element((f64::from(step) / 1320.0).clamp(-1.0, 1.0));
        let sent = Command::Sticks(gate.pass(&u_proposed, Some(0.0)).sticks());
        let mut bytes = Vec::new();
        sent.encode(&mut bytes);
        assert_eq!(Command::decode(&bytes), Ok(sent));
    }
}
