//! Take-offs of which the drone reports little.

use super::*;

#[test]
fn a_drone_that_is_heard_again_during_a_take_off_is_sent_no_port() {
    let mut fixture = Text::new();
    fixture.session = Session::text(9001, false, Arc::new(LinkCounters::default()));
    fixture.run(0);
    fixture.reply(0, "ok");
    fixture.fly(0, 4_000, |_| 7);
    assert_eq!(fixture.times("port"), [0]);
    fixture.order(4_000, DroneOrder::TakeOff);
    for now_ms in 4_000..6_100 {
        fixture.session.approve(approved(0.0), ms(now_ms), ms(now_ms));
        fixture.run(now_ms);
    }
    assert!(!fixture.session.counters.is_connected(), "silent for 2 s");
    fixture.steer(6_100, 7_000, |_| 7);
    assert!(fixture.session.counters.is_connected());
    assert_eq!(fixture.times("port"), [0], "it would end the take-off");
}

#[test]
fn a_take_off_of_a_drone_that_counts_no_seconds_and_does_not_reply_ends_after_8_s_aloft_or_12_s() {
    assert_eq!(first_sticks_ms(|now_ms| if now_ms < 5_000 { "10" } else { "80" }), 9_000);
    assert_eq!(first_sticks_ms(|_| "10"), 13_000);
}

/// When the first sticks go out after a take-off at 1 s by such distances to the floor. ms
fn first_sticks_ms(tof_cm: fn(i64) -> &'static str) -> i64 {
    let mut fixture = Text::new();
    fixture.session.advance(ms(0));
    fixture.reply(0, "ok");
    for now_ms in 0..15_000 {
        if now_ms % 100 == 0 {
            let line = format!("tof:{};bat:83;", tof_cm(now_ms));
            fixture.session.receive_state(line.as_bytes(), ms(now_ms));
        }
        if now_ms == 1_000 {
            fixture.order(now_ms, DroneOrder::TakeOff);
        }
        if now_ms % 20 == 0 {
            fixture.session.approve(approved(0.5), ms(now_ms), ms(now_ms));
        }
        fixture.run(now_ms);
    }
    assert_eq!(fixture.times("takeoff"), [1_000]);
    fixture.times("rc")[0]
}
