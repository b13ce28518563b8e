//! Hand-over of a session to the guardian: the state of its sender, and the packets that land the drone.

use horizon_model::rows::Sticks;

use super::super::Protocol;
use super::super::guardian::SenderState;
use super::super::protocol::{Action, HostPacket};
use super::super::text::Command;
use super::{DroneOrder, Message, Session};
use crate::clock::{TimeNs, TimeOfDay};

/// Packets that a guardian sends without a session: neutral sticks and the order to land, in `protocol`.
///
/// `landings` counts the orders before. Each has a number of its own, from the largest downwards: a drone may take a
/// known number for a copy of a landing that the neutral sticks have just cancelled.
pub(in crate::tello) fn landing_packets(protocol: Protocol, landings: u32) -> [Vec<u8>; 2] {
    let u = Sticks::zeros();
    let messages = match protocol {
        Protocol::Binary => {
            let time = TimeOfDay::default();
            // At most 60 within 15 s.
            let sequence = u16::try_from(landings).map_or(0, |landings| u16::MAX - landings);
            let land = HostPacket::Action { action: Action::Land, sequence };
            [HostPacket::Sticks { u, is_fast: false, time }, land].map(Message::Binary)
        }
        Protocol::Text => [Command::Sticks(u), Command::Land].map(Message::Text),
    };
    messages.map(|message| {
        let mut bytes = Vec::new();
        message.encode(&mut bytes);
        bytes
    })
}

impl Session {
    /// State by which the guardian decides if [`Session::advance`] is not called any more: `Idle` in a dry run. An
    /// emergency stop counts as a landing: neutral sticks and LAND are its next step.
    pub(in crate::tello) fn sender_state(&self, now: TimeNs) -> SenderState {
        if self.is_dry_run || !self.may_be_airborne(now) {
            SenderState::Idle
        } else if self.may_steer() {
            SenderState::Steering
        } else {
            SenderState::Landing
        }
    }

    /// Goes on with a landing that the guardian has ordered. Sticks and take-offs that wait to be sent are dropped.
    pub(in crate::tello) fn adopt_landing(&mut self, now: TimeNs) {
        if self.may_steer() {
            self.outbox.retain(|message| !moves(message));
            self.order(DroneOrder::Land, now);
        }
    }
}

/// Whether a message would cancel a landing, or end it in the air.
fn moves(message: &Message) -> bool {
    matches!(
        message,
        Message::Binary(
            HostPacket::Sticks { .. } | HostPacket::Action { action: Action::TakeOff, .. }
        ) | Message::Text(Command::Sticks(_) | Command::TakeOff)
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tello::protocol::VIDEO_PORT;

    #[test]
    fn the_landing_packets_are_neutral_sticks_and_a_landing_in_either_protocol() {
        assert_eq!(landing_packets(Protocol::Text, 0), [&b"rc 0 0 0 0"[..], &b"land"[..]]);
        for (landings, expected) in [(0, u16::MAX), (1, u16::MAX - 1), (59, u16::MAX - 59)] {
            let packets = landing_packets(Protocol::Binary, landings);
            let [neutral, land] = packets.map(|bytes| HostPacket::decode(&bytes).unwrap());
            assert!(matches!(neutral, HostPacket::Sticks { u, .. } if u == Sticks::zeros()));
            assert_eq!(land, HostPacket::Action { action: Action::Land, sequence: expected });
        }
    }

    #[test]
    fn sticks_and_take_offs_move_the_drone_and_nothing_else_does() {
        let (u, sequence) = (Sticks::zeros(), 1);
        let time = TimeOfDay::default();
        for message in [
            Message::Binary(HostPacket::Sticks { u, is_fast: false, time }),
            Message::Binary(HostPacket::Action { action: Action::TakeOff, sequence }),
            Message::Text(Command::Sticks(u)),
            Message::Text(Command::TakeOff),
        ] {
            assert!(moves(&message), "{message:?}");
        }
        for message in [
            Message::Binary(HostPacket::Action { action: Action::Land, sequence }),
            Message::Binary(HostPacket::EmergencyStop),
            Message::Binary(HostPacket::ConnReq { video_port: VIDEO_PORT }),
            Message::Text(Command::Land),
            Message::Text(Command::EmergencyStop),
            Message::Text(Command::Enter),
        ] {
            assert!(!moves(&message), "{message:?}");
        }
    }
}
