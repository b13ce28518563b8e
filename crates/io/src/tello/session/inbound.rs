//! What the drone sends, and what it changes: the link, and the word of one of the two witnesses.

use std::sync::atomic::Ordering;

use super::talk::Heard;
use super::{Flight, Link, PING_PERIOD, Session};
use crate::clock::TimeNs;
use crate::tello::{DroneStatus, Protocol};

impl Session {
    /// Takes a datagram of the drone's command port; its status, if it is one.
    pub fn receive(&mut self, datagram: &[u8], now: TimeNs) -> Option<DroneStatus> {
        let answered_from = self.outbox.len();
        let heard = self.talk.hear(datagram, now, &mut self.outbox);
        let is_ending = matches!(self.flight, Flight::Landing { .. } | Flight::EmergencyStop(_));
        if is_ending && !self.is_dry_run {
            // The drone asks again; an answer between two landings might cancel the first.
            self.outbox.truncate(answered_from);
        }
        self.take(heard, now)
    }

    /// Takes a state line of the text SDK, which comes to a port of its own.
    pub fn receive_state(&mut self, datagram: &[u8], now: TimeNs) -> Option<DroneStatus> {
        let heard = self.talk.hear_state(datagram, now);
        self.take(heard, now)
    }

    fn take(&mut self, heard: Option<Heard>, now: TimeNs) -> Option<DroneStatus> {
        let Some(heard) = heard else {
            self.counters.malformed.count();
            return None;
        };
        self.counters.packets.count();
        if let Link::Connected { heard_at, .. } = &mut self.link {
            *heard_at = now;
        }
        match heard {
            Heard::Life => {}
            Heard::Connected => self.connect(now),
            Heard::Acknowledged => self.counters.acks.count(),
            Heard::Refused => self.counters.refusals.count(),
            Heard::Fact(answer) => self.counters.note(answer),
            Heard::Status(status) => {
                self.witnesses.hear_status(&status, self.may_have_flown, now);
                self.may_have_flown |= status.is_flying;
                // A drone that reports to us in the binary protocol knows us, should every
                // acknowledgement be lost. State lines come in SDK mode only: it outlived the silence.
                if self.was_connected || self.talk.protocol() == Protocol::Binary {
                    self.connect(now);
                }
                self.note_rest(now);
                // A dry run plans as if its sticks were sent.
                let takes_sticks = status.takes_sticks || self.is_dry_run;
                return Some(DroneStatus { takes_sticks, ..status });
            }
        }
        None
    }

    fn connect(&mut self, now: TimeNs) {
        if matches!(self.link, Link::Asking { .. }) {
            self.link = Link::Connected { heard_at: now, ping_at: now.after(PING_PERIOD) };
            self.counters.is_connected.store(true, Ordering::Relaxed);
            if self.may_ask(now) && self.may_steer() {
                self.talk.greet(&mut self.outbox);
            }
        }
        self.was_connected = true;
    }
}
