//! What is sent to the drone, and when: handshake, sticks, orders and the watchdog.
//!
//! No clock and no socket; the session counts into shared counters. Datagrams, approvals, whether a pose is in the air,
//! and moments come in, messages to send come out. The two protocols are `binary` and `text` behind `protocol`; what is
//! safe to send is the same for both and decided here:
//!
//! - Sticks are repeated only while the control thread approves new ones; they become neutral 100 ms
//!   after it falls silent, and a landing after 1 s.
//! - A neutral stick packet goes out directly before every LAND, since a drone may keep its last sticks.
//! - From the first landing on there is no take-off and no stick packet but those neutral ones: any
//!   command may cancel a landing. Nothing stands between two landings; the request for a connection goes
//!   out directly before the neutral sticks.
//! - A landing ends when both sources, status and pose, report that the drone is down, or one of them for
//!   10 s while the other reports nothing.
//! - An emergency stop is allowed in any state. Nothing but another emergency stop follows it, and a landing if
//!   the drone still flies 0.6 s later: that the binary protocol executes an emergency stop was never verified.

mod airborne;
mod binary;
mod down_detection;
mod guard;
mod inbound;
mod landing_repetition;
mod messages;
mod sending;
mod text;

use std::sync::Arc;
use std::sync::atomic::Ordering;

use tello_flight::drone::{CONTROL_SILENCE_NEUTRAL, DroneOrder, TAKE_OFF_TAIL};
use tello_flight::gate::Approved;

use super::LinkCounters;
use crate::clock::{SpanNs, TimeNs};
use binary::BinaryProtocol;
use down_detection::{AirborneSources, Rest};
use landing_repetition::LandingRepetition;
use messages::SessionProtocol;
use text::TextProtocol;

pub(super) use guard::landing_packets;
pub use messages::Message;
pub use text::{STATE_PORT, TOF_FLYING_M};

/// Period of connection requests: a drone that boots receives one of the next requests.
const CONNECT_PERIOD: SpanNs = SpanNs::from_ms(2000);
/// Silence of the drone after which the connection counts as lost and is requested again.
const LINK_SILENCE: SpanNs = SpanNs::from_ms(2000);
/// Period of requests for settings and values that the drone has not confirmed. With the text protocol, period of
/// requests for the battery: the answer shows that requests arrive.
const REQUEST_PERIOD: SpanNs = SpanNs::from_ms(2000);

/// Period of stick commands (50 Hz), whether or not there are new sticks.
const STICKS_PERIOD: SpanNs = SpanNs::from_ms(20);
/// Silence of the control thread after which the drone is landed.
const CONTROL_SILENCE_LAND: SpanNs = SpanNs::from_ms(1000);

/// Time on the ground, by status and pose, after which a landing ends: longer than a bounce, or than one pose that
/// is an outlier.
const LAND_REST: SpanNs = SpanNs::from_ms(300);
/// Delay until a landing or an emergency stop that the socket did not take is sent again.
const REFUSED_PERIOD: SpanNs = SpanNs::from_ms(50);
/// [`TAKE_OFF_TAIL`] of an order whose repetitions may reach the drone one second late.
const TAKE_OFF_TIME: SpanNs = SpanNs(TAKE_OFF_TAIL.0 + 1_000_000_000);
/// Longest repetition of the last landing, to a drone that does not report that it stands. A drone that receives
/// nothing for as long lands by itself.
const LAST_LANDING_TIME: SpanNs = SpanNs::from_ms(15_000);

/// Datagrams of one emergency stop: if one of fifty datagrams is lost, all three are lost once in a hundred thousand
/// times.
const EMERGENCY_COPIES: usize = 3;
/// Period of repeated emergency stops.
const EMERGENCY_PERIOD: SpanNs = SpanNs::from_ms(200);
/// Time from the first emergency stop after which a drone that is not down has ignored it: every other emergency
/// stop becomes a landing. A fall from 1.5 m takes 0.55 s.
const EMERGENCY_LAND_AFTER: SpanNs = SpanNs::from_ms(600);
/// Time on the ground, by status and pose, after which the motors count as stopped.
const EMERGENCY_REST: SpanNs = SpanNs::from_ms(1000);

/// One drone, from the first request for a connection to the last landing.
#[derive(Debug)]
pub struct Session {
    protocol: Box<dyn SessionProtocol>,
    /// Sticks and orders are decided but not sent.
    is_dry_run: bool,
    link: Connection,
    /// Whether the drone ever answered or reported: before, sticks have no receiver.
    was_connected: bool,
    phase: SessionPhase,
    take_off: Option<TakeOffOrder>,
    /// Whether a take-off was ordered, a deflected stick sent, or the drone ever reported that it flies.
    may_have_flown: bool,
    sources: AirborneSources,
    /// When the session is over whatever the drone reports; `None` until it is stopped.
    over_at: Option<TimeNs>,
    counters: Arc<LinkCounters>,
    outbox: Vec<Message>,
}

/// The newest order to take off.
#[derive(Debug, Clone, Copy, PartialEq)]
struct TakeOffOrder {
    at: TimeNs,
    /// Whether the drone was airborne since, by status or pose.
    was_seen: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Connection {
    /// A request that is overdue waits for the next landing.
    Disconnected {
        again_at: TimeNs,
        is_overdue: bool,
    },
    Connected {
        heard_at: TimeNs,
        request_at: TimeNs,
    },
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum SessionPhase {
    /// Nothing approved yet.
    Quiet,
    /// The control thread steers.
    Steered { approved: Approved, approved_at: TimeNs, again_at: TimeNs },
    /// The landing is repeated until the drone has been down for a while.
    Landing { repetition: LandingRepetition, at_rest: Option<Rest> },
    /// The landing ended, and with it the flight: only another landing or an emergency stop may be
    /// ordered. The landing is resumed, at `again_at` or later, if a source reports that the drone is airborne.
    Landed { again_at: TimeNs },
    /// The emergency stop is repeated until the drone has been down for a while.
    EmergencyStop(EmergencyStop),
    /// The motors are stopped: only another emergency stop may be ordered. The emergency stop begins anew if a source
    /// reports that the drone is airborne.
    MotorsStopped,
}

/// The emergency-stop sequence: neutral sticks and emergency stops, then emergency stops and landings in turn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct EmergencyStop {
    since: TimeNs,
    again_at: TimeNs,
    at_rest: Option<Rest>,
    /// Whether a landing is next if the drone is not down.
    is_landing_next: bool,
}

impl Session {
    /// A session in the binary protocol that has sent nothing yet.
    ///
    /// `utc_start_ns` is the wall clock at time zero, ns since 1970. `altitude_limit_m` is sent to the
    /// drone until it confirms it. With `is_dry_run` neither sticks nor orders are ever sent.
    pub fn binary(
        utc_start_ns: i64,
        altitude_limit_m: Option<u16>,
        is_dry_run: bool,
        counters: Arc<LinkCounters>,
    ) -> Self {
        let protocol = BinaryProtocol::new(utc_start_ns, altitude_limit_m);
        Self::new(Box::new(protocol), is_dry_run, counters)
    }

    /// A session in the text SDK that has sent nothing yet; the state line is listened for at
    /// `state_port`.
    pub fn text(state_port: u16, is_dry_run: bool, counters: Arc<LinkCounters>) -> Self {
        Self::new(Box::new(TextProtocol::new(state_port)), is_dry_run, counters)
    }

    fn new(
        protocol: Box<dyn SessionProtocol>,
        is_dry_run: bool,
        counters: Arc<LinkCounters>,
    ) -> Self {
        Self {
            protocol,
            is_dry_run,
            link: Connection::Disconnected { again_at: TimeNs(0), is_overdue: false },
            was_connected: false,
            phase: SessionPhase::Quiet,
            take_off: None,
            may_have_flown: false,
            sources: AirborneSources::default(),
            over_at: None,
            counters,
            outbox: Vec::with_capacity(8),
        }
    }

    /// Messages to send now, oldest first. Real time: no allocation.
    pub fn drain(&mut self) -> std::vec::Drain<'_, Message> {
        self.outbox.drain(..)
    }

    /// Does what is due at `now`. To be called after every event and at `Session::next_deadline`. Real time:
    /// constant; allocates only if the outbox grows.
    pub fn advance(&mut self, now: TimeNs) {
        self.keep_link(now);
        self.advance_touchdown(now);
        match self.phase {
            SessionPhase::Steered { approved_at, .. }
                if now.since(approved_at) >= CONTROL_SILENCE_LAND =>
            {
                self.counters.watchdog_landings.count();
                self.land(now);
            }
            SessionPhase::Steered { approved, approved_at, again_at } if now >= again_at => {
                let is_silent = now.since(approved_at) >= CONTROL_SILENCE_NEUTRAL;
                if is_silent {
                    self.counters.neutralised.count();
                }
                let approved = if is_silent { Approved::neutral() } else { approved };
                let again_at = now.after(STICKS_PERIOD);
                self.phase = SessionPhase::Steered { approved, approved_at, again_at };
                self.send_sticks(approved, now);
            }
            SessionPhase::Landing { mut repetition, at_rest } if now >= repetition.again_at => {
                let has_neutral = repetition.take(now);
                self.phase = SessionPhase::Landing { repetition, at_rest };
                self.send_landing(has_neutral, now);
            }
            SessionPhase::EmergencyStop(stop) if now >= stop.again_at => {
                self.continue_emergency_stop(stop, now);
            }
            SessionPhase::Quiet
            | SessionPhase::Steered { .. }
            | SessionPhase::Landing { .. }
            | SessionPhase::Landed { .. }
            | SessionPhase::EmergencyStop(_)
            | SessionPhase::MotorsStopped => {}
        }
    }

    /// Requests a connection that is not there, and sends the periodic requests of one that is.
    fn keep_link(&mut self, now: TimeNs) {
        if let Connection::Connected { heard_at, .. } = self.link
            && now.since(heard_at) >= LINK_SILENCE
        {
            self.counters.is_connected.store(false, Ordering::Relaxed);
            self.link = Connection::Disconnected { again_at: now, is_overdue: false };
        }
        let may_request = self.may_request(now);
        match &mut self.link {
            Connection::Disconnected { again_at, is_overdue } if now >= *again_at => {
                *again_at = now.after(CONNECT_PERIOD);
                *is_overdue = !may_request;
                if may_request {
                    self.protocol.request_connection(&mut self.outbox);
                }
            }
            Connection::Connected { request_at, .. } if now >= *request_at => {
                *request_at = now.after(REQUEST_PERIOD);
                if may_request && self.may_steer() {
                    self.protocol.send_periodic_requests(&mut self.outbox);
                }
            }
            Connection::Disconnected { .. } | Connection::Connected { .. } => {}
        }
    }

    /// Whether a request may be sent between the packets of the flight: never between two emergency stops or two
    /// landings; in the text SDK not during a take-off either, which a request would end.
    fn may_request(&self, now: TimeNs) -> bool {
        match self.phase {
            SessionPhase::EmergencyStop(_) | SessionPhase::Landing { .. } => false,
            _ => self.protocol.may_request(now),
        }
    }

    /// When [`Session::advance`] has something to do. Real time: no allocation, constant cost.
    pub(crate) fn next_deadline(&self) -> TimeNs {
        let link = match self.link {
            Connection::Disconnected { again_at, .. } => again_at,
            Connection::Connected { heard_at, request_at } => {
                heard_at.after(LINK_SILENCE).min(request_at)
            }
        };
        match self.phase {
            SessionPhase::Quiet | SessionPhase::Landed { .. } | SessionPhase::MotorsStopped => link,
            SessionPhase::Landing { repetition, at_rest } => {
                let over_at = at_rest.map(|rest| rest.is_over_at(LAND_REST));
                link.min(repetition.again_at).min(over_at.unwrap_or(link))
            }
            SessionPhase::Steered { again_at, .. }
            | SessionPhase::EmergencyStop(EmergencyStop { again_at, .. }) => link.min(again_at),
        }
    }

    /// New sticks, which the control thread handed over at `handed_over_at`: sent at once, unless a landing
    /// or an emergency stop was ever ordered, or the sticks before were too old. Sticks that waited for the sender
    /// have spent a part of their 100 ms.
    pub fn approve(&mut self, approved: Approved, handed_over_at: TimeNs, now: TimeNs) {
        let is_too_late = now.since(handed_over_at) >= CONTROL_SILENCE_LAND;
        match self.phase {
            // Nothing has been steered that would have to be landed.
            SessionPhase::Quiet if is_too_late => {}
            // The session was not advanced for so long: the drone is landed now, not steered.
            SessionPhase::Steered { approved_at, .. }
                if now.since(approved_at) >= CONTROL_SILENCE_LAND => {}
            SessionPhase::Quiet | SessionPhase::Steered { .. } => {
                let approved_at = handed_over_at;
                self.phase = SessionPhase::Steered { approved, approved_at, again_at: now };
            }
            SessionPhase::Landing { .. }
            | SessionPhase::Landed { .. }
            | SessionPhase::EmergencyStop(_)
            | SessionPhase::MotorsStopped => {
                return;
            }
        }
        self.advance(now);
    }

    /// Sends an order.
    ///
    /// - Landing: repeated until it is over, each time directly after neutral sticks.
    /// - Take-off: sent once, and only to a drone that reported in the last 2 s that it stands. A second take-off is
    ///   sent only if the drone reports the same when the first one must show. None is sent after a landing was
    ///   ordered, by the watchdog or otherwise.
    /// - Emergency stop: sent three times at once after neutral sticks, then every 0.2 s until the drone has been down
    ///   for 1 s to both sources, or for 10 s to one. From 0.6 s on, while the drone is not down, every other
    ///   emergency stop is a landing. It ends all that went on before it, and no other order follows it.
    ///
    /// Real time: constant; allocates only if the outbox grows.
    pub fn order(&mut self, order: DroneOrder, now: TimeNs) {
        match order {
            DroneOrder::EmergencyStop if self.is_stopping() => {}
            DroneOrder::EmergencyStop => {
                self.emergency_stop(now);
                self.over_at = self.over_at.map(|at| at.max(now.after(LAST_LANDING_TIME)));
            }
            DroneOrder::Land
                if self.is_landing()
                    || self.is_stopping()
                    || self.phase == SessionPhase::MotorsStopped => {}
            DroneOrder::Land => self.land(now),
            DroneOrder::TakeOff if !self.may_take_off(now) => {}
            DroneOrder::TakeOff => {
                self.take_off = Some(TakeOffOrder { at: now, was_seen: false });
                self.may_have_flown = true;
                self.protocol.begin(order, now);
                self.send(DroneOrder::TakeOff);
                // From here the control thread has to report, or the watchdog lands.
                let approved = Approved::neutral();
                let again_at = now.after(STICKS_PERIOD);
                self.phase = SessionPhase::Steered { approved, approved_at: now, again_at };
            }
        }
    }

    /// The socket did not take all that was to be sent at `now`: a landing or an emergency stop goes out again within
    /// 50 ms. Sticks are not sent again here, since they are repeated every 20 ms anyway.
    ///
    /// Real time: no allocation, constant cost.
    pub(crate) fn note_refused(&mut self, now: TimeNs) {
        let soon = now.after(REFUSED_PERIOD);
        match &mut self.phase {
            SessionPhase::Landing { repetition: LandingRepetition { again_at, .. }, .. }
            | SessionPhase::EmergencyStop(EmergencyStop { again_at, .. }) => {
                *again_at = soon.min(*again_at);
            }
            // Sticks are repeated sooner than that.
            SessionPhase::Quiet
            | SessionPhase::Steered { .. }
            | SessionPhase::Landed { .. }
            | SessionPhase::MotorsStopped => {}
        }
    }

    /// Whether neither a landing nor an emergency stop was ever ordered.
    fn may_steer(&self) -> bool {
        matches!(self.phase, SessionPhase::Quiet | SessionPhase::Steered { .. })
    }

    fn is_landing(&self) -> bool {
        matches!(self.phase, SessionPhase::Landing { .. })
    }

    fn is_stopping(&self) -> bool {
        matches!(self.phase, SessionPhase::EmergencyStop(_))
    }

    fn land(&mut self, now: TimeNs) {
        // A caller that orders it in every period must not shorten the time between two of them.
        let again_at =
            if let SessionPhase::Landed { again_at } = self.phase { again_at } else { now };
        let repetition = LandingRepetition::begin(now, again_at);
        self.phase = SessionPhase::Landing { repetition, at_rest: None };
        self.advance(now);
    }
}

#[cfg(test)]
mod tests;
