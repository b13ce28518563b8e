//! Many simulated flights with random faults: is there one that ends badly?
//!
//! Owns which faults a seed draws, and the three things that no flight may do: leave the room further
//! than it takes to stop, get sticks while it lands, go on for ever. Judged by where the drone really
//! was and by what went over the wire.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::ops::Range;

use anyhow::Result;
use indicatif::ProgressBar;
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use tello_control::{Phase, Room};
use tello_io::tello::protocol::{Action, HostPacket};
use tello_sim::random::{Purpose, Random};
use tello_sim::{Fault, Phase as DronePhase, ScriptedFault, SimTable, Truth};

use crate::cycle::FlightTable;
use crate::virtual_time::VirtualFlight;

/// Most faults of a flight.
const FAULTS_MAX: f64 = 3.0;
/// Faults begin within this time after the start. s
const BEGIN_MAX_S: f64 = 30.0;
/// Shortest and longest fault but those that stay; the logarithm is uniform. s
const LENGTH_S: [f64; 2] = [0.1, 10.0];
/// Share of the faults that stay.
const STAYING_SHARE: f64 = 0.2;
/// A fault that stays. s
const FOR_EVER_S: f64 = 1e3;
/// Time after which a flight without an end is one of those sought. s
const TIME_LIMIT_S: f64 = 120.0;
/// How long a drone that never took off is waited for. s
const PATIENCE_S: f64 = 40.0;

/// How a flight ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum End {
    /// Told to land, and down.
    Landed,
    /// Brought down by the drone's own net: it heard nothing any more.
    OwnLanding,
    /// Never took off.
    StayedDown,
    /// None of these in time.
    Undefined,
}

/// What no flight may do.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Violation {
    /// Further outside of the room than it takes to stop from where it left it, while it could hear.
    LeftRoom,
    /// Sticks on the wire after an order to land.
    SticksWhileLanding,
    /// No end in time.
    NoEnd,
}

/// One flight of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(crate) struct CampaignRow {
    seed: u64,
    faults: Vec<ScriptedFault>,
    end: End,
    /// Furthest outside of the room while the drone could hear. m
    excess_m: f64,
    violations: Vec<Violation>,
}

/// All flights of a campaign.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub(crate) struct Campaign {
    flights: Vec<CampaignRow>,
}

impl Campaign {
    /// The flights of `seeds`, in their order, on all threads.
    ///
    /// # Errors
    /// A setting that breaks its rule.
    pub(crate) fn fly(
        flight: &FlightTable,
        sim: &SimTable,
        seeds: Range<u64>,
        bar: &ProgressBar,
    ) -> Result<Self> {
        let fly = |seed| {
            let row = fly(flight, sim, seed);
            bar.inc(1);
            row
        };
        let flights: Result<Vec<CampaignRow>> = seeds.into_par_iter().map(fly).collect();
        Ok(Self { flights: flights? })
    }

    /// Whether no flight did what none may do.
    pub(crate) fn is_clean(&self) -> bool {
        self.flights.iter().all(|flight| flight.violations.is_empty())
    }
}

/// Faults without values.
const PLAIN: [Fault; 12] = [
    Fault::MocapLost,
    Fault::MocapSilent,
    Fault::MocapGhost,
    Fault::MocapFrozen,
    Fault::MocapNan,
    Fault::MocapFar,
    Fault::MocapAside,
    Fault::MocapFlipped,
    Fault::MocapMillimetres,
    Fault::MocapOther,
    Fault::DroneDeaf,
    Fault::DroneMute,
];

/// The faults that `seed` draws.
fn draw(seed: u64) -> Vec<ScriptedFault> {
    let mut random = Random::new(seed, Purpose::Campaign);
    let count = random.between(1.0, FAULTS_MAX + 1.0).floor();
    let mut script = Vec::new();
    while (script.len() as f64) < count {
        let place = random.between(0.0, PLAIN.len() as f64);
        let fault = (0..).zip(PLAIN).take_while(|(i, _)| f64::from(*i) <= place).last();
        let fault = fault.map(|(_, fault)| fault);
        let [short_s, long_s] = LENGTH_S.map(f64::ln);
        let length_s = random.between(short_s, long_s).exp();
        let for_s = if random.chance(STAYING_SHARE) { FOR_EVER_S } else { length_s };
        let from_s = random.between(0.0, BEGIN_MAX_S);
        script.extend(fault.map(|fault| ScriptedFault { fault, from_s, for_s }));
    }
    script
}

/// The flight of `seed`, from the ground to its end.
fn fly(flight: &FlightTable, sim: &SimTable, seed: u64) -> Result<CampaignRow> {
    let faults = draw(seed);
    let sim = SimTable { faults: faults.clone(), ..sim.clone() };
    let room = flight.cycle.supervisor.room.as_ref().map(Room::try_from).transpose()?;
    let mut judge = Judge::new(room, &faults);
    let mut virtual_flight = VirtualFlight::new(flight, &sim, seed)?.without_plan();
    let end = loop {
        let phase = virtual_flight.tick()?.phase();
        let now_s = virtual_flight.inbox().now.seconds();
        let truth = virtual_flight.truth();
        judge.look(now_s, &truth, virtual_flight.wire());
        if let Some(end) = judge.end(now_s, phase, &truth) {
            break end;
        }
    };
    Ok(CampaignRow {
        seed,
        faults,
        end,
        excess_m: judge.excess_m,
        violations: judge.violations(end),
    })
}

/// What is remembered of a flight to judge it by.
struct Judge {
    room: Option<Room>,
    /// When the drone is deaf for the first time: from then on it goes where it wants. s
    deaf_from_s: f64,
    has_flown: bool,
    is_told_to_land: bool,
    has_sticks_while_landing: bool,
    excess_m: f64,
    /// Way to a stop when the drone left the room. m
    stop_m: f64,
}

impl Judge {
    fn new(room: Option<Room>, faults: &[ScriptedFault]) -> Self {
        let deaf = faults.iter().filter(|entry| entry.fault == Fault::DroneDeaf);
        Self {
            room,
            deaf_from_s: deaf.map(|entry| entry.from_s).fold(f64::INFINITY, f64::min),
            has_flown: false,
            is_told_to_land: false,
            has_sticks_while_landing: false,
            excess_m: 0.0,
            stop_m: 0.0,
        }
    }

    fn look(&mut self, now_s: f64, truth: &Truth, wire: &[HostPacket]) {
        self.has_flown |= truth.phase == DronePhase::Flying;
        let has_sticks = wire.iter().any(|packet| matches!(packet, HostPacket::Sticks { .. }));
        self.has_sticks_while_landing |= has_sticks && self.is_told_to_land;
        let is_landing =
            |packet: &HostPacket| matches!(packet, HostPacket::Action { action: Action::Land, .. });
        self.is_told_to_land |= wire.iter().any(is_landing);
        let Some(room) = self.room.filter(|_| now_s < self.deaf_from_s) else { return };
        let excess_m = room.excess_m(&truth.pose);
        if excess_m > 0.0 && self.excess_m <= 0.0 {
            let velocity = truth.velocity;
            let speed_mps = velocity.x_mps.hypot(velocity.y_mps).hypot(velocity.z_mps);
            self.stop_m = room.stop_m(speed_mps);
        }
        self.excess_m = self.excess_m.max(excess_m);
    }

    fn end(&self, now_s: f64, phase: Phase, truth: &Truth) -> Option<End> {
        let is_down = truth.phase == DronePhase::Grounded;
        let is_over = matches!(phase, Phase::Landed | Phase::Fault | Phase::Cut);
        match (self.has_flown, is_down) {
            (true, true) if is_over && self.is_told_to_land => Some(End::Landed),
            (true, true) if is_over => Some(End::OwnLanding),
            (false, true) if is_over || now_s > PATIENCE_S => Some(End::StayedDown),
            _ => (now_s > TIME_LIMIT_S).then_some(End::Undefined),
        }
    }

    fn violations(&self, end: End) -> Vec<Violation> {
        [
            (self.excess_m > self.stop_m, Violation::LeftRoom),
            (self.has_sticks_while_landing, Violation::SticksWhileLanding),
            (end == End::Undefined, Violation::NoEnd),
        ]
        .into_iter()
        .filter_map(|(is_so, violation)| is_so.then_some(violation))
        .collect()
    }
}

impl Display for Campaign {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let mut ends: BTreeMap<End, u64> = BTreeMap::new();
        for flight in &self.flights {
            *ends.entry(flight.end).or_default() += 1;
        }
        writeln!(f, "flights       {}", self.flights.len())?;
        for (end, count) in ends {
            writeln!(f, "{count:>13}  {end:?}")?;
        }
        let outside = self.flights.iter().filter(|flight| flight.excess_m > 0.0).count();
        let furthest_m = self.flights.iter().map(|flight| flight.excess_m).fold(0.0, f64::max);
        writeln!(f, "outside       {outside} flights left the room, by {furthest_m:.2} m at most")?;
        for flight in self.flights.iter().filter(|flight| !flight.violations.is_empty()) {
            writeln!(
                f,
                "seed {:<8} {:?}, {:?}, {:.2} m outside, {:?}",
                flight.seed, flight.violations, flight.end, flight.excess_m, flight.faults
            )?;
        }
        let bad = self.flights.iter().filter(|flight| !flight.violations.is_empty()).count();
        writeln!(f, "violations    {bad}")
    }
}
