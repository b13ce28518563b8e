//! Judges one flight of the campaign by where the vehicle truly was and by what went over the wire.
//!
//! Owns what no flight may do, and when what was wrong was noticed. Of the program under test only
//! its phase, its faults and its packets count.

use std::collections::BTreeSet;

use horizon_model::rows::{Pose, pose};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_flight::drone::LAND_PERIOD;
use tello_flight::{FaultSet, Phase, Pilot, Room};
use tello_io::tello::protocol::{Action, HostPacket};

use crate::{DronePhase, Truth};

/// Time after which a flight without an end is one of those sought: a mission may take 30 s more than twice
/// its planned time, and begin 40 s after the start. s
const TIME_LIMIT_S: f64 = 240.0;
/// Drift of a vehicle that levels or lands: two standard deviations of the simulated disturbance. m/s
const DRIFT_MPS: f64 = 0.1;
/// Time after which a drone that is still on the ground counts as one that stays there. s
const TAKE_OFF_WAIT_S: f64 = 40.0;
/// Ticks with neutral sticks that count as a reaction without a landing.
const NEUTRAL_TICKS: u32 = 5;

/// How a flight ended.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub(super) enum End {
    /// Ordered to land, and down.
    Landed,
    /// Brought down by the drone's own net: it heard nothing any more.
    OwnLanding,
    /// Never ordered to take off.
    StayedDown,
    /// Down, and the program goes on.
    Unnoticed,
    /// In the air at the end of the time, and the drone ignored its orders.
    Ignored,
    /// In the air at the end of the time.
    Undefined,
}

/// Rule that a flight broke.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub(super) enum Violation {
    /// Further outside of the room than it takes to stop from where it left it, or from where the drone
    /// began to execute orders again.
    LeftRoom,
    /// Sticks on the wire after an order to land: not neutral, or neutral without an order to land
    /// directly behind them.
    SticksWhileLanding,
    /// In the air at the end of the time, and it was the program's fault.
    NoEnd,
}

/// Times and distances of a flight from the moment in which the first fault can be observed: the fault is
/// present, and the vehicle flies.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
pub(super) struct MeasuredReaction {
    /// Until the program reported a fault in flight that it had not reported before. s
    pub detected_s: Option<f64>,
    /// From the first sticks that are not neutral until neutral ones are sent, 0.1 s long or before a
    /// landing, or an order to land or to stop the motors; 0 if the vehicle was not steered. s
    pub neutral_s: Option<f64>,
    /// Until the first order to land or to stop the motors. s
    pub land_s: Option<f64>,
    /// Whether that order ended a mission, and no fault did.
    pub is_mission_over: bool,
    /// Furthest of the true vehicle from where it was at the beginning, in flight. m
    pub travelled_m: f64,
    /// Furthest of the true vehicle outside of the room, whether the drone executed its orders or not. m
    pub outside_m: f64,
}

/// Measurements since the first fault can be observed.
#[derive(Debug)]
struct SinceFault {
    at_s: f64,
    from: Pose,
    /// Faults that were reported before.
    known: FaultSet,
    /// When sticks that are not neutral were first sent. s
    steered_s: Option<f64>,
    /// When the present run of neutral sticks began, and its length in ticks. s
    neutral: Option<(f64, u32)>,
    reaction: MeasuredReaction,
}

/// Program, wire and true drone after one tick.
#[derive(Debug, Clone, Copy)]
pub(super) struct TickView<'a> {
    pub(super) now_s: f64,
    /// Reported by the program.
    pub(super) faults: FaultSet,
    pub(super) wire: &'a [HostPacket],
    /// The drone as it truly is after the tick.
    pub(super) truth: Truth,
    /// Whether it ignores sticks, and orders to land.
    pub(super) ignores: [bool; 2],
}

/// Running judgement of a flight.
#[derive(Debug, Default)]
pub(super) struct Judge {
    room: Option<Room>,
    onset_s: f64,
    /// Time of the tick before. s
    now_s: f64,
    /// When the drone last ignored its orders. s
    ignored_at_s: f64,
    has_flown: bool,
    has_received_land: bool,
    /// Whether the drone ignores its orders.
    is_ignored: bool,
    /// How far outside it may be; `None` inside. m
    allowed_m: Option<f64>,
    /// Furthest outside while the drone executed its orders. m
    pub(super) excess_m: f64,
    found: BTreeSet<Violation>,
    /// Faults reported in flight before anything was wrong.
    known: FaultSet,
    since: Option<SinceFault>,
}

impl Judge {
    pub(super) fn new(room: Option<Room>, onset_s: f64) -> Self {
        Self { room, onset_s, ignored_at_s: f64::NEG_INFINITY, ..Self::default() }
    }

    pub(super) fn update(&mut self, tick: &TickView<'_>) {
        self.has_flown |= tick.truth.phase == DronePhase::Flying;
        self.begin(tick);
        self.read(tick.wire);
        let [ignores_sticks, ignores_land] = tick.ignores;
        // An order that was sent while the drone ignored orders has to be sent again.
        let ignores_orders = ignores_sticks || (self.has_received_land && ignores_land);
        let is_soon = tick.now_s - self.ignored_at_s <= LAND_PERIOD.seconds();
        self.is_ignored = ignores_orders || (self.is_ignored && is_soon && tick.wire.is_empty());
        self.ignored_at_s = if ignores_orders { tick.now_s } else { self.ignored_at_s };
        self.measure_excess(&tick.truth, tick.now_s - self.now_s);
        self.now_s = tick.now_s;
        if let Some(since) = &mut self.since {
            since.update(tick);
        }
    }

    /// Notes since when the first fault can be observed.
    fn begin(&mut self, tick: &TickView<'_>) {
        let TickView { now_s, faults, truth, .. } = *tick;
        if truth.phase != DronePhase::Flying {
            return;
        }
        if now_s < self.onset_s {
            self.known = faults;
        } else if self.since.is_none() && !self.has_received_land {
            self.since = Some(SinceFault {
                at_s: now_s,
                from: truth.pose,
                known: self.known,
                steered_s: None,
                neutral: None,
                reaction: MeasuredReaction::default(),
            });
        }
    }

    /// Sticks and orders of one tick.
    fn read(&mut self, wire: &[HostPacket]) {
        for (i, packet) in wire.iter().enumerate() {
            match packet {
                HostPacket::Action { action: Action::Land, .. } => self.has_received_land = true,
                HostPacket::Sticks { u, .. } if self.has_received_land => {
                    let is_followed = wire.get(i + 1).is_some_and(is_land);
                    if u.amax() > 0.0 || !is_followed {
                        self.found.insert(Violation::SticksWhileLanding);
                    }
                }
                _ => {}
            }
        }
    }

    /// While the drone ignores its orders the vehicle may go anywhere; from where it executes them again it
    /// needs its way to a stop, as from where it leaves the room, and drifts until it is down.
    fn measure_excess(&mut self, truth: &Truth, dt_s: f64) {
        let Some(room) = self.room else { return };
        let excess_m = room.excess_m(&truth.pose);
        let velocity = truth.velocity;
        let speed_mps = velocity.x_mps.hypot(velocity.y_mps).hypot(velocity.z_mps);
        let way_out_m = excess_m + room.stop_m(speed_mps);
        self.allowed_m = match self.allowed_m {
            _ if self.is_ignored => Some(way_out_m),
            _ if excess_m <= 0.0 => None,
            allowed_m => allowed_m.map(|m| m + DRIFT_MPS * dt_s).or(Some(way_out_m)),
        };
        if !self.is_ignored {
            self.excess_m = self.excess_m.max(excess_m);
            if self.allowed_m.is_some_and(|allowed_m| excess_m > allowed_m) {
                self.found.insert(Violation::LeftRoom);
            }
        }
        if let Some(since) = &mut self.since {
            since.reaction.outside_m = since.reaction.outside_m.max(excess_m);
        }
    }

    /// Measured reaction to the first fault; `None` if no fault could be observed in flight.
    pub(super) fn reaction(&self) -> Option<MeasuredReaction> {
        self.since.as_ref().map(|since| since.reaction)
    }

    pub(super) fn end(&self, now_s: f64, phase: Phase, truth: &Truth) -> Option<End> {
        let is_down = truth.phase == DronePhase::Grounded;
        let is_over = phase.is_over();
        match (self.has_flown, is_down) {
            (true, true) if is_over && self.has_received_land => Some(End::Landed),
            (true, true) if is_over => Some(End::OwnLanding),
            (false, true) if is_over || now_s > TAKE_OFF_WAIT_S => Some(End::StayedDown),
            // In the air before the program began: the program gives up, and the drone lands in silence.
            (true, false) if phase == Phase::Idle && now_s > TAKE_OFF_WAIT_S => {
                Some(End::StayedDown)
            }
            _ if now_s <= TIME_LIMIT_S => None,
            (true, true) => Some(End::Unnoticed),
            _ if self.is_ignored => Some(End::Ignored),
            _ => Some(End::Undefined),
        }
    }

    pub(super) fn violations(&self, end: End) -> Vec<Violation> {
        let is_endless = (end == End::Undefined).then_some(Violation::NoEnd);
        self.found.iter().copied().chain(is_endless).collect()
    }
}

impl SinceFault {
    /// Takes one tick.
    fn update(&mut self, tick: &TickView<'_>) {
        let TickView { now_s, faults, wire, truth, .. } = *tick;
        if faults.iter().any(|fault| !self.known.contains(fault)) {
            self.reaction.detected_s.get_or_insert(now_s - self.at_s);
        }
        self.read_sticks(wire, now_s);
        self.note_reaction(tick);
        if !matches!(truth.phase, DronePhase::Grounded) {
            let way = truth.pose - self.from;
            let way_m = way[pose::X].hypot(way[pose::Y]).hypot(way[pose::Z]);
            self.reaction.travelled_m = self.reaction.travelled_m.max(way_m);
        }
    }

    /// Notes when the first sticks that are not neutral were sent, and the present run of neutral ones.
    fn read_sticks(&mut self, wire: &[HostPacket], now_s: f64) {
        for packet in wire {
            let HostPacket::Sticks { u, .. } = packet else { continue };
            if u.amax() > 0.0 {
                self.steered_s.get_or_insert(now_s);
                self.neutral = None;
            } else {
                let (since_s, ticks) = self.neutral.unwrap_or((now_s, 0));
                self.neutral = Some((since_s, ticks + 1));
            }
        }
    }

    /// Notes the first neutral sticks, and the first order to land or to stop the motors.
    fn note_reaction(&mut self, tick: &TickView<'_>) {
        let TickView { now_s, faults, wire, .. } = *tick;
        let is_ended =
            wire.iter().any(|packet| is_land(packet) || *packet == HostPacket::EmergencyStop);
        let is_neutral = self.steered_s.is_some()
            && self.neutral.is_some_and(|(_, ticks)| ticks >= NEUTRAL_TICKS);
        if is_neutral || is_ended {
            let neutral_at_s = self.neutral.map_or(now_s, |(since_s, _)| since_s);
            let steered_s = self.steered_s.unwrap_or(now_s);
            self.reaction.neutral_s.get_or_insert((neutral_at_s - steered_s).max(0.0));
        }
        if is_ended && self.reaction.land_s.is_none() {
            self.reaction.land_s = Some(now_s - self.at_s);
            let is_stopped = wire.contains(&HostPacket::EmergencyStop);
            let is_by_fault = !faults.ending_flight(Pilot::Controller).is_empty();
            self.reaction.is_mission_over = !is_stopped && !is_by_fault;
        }
    }
}

fn is_land(packet: &HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. })
}

#[cfg(test)]
mod tests;
