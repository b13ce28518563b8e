//! A simulated flight, tick by tick, with what went over the wire.

use std::path::Path;

use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Pose, Sticks};
use tello_flight::cycle::{self, FlightTable, Operator, Tick};
use tello_flight::{Fault, MissionTable, Phase, Pilot, Start};
use tello_io::config;
use tello_io::tello::protocol::{Action, HostPacket};
use tello_sim::plant::STANDING_M;
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{InjectedFault, Profile, ScriptedFault, SimTable};

/// When the faults begin: the controller flies the mission. s
pub(crate) const FAULT_AT_S: f64 = 12.0;

/// One tick of a flight.
#[derive(Debug, Clone)]
pub(crate) struct Moment {
    pub(crate) at_s: f64,
    pub(crate) phase: Phase,
    pub(crate) pilot: Option<Pilot>,
    pub(crate) faults: Vec<Fault>,
    /// Largest stick on the wire in this tick; `None` if there were no sticks. 1
    pub(crate) stick: Option<f64>,
    /// Sticks on the wire in this tick that a landing allows: neutral, with LAND or an emergency stop directly behind.
    pub(crate) ends_softly: bool,
    /// The sticks that were decided.
    pub(crate) u_sent: Sticks,
    pub(crate) landings: usize,
    pub(crate) take_offs: usize,
    pub(crate) emergency_stops: usize,
    /// Where the drone really was.
    pub(crate) pose: Pose,
    pub(crate) drone: tello_sim::DronePhase,
}

/// A flight that was flown, and how.
pub(crate) struct Story {
    pub(crate) moments: Vec<Moment>,
}

/// The built-in settings with their square, and a simulator without chance.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn settings(script: &[ScriptedFault]) -> (FlightTable, SimTable) {
    let (fly, _) = config::fly(None, None).unwrap();
    let mut sim = tello_sim::settings(None).unwrap();
    sim.profile = Profile::Clean;
    sim.faults = script.to_vec();
    (config::flight(&fly, mission("big_square.json"), Start::Grounded), sim)
}

/// The mission of this name in `configs/missions`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn mission(name: &str) -> MissionTable {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions");
    config::mission(&folder.join(name)).unwrap()
}

/// `fault` from [`FAULT_AT_S`] on.
pub(crate) fn scripted(fault: InjectedFault, for_s: f64) -> [ScriptedFault; 1] {
    [ScriptedFault { fault, from_s: FAULT_AT_S, for_s }]
}

/// Flies until the drone stands again, at most for `seconds`. `person` acts before each tick.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn fly(
    settings: &(FlightTable, SimTable),
    seconds: f64,
    person: impl FnMut(f64, &mut VirtualFlight),
) -> Story {
    fly_with(cycle::build(&settings.0).unwrap(), settings, seconds, person)
}

/// As [`fly`], with this cycle.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
pub(crate) fn fly_with(
    cycle: Box<dyn Tick>,
    (flight, sim): &(FlightTable, SimTable),
    seconds: f64,
    mut person: impl FnMut(f64, &mut VirtualFlight),
) -> Story {
    let mut virtual_flight = VirtualFlight::with_cycle(cycle, flight, sim, 5).unwrap();
    let mut moments: Vec<Moment> = vec![];
    let mut has_flown = false;
    for step in 0_u32.. {
        let at_s = f64::from(step) * flight.cycle.dt_s;
        person(at_s, &mut virtual_flight);
        let out = virtual_flight.tick().unwrap();
        let (decision, u_sent) = (out.decision.unwrap(), out.u_sent);
        let wire = virtual_flight.wire();
        let count = |what: fn(&HostPacket) -> bool| wire.iter().filter(|one| what(one)).count();
        let sticks = wire.iter().filter_map(|packet| match packet {
            HostPacket::Sticks { u, .. } => Some(u.amax()),
            _ => None,
        });
        let truth = virtual_flight.truth();
        moments.push(Moment {
            at_s,
            phase: decision.phase,
            pilot: decision.pilot,
            faults: decision.faults.iter().collect(),
            stick: sticks.reduce(maximum),
            ends_softly: wire.iter().enumerate().all(|(index, packet)| match packet {
                HostPacket::Sticks { u, .. } => {
                    *u == Sticks::zeros() && wire.get(index + 1).is_some_and(is_ending)
                }
                _ => true,
            }),
            u_sent,
            landings: count(|one| matches!(one, HostPacket::Action { action: Action::Land, .. })),
            take_offs: count(|one| {
                matches!(one, HostPacket::Action { action: Action::TakeOff, .. })
            }),
            emergency_stops: count(|one| matches!(one, HostPacket::EmergencyStop)),
            pose: truth.pose,
            drone: truth.phase,
        });
        has_flown |= truth.phase == tello_sim::DronePhase::Flying;
        let is_down = has_flown && truth.phase == tello_sim::DronePhase::Grounded;
        let is_over = decision.phase.is_over() && is_down;
        if is_over || at_s >= seconds {
            break;
        }
    }
    Story { moments }
}

fn is_ending(packet: &HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. } | HostPacket::EmergencyStop)
}

/// A flight with nobody at the controls.
pub(crate) fn fly_alone(settings: &(FlightTable, SimTable), seconds: f64) -> Story {
    fly(settings, seconds, |_, _| {})
}

/// A person who asks for `operator` from `from_s` on.
pub(crate) fn asks(operator: Operator, from_s: f64) -> impl FnMut(f64, &mut VirtualFlight) {
    move |at_s, flight| {
        if at_s >= from_s {
            flight.set_operator(operator);
        }
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
impl Story {
    pub(crate) fn last(&self) -> &Moment {
        self.moments.last().unwrap()
    }

    pub(crate) fn has(&self, fault: Fault) -> bool {
        self.moments.iter().any(|moment| moment.faults.contains(&fault))
    }

    /// Time of the first moment from `from_s` on that is as asked for. s
    pub(crate) fn first(&self, from_s: f64, is_it: impl Fn(&Moment) -> bool) -> Option<f64> {
        self.moments
            .iter()
            .find(|moment| moment.at_s >= from_s && is_it(moment))
            .map(|moment| moment.at_s)
    }

    /// Time of the last deflected stick on the wire. s
    pub(crate) fn last_stick_s(&self) -> Option<f64> {
        let steers = |moment: &&Moment| moment.stick.is_some_and(|stick| stick > 0.0);
        self.moments.iter().rfind(steers).map(|moment| moment.at_s)
    }

    /// Largest change of a stick from tick to tick between these times. 1
    pub(crate) fn jump(&self, from_s: f64, to_s: f64) -> f64 {
        let pairs = self.moments.windows(2).filter(|pair| (from_s..to_s).contains(&pair[0].at_s));
        pairs.map(|pair| amax(&(pair[1].u_sent - pair[0].u_sent))).fold(0.0, maximum)
    }

    /// Asserts the rules of every flight.
    pub(crate) fn assert_sound(&self) {
        let landing_at_s =
            self.first(0.0, |moment| moment.landings > 0 || moment.emergency_stops > 0);
        for moment in &self.moments {
            if landing_at_s.is_some_and(|at_s| moment.at_s >= at_s) {
                assert!(moment.ends_softly, "sticks after a landing: {moment:?}");
                assert_eq!(moment.take_offs, 0, "a take-off after a landing: {moment:?}");
            }
        }
        let steered = self.moments.iter().filter(|moment| moment.stick.is_some_and(|u| u > 0.0));
        // Half a second: a heading that is wrong lands within one.
        assert!(steered.count() > 25, "the controller never flew");
    }

    /// [`Story::assert_landed_after`] of a fault that began at [`FAULT_AT_S`].
    pub(crate) fn assert_landed_by(&self, fault: Fault, within_s: [f64; 2]) {
        self.assert_landed_after(FAULT_AT_S, fault, within_s);
    }

    /// The flight was ended by `fault`, `within_s` after `from_s`, by a landing that was flown to its end.
    pub(crate) fn assert_landed_after(&self, from_s: f64, fault: Fault, within_s: [f64; 2]) {
        self.assert_sound();
        assert!(self.has(fault), "{fault:?} is missing at the end: {:?}", self.last());
        let landing_at_s = self.first(0.0, |moment| moment.landings > 0).unwrap();
        let after_s = landing_at_s - from_s;
        let [soonest_s, latest_s] = within_s;
        assert!((soonest_s..=latest_s).contains(&after_s), "landing after {after_s} s");
        self.assert_down();
    }

    pub(crate) fn assert_down(&self) {
        let height_m = self.last().pose[horizon_model::rows::pose::Z];
        assert!(height_m < STANDING_M + 0.01, "still {height_m} m high: {:?}", self.last());
        assert_eq!(self.last().drone, tello_sim::DronePhase::Grounded, "{:?}", self.last());
    }
}
