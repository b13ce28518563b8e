//! Contacts with walls and obstacles: would braking have avoided them?
//!
//! Owns the flights beside them and the bound by braking. Backwards from a contact the newest moment is sought from
//! which braking at the limit of the vehicle keeps clear. The world of that moment is flown again for that, with its
//! disturbance, its faults and the sticks in transit: the dead time, an outage or a second controller count as they
//! are.

use std::collections::VecDeque;

use anyhow::Result;
use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, Sticks, pose};
use tello_eval::metrics::Surroundings;
use tello_flight::cycle::FlightTable;
use tello_io::clock::TimeOfDay;
use tello_io::mocap::ABOUT_Z;
use tello_io::tello::protocol::HostPacket;
use tello_sim::campaign::{Draw, Family, draw};
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{DT_S, DronePhase, InjectedFault, PasserTable, SimTable, World};

/// Flights end here. s
const TIME_LIMIT_S: f64 = 60.0;

/// Earlier than this before a contact the vehicle need not brake for it. s
const BACK_S: f64 = 4.0;

/// Between two moments from which braking is tried. steps
const EVERY_STEPS: u64 = 5;

/// For this long after the contact a vehicle that has braked has to be clear. s
const CLEAR_S: f64 = 1.0;

/// Braking times that are tried, in units of the speed over the largest acceleration.
const BRAKINGS: [f64; 5] = [0.0, 0.5, 0.75, 1.0, 1.25];

/// A pose that is further than this from the truth, or turned by more, deceives. m, rad
const FALSE_M: f64 = 0.1;
const FALSE_RAD: f64 = 0.3;

/// Without a pose for longer than this, where the vehicle is cannot be known to a decimetre: two standard deviations of
/// its disturbance velocity. s
const NO_POSE_S: f64 = 1.0;

/// Kind of surface that was touched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Touched {
    /// A wall of the room.
    Wall,
    /// An obstacle.
    Obstacle,
}

/// Whether a contact could have been avoided by braking at the limit of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Avoidability {
    /// Braking would have helped from a moment on in which the program knew where the vehicle was.
    Avoidable,
    /// Nothing helped after the last of the faults and turns of the obstacle had begun.
    TooLate,
    /// At the last moment the newest pose was false, or the program stood still.
    FalsePose,
    /// At the last moment there had been no pose for a second.
    NoPose,
    /// No braking of the last seconds helped.
    Unavoidable,
}

/// The first contact of a flight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Contact {
    /// When. s
    pub(super) at_s: f64,
    /// With what.
    pub(super) touched: Touched,
    /// Whether braking would have helped.
    pub(super) avoidability: Avoidability,
    /// Time from the newest moment from which braking helps to the contact; `None` if there is none. s, > 0
    pub(super) ahead_s: Option<f64>,
}

/// Result of one flight beside walls and obstacles.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ContactFlight {
    /// Families of the faults in the flight; empty without faults.
    pub(super) families: Vec<Family>,
    /// Whether all targets of the mission were reached.
    pub(super) is_finished: bool,
    /// First contact in the air; `None` without one.
    pub(super) contact: Option<Contact>,
}

/// A moment from which braking may be tried.
#[derive(Debug)]
struct Moment {
    step: u64,
    world: World,
    knowledge: Knowledge,
}

/// Knowledge of the pose that the program could have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Knowledge {
    True,
    False,
    None,
}

/// The flight of `seed`, with faults of all families or without faults, up to its first contact or its end.
///
/// # Errors
/// A setting that breaks its rule.
pub(super) fn fly_to_contact(
    flight: &FlightTable,
    settings: &SimTable,
    has_faults: bool,
    seed: u64,
) -> Result<ContactFlight> {
    let drawn = has_faults.then(|| draw(seed, settings, None));
    let (families, sim) =
        drawn.map_or((Vec::new(), settings.clone()), |Draw { families, sim, .. }| (families, sim));
    let scene = Scene { around: Surroundings::of(&flight.cycle)?, passer: sim.passer, seed };
    let mut watch = Watch::new(scene, &sim);
    let mut virtual_flight = VirtualFlight::new(flight, &sim, seed)?.without_plan();
    let mut is_finished = false;
    for _ in 0..steps(TIME_LIMIT_S) {
        watch.remember(virtual_flight.world());
        let out = virtual_flight.tick()?;
        is_finished |= out.targets_reached > 0 && out.targets_reached == out.target_number;
        if out.phase().is_over() {
            break;
        }
        let contact = watch.contact(virtual_flight.world());
        if contact.is_some() {
            return Ok(ContactFlight { families, is_finished, contact });
        }
    }
    Ok(ContactFlight { families, is_finished, contact: None })
}

/// Room, obstacles and second object of a flight.
#[derive(Debug)]
struct Scene {
    around: Surroundings,
    passer: Option<PasserTable>,
    seed: u64,
}

impl Scene {
    /// Surface that the vehicle touches in `world`.
    fn touched(&self, world: &World) -> Option<Touched> {
        let truth = world.truth();
        if truth.phase == DronePhase::Grounded {
            return None;
        }
        let moving = self.passer.map(|passer| passer.place(world.step(), self.seed));
        let least = self.around.at(&truth.pose, moving);
        let is_behind = |distance_m: Option<f64>| distance_m.is_some_and(|m| m < 0.0);
        match (is_behind(least.wall_m), is_behind(least.obstacle_m)) {
            (true, _) => Some(Touched::Wall),
            (false, true) => Some(Touched::Obstacle),
            (false, false) => None,
        }
    }

    /// Whether the vehicle keeps clear up to `until`, if it brakes from now on.
    fn is_clear_by_braking(&self, world: &World, until: u64) -> bool {
        let plant = world.drone().plant();
        let (dead_time_s, accel_mps2) = plant.limits();
        // The velocity when the first stick acts: by the sticks in transit.
        let mut then = world.clone();
        for _ in 0..steps(dead_time_s) {
            steer(&mut then, Sticks::zeros());
        }
        let truth = then.truth();
        let (x_mps, y_mps) = (truth.velocity.x_mps, truth.velocity.y_mps);
        let speed_mps = x_mps.hypot(y_mps);
        let against = [-x_mps, -y_mps].map(|v| v / speed_mps.max(f64::MIN_POSITIVE));
        let u = plant.sticks_towards(truth.pose[pose::THETA], against);
        BRAKINGS.into_iter().any(|part| {
            let braking_steps = steps(part * speed_mps / accel_mps2);
            let mut braked = world.clone();
            let begin = braked.step();
            while braked.step() < until {
                let is_braking = braked.step() < begin + braking_steps;
                steer(&mut braked, if is_braking { u } else { Sticks::zeros() });
                if self.touched(&braked).is_some() {
                    return false;
                }
            }
            true
        })
    }
}

/// One step of `world` with these sticks.
fn steer(world: &mut World, u: Sticks) {
    world.receive(&HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() });
    world.advance();
}

/// History of a flight, by which its contact is judged.
#[derive(Debug)]
struct Watch {
    scene: Scene,
    object: String,
    onsets: Vec<u64>,
    /// True poses from the start on.
    truths: Vec<Pose>,
    /// Newest step of which a pose of the drone arrived, and whether it was true.
    newest: Option<(u64, bool)>,
    link_was_up: bool,
    moments: VecDeque<Moment>,
}

impl Watch {
    fn new(scene: Scene, sim: &SimTable) -> Self {
        let onsets = sim.faults.iter().map(|fault| steps(fault.from_s)).collect();
        Self {
            scene,
            object: sim.object.clone(),
            onsets,
            truths: Vec::new(),
            newest: None,
            link_was_up: true,
            moments: VecDeque::new(),
        }
    }

    /// Notes the world as it is before a tick.
    fn remember(&mut self, world: &World) {
        let (step, truth) = (world.step(), world.truth());
        self.truths.push(truth.pose);
        for frame in world.frames().filter(|frame| frame.object == self.object) {
            let Some(body) = frame.body else { continue };
            let taken = u64::from(frame.number);
            let was = self.truths[usize::try_from(taken).unwrap_or(0).min(self.truths.len() - 1)];
            let [dx, dy, dz] = std::array::from_fn(|i| body.pos_v[i] - was[pose::X + i]);
            let is_near = dx.hypot(dy).hypot(dz) <= FALSE_M;
            let is_turned = wrap(body.angles[ABOUT_Z] - was[pose::THETA]).abs() > FALSE_RAD;
            self.newest = Some((taken, is_near && !is_turned));
        }
        if self.link_was_up && !truth.link_is_up {
            self.onsets.push(step);
        }
        self.link_was_up = truth.link_is_up;
        if step.is_multiple_of(EVERY_STEPS) {
            self.moments.push_back(Moment {
                step,
                world: world.clone(),
                knowledge: self.knowledge(world),
            });
        }
        while self.moments.front().is_some_and(|one| is_longer(one.step, step, BACK_S)) {
            self.moments.pop_front();
        }
    }

    fn knowledge(&self, world: &World) -> Knowledge {
        match self.newest {
            _ if world.has_fault(InjectedFault::ControlStalled) => Knowledge::False,
            Some((_, false)) => Knowledge::False,
            Some((taken, true)) if !is_longer(taken, world.step(), NO_POSE_S) => Knowledge::True,
            _ => Knowledge::None,
        }
    }

    /// The contact that the vehicle has in `world`, judged.
    fn contact(&self, world: &World) -> Option<Contact> {
        let touched = self.scene.touched(world)?;
        let at = world.step();
        let until = at + steps(CLEAR_S);
        let helps = |one: &&Moment| self.scene.is_clear_by_braking(&one.world, until);
        let last = self.moments.iter().rev().find(helps);
        let avoidability = match last {
            None => Avoidability::Unavoidable,
            Some(last) if self.changes_between(last.step, at) => Avoidability::TooLate,
            Some(Moment { knowledge: Knowledge::True, .. }) => Avoidability::Avoidable,
            Some(Moment { knowledge: Knowledge::False, .. }) => Avoidability::FalsePose,
            Some(Moment { knowledge: Knowledge::None, .. }) => Avoidability::NoPose,
        };
        let ahead_s = last.map(|last| (at - last.step) as f64 * DT_S);
        Some(Contact { at_s: at as f64 * DT_S, touched, avoidability, ahead_s })
    }

    /// Whether a fault begins or the obstacle turns after `from`, up to `to`.
    fn changes_between(&self, from: u64, to: u64) -> bool {
        let turns =
            |passer: PasserTable| (from..to).any(|step| passer.turns_after(step, self.scene.seed));
        self.onsets.iter().any(|onset| (from + 1..=to).contains(onset))
            || self.scene.passer.is_some_and(turns)
    }
}

/// Whether the steps between take longer than `limit_s`.
fn is_longer(from: u64, to: u64, limit_s: f64) -> bool {
    to.saturating_sub(from) as f64 * DT_S > limit_s
}

fn steps(time_s: f64) -> u64 {
    horizon_model::steps(time_s, DT_S) as u64
}

#[cfg(test)]
mod tests;
