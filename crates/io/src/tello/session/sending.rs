//! What a decision puts on the wire: sticks, a landing with its neutral sticks, the emergency ladder.

use super::witness::Rest;
use super::{
    ASK_PERIOD, Approved, CONTROL_SILENCE_NEUTRAL, CUT_COPIES, CUT_PATIENCE, CUT_PERIOD, Cutting,
    Flight, Link, Order, Session,
};
use crate::clock::TimeNs;
use crate::tello::{Protocol, SenderState};

impl Session {
    pub(super) fn send_sticks(&mut self, approved: Approved, now: TimeNs) {
        if self.was_connected && !self.is_dry_run && self.talk.takes_sticks(now) {
            self.may_have_flown |= approved != Approved::neutral();
            self.counters.sticks.count();
            self.talk.steer(approved, now, &mut self.outbox);
        }
    }

    pub(super) fn send(&mut self, order: Order) {
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
        self.talk.begin(Order::Land, now);
        self.send(Order::Land);
    }

    /// Neutral sticks, whether the drone has acknowledged anything or not.
    fn send_neutral(&mut self, now: TimeNs) {
        if !self.is_dry_run {
            self.counters.ending_neutrals.count();
            self.talk.steer(Approved::neutral(), now, &mut self.outbox);
        }
    }

    /// Begins the emergency ladder.
    pub(super) fn cut(&mut self, now: TimeNs) {
        let again_at = now.after(CUT_PERIOD);
        let cutting = Cutting { since: now, again_at, at_rest: None, is_landing_next: true };
        self.flight = Flight::Cutting(cutting);
        self.send_neutral(now);
        self.talk.begin(Order::Cut, now);
        for _ in 0..CUT_COPIES {
            self.send(Order::Cut);
        }
    }

    /// The next rung of the ladder: a cut, or a landing in its turn if the cut seems to have no effect.
    pub(super) fn go_on_cutting(&mut self, cutting: Cutting, now: TimeNs) {
        let is_obeyed = cutting.at_rest.is_some_and(Rest::is_agreed);
        let is_landing_due = cutting.is_landing_next && now.since(cutting.since) >= CUT_PATIENCE;
        let is_landing = is_landing_due && !is_obeyed;
        self.flight = Flight::Cutting(Cutting {
            again_at: now.after(CUT_PERIOD),
            is_landing_next: !is_landing,
            ..cutting
        });
        if is_landing {
            self.send_landing(now);
        } else {
            self.send(Order::Cut);
        }
    }

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
            Flight::Cutting(_) => SenderState::Cutting,
            Flight::Cut => SenderState::Cut,
        }
    }
}
