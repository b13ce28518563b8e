//! What a session leaves to the watchdog: by when it will have spoken, and what to send if it has not.

use tello_model::rows::Sticks;

use super::super::Protocol;
use super::super::protocol::{Action, HostPacket};
use super::super::text::Command;
use super::super::watchdog::LastWords;
use super::{Message, Session};
use crate::clock::{TimeNs, TimeOfDay};

impl Session {
    /// By when [`Session::advance`] must be called for the sake of a drone that may be in the air;
    /// `None` if there is none. A cut counts too: neutral sticks and a landing are its next rung.
    pub(in crate::tello) fn promise(&self, now: TimeNs) -> Option<TimeNs> {
        let is_guarded = !self.is_dry_run && self.may_be_airborne(now);
        is_guarded.then(|| self.next_deadline().max(now))
    }

    /// Packets for a time when there is no session any more.
    pub(in crate::tello) fn last_words(&self) -> LastWords {
        let (neutral, land) = match self.talk.protocol() {
            Protocol::Binary => {
                let (u, time) = (Sticks::zeros(), TimeOfDay::default());
                let land = HostPacket::Action { action: Action::Land, sequence: u16::MAX };
                (
                    Message::Binary(HostPacket::Sticks { u, is_fast: false, time }),
                    Message::Binary(land),
                )
            }
            Protocol::Text => {
                (Message::Text(Command::Sticks(Sticks::zeros())), Message::Text(Command::Land))
            }
        };
        let encoded = |message: Message| {
            let mut bytes = Vec::new();
            message.encode(&mut bytes);
            bytes
        };
        LastWords { neutral: encoded(neutral), land: encoded(land) }
    }
}
