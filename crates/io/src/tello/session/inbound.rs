//! Messages of the drone, and what they change: the link, and the report of one of the two sources.

use std::sync::atomic::Ordering;

use super::messages::Received;
use super::{Connection, REQUEST_PERIOD, Session, SessionPhase};
use crate::clock::TimeNs;
use crate::tello::DroneStatus;

impl Session {
    /// Takes a datagram that came from the drone's command port at `now`; its status, if it is one. One that makes no
    /// sense is counted as malformed. What is to be answered waits in [`Session::drain`], unless a landing or an
    /// emergency stop goes on: then nothing is answered. Cost: linear in the datagram; allocates only if the outbox
    /// grows, and for a refusal.
    pub fn receive(&mut self, datagram: &[u8], now: TimeNs) -> Option<DroneStatus> {
        let answered_from = self.outbox.len();
        let heard = self.protocol.receive(datagram, now, &mut self.outbox);
        if heard == Some(Received::Refused) {
            self.counters.note_refusal(datagram);
        }
        let is_ending =
            matches!(self.phase, SessionPhase::Landing { .. } | SessionPhase::EmergencyStop(_));
        if is_ending && !self.is_dry_run {
            // The drone asks again; an answer between two landings might cancel the first.
            self.outbox.truncate(answered_from);
        }
        self.take(heard, now)
    }

    /// Takes a state line of the text SDK, which came to a port of its own at `now`; its status, if the line has a
    /// charge and it is known whether the motors run. One that makes no sense is counted as malformed.
    pub(crate) fn receive_state(&mut self, datagram: &[u8], now: TimeNs) -> Option<DroneStatus> {
        let heard = self.protocol.receive_state(datagram, now);
        self.take(heard, now)
    }

    fn take(&mut self, heard: Option<Received>, now: TimeNs) -> Option<DroneStatus> {
        let Some(heard) = heard else {
            self.counters.malformed.count();
            return None;
        };
        self.counters.packets.count();
        if let Connection::Connected { heard_at, .. } = &mut self.link {
            *heard_at = now;
        }
        match heard {
            // The words of a refusal are noted where they are read.
            Received::OtherPacket | Received::Refused => {}
            Received::Connected => self.connect(now),
            Received::Acknowledged => self.counters.acks.count(),
            Received::Answer(answer) => self.counters.note(answer),
            Received::Status(status) => {
                self.sources.receive_status(&status, self.may_have_flown, now);
                self.may_have_flown |= status.is_flying;
                // A drone that reports knows us, should every answer be lost, or go to another port: state lines of
                // the text SDK come in SDK mode only, in which it takes sticks.
                self.connect(now);
                self.advance_touchdown(now);
                // A dry run plans as if its sticks were sent.
                let takes_sticks = status.takes_sticks || self.is_dry_run;
                return Some(DroneStatus { takes_sticks, ..status });
            }
        }
        None
    }

    fn connect(&mut self, now: TimeNs) {
        if matches!(self.link, Connection::Disconnected { .. }) {
            self.link =
                Connection::Connected { heard_at: now, request_at: now.after(REQUEST_PERIOD) };
            self.counters.is_connected.store(true, Ordering::Relaxed);
            if self.may_request(now) && self.may_steer() {
                self.protocol.on_connected(&mut self.outbox);
            }
        }
        self.was_connected = true;
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::tests::{ms, status};
    use super::*;
    use crate::tello::LinkCounters;

    const STANDS: &[u8] = b"tof:10;bat:80;";

    fn binary() -> Session {
        Session::binary(0, None, false, Arc::new(LinkCounters::default()))
    }

    #[test]
    fn bytes_that_mean_nothing_are_counted_and_are_no_sign_of_life() {
        let mut session = binary();
        let link = Connection::Connected { heard_at: ms(0), request_at: ms(9_000) };
        session.link = link;
        assert_eq!(session.receive(b"noise", ms(50)), None);
        assert_eq!((session.counters.malformed.get(), session.counters.packets.get()), (1, 0));
        assert_eq!(session.link, link);
        assert!(session.receive(&status(false), ms(60)).is_some());
        assert_eq!((session.counters.malformed.get(), session.counters.packets.get()), (1, 1));
        assert_eq!(session.link, Connection::Connected { heard_at: ms(60), request_at: ms(9_000) });
    }

    #[test]
    fn a_refusal_is_counted_with_its_words() {
        let mut text = Session::text(8890, false, Arc::new(LinkCounters::default()));
        assert_eq!(text.counters.refusal(), None);
        text.receive(b"error Motor stop\r\n", ms(0));
        text.receive(b"ok", ms(10));
        assert_eq!(text.counters.refusal().as_deref(), Some("error Motor stop"));
        text.receive(format!("error {}", "x".repeat(200)).as_bytes(), ms(20));
        assert_eq!(text.counters.refusal().map(|words| words.len()), Some(80));
        assert_eq!(text.counters.refusals.get(), 2);
    }

    #[test]
    fn a_status_connects_and_so_does_a_state_line() {
        let mut session = binary();
        session.receive(&status(false), ms(0));
        assert!(session.was_connected && matches!(session.link, Connection::Connected { .. }));
        let mut text = Session::text(8890, false, Arc::new(LinkCounters::default()));
        assert!(text.receive_state(STANDS, ms(0)).is_some());
        assert!(text.was_connected && matches!(text.link, Connection::Connected { .. }));
    }

    #[test]
    fn a_drone_that_flies_has_flown_and_one_that_stands_has_not() {
        for is_flying in [false, true] {
            let mut session = binary();
            session.receive(&status(is_flying), ms(0));
            assert_eq!(session.may_have_flown, is_flying);
            session.receive(&status(false), ms(100));
            assert_eq!(session.may_have_flown, is_flying, "it stays so");
        }
    }

    #[test]
    fn a_dry_run_takes_sticks_that_a_standing_drone_would_not() {
        for is_dry_run in [false, true] {
            let mut text = Session::text(8890, is_dry_run, Arc::new(LinkCounters::default()));
            let status = text.receive_state(STANDS, ms(0)).unwrap();
            assert_eq!(status.takes_sticks, is_dry_run);
        }
    }
}
