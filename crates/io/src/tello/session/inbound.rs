//! What the drone says, and what it changes: the link, and the ends of landings and cuts.

use std::sync::atomic::Ordering;

use super::talk::Heard;
use super::{CUT_REST, Flight, Link, PING_PERIOD, Session};
use crate::clock::TimeNs;
use crate::tello::{DroneStatus, Protocol};

impl Session {
    /// Takes a datagram of the drone's command port; its status, if it is one.
    pub fn receive(&mut self, datagram: &[u8], now: TimeNs) -> Option<DroneStatus> {
        let heard = self.talk.hear(datagram, now, &mut self.outbox);
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
                self.is_flying = Some(status.is_flying);
                // State lines come in SDK mode only: it outlived the silence.
                if self.was_connected && self.talk.protocol() == Protocol::Text {
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

    /// Ends a landing or a cut when the drone's newest status says that it is over.
    fn note_rest(&mut self, now: TimeNs) {
        let is_airborne = self.may_be_airborne(now);
        self.flight = match self.flight {
            Flight::Landing { .. } if !is_airborne => Flight::Landed,
            Flight::Cutting { again_at, at_rest_since } => {
                let at_rest_since = (!is_airborne).then(|| at_rest_since.unwrap_or(now));
                if at_rest_since.is_some_and(|since| now.since(since) >= CUT_REST) {
                    Flight::Cut
                } else {
                    Flight::Cutting { again_at, at_rest_since }
                }
            }
            flight => flight,
        };
    }
}
