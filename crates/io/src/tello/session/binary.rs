//! The session in the binary protocol: sequence numbers, the drone's questions, its settings.

use super::messages::{Message, Received, SessionProtocol};
use super::{Approved, DroneOrder};
use crate::clock::{CivilTime, SpanNs, TimeNs};
use crate::tello::protocol::{
    Action, DronePacket, HostPacket, PacketError, Query, Setting, VIDEO_PORT,
};
use crate::tello::{DroneStatus, status_from_binary};

/// Time after which a take-off without an answer is repeated. The flag "flying" shows one that arrived within about
/// 1 s.
const TAKE_OFF_REPEAT_AFTER: SpanNs = SpanNs::from_ms(2500);

/// How often the drone is asked for what it does not answer: two of a hundred answers never come.
const ASKED_MAX: u8 = 3;

/// Age up to which a heading is one of the status that arrives: both come ten times a second.
const HEADING_AGE_MAX: SpanNs = SpanNs::from_ms(300);

/// Numbers and open questions.
#[derive(Debug)]
pub(super) struct BinaryProtocol {
    /// The wall clock at time zero. ns since 1970
    utc_start_ns: i64,
    /// Highest altitude that the drone has yet to confirm. m
    altitude_limit_m: Option<u16>,
    /// Queries to be sent, until they are answered.
    queries: [Option<Query>; Query::ALL.len()],
    /// How often it was asked.
    asked: u8,
    /// Number of the newest action or setting.
    sequence: u16,
    /// The newest action and its number, until acknowledged.
    unacknowledged: Option<(Action, u16)>,
    /// The newest heading of the drone's log, counter-clockwise from above (rad), and when it arrived.
    heading: Option<(f64, TimeNs)>,
}

impl BinaryProtocol {
    pub(super) fn new(utc_start_ns: i64, altitude_limit_m: Option<u16>) -> Self {
        Self {
            utc_start_ns,
            altitude_limit_m,
            queries: Query::ALL.map(Some),
            asked: 0,
            sequence: 0,
            unacknowledged: None,
            heading: None,
        }
    }

    /// The number of what is sent next.
    fn next_number(&mut self) {
        self.sequence = self.sequence.wrapping_add(1);
    }

    /// Date and time at `now`, UTC: the drone puts it into its own log only.
    fn civil(&self, now: TimeNs) -> CivilTime {
        CivilTime::from_unix_ns(self.utc_start_ns.saturating_add(now.0))
    }
}

impl SessionProtocol for BinaryProtocol {
    fn request_connection(&mut self, outbox: &mut Vec<Message>) {
        outbox.push(Message::Binary(HostPacket::ConnReq { video_port: VIDEO_PORT }));
    }

    /// Sends the settings until the drone has confirmed them, and queries the missing values.
    fn send_periodic_requests(&mut self, outbox: &mut Vec<Message>) {
        if let Some(limit_m) = self.altitude_limit_m {
            self.next_number();
            let sequence = self.sequence;
            outbox.push(Message::Binary(HostPacket::AltitudeLimit { sequence, limit_m }));
        }
        if self.asked < ASKED_MAX {
            self.asked += 1;
            // Answers are distinguished by their ids; the numbers of orders and settings are left alone.
            let sequence = u16::from(self.asked);
            for query in self.queries.into_iter().flatten() {
                outbox.push(Message::Binary(HostPacket::Query { sequence, query }));
            }
        }
    }

    fn on_connected(&mut self, outbox: &mut Vec<Message>) {
        self.send_periodic_requests(outbox);
    }

    fn steer(&mut self, approved: Approved, now: TimeNs, outbox: &mut Vec<Message>) {
        let (u, time) = (approved.sticks(), self.civil(now).time);
        outbox.push(Message::Binary(HostPacket::Sticks { u, is_fast: false, time }));
    }

    fn begin(&mut self, _order: DroneOrder, _now: TimeNs) {
        self.next_number();
    }

    fn order(&mut self, order: DroneOrder, outbox: &mut Vec<Message>) {
        let action = match order {
            DroneOrder::TakeOff => Action::TakeOff,
            DroneOrder::Land => Action::Land,
            DroneOrder::EmergencyStop => {
                return outbox.push(Message::Binary(HostPacket::EmergencyStop));
            }
        };
        let sequence = self.sequence;
        self.unacknowledged = Some((action, sequence));
        outbox.push(Message::Binary(HostPacket::Action { action, sequence }));
    }

    /// An order to take off that was not acknowledged may be lost. One that was is never repeated: somebody may have
    /// the drone in the hand since.
    fn take_off_repeat_after(&self) -> Option<SpanNs> {
        let is_lost = matches!(self.unacknowledged, Some((Action::TakeOff, _)));
        is_lost.then_some(TAKE_OFF_REPEAT_AFTER)
    }

    fn receive(
        &mut self,
        datagram: &[u8],
        now: TimeNs,
        outbox: &mut Vec<Message>,
    ) -> Option<Received> {
        let packet = match DronePacket::decode(datagram) {
            Ok(packet) => packet,
            Err(PacketError::Unread { .. }) => return Some(Received::OtherPacket),
            Err(_) => return None,
        };
        Some(match packet {
            DronePacket::ConnAck { .. } => Received::Connected,
            DronePacket::DateTimeRequest { sequence } => {
                let time = self.civil(now);
                outbox.push(Message::Binary(HostPacket::DateTime { sequence, time }));
                Received::OtherPacket
            }
            DronePacket::LogHeader { sequence, header_id } => {
                outbox.push(Message::Binary(HostPacket::LogHeaderAck { sequence, header_id }));
                Received::OtherPacket
            }
            DronePacket::Ack { action, sequence } => {
                if self.unacknowledged == Some((action, sequence)) {
                    self.unacknowledged = None;
                    Received::Acknowledged
                } else {
                    Received::OtherPacket
                }
            }
            DronePacket::Answer { answer, .. } => {
                for query in &mut self.queries {
                    *query = query.filter(|query| *query != answer.query());
                }
                Received::Answer(answer)
            }
            DronePacket::SettingAck { setting: Setting::AltitudeLimit, .. } => {
                self.altitude_limit_m = None;
                Received::OtherPacket
            }
            DronePacket::Status { status, .. } => {
                let is_fresh = |(_, at): &(f64, TimeNs)| now.since(*at) <= HEADING_AGE_MAX;
                let heading_rad = self.heading.filter(is_fresh).map(|(heading_rad, _)| heading_rad);
                Received::Status(DroneStatus { heading_rad, ..status_from_binary(&status, now) })
            }
            DronePacket::LogData { yaw_rad, .. } => {
                self.heading = Some((-yaw_rad, now));
                Received::OtherPacket
            }
            DronePacket::WifiStrength { .. } => Received::OtherPacket,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{bytes, ms};
    use super::*;
    use crate::tello::protocol::FlightStatus;

    fn receive(protocol: &mut BinaryProtocol, packet: DronePacket) -> Option<Received> {
        receive_at(protocol, 0, packet)
    }

    fn receive_at(
        protocol: &mut BinaryProtocol,
        now_ms: i64,
        packet: DronePacket,
    ) -> Option<Received> {
        protocol.receive(&bytes(packet), ms(now_ms), &mut Vec::new())
    }

    #[test]
    fn numbers_begin_again_after_the_largest() {
        let mut protocol = BinaryProtocol::new(0, None);
        protocol.sequence = u16::MAX;
        protocol.begin(DroneOrder::Land, ms(0));
        assert_eq!(protocol.sequence, 0);
    }

    #[test]
    fn only_the_newest_action_is_acknowledged_and_only_once() {
        let mut protocol = BinaryProtocol::new(0, None);
        protocol.sequence = 7;
        protocol.order(DroneOrder::Land, &mut Vec::new());
        let ack = |action, sequence| DronePacket::Ack { action, sequence };
        for (packet, expected) in [
            (ack(Action::Land, 6), Received::OtherPacket),
            (ack(Action::TakeOff, 7), Received::OtherPacket),
            (ack(Action::Land, 7), Received::Acknowledged),
            (ack(Action::Land, 7), Received::OtherPacket),
        ] {
            assert_eq!(receive(&mut protocol, packet), Some(expected), "{packet:?}");
        }
    }

    #[test]
    fn only_a_take_off_that_was_not_acknowledged_may_be_lost() {
        let mut protocol = BinaryProtocol::new(0, None);
        assert_eq!(protocol.take_off_repeat_after(), None);
        protocol.order(DroneOrder::TakeOff, &mut Vec::new());
        assert_eq!(protocol.take_off_repeat_after(), Some(TAKE_OFF_REPEAT_AFTER));
        receive(&mut protocol, DronePacket::Ack { action: Action::TakeOff, sequence: 0 });
        assert_eq!(protocol.take_off_repeat_after(), None);
        protocol.order(DroneOrder::Land, &mut Vec::new());
        assert_eq!(protocol.take_off_repeat_after(), None);
    }

    #[test]
    fn a_status_has_the_heading_of_the_log_counter_clockwise_while_it_is_fresh() {
        let mut protocol = BinaryProtocol::new(0, None);
        let status = DronePacket::Status { sequence: 1, status: FlightStatus::new(true) };
        let heading =
            |protocol: &mut BinaryProtocol, now_ms| match receive_at(protocol, now_ms, status) {
                Some(Received::Status(status)) => status.heading_rad,
                heard => panic!("{heard:?}"),
            };
        assert_eq!(heading(&mut protocol, 0), None, "no log");
        let log = DronePacket::LogData { sequence: 2, tick: 77, yaw_rad: 0.5 };
        assert_eq!(receive_at(&mut protocol, 100, log), Some(Received::OtherPacket));
        let near = |got: Option<f64>| got.is_some_and(|got| (got + 0.5).abs() < 1e-6);
        assert!(near(heading(&mut protocol, 100)) && near(heading(&mut protocol, 400)));
        assert_eq!(heading(&mut protocol, 401), None, "an old one");
    }

    #[test]
    fn noise_is_not_understood_and_an_emergency_stop_has_no_number() {
        let mut protocol = BinaryProtocol::new(0, None);
        assert_eq!(protocol.receive(b"noise", ms(0), &mut Vec::new()), None);
        let mut outbox = Vec::new();
        protocol.order(DroneOrder::EmergencyStop, &mut outbox);
        assert_eq!(outbox, [Message::Binary(HostPacket::EmergencyStop)]);
        assert_eq!(protocol.unacknowledged, None);
    }
}
