//! What is sent to the drone, and when: handshake, sticks, orders and the watchdog.
//!
//! Pure: datagrams, approvals and moments come in, messages to send come out. The two protocols are
//! `binary` and `text` behind `talk`; what is safe to say is the same for both and decided here. A
//! stuck stick is impossible: sticks are repeated only while the control thread approves new ones, become
//! neutral 100 ms after it falls silent and a landing after 1 s. A landing is cancelled by any
//! command, so that from the first landing on no sticks and no take-off are sent; a cut of the motors
//! is allowed in any state, and nothing but another cut follows it.

mod binary;
mod guard;
mod inbound;
mod talk;
mod text;

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::gate::Approved;
use super::{LinkCounters, Protocol};
use crate::clock::{SpanNs, TimeNs};
use binary::BinaryTalk;
use talk::Talk;
use text::TextTalk;

pub(super) use guard::{LastWords, last_words};
pub use talk::Message;

const ASK_PERIOD: SpanNs = SpanNs::from_ms(2000);
/// Silence of the drone after which the connection counts as lost and is asked for again.
const LINK_SILENCE: SpanNs = SpanNs::from_ms(2000);
const PING_PERIOD: SpanNs = SpanNs::from_ms(2000);

const STICKS_PERIOD: SpanNs = SpanNs::from_ms(20);
/// Silence of the control thread after which the sticks become neutral.
const CONTROL_SILENCE_NEUTRAL: SpanNs = SpanNs::from_ms(100);
/// Silence of the control thread after which the drone is landed.
const CONTROL_SILENCE_LAND: SpanNs = SpanNs::from_ms(1000);

const LAND_PERIOD: SpanNs = SpanNs::from_ms(500);
/// A take-off may last so long; until then "not flying" does not mean landed.
const TAKE_OFF_TIME: SpanNs = SpanNs::from_ms(5000);
/// How long the last landing is repeated to a drone that does not say that it stands. After as long a
/// silence it lands by itself.
const LAST_LANDING_TIME: SpanNs = SpanNs::from_ms(15_000);

/// A cut is sent so often at once: one of fifty datagrams is lost, one of a hundred thousand thrice.
const CUT_COPIES: usize = 3;
const CUT_PERIOD: SpanNs = SpanNs::from_ms(200);
/// How long the drone has to say that it does not fly before its motors count as cut.
const CUT_REST: SpanNs = SpanNs::from_ms(1000);

/// What changes the phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Start the motors and climb to about 1 m.
    TakeOff,
    /// Descend and stop the motors.
    Land,
    /// Stop the motors now: the drone falls. Stronger than a landing.
    Cut,
}

/// One drone, from the first request for a connection to the last landing.
#[derive(Debug)]
pub struct Session {
    talk: Talk,
    /// Sticks and orders are decided but not sent.
    is_dry_run: bool,
    link: Link,
    /// Whether the drone ever acknowledged: before, sticks have no receiver.
    was_connected: bool,
    flight: Flight,
    take_off_at: Option<TimeNs>,
    /// The drone's newest word on it.
    is_flying: Option<bool>,
    /// When the session is over whatever the drone says; `None` until it is stopped.
    over_at: Option<TimeNs>,
    counters: Arc<LinkCounters>,
    outbox: Vec<Message>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Link {
    Asking { again_at: TimeNs },
    Connected { heard_at: TimeNs, ping_at: TimeNs },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Flight {
    /// Nothing approved yet.
    Quiet,
    /// The control thread steers.
    Steered { approved: Approved, approved_at: TimeNs, again_at: TimeNs },
    /// The landing is repeated until the drone says that it does not fly.
    Landing { again_at: TimeNs },
    /// The landing ended, and with it the flight: only another landing may be ordered.
    Landed,
    /// The cut is repeated until the drone has said for a while that it does not fly.
    Cutting { again_at: TimeNs, at_rest_since: Option<TimeNs> },
    /// The motors are cut: only another cut may be ordered.
    Cut,
}

impl Session {
    /// A session in the binary protocol that has sent nothing yet.
    ///
    /// `utc_start_ns` is the wall clock at time zero, ns since 1970. `altitude_limit_m` is told to the
    /// drone until it confirms it. With `is_dry_run` neither sticks nor orders are ever sent.
    pub fn binary(
        utc_start_ns: i64,
        altitude_limit_m: Option<u16>,
        is_dry_run: bool,
        counters: Arc<LinkCounters>,
    ) -> Self {
        let talk = Talk::Binary(BinaryTalk::new(utc_start_ns, altitude_limit_m));
        Self::new(talk, is_dry_run, counters)
    }

    /// A session in the text SDK that has sent nothing yet; the state line is listened for at
    /// `state_port`.
    pub fn text(state_port: u16, is_dry_run: bool, counters: Arc<LinkCounters>) -> Self {
        Self::new(Talk::Text(TextTalk::new(state_port)), is_dry_run, counters)
    }

    fn new(talk: Talk, is_dry_run: bool, counters: Arc<LinkCounters>) -> Self {
        Self {
            talk,
            is_dry_run,
            link: Link::Asking { again_at: TimeNs(0) },
            was_connected: false,
            flight: Flight::Quiet,
            take_off_at: None,
            is_flying: None,
            over_at: None,
            counters,
            outbox: Vec::with_capacity(8),
        }
    }

    /// What to send now, oldest first.
    pub fn drain(&mut self) -> std::vec::Drain<'_, Message> {
        self.outbox.drain(..)
    }

    /// Does what is due at `now`. To be called after every event and at [`Session::next_deadline`].
    pub fn advance(&mut self, now: TimeNs) {
        self.keep_link(now);
        match self.flight {
            Flight::Steered { approved_at, .. }
                if now.since(approved_at) >= CONTROL_SILENCE_LAND =>
            {
                self.counters.watchdog_landings.count();
                self.land(now);
            }
            Flight::Steered { approved, approved_at, again_at } if now >= again_at => {
                let is_silent = now.since(approved_at) >= CONTROL_SILENCE_NEUTRAL;
                if is_silent {
                    self.counters.neutralised.count();
                }
                let approved = if is_silent { Approved::neutral() } else { approved };
                let again_at = now.after(STICKS_PERIOD);
                self.flight = Flight::Steered { approved, approved_at, again_at };
                self.send_sticks(approved, now);
            }
            Flight::Landing { again_at } if now >= again_at => {
                self.flight = Flight::Landing { again_at: now.after(LAND_PERIOD) };
                self.send(Order::Land);
            }
            Flight::Cutting { again_at, at_rest_since } if now >= again_at => {
                self.flight = Flight::Cutting { again_at: now.after(CUT_PERIOD), at_rest_since };
                self.send(Order::Cut);
            }
            Flight::Quiet
            | Flight::Steered { .. }
            | Flight::Landing { .. }
            | Flight::Landed
            | Flight::Cutting { .. }
            | Flight::Cut => {}
        }
    }

    /// Asks for a connection that is not there, and keeps one that is.
    fn keep_link(&mut self, now: TimeNs) {
        if let Link::Connected { heard_at, .. } = self.link
            && now.since(heard_at) >= LINK_SILENCE
        {
            self.counters.is_connected.store(false, Ordering::Relaxed);
            self.link = Link::Asking { again_at: now };
        }
        let may_ask = self.may_ask(now);
        match &mut self.link {
            Link::Asking { again_at } if now >= *again_at => {
                *again_at = now.after(ASK_PERIOD);
                if may_ask {
                    self.counters.conn_requests.count();
                    self.talk.ask(&mut self.outbox);
                }
            }
            Link::Connected { ping_at, .. } if now >= *ping_at => {
                *ping_at = now.after(PING_PERIOD);
                if may_ask && self.may_steer() {
                    self.talk.ping(&mut self.outbox);
                }
            }
            Link::Asking { .. } | Link::Connected { .. } => {}
        }
    }

    /// Whether a question may stand between what the flight needs: never between two cuts; in the text
    /// SDK neither during a take-off, which it would end, nor between two landings.
    fn may_ask(&self, now: TimeNs) -> bool {
        match self.flight {
            Flight::Cutting { .. } => false,
            Flight::Landing { .. } => self.talk.protocol() == Protocol::Binary,
            _ => self.talk.may_ask(now),
        }
    }

    /// When [`Session::advance`] has something to do.
    pub fn next_deadline(&self) -> TimeNs {
        let link = match self.link {
            Link::Asking { again_at } => again_at,
            Link::Connected { heard_at, ping_at } => heard_at.after(LINK_SILENCE).min(ping_at),
        };
        match self.flight {
            Flight::Quiet | Flight::Landed | Flight::Cut => link,
            Flight::Steered { again_at, .. }
            | Flight::Landing { again_at }
            | Flight::Cutting { again_at, .. } => link.min(again_at),
        }
    }

    /// New sticks: sent at once, unless a landing or a cut was ever ordered.
    pub fn approve(&mut self, approved: Approved, now: TimeNs) {
        if self.may_steer() {
            self.flight = Flight::Steered { approved, approved_at: now, again_at: now };
            self.advance(now);
        }
    }

    /// Sends an order. A landing is repeated until it is over. A take-off is sent once; another one is
    /// sent only if the drone says that it stands when the first must show. There is none once a
    /// landing was ordered, be it by the watchdog. A cut is sent three times at once, then every 0.2 s
    /// until the drone has said for 1 s that it does not fly; it ends whatever went on before it, and
    /// no other order follows it.
    pub fn order(&mut self, order: Order, now: TimeNs) {
        match order {
            Order::Cut if self.is_cutting() => {}
            Order::Cut => {
                let again_at = now.after(CUT_PERIOD);
                self.flight = Flight::Cutting { again_at, at_rest_since: None };
                self.talk.begin(order, now);
                for _ in 0..CUT_COPIES {
                    self.send(Order::Cut);
                }
            }
            Order::Land if self.is_landing() || self.is_cutting() || self.flight == Flight::Cut => {
            }
            Order::Land => self.land(now),
            Order::TakeOff if !self.may_take_off(now) => {}
            Order::TakeOff => {
                self.take_off_at = Some(now);
                self.talk.begin(order, now);
                self.send(Order::TakeOff);
                // From here the control thread has to report, or the watchdog lands.
                let approved = Approved::neutral();
                let again_at = now.after(STICKS_PERIOD);
                self.flight = Flight::Steered { approved, approved_at: now, again_at };
            }
        }
    }

    /// Whether a take-off may be ordered: never in the air, nor while an earlier one may be under way.
    fn may_take_off(&self, now: TimeNs) -> bool {
        let is_first_or_lost = self.take_off_at.is_none_or(|at| {
            self.is_flying == Some(false) && now.since(at) >= self.talk.take_off_patience()
        });
        self.may_steer() && self.is_flying != Some(true) && is_first_or_lost
    }

    /// Ends the session: at once in a dry run or if the drone stands, otherwise by a landing, or by
    /// the cut that goes on.
    pub fn stop(&mut self, now: TimeNs) {
        if self.is_dry_run || !(self.is_cutting() || self.may_be_airborne(now)) {
            self.over_at = Some(now);
        } else {
            self.over_at = Some(now.after(LAST_LANDING_TIME));
            self.order(Order::Land, now);
        }
    }

    /// Whether the session was stopped and no longer has to be advanced: the drone stands, or has not
    /// said so for 15 s.
    pub fn is_over(&self, now: TimeNs) -> bool {
        let has_work = self.is_cutting() || self.may_be_airborne(now);
        self.over_at.is_some_and(|over_at| now >= over_at || !has_work)
    }

    /// Whether the drone may be in the air: if in doubt, yes. Our sticks and landings are a reason to
    /// doubt only if it ever acknowledged the connection.
    fn may_be_airborne(&self, now: TimeNs) -> bool {
        let may_be_taking_off = self.take_off_at.is_some_and(|at| now.since(at) < TAKE_OFF_TIME);
        let has_heard_us = self.was_connected || self.take_off_at.is_some();
        let is_over = matches!(self.flight, Flight::Quiet | Flight::Landed | Flight::Cut);
        let is_ours = has_heard_us && !is_over;
        may_be_taking_off || self.is_flying.unwrap_or(is_ours)
    }

    /// Whether neither a landing nor a cut was ever ordered.
    fn may_steer(&self) -> bool {
        matches!(self.flight, Flight::Quiet | Flight::Steered { .. })
    }

    fn is_landing(&self) -> bool {
        matches!(self.flight, Flight::Landing { .. })
    }

    fn is_cutting(&self) -> bool {
        matches!(self.flight, Flight::Cutting { .. })
    }

    fn land(&mut self, now: TimeNs) {
        self.talk.begin(Order::Land, now);
        self.flight = Flight::Landing { again_at: now };
        self.advance(now);
    }

    fn send_sticks(&mut self, approved: Approved, now: TimeNs) {
        if self.was_connected && !self.is_dry_run && self.talk.takes_sticks(now) {
            self.counters.sticks.count();
            self.talk.steer(approved, now, &mut self.outbox);
        }
    }

    fn send(&mut self, order: Order) {
        if !self.is_dry_run {
            self.counters.orders.count();
            self.talk.order(order, &mut self.outbox);
        }
    }
}

#[cfg(test)]
mod tests;
