//! The session in the text SDK: replies without numbers, a state line without "flying".
//!
//! A reply does not state what it answers, so nothing is waited for and none is taken for more than it
//! can prove: one that is late, doubled or missing shifts nothing. Charge comes from the state line,
//! never from a reply.

use tello_flight::drone::MOTORS_REST;

use super::DroneOrder;
use super::messages::{Message, Received};
use crate::clock::{SpanNs, TimeNs};
use crate::tello::DroneStatus;
use crate::tello::text::{Command, Field, Query, Reply, StateLine, VIDEO_PORT};

/// Where the drone sends its state line unless it is configured otherwise.
pub const STATE_PORT: u16 = 8890;

/// An `ok` that comes sooner after a take-off order answers something older: the drone sends it when it
/// hovers, after about 6 s, and a reply takes 0.3 s at most: assumptions (docs/bench-test.md).
const TAKE_OFF_MIN: SpanNs = SpanNs::from_ms(2500);
/// A drone that flies so long after the order hovers: its reply was lost.
const TAKE_OFF_TYPICAL: SpanNs = SpanNs::from_ms(8000);
/// After so long the take-off is over, one way or the other: before the drone lands by itself, 15 s after the last
/// packet.
const TAKE_OFF_MAX: SpanNs = SpanNs::from_ms(12_000);

/// Distances to the floor at which a drone counts as flying while it is unknown whether its motors run: a drone
/// on the floor reports 0.1 or 0.3 m. m
pub const TOF_FLYING_M: std::ops::RangeInclusive<f64> = 0.31..=10.0;

/// Newest reports of replies and state lines.
#[derive(Debug, Default)]
pub(super) struct TextTalk {
    /// Where the state line is to go, if not to the usual port.
    state_port: Option<u16>,
    take_off: TakeOff,
    motors: Option<Motors>,
    /// Whether the newest distance to the floor is that of a flying drone.
    is_high: Option<bool>,
    battery_pct: Option<u8>,
    /// Whether a state line has come since the ports were sent.
    has_state_line: bool,
}

/// Sticks that come shortly before or during a take-off make it fail.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum TakeOff {
    /// Not ordered.
    #[default]
    None,
    Ordered {
        at: TimeNs,
        /// Whether the drone refused something since: it has received the order.
        is_refused: bool,
    },
    Over,
}

impl TakeOff {
    /// The same after it was seen that the drone flies: its reply was lost.
    fn flown(self) -> Self {
        if matches!(self, Self::Ordered { .. }) { Self::Over } else { self }
    }
}

/// The newest count of seconds with motors on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Motors {
    count_s: f64,
    /// When this count was first seen, and last.
    since: TimeNs,
    last: TimeNs,
    /// Whether it was ever seen to grow; before, it may have stood still for long.
    has_grown: bool,
}

impl TextTalk {
    pub(super) fn new(state_port: u16) -> Self {
        let state_port = (state_port != STATE_PORT).then_some(state_port);
        Self { state_port, ..Self::default() }
    }

    /// Sends the state line where it is listened for. The drone may have been started anew.
    pub(super) fn greet(&mut self, outbox: &mut Vec<Message>) {
        self.has_state_line = false;
        if let Some(state) = self.state_port {
            outbox.push(Message::Text(Command::Ports { state, video: VIDEO_PORT }));
        }
    }

    /// A question that every firmware answers and whose answer cannot be taken for an `ok`: state lines
    /// may arrive while the link to the drone is dead, answers do not. The ports may have been lost if no state line
    /// came.
    pub(super) fn ping(&mut self, outbox: &mut Vec<Message>) {
        if !self.has_state_line {
            self.greet(outbox);
        }
        outbox.push(Message::Text(Command::Query(Query::Battery)));
    }

    pub(super) fn begin(&mut self, order: DroneOrder, now: TimeNs) {
        self.take_off = match order {
            DroneOrder::TakeOff => TakeOff::Ordered { at: now, is_refused: false },
            DroneOrder::Land | DroneOrder::EmergencyStop => TakeOff::Over,
        };
    }

    /// An order to take off that was not answered may be lost. One that was is never repeated.
    pub(super) fn take_off_repeat_after(&self) -> Option<SpanNs> {
        let is_answered =
            matches!(self.take_off, TakeOff::Over | TakeOff::Ordered { is_refused: true, .. });
        (!is_answered).then_some(super::TAKE_OFF_TIME)
    }

    /// Whether a take-off was ordered that may not be over.
    pub(super) fn is_taking_off(&self, now: TimeNs) -> bool {
        match self.take_off {
            TakeOff::None | TakeOff::Over => false,
            TakeOff::Ordered { at, .. } if self.is_flying() == Some(true) => {
                now.since(at) < TAKE_OFF_TYPICAL
            }
            TakeOff::Ordered { at, .. } => now.since(at) < TAKE_OFF_MAX,
        }
    }

    /// Not while a take-off is running, nor before one: a standing drone ignores them, and the
    /// take-off that follows is refused.
    pub(super) fn takes_sticks(&self, now: TimeNs) -> bool {
        match self.take_off {
            TakeOff::None => self.motors_run() == Some(true),
            TakeOff::Ordered { .. } => {
                let is_silent =
                    self.motors.is_some_and(|motors| now.since(motors.last) >= MOTORS_REST);
                !self.is_taking_off(now) && (self.motors_run() != Some(false) || is_silent)
            }
            TakeOff::Over => true,
        }
    }

    pub(super) fn receive_reply(&mut self, datagram: &[u8], now: TimeNs) -> Option<Received> {
        let ordered_for = match self.take_off {
            TakeOff::Ordered { at, .. } => Some(now.since(at)),
            TakeOff::None | TakeOff::Over => None,
        };
        Some(match (Reply::decode(datagram)?, ordered_for) {
            (Reply::Done, Some(so_long)) if so_long >= TAKE_OFF_MIN => {
                self.take_off = TakeOff::Over;
                Received::Acknowledged
            }
            (Reply::Done, _) => Received::Connected,
            // It may refuse a doubled take-off while the first is running: the motors decide.
            (Reply::Refused, _) => {
                if let TakeOff::Ordered { is_refused, .. } = &mut self.take_off {
                    *is_refused = true;
                }
                Received::Refused
            }
            (Reply::Value, _) => Received::Life,
        })
    }

    /// A status needs a charge and a sign of the motors; a line without them is a sign of life.
    pub(super) fn receive_state(&mut self, datagram: &[u8], now: TimeNs) -> Option<Received> {
        let line = StateLine::decode(datagram)?;
        self.has_state_line = true;
        self.battery_pct = line.get(Field::Bat).map(percent).or(self.battery_pct);
        if let Some(count_s) = line.get(Field::Time) {
            self.motors = Some(Motors::seen(self.motors, count_s, now));
        }
        self.is_high = line.tof_m().and_then(|tof_m| self.flies_at(tof_m));
        if !self.is_taking_off(now) && self.motors_run() == Some(true) {
            self.take_off = self.take_off.flown();
        }
        let (Some(is_flying), Some(battery_pct)) = (self.is_flying(), self.battery_pct) else {
            return Some(Received::Life);
        };
        Some(Received::Status(DroneStatus {
            received_at: now,
            is_flying,
            is_on_ground: !is_flying,
            takes_sticks: self.takes_sticks(now),
            is_battery_low: None,
            is_battery_critical: None,
            battery_pct,
            battery_v: None,
            height_m: line.height_m(),
            velocity_d_mps: line.velocity_d_mps(),
            heading_rad: line.heading_rad(),
            flight_mode: None,
        }))
    }

    /// Whether a drone of unknown motors that measures `tof_m` to the floor flies. Without an echo the distance shows
    /// nothing: the motors will, where the line counts their seconds, else what the newest echo showed stays.
    fn flies_at(&self, tof_m: f64) -> Option<bool> {
        if tof_m <= *TOF_FLYING_M.end() {
            return Some(TOF_FLYING_M.contains(&tof_m));
        }
        self.motors.is_none().then(|| self.is_high == Some(true))
    }

    /// Whether the drone flies: by its motors or, while these are unknown, by its distance to the floor.
    fn is_flying(&self) -> Option<bool> {
        self.motors_run().or(self.is_high)
    }

    /// Whether the motors run, by the newest line; `None` before their count was watched for long enough.
    fn motors_run(&self) -> Option<bool> {
        let Motors { since, last, has_grown, .. } = self.motors?;
        let is_at_rest = last.since(since) >= MOTORS_REST;
        (has_grown || is_at_rest).then_some(!is_at_rest)
    }
}

impl Motors {
    /// The count after a line with `count_s`. One that goes back is of a drone that was switched
    /// off meanwhile.
    fn seen(before: Option<Self>, count_s: f64, now: TimeNs) -> Self {
        match before {
            Some(before) if count_s > before.count_s => {
                Self { count_s, since: now, last: now, has_grown: true }
            }
            Some(before) if count_s >= before.count_s => Self { last: now, ..before },
            _ => Self { count_s, since: now, last: now, has_grown: false },
        }
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "ends at 0 and 255")]
fn percent(value: f64) -> u8 {
    value as u8
}

#[cfg(test)]
mod tests {
    use super::super::tests::ms;
    use super::*;

    /// Motors whose count was seen to grow at `since_ms`.
    fn running(since_ms: i64) -> Motors {
        Motors { count_s: 9.0, since: ms(since_ms), last: ms(since_ms), has_grown: true }
    }

    #[test]
    fn the_ports_are_sent_until_a_state_line_has_come() {
        let sent = |talk: &mut TextTalk| {
            let mut outbox = Vec::new();
            talk.ping(&mut outbox);
            outbox.len()
        };
        let mut talk = TextTalk::new(9000);
        assert_eq!(sent(&mut talk), 2);
        talk.receive_state(b"bat:80;time:3;\r\n", ms(0)).unwrap();
        assert_eq!([sent(&mut talk), sent(&mut TextTalk::new(STATE_PORT))], [1, 1]);
        talk.greet(&mut Vec::new());
        assert_eq!(sent(&mut talk), 2, "a new connection");
    }

    #[test]
    fn motors_run_while_their_count_grows_and_stand_three_seconds_after_it_did() {
        let mut talk = TextTalk::new(STATE_PORT);
        assert_eq!(talk.motors_run(), None);
        for (has_grown, at_ms, expected) in [
            (true, 2_999, Some(true)),
            (true, 3_000, Some(false)),
            (false, 2_999, None),
            (false, 3_000, Some(false)),
        ] {
            let last = ms(at_ms);
            talk.motors = Some(Motors { count_s: 7.0, since: ms(0), last, has_grown });
            assert_eq!(talk.motors_run(), expected, "{has_grown}, {at_ms} ms");
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
            let mut talk = TextTalk::new(8890);
            assert_eq!(talk.take_off_repeat_after(), Some(super::super::TAKE_OFF_TIME));
            talk.begin(DroneOrder::TakeOff, ms(0));
            talk.receive_reply(reply.as_bytes(), ms(5_000));
            assert_eq!(talk.take_off_repeat_after().is_none(), is_answered, "{reply}");
        }
    }

    #[test]
    fn a_take_off_is_over_by_its_time_or_by_an_ok_that_is_late_enough() {
        let ordered = |motors: Option<Motors>| {
            let mut talk = TextTalk::new(STATE_PORT);
            talk.begin(DroneOrder::TakeOff, ms(0));
            talk.motors = motors;
            talk
        };
        for (motors, state, over_ms) in [
            (None, "bat:90;", 12_000),
            (None, "bat:90;tof:30;", 12_000),
            (None, "bat:90;tof:31;", 8_000),
            (Some(running(7_500)), "bat:90;tof:10;", 8_000),
        ] {
            let mut talk = ordered(motors);
            talk.receive_state(state.as_bytes(), ms(7_000));
            assert!(talk.is_taking_off(ms(over_ms - 1)), "{motors:?} {state}");
            assert!(!talk.is_taking_off(ms(over_ms)), "{motors:?} {state}");
            assert!(!talk.takes_sticks(ms(over_ms - 1)), "{motors:?} {state}");
            assert!(talk.takes_sticks(ms(over_ms)), "{motors:?} {state}");
        }
        for (at_ms, heard, is_running) in
            [(2_499, Received::Connected, true), (2_500, Received::Acknowledged, false)]
        {
            let mut talk = ordered(None);
            assert_eq!(talk.receive_reply(b"ok", ms(at_ms)), Some(heard));
            assert_eq!(talk.is_taking_off(ms(at_ms)), is_running, "{at_ms} ms");
        }
        let mut landing = ordered(None);
        landing.begin(DroneOrder::Land, ms(10));
        assert!(!landing.is_taking_off(ms(10)) && landing.takes_sticks(ms(10)));
    }

    #[test]
    fn a_drone_that_was_seen_to_fly_takes_sticks_though_its_state_lines_end() {
        let mut talk = TextTalk::new(STATE_PORT);
        talk.begin(DroneOrder::TakeOff, ms(0));
        // No `ok`; the count of seconds grows until 9 s.
        for (count_s, at_ms) in [(0, 1_000), (3, 4_000), (7, 7_999), (8, 9_000)] {
            let line = format!("bat:90;time:{count_s};");
            talk.receive_state(line.as_bytes(), ms(at_ms));
            assert_eq!(talk.takes_sticks(ms(at_ms)), at_ms >= 8_000, "{at_ms} ms");
        }
        for at_ms in [9_100, 12_100, 60_000] {
            assert!(talk.takes_sticks(ms(at_ms)) && !talk.is_taking_off(ms(at_ms)), "{at_ms} ms");
        }
        assert_eq!(talk.take_off_repeat_after(), None, "it is not repeated");
    }

    #[test]
    fn after_the_longest_take_off_a_drone_takes_sticks_unless_it_says_that_it_stands() {
        for (last_ms, takes) in [(4_000, true), (9_000, true), (9_001, false), (12_000, false)] {
            let mut talk = TextTalk::new(STATE_PORT);
            talk.begin(DroneOrder::TakeOff, ms(0));
            talk.motors =
                Some(Motors { count_s: 0.0, since: ms(0), last: ms(last_ms), has_grown: false });
            assert!(!talk.takes_sticks(ms(11_999)), "{last_ms} ms");
            assert_eq!(talk.takes_sticks(ms(12_000)), takes, "{last_ms} ms");
        }
    }

    #[test]
    fn a_drone_of_unknown_motors_flies_by_an_echo_from_0_31_to_10_m() {
        let mut talk = TextTalk::new(STATE_PORT);
        for (tof_m, flies) in [(0.1, false), (0.3, false), (0.31, true), (10.0, true)] {
            talk.motors = None;
            assert_eq!(talk.flies_at(tof_m), Some(flies), "{tof_m} m");
            talk.motors = Some(running(0));
            assert_eq!(talk.flies_at(tof_m), Some(flies), "{tof_m} m");
        }
        // No echo: the motors will tell, where they are counted.
        assert_eq!(talk.flies_at(10.01), None);
        talk.motors = None;
        assert_eq!(talk.flies_at(10.01), Some(false));
        for is_high in [true, false] {
            talk.is_high = Some(is_high);
            assert_eq!(talk.flies_at(10.01), Some(is_high), "as by the newest echo");
        }
    }

    #[test]
    fn a_charge_above_100_stays_one_and_numbers_that_no_byte_holds_are_limited() {
        assert_eq!([-5.0, 99.9, 250.0, 1e9, f64::NAN].map(percent), [0, 99, 250, 255, 0]);
    }
}
