//! What a decision puts on the wire: sticks, a landing with its neutral sticks, the emergency ladder.

use super::witness::Rest;
use super::{
    ASK_PERIOD, Approved, CONTROL_SILENCE_NEUTRAL, DroneOrder, EMERGENCY_COPIES,
    EMERGENCY_PATIENCE, EMERGENCY_PERIOD, EmergencyStop, Flight, Link, Session,
};
use crate::clock::TimeNs;
use crate::tello::{Protocol, SenderState};

impl Session {
    /// Sends sticks, if the drone has acknowledged the connection and takes them now; never in a dry run.
    pub(super) fn send_sticks(&mut self, approved: Approved, now: TimeNs) {
        if self.was_connected && !self.is_dry_run && self.talk.takes_sticks(now) {
            self.may_have_flown |= approved != Approved::neutral();
            self.counters.sticks.count();
            self.talk.steer(approved, now, &mut self.outbox);
        }
    }

    /// Sends one copy of an order; never in a dry run.
    pub(super) fn send(&mut self, order: DroneOrder) {
        if !self.is_dry_run {
            self.counters.orders.count();
            self.talk.order(order, &mut self.outbox);
        }
    }

    /// Neutral sticks and directly after them LAND. A request for a connection that is overdue goes before
    /// both, so that nothing stands between them, nor between two landings.
    pub(super) fn send_landing(&mut self, now: TimeNs) {
        if let Link::Asking { again_at, is_overdue: is_overdue @ true } = &mut self.link
            && self.talk.protocol() == Protocol::Binary
        {
            (*again_at, *is_overdue) = (now.after(ASK_PERIOD), false);
            self.counters.conn_requests.count();
            self.talk.ask(&mut self.outbox);
        }
        self.send_neutral(now);
        // With a number of its own: a drone may take a known number for a copy of a landing that the
        // neutral sticks have just cancelled.
        self.talk.begin(DroneOrder::Land, now);
        self.send(DroneOrder::Land);
    }

    /// Neutral sticks, whether the drone has acknowledged anything or not.
    fn send_neutral(&mut self, now: TimeNs) {
        if !self.is_dry_run {
            self.counters.ending_neutrals.count();
            self.talk.steer(Approved::neutral(), now, &mut self.outbox);
        }
    }

    /// Begins the emergency ladder.
    pub(super) fn emergency_stop(&mut self, now: TimeNs) {
        let again_at = now.after(EMERGENCY_PERIOD);
        let stop = EmergencyStop { since: now, again_at, at_rest: None, is_landing_next: true };
        self.flight = Flight::EmergencyStop(stop);
        self.send_neutral(now);
        self.talk.begin(DroneOrder::EmergencyStop, now);
        for _ in 0..EMERGENCY_COPIES {
            self.send(DroneOrder::EmergencyStop);
        }
    }

    /// The next rung of the ladder: an emergency stop, or a landing in its turn if the emergency stop seems to have no
    /// effect.
    pub(super) fn go_on_stopping(&mut self, stop: EmergencyStop, now: TimeNs) {
        let is_obeyed = stop.at_rest.is_some_and(Rest::is_agreed);
        let is_landing_due = stop.is_landing_next && now.since(stop.since) >= EMERGENCY_PATIENCE;
        let is_landing = is_landing_due && !is_obeyed;
        self.flight = Flight::EmergencyStop(EmergencyStop {
            again_at: now.after(EMERGENCY_PERIOD),
            is_landing_next: !is_landing,
            ..stop
        });
        if is_landing {
            self.send_landing(now);
        } else {
            self.send(DroneOrder::EmergencyStop);
        }
    }

    /// What is sent at `now`, for the counters.
    pub(super) fn sender_state(&self, now: TimeNs) -> SenderState {
        match self.flight {
            Flight::Quiet => SenderState::Quiet,
            Flight::Steered { approved_at, .. }
                if now.since(approved_at) >= CONTROL_SILENCE_NEUTRAL =>
            {
                SenderState::Neutral
            }
            Flight::Steered { .. } => SenderState::Steering,
            Flight::Landing { .. } => SenderState::Landing,
            Flight::Landed { .. } => SenderState::Landed,
            Flight::EmergencyStop(_) => SenderState::EmergencyStop,
            Flight::MotorsStopped => SenderState::MotorsStopped,
        }
    }
}
