//! What a session leaves to the guardian: what it does, and what to send when it is gone.

use horizon_model::rows::Sticks;

use super::super::Protocol;
use super::super::guardian::Duty;
use super::super::protocol::{Action, HostPacket};
use super::super::text::Command;
use super::{DroneOrder, Message, Session};
use crate::clock::{TimeNs, TimeOfDay};

/// Packets that need no session: what a guardian sends.
#[derive(Debug, Clone)]
pub(in crate::tello) struct LastWords {
    /// All sticks at rest.
    pub(in crate::tello) neutral: Vec<u8>,
    /// The order to land.
    pub(in crate::tello) land: Vec<u8>,
}

/// The last words in `protocol`.
pub(in crate::tello) fn last_words(protocol: Protocol) -> LastWords {
    let u = Sticks::zeros();
    let (neutral, land) = match protocol {
        Protocol::Binary => {
            let time = TimeOfDay::default();
            let land = HostPacket::Action { action: Action::Land, sequence: u16::MAX };
            (Message::Binary(HostPacket::Sticks { u, is_fast: false, time }), Message::Binary(land))
        }
        Protocol::Text => (Message::Text(Command::Sticks(u)), Message::Text(Command::Land)),
    };
    let encoded = |message: Message| {
        let mut bytes = Vec::new();
        message.encode(&mut bytes);
        bytes
    };
    LastWords { neutral: encoded(neutral), land: encoded(land) }
}

impl Session {
    /// What the guardian has to go on with if [`Session::advance`] is not called any more: nothing in a dry
    /// run. An emergency stop counts as a landing: neutral sticks and LAND are its next step.
    pub(in crate::tello) fn duty(&self, now: TimeNs) -> Duty {
        if self.is_dry_run || !self.may_be_airborne(now) {
            Duty::Idle
        } else if self.may_steer() {
            Duty::Steering
        } else {
            Duty::Landing
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

    #[test]
    fn the_last_words_are_neutral_sticks_and_a_landing_in_either_protocol() {
        let text = last_words(Protocol::Text);
        assert_eq!((&*text.neutral, &*text.land), (&b"rc 0 0 0 0"[..], &b"land"[..]));
        let binary = last_words(Protocol::Binary);
        let neutral = HostPacket::decode(&binary.neutral).unwrap();
        assert!(
            matches!(neutral, HostPacket::Sticks { u, .. } if u == Sticks::zeros()),
            "{neutral:?}"
        );
        let land = HostPacket::decode(&binary.land).unwrap();
        assert!(matches!(land, HostPacket::Action { action: Action::Land, .. }), "{land:?}");
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
            Message::Binary(HostPacket::ConnReq { video_port: 6038 }),
            Message::Text(Command::Land),
            Message::Text(Command::EmergencyStop),
            Message::Text(Command::Enter),
        ] {
            assert!(!moves(&message), "{message:?}");
        }
    }
}
