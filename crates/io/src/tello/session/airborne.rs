//! Whether the drone may be in the air, and what ends with its being down: landings, emergency stops, the session.

use tello_flight::drone::TAKE_OFF_UNSEEN;

use super::down_detection::Rest;
use super::landing_repetition::LandingRepetition;
use super::{
    DroneOrder, EMERGENCY_REST, LAND_REST, LAST_LANDING_TIME, Session, SessionPhase, TAKE_OFF_TIME,
    TakeOffOrder,
};
use crate::clock::TimeNs;

impl Session {
    /// Takes what a fresh pose of the motion capture shows: in the air, on the floor, or `None` if there is no
    /// fresh pose. To be called in every period of the control loop.
    ///
    /// A landing ends only when both sources, status and pose, report that the drone is down, or one of them
    /// for 10 s while the other reports nothing. "On the floor" counts for 0.5 s. "In the air" counts until the
    /// opposite is seen, or until there was no fresh pose for 2 s.
    pub fn observe_pose(&mut self, is_airborne: Option<bool>, now: TimeNs) {
        self.sources.observe_pose(is_airborne, now);
        self.advance_touchdown(now);
    }

    /// Whether the drone may be in the air by status and pose and by what was sent to it: if in doubt, yes. Our sticks
    /// and landings are a reason to doubt only if it ever acknowledged the connection.
    pub(super) fn may_be_airborne(&self, now: TimeNs) -> bool {
        let seen = if self.may_have_flown || !self.may_steer() {
            let has_ended =
                matches!(self.phase, SessionPhase::Landed { .. } | SessionPhase::MotorsStopped);
            // One source that reports "down" has to last before it ends a landing.
            let is_certain = has_ended || !self.sources.is_alone(now);
            self.sources.is_airborne(now).map(|is_airborne| is_airborne || !is_certain)
        } else {
            // Carried by hand before the flight: a pose in the air is no reason to land.
            self.sources.status(now)
        };
        self.may_be_taking_off(now) || seen.unwrap_or_else(|| self.is_airborne_in_doubt())
    }

    /// The same where neither status nor pose is available.
    fn is_airborne_in_doubt(&self) -> bool {
        let last_status = self.sources.last_status();
        match self.phase {
            SessionPhase::Landed { .. } | SessionPhase::MotorsStopped => false,
            SessionPhase::Quiet => last_status == Some(true),
            // It stood when it was last heard, and nothing has made it fly since.
            SessionPhase::Steered { .. } if !self.may_have_flown && last_status == Some(false) => {
                false
            }
            SessionPhase::Steered { .. }
            | SessionPhase::Landing { .. }
            | SessionPhase::EmergencyStop(_) => self.was_connected || self.may_have_flown,
        }
    }

    /// Whether a take-off may be ordered: only to a drone that reports now that it stands, and not while an
    /// earlier take-off may be running.
    pub(super) fn may_take_off(&self, now: TimeNs) -> bool {
        let may_be_lost = |TakeOffOrder { at, .. }| {
            self.protocol.take_off_repeat_after().is_some_and(|after| now.since(at) >= after)
        };
        let is_first_or_lost = self.take_off.is_none_or(may_be_lost);
        self.may_steer() && self.sources.status(now) == Some(false) && is_first_or_lost
    }

    /// Until then "not flying" does not mean landed.
    fn may_be_taking_off(&self, now: TimeNs) -> bool {
        self.take_off.is_some_and(|TakeOffOrder { at, was_seen }| {
            now.since(at) < if was_seen { TAKE_OFF_TIME } else { TAKE_OFF_UNSEEN }
        })
    }

    /// Ends a landing or an emergency stop when the drone has been down for long enough, and resumes it when a
    /// source reports that the drone is airborne again: the source may have been missing before.
    pub(super) fn advance_touchdown(&mut self, now: TimeNs) {
        let is_airborne = self.sources.is_airborne(now) == Some(true);
        if let Some(take_off) = &mut self.take_off {
            take_off.was_seen |= is_airborne;
        }
        let is_taking_off = self.may_be_taking_off(now);
        let sources = self.sources;
        let rest = |before| sources.rest(before, now).filter(|_| !is_taking_off);
        let is_over =
            |rest: Option<Rest>, hold| rest.is_some_and(|rest| now >= rest.is_over_at(hold));
        match &mut self.phase {
            SessionPhase::Landing { repetition, at_rest } => {
                *at_rest = rest(*at_rest);
                if is_over(*at_rest, LAND_REST) {
                    self.phase = SessionPhase::Landed { again_at: repetition.again_at };
                }
            }
            SessionPhase::Landed { again_at } if is_airborne => {
                let repetition = LandingRepetition::begin(now, *again_at);
                self.phase = SessionPhase::Landing { repetition, at_rest: None };
            }
            SessionPhase::EmergencyStop(stop) => {
                stop.at_rest = rest(stop.at_rest);
                if is_over(stop.at_rest, EMERGENCY_REST) {
                    self.phase = SessionPhase::MotorsStopped;
                }
            }
            SessionPhase::MotorsStopped if is_airborne => self.emergency_stop(now),
            SessionPhase::Quiet
            | SessionPhase::Steered { .. }
            | SessionPhase::Landed { .. }
            | SessionPhase::MotorsStopped => {}
        }
    }

    /// Ends the session: at once in a dry run or if the drone stands, otherwise by a landing, or by
    /// the emergency stop that goes on.
    pub fn stop(&mut self, now: TimeNs) {
        if self.is_dry_run || !self.has_work(now) {
            self.over_at = Some(now);
        } else {
            self.over_at = Some(now.after(LAST_LANDING_TIME));
            self.order(DroneOrder::Land, now);
        }
    }

    /// Whether the session was stopped and no longer has to be advanced: the drone is down, or 15 s have
    /// passed in which its status and the poses did not agree on that.
    pub fn is_over(&self, now: TimeNs) -> bool {
        self.over_at.is_some_and(|over_at| now >= over_at || !self.has_work(now))
    }

    /// Whether the drone may be in the air, or has not been down for long enough.
    fn has_work(&self, now: TimeNs) -> bool {
        let is_settling = match self.phase {
            SessionPhase::Landing { at_rest, .. } => at_rest.is_some(),
            SessionPhase::EmergencyStop(_) => true,
            _ => false,
        };
        is_settling || self.may_be_airborne(now)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::tests::{approved, bytes, ms, status};
    use super::*;
    use crate::tello::LinkCounters;
    use crate::tello::protocol::{Action, DronePacket};

    /// A session that hears a status at 0 ms.
    fn reported(is_flying: bool) -> Session {
        let mut session = Session::binary(0, None, false, Arc::new(LinkCounters::default()));
        session.receive(&status(is_flying), ms(0));
        session
    }

    #[test]
    fn a_take_off_is_repeated_after_its_time_unless_it_was_acknowledged() {
        assert!(reported(false).may_take_off(ms(0)) && !reported(true).may_take_off(ms(0)));
        assert!(!reported(false).may_take_off(ms(2_001)), "an old status");
        for is_acknowledged in [false, true] {
            let mut session = reported(false);
            session.order(DroneOrder::TakeOff, ms(0));
            if is_acknowledged {
                let ack = DronePacket::Ack { action: Action::TakeOff, sequence: 1 };
                session.receive(&bytes(ack), ms(10));
                assert_eq!(session.counters.acks.get(), 1);
            }
            for (at_ms, may) in [(2_499, false), (2_500, true), (5_000, true), (60_000, true)] {
                session.receive(&status(false), ms(at_ms));
                assert_eq!(session.may_take_off(ms(at_ms)), may && !is_acknowledged, "{at_ms} ms");
            }
            session.order(DroneOrder::Land, ms(60_000));
            assert!(!session.may_take_off(ms(60_001)), "after a landing");
        }
    }

    #[test]
    fn a_take_off_may_be_running_for_five_seconds_or_eight_if_it_was_not_seen() {
        for (was_seen, over_ms) in [(true, 5_000), (false, 8_000)] {
            let mut session = reported(false);
            session.take_off = Some(TakeOffOrder { at: ms(0), was_seen });
            session.receive(&status(false), ms(over_ms - 1));
            session.observe_pose(Some(false), ms(over_ms - 1));
            assert!(session.may_be_airborne(ms(over_ms - 1)), "{was_seen}");
            assert!(!session.may_be_airborne(ms(over_ms)), "{was_seen}");
        }
        let mut session = reported(false);
        session.order(DroneOrder::TakeOff, ms(0));
        session.receive(&status(true), ms(1_000));
        assert_eq!(session.take_off, Some(TakeOffOrder { at: ms(0), was_seen: true }));
    }

    #[test]
    fn without_any_source_what_was_sent_decides() {
        let steered =
            SessionPhase::Steered { approved: approved(0.5), approved_at: ms(0), again_at: ms(0) };
        let repetition = LandingRepetition::begin(ms(0), ms(0));
        let landing = SessionPhase::Landing { repetition, at_rest: None };
        let landed = SessionPhase::Landed { again_at: ms(0) };
        for (phase, reported, may_have_flown, was_connected, expected) in [
            (SessionPhase::Quiet, None, false, true, false),
            (SessionPhase::Quiet, Some(true), false, true, true),
            (SessionPhase::Quiet, Some(false), false, true, false),
            (steered, Some(false), false, true, false),
            (steered, Some(false), true, true, true),
            (steered, None, false, true, true),
            (steered, None, false, false, false),
            (steered, None, true, false, true),
            (landing, Some(false), false, true, true),
            (landing, None, false, false, false),
            (landed, Some(true), true, true, false),
            (SessionPhase::MotorsStopped, Some(true), true, true, false),
        ] {
            let mut session = Session::binary(0, None, false, Arc::new(LinkCounters::default()));
            if let Some(is_flying) = reported {
                session.receive(&status(is_flying), ms(0));
            }
            (session.phase, session.may_have_flown) = (phase, may_have_flown);
            session.was_connected = was_connected;
            assert_eq!(session.is_airborne_in_doubt(), expected, "{phase:?}, {reported:?}");
        }
    }
}
