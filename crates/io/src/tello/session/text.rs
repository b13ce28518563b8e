//! The session in the text SDK: replies without numbers, a state line without "flying".
//!
//! A reply does not state what it answers, so nothing is waited for and none is taken for more than it
//! can prove: one that is late, doubled or missing shifts nothing. Charge comes from the state line,
//! never from a reply.

use tello_flight::drone::MOTORS_REST;

use super::messages::{Message, Received, SessionProtocol};
use super::{Approved, DroneOrder};
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
pub(super) struct TextProtocol {
    /// Where the state line is to go, if not to the usual port.
    state_port: Option<u16>,
    take_off: TextTakeOff,
    motors: Option<Motors>,
    /// Whether the newest distance to the floor is that of a flying drone.
    is_high: Option<bool>,
    battery_pct: Option<u8>,
    /// Whether a state line has come since the ports were sent.
    has_state_line: bool,
}

/// Sticks that come shortly before or during a take-off make it fail.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
enum TextTakeOff {
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

impl TextTakeOff {
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

impl TextProtocol {
    pub(super) fn new(state_port: u16) -> Self {
        let state_port = (state_port != STATE_PORT).then_some(state_port);
        Self { state_port, ..Self::default() }
    }

    /// Whether a take-off was ordered that may not be over.
    fn is_taking_off(&self, now: TimeNs) -> bool {
        match self.take_off {
            TextTakeOff::None | TextTakeOff::Over => false,
            TextTakeOff::Ordered { at, .. } if self.is_flying() == Some(true) => {
                now.since(at) < TAKE_OFF_TYPICAL
            }
            TextTakeOff::Ordered { at, .. } => now.since(at) < TAKE_OFF_MAX,
        }
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

impl SessionProtocol for TextProtocol {
    fn request_connection(&mut self, outbox: &mut Vec<Message>) {
        outbox.push(Message::Text(Command::Enter));
    }

    /// Sends the state line where it is listened for. The drone may have been started anew.
    fn on_connected(&mut self, outbox: &mut Vec<Message>) {
        self.has_state_line = false;
        if let Some(state) = self.state_port {
            outbox.push(Message::Text(Command::Ports { state, video: VIDEO_PORT }));
        }
    }

    /// A question that every firmware answers and whose answer cannot be taken for an `ok`: state lines
    /// may arrive while the link to the drone is dead, answers do not. The ports may have been lost if no state line
    /// came.
    fn send_periodic_requests(&mut self, outbox: &mut Vec<Message>) {
        if !self.has_state_line {
            self.on_connected(outbox);
        }
        outbox.push(Message::Text(Command::Query(Query::Battery)));
    }

    fn begin(&mut self, order: DroneOrder, now: TimeNs) {
        self.take_off = match order {
            DroneOrder::TakeOff => TextTakeOff::Ordered { at: now, is_refused: false },
            DroneOrder::Land | DroneOrder::EmergencyStop => TextTakeOff::Over,
        };
    }

    /// An order to take off that was not answered may be lost. One that was is never repeated.
    fn take_off_repeat_after(&self) -> Option<SpanNs> {
        let is_answered = matches!(
            self.take_off,
            TextTakeOff::Over | TextTakeOff::Ordered { is_refused: true, .. }
        );
        (!is_answered).then_some(super::TAKE_OFF_TIME)
    }

    fn steer(&mut self, approved: Approved, _now: TimeNs, outbox: &mut Vec<Message>) {
        outbox.push(Message::Text(Command::Sticks(approved.sticks())));
    }

    fn order(&mut self, order: DroneOrder, outbox: &mut Vec<Message>) {
        outbox.push(Message::Text(match order {
            DroneOrder::TakeOff => Command::TakeOff,
            DroneOrder::Land => Command::Land,
            DroneOrder::EmergencyStop => Command::EmergencyStop,
        }));
    }

    fn may_request(&self, now: TimeNs) -> bool {
        !self.is_taking_off(now)
    }

    /// Not while a take-off is running, nor before one: a standing drone ignores them, and the
    /// take-off that follows is refused.
    fn takes_sticks(&self, now: TimeNs) -> bool {
        match self.take_off {
            TextTakeOff::None => self.motors_run() == Some(true),
            TextTakeOff::Ordered { .. } => {
                let is_silent =
                    self.motors.is_some_and(|motors| now.since(motors.last) >= MOTORS_REST);
                !self.is_taking_off(now) && (self.motors_run() != Some(false) || is_silent)
            }
            TextTakeOff::Over => true,
        }
    }

    fn receive(
        &mut self,
        datagram: &[u8],
        now: TimeNs,
        _outbox: &mut Vec<Message>,
    ) -> Option<Received> {
        let ordered_for = match self.take_off {
            TextTakeOff::Ordered { at, .. } => Some(now.since(at)),
            TextTakeOff::None | TextTakeOff::Over => None,
        };
        Some(match (Reply::decode(datagram)?, ordered_for) {
            (Reply::Done, Some(so_long)) if so_long >= TAKE_OFF_MIN => {
                self.take_off = TextTakeOff::Over;
                Received::Acknowledged
            }
            (Reply::Done, _) => Received::Connected,
            // It may refuse a doubled take-off while the first is running: the motors decide.
            (Reply::Refused, _) => {
                if let TextTakeOff::Ordered { is_refused, .. } = &mut self.take_off {
                    *is_refused = true;
                }
                Received::Refused
            }
            (Reply::Value, _) => Received::OtherPacket,
        })
    }

    /// A status needs a charge and a sign of the motors; a line without them is a sign of life.
    fn receive_state(&mut self, datagram: &[u8], now: TimeNs) -> Option<Received> {
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
            return Some(Received::OtherPacket);
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
mod tests;
