use super::super::tests::ms;
use super::*;

/// Motors whose count was seen to grow at `since_ms`.
fn running(since_ms: i64) -> Motors {
    Motors { count_s: 9.0, since: ms(since_ms), last: ms(since_ms), has_grown: true }
}

#[test]
fn the_ports_are_sent_until_a_state_line_has_come() {
    let sent = |protocol: &mut TextProtocol| {
        let mut outbox = Vec::new();
        protocol.send_periodic_requests(&mut outbox);
        outbox.len()
    };
    let mut protocol = TextProtocol::new(9000);
    assert_eq!(sent(&mut protocol), 2);
    protocol.receive_state(b"bat:80;time:3;\r\n", ms(0)).unwrap();
    assert_eq!([sent(&mut protocol), sent(&mut TextProtocol::new(STATE_PORT))], [1, 1]);
    protocol.on_connected(&mut Vec::new());
    assert_eq!(sent(&mut protocol), 2, "a new connection");
}

#[test]
fn motors_run_while_their_count_grows_and_stand_three_seconds_after_it_did() {
    let mut protocol = TextProtocol::new(STATE_PORT);
    assert_eq!(protocol.motors_run(), None);
    for (has_grown, at_ms, expected) in [
        (true, 2_999, Some(true)),
        (true, 3_000, Some(false)),
        (false, 2_999, None),
        (false, 3_000, Some(false)),
    ] {
        let last = ms(at_ms);
        protocol.motors = Some(Motors { count_s: 7.0, since: ms(0), last, has_grown });
        assert_eq!(protocol.motors_run(), expected, "{has_grown}, {at_ms} ms");
    }
}

#[test]
fn a_count_that_goes_back_begins_anew_and_one_that_stays_keeps_its_time() {
    let seen = |count_s| Motors::seen(Some(running(0)), count_s, ms(500));
    let last = ms(500);
    assert_eq!(seen(9.0), Motors { last, ..running(0) });
    assert_eq!(seen(10.0), Motors { count_s: 10.0, since: last, last, has_grown: true });
    assert_eq!(seen(8.0), Motors { count_s: 8.0, since: last, last, has_grown: false });
    assert!(!Motors::seen(None, 9.0, ms(500)).has_grown);
}

#[test]
fn an_order_to_take_off_that_was_answered_is_never_repeated() {
    for (reply, is_answered) in [("87", false), ("error Motor stop", true), ("ok", true)] {
        let mut protocol = TextProtocol::new(8890);
        assert_eq!(protocol.take_off_repeat_after(), Some(super::super::TAKE_OFF_TIME));
        protocol.begin(DroneOrder::TakeOff, ms(0));
        protocol.receive(reply.as_bytes(), ms(5_000), &mut Vec::new());
        assert_eq!(protocol.take_off_repeat_after().is_none(), is_answered, "{reply}");
    }
}

#[test]
fn a_take_off_is_over_by_its_time_or_by_an_ok_that_is_late_enough() {
    let ordered = |motors: Option<Motors>| {
        let mut protocol = TextProtocol::new(STATE_PORT);
        protocol.begin(DroneOrder::TakeOff, ms(0));
        protocol.motors = motors;
        protocol
    };
    for (motors, state, over_ms) in [
        (None, "bat:90;", 12_000),
        (None, "bat:90;tof:30;", 12_000),
        (None, "bat:90;tof:31;", 8_000),
        (Some(running(7_500)), "bat:90;tof:10;", 8_000),
    ] {
        let mut protocol = ordered(motors);
        protocol.receive_state(state.as_bytes(), ms(7_000));
        assert!(protocol.is_taking_off(ms(over_ms - 1)), "{motors:?} {state}");
        assert!(!protocol.is_taking_off(ms(over_ms)), "{motors:?} {state}");
        assert!(!protocol.takes_sticks(ms(over_ms - 1)), "{motors:?} {state}");
        assert!(protocol.takes_sticks(ms(over_ms)), "{motors:?} {state}");
    }
    for (at_ms, heard, is_running) in
        [(2_499, Received::Connected, true), (2_500, Received::Acknowledged, false)]
    {
        let mut protocol = ordered(None);
        assert_eq!(protocol.receive(b"ok", ms(at_ms), &mut Vec::new()), Some(heard));
        assert_eq!(protocol.is_taking_off(ms(at_ms)), is_running, "{at_ms} ms");
    }
    let mut landing = ordered(None);
    landing.begin(DroneOrder::Land, ms(10));
    assert!(!landing.is_taking_off(ms(10)) && landing.takes_sticks(ms(10)));
}

#[test]
fn a_drone_that_was_seen_to_fly_takes_sticks_though_its_state_lines_end() {
    let mut protocol = TextProtocol::new(STATE_PORT);
    protocol.begin(DroneOrder::TakeOff, ms(0));
    // No `ok`; the count of seconds grows until 9 s.
    for (count_s, at_ms) in [(0, 1_000), (3, 4_000), (7, 7_999), (8, 9_000)] {
        let line = format!("bat:90;time:{count_s};");
        protocol.receive_state(line.as_bytes(), ms(at_ms));
        assert_eq!(protocol.takes_sticks(ms(at_ms)), at_ms >= 8_000, "{at_ms} ms");
    }
    for at_ms in [9_100, 12_100, 60_000] {
        assert!(
            protocol.takes_sticks(ms(at_ms)) && !protocol.is_taking_off(ms(at_ms)),
            "{at_ms} ms"
        );
    }
    assert_eq!(protocol.take_off_repeat_after(), None, "it is not repeated");
}

#[test]
fn after_the_longest_take_off_a_drone_takes_sticks_unless_it_reports_standing() {
    for (last_ms, takes) in [(4_000, true), (9_000, true), (9_001, false), (12_000, false)] {
        let mut protocol = TextProtocol::new(STATE_PORT);
        protocol.begin(DroneOrder::TakeOff, ms(0));
        protocol.motors =
            Some(Motors { count_s: 0.0, since: ms(0), last: ms(last_ms), has_grown: false });
        assert!(!protocol.takes_sticks(ms(11_999)), "{last_ms} ms");
        assert_eq!(protocol.takes_sticks(ms(12_000)), takes, "{last_ms} ms");
    }
}

#[test]
fn a_drone_of_unknown_motors_flies_by_an_echo_from_0_31_to_10_m() {
    let mut protocol = TextProtocol::new(STATE_PORT);
    for (tof_m, flies) in [(0.1, false), (0.3, false), (0.31, true), (10.0, true)] {
        protocol.motors = None;
        assert_eq!(protocol.flies_at(tof_m), Some(flies), "{tof_m} m");
        protocol.motors = Some(running(0));
        assert_eq!(protocol.flies_at(tof_m), Some(flies), "{tof_m} m");
    }
    // No echo: the motors decide, where they are counted.
    assert_eq!(protocol.flies_at(10.01), None);
    protocol.motors = None;
    assert_eq!(protocol.flies_at(10.01), Some(false));
    for is_high in [true, false] {
        protocol.is_high = Some(is_high);
        assert_eq!(protocol.flies_at(10.01), Some(is_high), "as by the newest echo");
    }
}

#[test]
fn a_charge_above_100_stays_one_and_numbers_that_no_byte_holds_are_limited() {
    assert_eq!([-5.0, 99.9, 250.0, 1e9, f64::NAN].map(percent), [0, 99, 250, 255, 0]);
}
