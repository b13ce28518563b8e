//! A flight in virtual time: the tick and the simulator, connected by the bytes of the real links.
//!
//! Owns the hand-over only. Poses are relay lines, sticks and orders are packets of the Tello's
//! protocol, as between sockets. One seed, one flight, bit for bit: nothing here reads a clock.

use std::sync::Arc;

use anyhow::Result;
use horizon_model::rows::{Pose, Sticks, pose};
use tello_flight::Mission;
use tello_io::clock::TimeNs;
use tello_io::mocap::{MocapCounters, MocapSettings, MocapStream, Sighting};
use tello_io::tello::protocol::{DronePacket, HostPacket};
use tello_io::tello::{DroneStatus, LinkCounters, Session};

use crate::{InjectedFault, PasserTable, SimStart, SimTable, Truth, World};

use tello_flight::cycle::{
    self, FlightTable, Inbox, Operator, Outcome, ParameterEstimate, SIGHTINGS_MAX, Tick, Unwatched,
};

/// Ticks between two reports of the drone.
const STATUS_EVERY_TICKS: u64 = 5;

/// A controller and the world that it flies in.
pub struct VirtualFlight {
    cycle: Box<dyn Tick>,
    world: World,
    session: Session,
    relay: MocapStream,
    relay_counters: MocapCounters,
    inbox: Inbox,
    /// Observations and reports since the last tick; of more than one period after a stall.
    arrived: Arrived,
    u_hand: Option<Sticks>,
    out: Outcome,
    watch: Unwatched,
    late_at_poll: Option<u32>,
    dt_ns: f64,
    /// Heading at the start. rad
    theta_start: f64,
    true_pose: Pose,
    passer: Option<PasserTable>,
    seed: u64,
    /// Bytes on their way.
    bytes: Vec<u8>,
    /// Packets that the last tick sent to the drone.
    wire: Vec<HostPacket>,
}

/// Observations and reports that wait for the next tick.
#[derive(Debug, Default)]
struct Arrived {
    sightings: Vec<Sighting>,
    drone: Option<DroneStatus>,
    /// Periods without a tick.
    skipped: u64,
}

impl VirtualFlight {
    /// The flight of `seed`, nothing ticked yet. A flight that starts in the air starts near its
    /// first target, wherever `sim` would have it start.
    ///
    /// # Errors
    /// A setting that breaks its rule.
    pub fn new(flight: &FlightTable, sim: &SimTable, seed: u64) -> Result<Self> {
        Self::with_cycle(cycle::build(flight)?, flight, sim, seed)
    }

    /// The flight of `seed` with a cycle of the caller's, which [`cycle::build_with`] makes for another model than
    /// `flight` names.
    ///
    /// # Errors
    /// As [`VirtualFlight::new`].
    pub fn with_cycle(
        cycle: Box<dyn Tick>,
        flight: &FlightTable,
        sim: &SimTable,
        seed: u64,
    ) -> Result<Self> {
        let mut sim = sim.clone();
        if flight.start == tello_flight::Start::Airborne {
            let [x, y, z, theta] =
                Mission::new(&flight.mission, flight.cycle.dt_s)?.first_pose().into();
            sim.start = SimStart::Air { x, y, z, theta };
        }
        let out = cycle.new_outcome();
        let world = World::new(&sim, seed)?;
        let mut inbox = Inbox::new();
        inbox.operator = Operator::Fly;
        Ok(Self {
            cycle,
            true_pose: world.truth().pose,
            theta_start: world.truth().pose[pose::THETA],
            world,
            session: Session::binary(0, None, false, Arc::new(LinkCounters::default())),
            relay: MocapStream::new(&MocapSettings::relay(&sim.object)?),
            relay_counters: MocapCounters::default(),
            inbox,
            arrived: Arrived::default(),
            u_hand: None,
            out,
            watch: Unwatched::default(),
            late_at_poll: None,
            dt_ns: flight.cycle.dt_s * 1e9,
            passer: sim.passer,
            seed,
            bytes: Vec::new(),
            wire: Vec::new(),
        })
    }

    /// The flight with outcomes that lack the plan: for those who count what was flown.
    #[must_use]
    pub fn without_plan(self) -> Self {
        Self { watch: Unwatched::without_plan(), ..self }
    }

    /// An empty outcome of this flight's cycle, the shape of its log.
    pub fn new_outcome(&self) -> Outcome {
        self.cycle.new_outcome()
    }

    /// From now on the time of the solvers is over at this poll of each tick; `None`, as at first: at none.
    pub fn set_late_at_poll(&mut self, poll: Option<u32>) {
        self.late_at_poll = poll;
        self.watch = self.watch.late_at(poll);
    }

    /// Ticks once and lives through the period that follows.
    ///
    /// # Errors
    /// A line or packet of ours that is none: a bug in the protocol.
    pub fn tick(&mut self) -> Result<&Outcome> {
        let step = self.world.step();
        #[expect(clippy::cast_possible_truncation, reason = "hours of ns fit 53 bits")]
        let now = TimeNs((step as f64 * self.dt_ns).round() as i64);
        self.true_pose = self.world.truth().pose;
        self.bytes.clear();
        self.world.relay_line(&mut self.bytes);
        // A flight that begins in the air learns the clock from its first frame.
        let is_timed = self.relay_counters.sightings.get() > 0;
        self.relay.set_airborne(cycle::is_flight_phase(self.out.phase()) && is_timed);
        let sightings = &mut self.arrived.sightings;
        let push = |sighting| sightings.push(sighting);
        self.relay.push(&self.bytes, now, &self.relay_counters, push)?;
        if step.is_multiple_of(STATUS_EVERY_TICKS)
            && let Some(status) = self.world.flight_status()
        {
            if let Some(record) = self.world.log_record(0, self.theta_start) {
                self.answer(&record, now);
            }
            self.answer(&DronePacket::Status { sequence: 0, status }, now);
        }

        if self.world.has_fault(InjectedFault::ControlStalled) {
            self.arrived.skipped += 1;
        } else {
            self.control(step, now);
        }
        self.session.advance(now);
        self.deliver(now)?;
        self.world.advance();
        Ok(&self.out)
    }

    /// One tick of the control loop.
    fn control(&mut self, step: u64, now: TimeNs) {
        self.inbox.open(step, now);
        self.inbox.late_at_poll = self.late_at_poll;
        self.inbox.obstacle_w = self.passer.and_then(|passer| passer.seen(step, self.seed));
        self.inbox.manual = self.u_hand.map(Into::into);
        let excess = self.arrived.sightings.len().saturating_sub(SIGHTINGS_MAX);
        self.inbox.sightings.extend(self.arrived.sightings.drain(..).skip(excess));
        self.inbox.drone = self.arrived.drone.take();
        self.inbox.skipped = std::mem::take(&mut self.arrived.skipped);

        self.cycle.tick(&self.inbox, &mut { self.watch }, &mut self.out);

        if let Some(order) = self.out.order() {
            self.session.order(order, now);
        }
        self.session.observe_pose(self.out.pose_is_airborne(), now);
        self.session.approve(self.out.approved, now, now);
    }

    /// The inputs of the last tick.
    pub fn inbox(&self) -> &Inbox {
        &self.inbox
    }

    /// Parameter estimate of the flight, as [`Tick::parameter_estimate`].
    pub fn parameter_estimate(&self) -> Option<ParameterEstimate> {
        self.cycle.parameter_estimate()
    }

    /// Where the drone really was when the last tick began, world frame. m, rad
    pub fn true_pose(&self) -> Pose {
        self.true_pose
    }

    /// Where the second object really was when the last tick began, if there is one, world frame. m
    pub fn true_obstacle_w(&self) -> Option<[f64; 3]> {
        self.passer.map(|passer| passer.place(self.inbox.step, self.seed))
    }

    /// Sets the operator's request from now on; at first it is to fly.
    pub fn set_operator(&mut self, operator: Operator) {
        self.inbox.operator = operator;
    }

    /// The sticks of a person who steers from now on; `None`: the controller does. At first, `None`.
    pub fn set_manual(&mut self, u_hand: Option<Sticks>) {
        self.u_hand = u_hand;
    }

    /// Packets that the last tick sent to the drone, oldest first, whether they arrive or not.
    pub fn wire(&self) -> &[HostPacket] {
        &self.wire
    }

    /// The world as it is now.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The drone as it really is, now.
    pub fn truth(&self) -> Truth {
        self.world.truth()
    }

    /// Whether the drone ignores our sticks, and whether it would ignore an order to land, now.
    pub fn ignores(&self) -> [bool; 2] {
        [self.world.ignores_sticks(), self.world.ignores_land()]
    }

    /// Carries what the session wants sent to the drone, and its answers back.
    fn deliver(&mut self, now: TimeNs) -> Result<()> {
        self.wire.clear();
        for message in self.session.drain() {
            message.encode(&mut self.bytes);
            self.wire.push(HostPacket::decode(&self.bytes)?);
        }
        for sent in 0..self.wire.len() {
            let Some(packet) = self.wire.get(sent) else { break };
            if let Some(answer) = self.world.receive(packet) {
                self.answer(&answer, now);
            }
        }
        Ok(())
    }

    fn answer(&mut self, packet: &DronePacket, now: TimeNs) {
        packet.encode(&mut self.bytes);
        if let Some(status) = self.session.receive(&self.bytes, now) {
            self.arrived.drone = Some(status);
        }
    }
}

impl std::fmt::Debug for VirtualFlight {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("VirtualFlight").field("step", &self.inbox.step).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests;
