//! What a decision puts on the wire: sticks, a landing with its neutral sticks, the emergency-stop sequence.

use super::down_detection::Rest;
use super::{
    Approved, CONNECT_PERIOD, Connection, DroneOrder, EMERGENCY_COPIES, EMERGENCY_LAND_AFTER,
    EMERGENCY_PERIOD, EmergencyStop, Session, SessionPhase,
};
use crate::clock::TimeNs;

impl Session {
    /// Sends sticks, if the drone has answered or reported and takes them now; never in a dry run.
    pub(super) fn send_sticks(&mut self, approved: Approved, now: TimeNs) {
        if self.was_connected && !self.is_dry_run && self.protocol.takes_sticks(now) {
            self.may_have_flown |= approved != Approved::neutral();
            self.counters.sticks.count();
            self.protocol.steer(approved, now, &mut self.outbox);
        }
    }

    /// Sends one copy of an order; never in a dry run.
    pub(super) fn send(&mut self, order: DroneOrder) {
        if !self.is_dry_run {
            self.counters.orders.count();
            self.protocol.order(order, &mut self.outbox);
        }
    }

    /// LAND, and neutral sticks directly before it if `has_neutral`. A request for a connection that is overdue goes
    /// before both, so that nothing stands between them: a drone that has restarted ignores LAND without one.
    pub(super) fn send_landing(&mut self, has_neutral: bool, now: TimeNs) {
        if let Connection::Disconnected { again_at, is_overdue: is_overdue @ true } = &mut self.link
        {
            (*again_at, *is_overdue) = (now.after(CONNECT_PERIOD), false);
            self.protocol.request_connection(&mut self.outbox);
        }
        if has_neutral {
            self.send_neutral(now);
        }
        // With a number of its own: a drone may take a known number for a copy of a landing that the
        // neutral sticks have just cancelled.
        self.protocol.begin(DroneOrder::Land, now);
        self.send(DroneOrder::Land);
    }

    /// Neutral sticks, whether the drone has acknowledged anything or not.
    fn send_neutral(&mut self, now: TimeNs) {
        if !self.is_dry_run {
            self.protocol.steer(Approved::neutral(), now, &mut self.outbox);
        }
    }

    /// Begins the emergency-stop sequence.
    pub(super) fn emergency_stop(&mut self, now: TimeNs) {
        let again_at = now.after(EMERGENCY_PERIOD);
        let stop = EmergencyStop { since: now, again_at, at_rest: None, is_landing_next: true };
        self.phase = SessionPhase::EmergencyStop(stop);
        self.send_neutral(now);
        self.protocol.begin(DroneOrder::EmergencyStop, now);
        for _ in 0..EMERGENCY_COPIES {
            self.send(DroneOrder::EmergencyStop);
        }
    }

    /// The next step of the emergency-stop sequence: an emergency stop, or a landing in its turn if the emergency stop
    /// seems to have no effect.
    pub(super) fn continue_emergency_stop(&mut self, stop: EmergencyStop, now: TimeNs) {
        let is_obeyed = stop.at_rest.is_some_and(Rest::is_agreed);
        let is_landing_due = stop.is_landing_next && now.since(stop.since) >= EMERGENCY_LAND_AFTER;
        let is_landing = is_landing_due && !is_obeyed;
        self.phase = SessionPhase::EmergencyStop(EmergencyStop {
            again_at: now.after(EMERGENCY_PERIOD),
            is_landing_next: !is_landing,
            ..stop
        });
        if is_landing {
            self.send_landing(true, now);
        } else {
            self.send(DroneOrder::EmergencyStop);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::Message;
    use super::super::down_detection::AirborneSources;
    use super::super::tests::{approved, ms};
    use super::*;
    use crate::tello::LinkCounters;
    use crate::tello::protocol::{Action, HostPacket};
    use crate::tello::text::Command;

    fn session(is_dry_run: bool) -> Session {
        Session::binary(0, None, is_dry_run, Arc::new(LinkCounters::default()))
    }

    /// What waits to be sent, by a word each.
    fn waiting(session: &mut Session) -> Vec<&'static str> {
        let words = session.drain().map(|message| match message {
            Message::Binary(HostPacket::ConnReq { .. }) | Message::Text(Command::Enter) => "ask",
            Message::Binary(HostPacket::Sticks { .. }) | Message::Text(Command::Sticks(_)) => {
                "sticks"
            }
            Message::Binary(HostPacket::Action { action: Action::Land, .. })
            | Message::Text(Command::Land) => "land",
            Message::Binary(HostPacket::EmergencyStop) | Message::Text(Command::EmergencyStop) => {
                "stop"
            }
            _ => "other",
        });
        words.collect()
    }

    #[test]
    fn an_overdue_request_goes_once_directly_before_a_landing() {
        let asking = |is_overdue| Connection::Disconnected { again_at: ms(9_000), is_overdue };
        let text = Session::text(8890, false, Arc::new(LinkCounters::default()));
        for mut session in [session(false), text] {
            session.link = asking(true);
            session.send_landing(true, ms(10));
            assert_eq!(waiting(&mut session), ["ask", "sticks", "land"]);
            let again_at = ms(10).after(CONNECT_PERIOD);
            assert_eq!(session.link, Connection::Disconnected { again_at, is_overdue: false });
            session.send_landing(true, ms(20));
            assert_eq!(waiting(&mut session), ["sticks", "land"], "no longer overdue");
        }
    }

    #[test]
    fn sticks_need_a_connection_and_only_deflected_ones_may_make_it_fly() {
        let mut session = session(false);
        session.send_sticks(approved(0.5), ms(0));
        assert!(waiting(&mut session).is_empty() && !session.may_have_flown, "not connected");
        session.was_connected = true;
        session.send_sticks(Approved::neutral(), ms(0));
        assert_eq!((waiting(&mut session), session.may_have_flown), (vec!["sticks"], false));
        session.send_sticks(approved(0.5), ms(0));
        assert_eq!((waiting(&mut session), session.may_have_flown), (vec!["sticks"], true));
        let mut dry = self::session(true);
        dry.was_connected = true;
        dry.send_sticks(approved(0.5), ms(0));
        dry.send_landing(true, ms(0));
        dry.emergency_stop(ms(0));
        assert_eq!((waiting(&mut dry), dry.counters.orders.get()), (Vec::new(), 0));
    }

    #[test]
    fn every_other_step_lands_once_its_time_is_over_and_none_is_at_rest() {
        let mut down = AirborneSources::default();
        down.observe_pose(Some(false), ms(0));
        let alone = down.rest(None, ms(0));
        let stop = |at_rest, is_landing_next| EmergencyStop {
            since: ms(0),
            again_at: ms(0),
            at_rest,
            is_landing_next,
        };
        let land_at = TimeNs(0).after(EMERGENCY_LAND_AFTER);
        let before = TimeNs(land_at.0 - 1);
        for (stop, now, sent, is_landing_next) in [
            (stop(None, true), before, vec!["stop"], true),
            (stop(None, true), land_at, vec!["sticks", "land"], false),
            (stop(alone, true), land_at, vec!["sticks", "land"], false),
            (stop(None, false), land_at, vec!["stop"], true),
        ] {
            let mut session = session(false);
            session.continue_emergency_stop(stop, now);
            assert_eq!(waiting(&mut session), sent, "{stop:?}");
            let SessionPhase::EmergencyStop(next) = session.phase else { panic!("{session:?}") };
            assert_eq!(next.is_landing_next, is_landing_next, "{stop:?}");
            assert_eq!(next.again_at, now.after(EMERGENCY_PERIOD));
        }
    }
}
