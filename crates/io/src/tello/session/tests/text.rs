//! The session in the text SDK.

mod take_off;

use super::*;
use crate::tello::text::{Command, Query};

/// A session in the text SDK and the story of what it sent, but for the landings that only a burst adds.
struct Text {
    session: Session,
    sent: Vec<(i64, String)>,
    landings: Landings,
}

impl Text {
    fn new() -> Self {
        let session = Session::text(8890, false, Arc::new(LinkCounters::default()));
        Self { session, sent: Vec::new(), landings: Landings::default() }
    }

    /// Connected at 0 ms to a drone that stands, watched for 4 s; what was sent is forgotten.
    fn standing() -> Self {
        let mut fixture = Self::new();
        fixture.session.advance(ms(0));
        fixture.reply(0, "ok");
        fixture.fly(0, 4_000, |_| 7);
        assert_eq!(fixture.session.sources.last_status(), Some(false), "{:?}", fixture.session);
        fixture.sent.clear();
        fixture
    }

    /// Takes what is to be sent. Neutral sticks and the `land` directly behind them are one entry.
    fn note(&mut self, now_ms: i64) {
        for message in self.session.drain() {
            let Message::Text(command) = message else { panic!("{message:?} in the text SDK") };
            if command == Command::Land {
                self.sent.pop_if(|(at_ms, text)| *at_ms == now_ms && text == "rc 0 0 0 0");
                if !self.landings.keep(now_ms) {
                    continue;
                }
            }
            self.sent.push((now_ms, command.to_string()));
        }
    }

    fn run(&mut self, now_ms: i64) {
        if ms(now_ms) >= self.session.next_deadline() {
            self.session.advance(ms(now_ms));
            assert!(self.session.next_deadline() > ms(now_ms), "busy at {now_ms} ms");
        }
        self.note(now_ms);
    }

    fn reply(&mut self, now_ms: i64, text: &str) {
        assert_eq!(self.session.receive(text.as_bytes(), ms(now_ms)), None);
        self.note(now_ms);
    }

    fn state(&mut self, now_ms: i64, time_s: i64) -> Option<DroneStatus> {
        let line = format!("pitch:0;tof:10;h:40;bat:83;time:{time_s};\r\n");
        let status = self.session.receive_state(line.as_bytes(), ms(now_ms));
        self.note(now_ms);
        status
    }

    /// Lives on with a state line every 100 ms.
    fn fly(&mut self, from_ms: i64, to_ms: i64, time_s: impl Fn(i64) -> i64) {
        for now_ms in from_ms..to_ms {
            if now_ms % 100 == 0 {
                self.state(now_ms, time_s(now_ms));
            }
            self.run(now_ms);
        }
    }

    /// The same under a control thread that wants half roll.
    fn steer(&mut self, from_ms: i64, to_ms: i64, time_s: impl Fn(i64) -> i64) {
        for now_ms in from_ms..to_ms {
            if now_ms % 20 == 0 {
                self.session.approve(approved(0.5), ms(now_ms), ms(now_ms));
            }
            self.fly(now_ms, now_ms + 1, &time_s);
        }
    }

    fn order(&mut self, now_ms: i64, order: DroneOrder) {
        self.session.order(order, ms(now_ms));
        self.note(now_ms);
    }

    fn times(&self, word: &str) -> Vec<i64> {
        let hits = self.sent.iter().filter(|(_, text)| text.split(' ').next() == Some(word));
        hits.map(|(at, _)| *at).collect()
    }
}

/// Seconds with motors on that run from `start_ms`.
fn running(start_ms: i64) -> impl Fn(i64) -> i64 {
    move |now_ms| 7 + (now_ms - start_ms).max(0) / 1000
}

#[test]
fn sdk_mode_is_asked_for_until_it_is_confirmed_whatever_else_comes_first() {
    let mut fixture = Text::new();
    for now_ms in 0..5_000 {
        fixture.run(now_ms);
    }
    assert_eq!(fixture.times("command"), [0, 2_000, 4_000]);
    // A real drone's binary status comes first.
    let status = b"\xcc\x18\x01\xb9\x88\x56\x00\x09\x00";
    assert_eq!(fixture.session.receive(status, ms(5_000)), None);
    assert!(!fixture.session.counters.is_connected());
    fixture.reply(5_003, "ok");
    assert!(fixture.session.counters.is_connected());
    assert_eq!(fixture.session.counters.malformed.get(), 1);
    assert_eq!(fixture.sent.len(), 3, "{:?}", fixture.sent);
}

#[test]
fn another_state_port_is_sent() {
    let mut fixture = Text::new();
    fixture.session = Session::text(9001, false, Arc::new(LinkCounters::default()));
    fixture.run(0);
    fixture.reply(1, "OK\r\n");
    assert_eq!(fixture.sent[1], (1, "port 9001 11111".into()));
}

#[test]
fn a_drone_flies_while_its_motors_count_seconds() {
    let mut fixture = Text::new();
    fixture.session.advance(ms(0));
    fixture.reply(0, "ok");
    let fly = |fixture: &mut Text, now_ms, time_s| fixture.state(now_ms, time_s).unwrap().is_flying;
    assert!(!fly(&mut fixture, 0, 7), "10 cm above the floor");
    assert!(!fly(&mut fixture, 2_900, 7));
    assert!(!fly(&mut fixture, 3_000, 7), "off for 3 s");
    assert!(fly(&mut fixture, 3_100, 8));
    assert!(fly(&mut fixture, 6_000, 8));
    assert!(!fly(&mut fixture, 6_100, 8));
    // Switched off and on meanwhile: a smaller count, and the floor is far away.
    let line = b"tof:80;bat:83;time:0;";
    assert!(fixture.session.receive_state(line, ms(6_200)).unwrap().is_flying);
    let status = fixture.state(9_300, 0).unwrap();
    assert!(status.is_on_ground && !status.is_flying, "{status:?}");
    assert_eq!((status.battery_pct, status.height_m), (83, Some(0.4)));
    assert_eq!((status.battery_v, status.is_battery_low, status.flight_mode), (None, None, None));
}

#[test]
fn a_line_that_lacks_what_a_status_needs_is_a_sign_of_life() {
    let mut fixture = Text::new();
    let receive = |fixture: &mut Text, line: &[u8]| fixture.session.receive_state(line, ms(1));
    assert_eq!(receive(&mut fixture, b"pitch:0;time:3;tof:10;"), None, "no charge");
    assert_eq!(receive(&mut fixture, b"bat:50;"), None, "no sign of the motors");
    assert_eq!(fixture.session.counters.malformed.get(), 0);
    // The charge is remembered. Without an echo the motors decide, once they were watched.
    assert_eq!(receive(&mut fixture, b"bat:50;tof:6553;time:3;"), None);
    assert!(!receive(&mut fixture, b"tof:10;").unwrap().is_flying);
    assert!(receive(&mut fixture, b"tof:80;").unwrap().is_flying);
    // SDK 3.0 by its document: no time.
    let mut fixture = Text::new();
    assert!(!receive(&mut fixture, b"bat:50;tof:10;").unwrap().is_flying);
    assert!(receive(&mut fixture, b"tof:80;").unwrap().is_flying);
    assert!(receive(&mut fixture, b"tof:6553;").unwrap().is_flying, "no echo, as before");
    assert!(!receive(&mut fixture, b"tof:10;").unwrap().is_flying);
    assert!(!receive(&mut fixture, b"tof:6553;").unwrap().is_flying, "no echo, as before");
    assert_eq!(receive(&mut fixture, b"nonsense"), None);
    assert_eq!(fixture.session.counters.malformed.get(), 1);
}

#[test]
fn a_drone_in_the_air_is_never_ordered_to_take_off() {
    // Met in flight, with an echo from the floor or without one.
    for tof_cm in [10, 80, 6_553] {
        let mut fixture = Text::new();
        fixture.session.advance(ms(0));
        fixture.reply(0, "ok");
        for now_ms in 0..9_000 {
            if now_ms % 100 == 0 {
                let time_s = 20 + now_ms / 1_000;
                let line = format!("tof:{tof_cm};bat:83;time:{time_s};");
                fixture.session.receive_state(line.as_bytes(), ms(now_ms));
            }
            // From the first moment at which its motors have shown.
            if now_ms >= 1_000 || tof_cm > 10 {
                fixture.order(now_ms, DroneOrder::TakeOff);
            }
            fixture.run(now_ms);
        }
        assert_eq!(fixture.times("takeoff"), [0; 0], "{tof_cm} cm");
    }
}

#[test]
fn a_state_line_of_2_s_ago_is_no_reason_to_take_off() {
    let mut fixture = Text::standing();
    for now_ms in 4_000..5_950 {
        fixture.run(now_ms);
    }
    fixture.order(5_950, DroneOrder::TakeOff);
    assert_eq!(fixture.times("takeoff"), [0; 0], "last heard at 3.9 s");
    fixture.state(5_960, 7);
    fixture.order(5_960, DroneOrder::TakeOff);
    assert_eq!(fixture.times("takeoff"), [5_960]);
}

#[test]
fn a_landing_that_is_refused_is_ordered_again_after_half_a_second() {
    let mut fixture = Text::standing();
    fixture.order(4_000, DroneOrder::TakeOff);
    fixture.steer(4_001, 11_000, running(5_000));
    fixture.reply(11_000, "ok");
    fixture.order(11_000, DroneOrder::Land);
    for now_ms in 11_001..14_000 {
        fixture.reply(now_ms, "error");
        fixture.steer(now_ms, now_ms + 1, running(5_000));
    }
    // Not sooner: the neutral sticks before it may cancel a landing that has begun.
    assert_eq!(fixture.times("land"), (11_000..14_000).step_by(500).collect::<Vec<_>>());
    assert_eq!(fixture.session.counters.refusals.get(), 2_999);
}

#[test]
fn sticks_keep_silent_before_and_during_a_take_off() {
    let mut fixture = Text::standing();
    fixture.steer(4_000, 6_000, |_| 7);
    fixture.order(6_000, DroneOrder::TakeOff);
    fixture.steer(6_001, 12_000, running(7_000));
    assert_eq!(fixture.times("rc"), [0; 0]);
    assert_eq!(fixture.times("takeoff"), [6_000]);
    // Nor a question, which would be dropped or disturb.
    assert!(fixture.times("battery?").iter().all(|at| *at <= 6_000), "{:?}", fixture.sent);
    let status = fixture.state(12_000, 12).unwrap();
    assert!(status.is_flying && !status.takes_sticks, "{status:?}");
    fixture.reply(12_001, "ok");
    fixture.steer(12_001, 12_200, running(7_000));
    assert_eq!(fixture.times("rc").len(), 10);
    assert!(fixture.sent.contains(&(12_020, "rc 50 0 0 0".into())), "{:?}", fixture.sent);
    assert_eq!(fixture.session.counters.acks.get(), 1);
}

#[test]
fn an_ok_that_is_late_or_doubled_ends_no_take_off() {
    let mut fixture = Text::standing();
    fixture.order(4_000, DroneOrder::TakeOff);
    for now_ms in (4_010..6_400).step_by(10) {
        fixture.reply(now_ms, "ok");
        // A take-off that the air doubled is refused while the first is running.
        fixture.reply(now_ms, "error Not joystick");
        fixture.steer(now_ms, now_ms + 10, running(5_000));
    }
    fixture.steer(6_400, 9_000, running(5_000));
    assert_eq!(fixture.times("rc"), [0; 0]);
    fixture.reply(9_000, "ok");
    fixture.reply(9_001, "ok");
    fixture.reply(9_002, "87");
    fixture.steer(9_002, 9_100, running(5_000));
    assert_eq!(fixture.times("rc").len(), 5, "{:?}", fixture.sent);
    assert_eq!(fixture.session.counters.acks.get(), 1);
}

#[test]
fn a_take_off_whose_reply_is_lost_is_not_repeated_and_ends_by_its_time() {
    let mut fixture = Text::standing();
    fixture.order(4_000, DroneOrder::TakeOff);
    for now_ms in 4_001..14_000 {
        fixture.order(now_ms, DroneOrder::TakeOff);
        fixture.steer(now_ms, now_ms + 1, running(5_000));
    }
    assert_eq!(fixture.times("takeoff"), [4_000]);
    assert_eq!(fixture.times("rc").first(), Some(&12_000), "8 s after the order");
}

#[test]
fn a_take_off_that_was_lost_is_repeated_to_a_standing_drone_only_and_one_that_was_refused_is_not() {
    for is_refused in [false, true] {
        let mut fixture = Text::standing();
        fixture.order(4_000, DroneOrder::TakeOff);
        if is_refused {
            fixture.reply(4_050, "error Motor stop");
            assert_eq!(fixture.session.counters.refusals.get(), 1);
        }
        for now_ms in 4_051..20_000 {
            fixture.order(now_ms, DroneOrder::TakeOff);
            fixture.steer(now_ms, now_ms + 1, running(10_000));
        }
        let expected: &[i64] = if is_refused { &[4_000] } else { &[4_000, 9_000] };
        assert_eq!(fixture.times("takeoff"), expected, "motors run from 11 s on");
    }
}

#[test]
fn a_landing_is_repeated_until_the_motors_are_off_and_a_silent_drone_is_asked_before_it() {
    let mut fixture = Text::standing();
    fixture.order(4_000, DroneOrder::TakeOff);
    fixture.steer(4_001, 11_000, running(5_000));
    fixture.reply(11_000, "ok");
    fixture.steer(11_000, 12_000, running(5_000));
    fixture.sent.clear();
    fixture.order(12_000, DroneOrder::Land);
    // Down at 15 s; the downlink is dead for 3 s.
    fixture.steer(12_001, 13_000, running(5_000));
    for now_ms in 13_000..16_000 {
        fixture.run(now_ms);
    }
    fixture.reply(16_000, "error Auto land");
    for now_ms in (16_000..25_000).step_by(20) {
        fixture.session.observe_pose(Some(false), ms(now_ms));
        fixture.steer(now_ms, now_ms + 20, |_| 17);
    }
    let landings: Vec<_> = (12_000..=19_000).step_by(500).collect();
    assert_eq!(fixture.times("land"), landings, "the count stands still for 3.3 s from 16 s on");
    let others: Vec<_> = fixture.sent.iter().filter(|(_, text)| text != "land").collect();
    // A drone that has restarted hears nothing before it.
    assert_eq!(others, [&(15_000, "command".to_owned())]);
}

#[test]
fn an_emergency_stop_is_sent_in_any_phase() {
    let mut fixture = Text::standing();
    fixture.order(4_000, DroneOrder::TakeOff);
    fixture.order(5_000, DroneOrder::EmergencyStop);
    fixture.steer(5_001, 5_500, running(5_000));
    assert_eq!(fixture.times("emergency"), [5_000, 5_000, 5_000, 5_200, 5_400]);
    assert_eq!(fixture.times("rc"), [5_000], "neutral sticks before the first emergency stop");
    assert_eq!(fixture.sent[1], (5_000, "rc 0 0 0 0".into()));
    for now_ms in (5_500..30_000).step_by(20) {
        fixture.session.observe_pose(Some(false), ms(now_ms));
        fixture.steer(now_ms, now_ms + 20, |_| 8);
    }
    // Its motors show for 3 s after they stopped, and "not flying" counts from 9 s on.
    assert_eq!(fixture.times("land"), (5_600..9_000).step_by(400).collect::<Vec<_>>());
    let last = *fixture.times("emergency").last().unwrap();
    assert!((8_400..10_000).contains(&last), "count at rest 3 s, and 1 s more: {last} ms");
}

#[test]
fn answers_are_asked_for_every_2_s_on_the_ground_and_in_the_air() {
    let mut fixture = Text::standing();
    fixture.fly(4_000, 8_000, running(4_000));
    fixture.steer(8_000, 12_000, running(4_000));
    assert_eq!(fixture.times("battery?"), [4_000, 6_000, 8_000, 10_000]);
    assert_eq!(fixture.times("rc").len(), 200, "a drone that flies takes sticks");
    assert_eq!(Command::Query(Query::Battery).to_string(), "battery?");
}

#[test]
fn answers_to_sticks_neither_stop_the_sticks_nor_acknowledge_an_order() {
    let mut fixture = Text::standing();
    fixture.fly(4_000, 8_000, running(4_000));
    for now_ms in (8_000..10_000).step_by(10) {
        fixture.reply(now_ms, "ok");
        fixture.reply(now_ms, "error Not joystick");
        fixture.steer(now_ms, now_ms + 10, running(4_000));
    }
    assert_eq!(fixture.times("rc").len(), 100);
    assert_eq!(fixture.session.counters.acks.get(), 0);
}

#[test]
fn a_dry_run_plans_as_if_it_steered() {
    let mut fixture = Text::new();
    fixture.session = Session::text(8890, true, Arc::new(LinkCounters::default()));
    fixture.run(0);
    fixture.reply(0, "ok");
    assert!(fixture.state(0, 7).unwrap().takes_sticks);
    fixture.order(1, DroneOrder::TakeOff);
    fixture.steer(1, 3_000, |_| 7);
    fixture.order(3_000, DroneOrder::EmergencyStop);
    let words = ["command", "battery?"];
    assert!(fixture.sent.iter().all(|(_, text)| words.contains(&&**text)), "{:?}", fixture.sent);
}

#[test]
fn a_velocity_is_handed_on_when_all_axes_are_reported() {
    let mut fixture = Text::new();
    let mut velocity =
        |line: &[u8]| fixture.session.receive_state(line, ms(1)).expect("no status").velocity_d_mps;
    assert_eq!(
        velocity(b"vgx:3;vgy:-4;vgz:12;tof:80;bat:83;"),
        Some([3.0, -4.0, 12.0].map(|tenths| tenths * 0.1))
    );
    assert_eq!(velocity(b"vgx:3;vgy:-4;tof:80;bat:83;"), None);
}
