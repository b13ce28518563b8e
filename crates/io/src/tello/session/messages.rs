//! Decisions of the session as messages of a protocol, and the meaning of the drone's datagrams.
//!
//! Owns [`Message`] and [`Received`], the two sides of that translation. The protocols are `binary` and
//! `text`; the session decides when something is sent.

use std::fmt::Debug;

use super::{Approved, DroneOrder};
use crate::clock::{SpanNs, TimeNs};
use crate::tello::DroneStatus;
use crate::tello::protocol::{Answer, HostPacket};
use crate::tello::text::Command;

/// A datagram to send.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Message {
    /// In the binary protocol.
    Binary(HostPacket),
    /// In the text SDK.
    Text(Command),
}

impl Message {
    /// Writes the datagram over the content of `to`.
    pub fn encode(&self, to: &mut Vec<u8>) {
        match self {
            Self::Binary(packet) => packet.encode(to),
            Self::Text(command) => command.encode(to),
        }
    }
}

/// Meaning of a datagram of the drone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Received {
    /// A packet that shows only that the drone is there.
    OtherPacket,
    /// The request for a connection is answered.
    Connected,
    /// The newest action is answered.
    Acknowledged,
    /// An action, or something else, is refused.
    Refused,
    /// The answer to a request for a value.
    Answer(Answer),
    /// The status of the drone.
    Status(DroneStatus),
}

/// Messages and meanings of one of the two protocols.
pub(super) trait SessionProtocol: Debug + Send {
    /// Requests a connection.
    fn request_connection(&mut self, outbox: &mut Vec<Message>);

    /// Sends the requests that are repeated every two seconds, on the ground and in the air.
    fn send_periodic_requests(&mut self, outbox: &mut Vec<Message>);

    /// Sends the first messages of a new connection.
    fn on_connected(&mut self, outbox: &mut Vec<Message>);

    /// Sends sticks.
    fn steer(&mut self, approved: Approved, now: TimeNs, outbox: &mut Vec<Message>);

    /// Begins an order that is answered: what is sent from here on until the next one is its copies.
    fn begin(&mut self, order: DroneOrder, now: TimeNs);

    /// One copy of an order.
    fn order(&mut self, order: DroneOrder, outbox: &mut Vec<Message>);

    /// Whether sticks may be sent now.
    fn takes_sticks(&self, _now: TimeNs) -> bool {
        true
    }

    /// Whether a request may be sent now.
    fn may_request(&self, _now: TimeNs) -> bool {
        true
    }

    /// After which time an order to take off may be repeated to a drone that reports that it stands; `None`: never.
    fn take_off_repeat_after(&self) -> Option<SpanNs>;

    /// Takes a datagram of the command port; `None` if it is not understood.
    fn receive(
        &mut self,
        datagram: &[u8],
        now: TimeNs,
        outbox: &mut Vec<Message>,
    ) -> Option<Received>;

    /// Takes a datagram of the state port, which only the text SDK has; `None` if it is not understood.
    fn receive_state(&mut self, _datagram: &[u8], _now: TimeNs) -> Option<Received> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::super::binary::BinaryProtocol;
    use super::super::tests::ms;
    use super::super::text::TextProtocol;
    use super::*;

    fn both() -> [Box<dyn SessionProtocol>; 2] {
        [Box::new(BinaryProtocol::new(0, None)), Box::new(TextProtocol::new(8890))]
    }

    #[test]
    fn each_order_is_the_command_of_its_name_in_the_text_sdk() {
        let [_, mut text] = both();
        for (order, command) in [
            (DroneOrder::TakeOff, Command::TakeOff),
            (DroneOrder::Land, Command::Land),
            (DroneOrder::EmergencyStop, Command::EmergencyStop),
        ] {
            let mut outbox = Vec::new();
            text.order(order, &mut outbox);
            assert_eq!(outbox, [Message::Text(command)]);
        }
    }

    #[test]
    fn a_take_off_holds_sticks_and_questions_back_in_the_text_sdk_only() {
        let [mut binary, mut text] = both();
        assert_eq!([binary.takes_sticks(ms(0)), text.takes_sticks(ms(0))], [true, false]);
        assert!(binary.may_request(ms(0)) && text.may_request(ms(0)));
        for protocol in [&mut binary, &mut text] {
            protocol.begin(DroneOrder::TakeOff, ms(0));
        }
        assert_eq!([binary.takes_sticks(ms(1)), text.takes_sticks(ms(1))], [true, false]);
        assert_eq!([binary.may_request(ms(1)), text.may_request(ms(1))], [true, false]);
    }

    #[test]
    fn a_state_line_means_something_in_the_text_sdk_only() {
        let heard =
            both().map(|mut protocol| protocol.receive_state(b"tof:10;bat:80;", ms(0)).is_some());
        assert_eq!(heard, [false, true]);
    }
}
