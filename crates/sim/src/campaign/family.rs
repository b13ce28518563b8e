//! Families of faults: what a flight of the campaign may draw, with its values.
//!
//! Owns the ranges. A family is a fault with a time or of the set-up, or a switch of the drone. One seed, one draw.

use std::f64::consts::{PI, TAU};

use clap::ValueEnum;
use horizon_model::rows::pose;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::random::{Purpose, Random};
use crate::{
    Axes, CancelledBy, FlyingFlag, InjectedFault, Measured, OutageBehaviour, Profile,
    ScriptedFault, SimStart, SimTable,
};

/// Most faults of a flight that have a time.
const FAULTS_MAX: f64 = 3.0;
/// Faults begin within this time after the start. s
const BEGIN_MAX_S: f64 = 18.0;
/// Shortest and longest fault but those that stay; the logarithm is uniform. s
const LENGTH_S: [f64; 2] = [0.1, 10.0];
/// Fraction of the faults that stay.
const STAYING: f64 = 0.3;
/// A fault that stays. s
const FOR_EVER_S: f64 = 1e3;
/// Probability of each family that is there from the start: a set-up or a switch of the drone.
const LASTING: f64 = 0.04;
/// Height of a drone that flies at the start. m
const ALOFT_M: f64 = 1.2;

/// Something that is wrong in a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
#[value(rename_all = "snake_case")]
#[derive(Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Family {
    /// The object is lost.
    Lost,
    /// The mocap is silent.
    Silent,
    /// The last pose is repeated.
    Frozen,
    /// The pose is not a number.
    Nan,
    /// A fixed pose in the room.
    Fixed,
    /// The position is 3 or 10 m away.
    Far,
    /// The position comes in millimetres.
    Millimetres,
    /// Only another subject is seen.
    OtherSubject,
    /// Another object that stands still, 0 to 3 m away, with 0 to 5 mm of noise.
    Ghost,
    /// The pose is stuck under 0.01 to 5 mm of noise.
    Stuck,
    /// One or two coordinates of the position are stuck under up to 5 mm of noise, the others are right.
    AxesStuck,
    /// Another object that moves, such as a person.
    Walker,
    /// Another object leaves the place of the drone at 0.05 to 1.5 m/s, nearly straight.
    Leaving,
    /// The horizontal position drifts by 0.02 to 1 m/s.
    Drift,
    /// The height drifts by 0.02 to 0.5 m/s.
    HeightDrift,
    /// The heading drifts by 0.02 to 1 rad/s.
    HeadingDrift,
    /// The heading steps by 0.3 to 3.14 rad.
    HeadingStep,
    /// Noise grows by up to 0.2 m/s and 0.4 rad/s.
    Noise,
    /// The object is lost for a part of every period.
    Occluded,
    /// The frames arrive 0.05 to 3 s late.
    Lag,
    /// The age of the frames grows by 0.02 to 0.9 s/s.
    LagRamp,
    /// The connection carries 10 to 98 % of the frames.
    SlowLink,
    /// The drone hears nothing.
    Deaf,
    /// The drone reports nothing.
    Mute,
    /// The drone's sticks stay as they are.
    StuckSticks,
    /// The drone refuses to land for a time, or for ever.
    LandRefused,
    /// The drone starts anew and levels.
    Reboot,
    /// Another controller sends sticks.
    SecondController,
    /// The control loop stands still for up to 0.4 s, or for ever.
    Stall,
    /// The drone does not obey the order to stop the motors.
    NoEmergency,
    /// A landing goes on with the last sticks.
    LandingKeepsSticks,
    /// The first orders to land, or those of the first seconds, are not heard.
    LandUnheard,
    /// Sticks call a landing off.
    LandingCancelled,
    /// The drone's word on flying is wrong or late.
    FlyingFlag,
    /// The reported velocity is absent, late, or in another frame.
    Velocity,
    /// The reported height is absent or drifts.
    Height,
    /// The drone does not land when it hears nothing.
    NoAutoLand,
    /// Commands get lost, and the last ones stay applied in some or all of the outages.
    HeldOutages,
    /// The drone flies at the start.
    AlreadyFlying,
    /// The world frame is turned about the vertical, all the time.
    FrameTurned,
    /// The world frame is mirrored, all the time.
    FrameMirrored,
    /// The world frame is scaled by 0.8 to 1.25, all the time.
    FrameScaled,
    /// The heading is turned by 0.5 to 3.14 rad, all the time.
    HeadingTurned,
    /// The reported heading is absent, drifts, is late, or has the other sense.
    HeadingReport,
}

/// What a flight drew.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Draw {
    /// In the order of their draw, without repetitions.
    pub(crate) families: Vec<Family>,
    /// The world with what was drawn.
    pub(crate) sim: SimTable,
    /// Begin of the first fault; 0 if something is wrong from the start. s
    pub(crate) onset_s: f64,
}

/// The draw of `seed` in `sim`: of all families, or of `only`.
pub(crate) fn draw(seed: u64, sim: &SimTable, only: Option<Family>) -> Draw {
    let mut random = Random::new(seed, Purpose::Campaign);
    let sim = SimTable { faults: Vec::new(), ..sim.clone() };
    let mut draw = Draw { families: Vec::new(), sim, onset_s: f64::INFINITY };
    if let Some(family) = only {
        draw.add(family, &mut random);
        return draw;
    }
    let (lasting, timed): (Vec<Family>, Vec<Family>) =
        Family::value_variants().iter().copied().partition(|family| family.is_lasting());
    let count = random.between(1.0, FAULTS_MAX + 1.0).floor();
    while (draw.sim.faults.len() as f64) < count {
        draw.add(pick(&timed, &mut random), &mut random);
    }
    for family in lasting {
        if random.chance(LASTING) {
            draw.add(family, &mut random);
        }
    }
    draw
}

impl Draw {
    fn add(&mut self, family: Family, random: &mut Random) {
        if let Some(fault) = family.fault(random) {
            let [short_s, long_s] = LENGTH_S.map(f64::ln);
            let length_s = random.between(short_s, long_s).exp();
            let is_staying = random.chance(STAYING);
            let (mut from_s, for_s) = (random.between(0.0, BEGIN_MAX_S), [length_s, FOR_EVER_S]);
            let mut for_s = for_s[usize::from(is_staying)];
            if family.is_lasting() {
                (from_s, for_s) = (0.0, FOR_EVER_S);
            } else if fault == InjectedFault::ControlStalled && !is_staying {
                for_s = length_s.min(0.4);
            }
            self.onset_s = self.onset_s.min(from_s);
            self.sim.faults.push(ScriptedFault { fault, from_s, for_s });
        } else {
            self.onset_s = 0.0;
            family.switch(&mut self.sim, random);
        }
        if !self.families.contains(&family) {
            self.families.push(family);
        }
    }
}

impl Family {
    /// Whether it is there from the start to the end.
    fn is_lasting(self) -> bool {
        self >= Self::NoEmergency
    }

    /// The fault, or `None` for a switch.
    fn fault(self, random: &mut Random) -> Option<InjectedFault> {
        Some(match self {
            Self::Lost => InjectedFault::MocapLost,
            Self::Silent => InjectedFault::MocapSilent,
            Self::Frozen => InjectedFault::MocapFrozen,
            Self::Nan => InjectedFault::MocapNan,
            Self::Fixed => InjectedFault::MocapGhost,
            Self::Far => pick(&[InjectedFault::MocapAside, InjectedFault::MocapFar], random),
            Self::Millimetres => InjectedFault::MocapMillimetres,
            Self::OtherSubject => InjectedFault::MocapOther,
            Self::Deaf => InjectedFault::DroneDeaf,
            Self::Mute => InjectedFault::DroneMute,
            Self::StuckSticks => InjectedFault::DroneSticksStuck,
            Self::LandRefused => InjectedFault::DroneRefusesLand,
            Self::Reboot => InjectedFault::DroneReboot { falls: false },
            Self::SecondController => InjectedFault::SecondController {
                sticks: [(); 4].map(|()| random.between(-0.6, 0.6)),
                rate_hz: random.between(2.0, 50.0),
            },
            Self::Stall => InjectedFault::ControlStalled,
            Self::FrameTurned => frame(sign(random) * random.between(0.2, PI), false, 1.0),
            Self::FrameMirrored => frame(0.0, true, 1.0),
            Self::FrameScaled => frame(0.0, false, log_between(random, 0.8, 1.25)),
            Self::HeadingTurned => {
                InjectedFault::MocapHeading { turn_rad: sign(random) * random.between(0.5, PI) }
            }
            Self::NoEmergency
            | Self::LandingKeepsSticks
            | Self::LandUnheard
            | Self::LandingCancelled
            | Self::FlyingFlag
            | Self::Velocity
            | Self::Height
            | Self::NoAutoLand
            | Self::HeldOutages
            | Self::AlreadyFlying
            | Self::HeadingReport => return None,
            _ => self.false_pose(random),
        })
    }

    /// The fault of the mocap with values that begins in flight.
    fn false_pose(self, random: &mut Random) -> InjectedFault {
        match self {
            Self::Ghost => InjectedFault::MocapStill {
                offset_w_m: vector(random, 0.0, 3.0),
                turn_rad: if random.chance(0.5) { random.between(-PI, PI) } else { 0.0 },
                noise_m: random.between(0.0, 5e-3),
                noise_rad: random.between(0.0, 0.02),
            },
            Self::Stuck => InjectedFault::MocapStill {
                offset_w_m: [0.0; 3],
                turn_rad: 0.0,
                noise_m: log_between(random, 1e-5, 5e-3),
                noise_rad: log_between(random, 1e-5, 0.02),
            },
            Self::AxesStuck => axes_stuck(random),
            Self::Walker => InjectedFault::MocapWalker {
                offset_w_m: vector(random, 0.0, 2.0),
                radius_m: random.between(0.3, 2.0),
                speed_mps: random.between(0.05, 1.5),
                noise_m: random.between(0.0, 5e-3),
                noise_rad: random.between(0.0, 0.02),
            },
            Self::Leaving => InjectedFault::MocapWalker {
                offset_w_m: [0.0; 3],
                radius_m: random.between(5.0, 20.0),
                speed_mps: log_between(random, 0.05, 1.5),
                noise_m: random.between(0.0, 5e-3),
                noise_rad: random.between(0.0, 0.02),
            },
            Self::Drift | Self::HeightDrift | Self::HeadingDrift => self.drift(random),
            Self::HeadingStep => {
                InjectedFault::MocapHeading { turn_rad: sign(random) * random.between(0.3, PI) }
            }
            Self::Noise => InjectedFault::MocapNoise {
                growth_mps: random.between(0.0, 0.2),
                growth_radps: random.between(0.0, 0.4),
            },
            Self::Occluded => {
                let period_s = random.between(0.1, 4.0);
                let lost_s = period_s * random.between(0.2, 0.95);
                InjectedFault::MocapOccluded { period_s, lost_s }
            }
            Self::Lag => InjectedFault::MocapLag { delay_s: log_between(random, 0.05, 3.0) },
            Self::LagRamp => InjectedFault::MocapLagRamp { growth: log_between(random, 0.02, 0.9) },
            Self::SlowLink => InjectedFault::MocapSlowLink {
                bytes_per_s: RELAY_BYTES_PER_S * random.between(0.1, 0.98),
            },
            _ => InjectedFault::MocapSilent,
        }
    }

    /// The drift with values: along the floor, in height or in heading.
    fn drift(self, random: &mut Random) -> InjectedFault {
        let (mut velocity_w_mps, mut yaw_radps) = ([0.0; 3], 0.0);
        match self {
            Self::HeightDrift => {
                velocity_w_mps[pose::Z] = sign(random) * log_between(random, 0.02, 0.5);
            }
            Self::HeadingDrift => yaw_radps = sign(random) * log_between(random, 0.02, 1.0),
            _ => {
                let speed_mps = log_between(random, 0.02, 1.0);
                let (sin, cos) = random.between(0.0, TAU).sin_cos();
                velocity_w_mps = [speed_mps * cos, speed_mps * sin, 0.0];
            }
        }
        InjectedFault::MocapDrift { velocity_w_mps, yaw_radps }
    }

    /// Sets the switch in `sim`; nothing for a fault.
    fn switch(self, sim: &mut SimTable, random: &mut Random) {
        let SimTable { drone, start, profile, .. } = sim;
        match self {
            Self::NoEmergency => drone.emergency.binary = false,
            Self::LandingKeepsSticks => drone.landing.keeps_sticks = true,
            Self::LandUnheard if random.chance(0.5) => {
                drone.landing.deaf_s = random.between(0.2, 10.0);
            }
            Self::LandUnheard => drone.landing.deaf_count = pick(&[1, 2, 3, 5, 10], random),
            Self::LandingCancelled => {
                drone.landing.cancelled_by =
                    pick(&[CancelledBy::Deflection, CancelledBy::AnySticks], random);
            }
            Self::FlyingFlag => {
                let right = FlyingFlag::Right;
                let all = [right, FlyingFlag::Inverted, FlyingFlag::Standing, FlyingFlag::Flying];
                drone.status.flying = pick(&all, random);
                drone.status.flying_late_s = random.between(0.0, 8.0);
            }
            Self::Velocity => {
                let velocity = &mut drone.status.velocity;
                velocity.is_present = random.chance(0.7);
                velocity.axes = pick(&[Axes::World, Axes::Body], random);
                velocity.turn_rad = random.between(-PI, PI);
                velocity.is_mirrored = random.chance(0.5);
                velocity.is_upside_down = random.chance(0.5);
                velocity.late_s = random.between(0.0, 0.6);
                velocity.measured = pick(&[Measured::True, Measured::Own], random);
            }
            Self::Height => {
                drone.status.has_height = random.chance(0.5);
                drone.status.height_drift_mps = random.between(-0.1, 0.1);
            }
            Self::HeadingReport => {
                let heading = &mut drone.status.heading;
                heading.is_present = random.chance(0.7);
                heading.is_mirrored = random.chance(0.5);
                heading.drift_radps = random.between(-0.1, 0.1);
                heading.late_s = random.between(0.0, 0.6);
            }
            Self::NoAutoLand => drone.lands_on_silence = false,
            Self::HeldOutages => {
                *profile = Profile::Outages;
                drone.outage = pick(&[OutageBehaviour::Held, OutageBehaviour::Mixed], random);
            }
            Self::AlreadyFlying if let SimStart::Ground { x, y, theta } = *start => {
                *start = SimStart::Air { x, y, z: ALOFT_M, theta };
            }
            _ => {}
        }
    }
}

/// Bytes that the relay sends, in the mean. 1/s
const RELAY_BYTES_PER_S: f64 = 4e3;

fn frame(turn_rad: f64, is_mirrored: bool, scale: f64) -> InjectedFault {
    InjectedFault::MocapFrame { turn_rad, is_mirrored, scale }
}

/// One of `all`, which are not none.
fn pick<T: Copy>(all: &[T], random: &mut Random) -> T {
    let place = horizon_model::whole(random.between(0.0, all.len() as f64));
    all[place.min(all.len() - 1)]
}

fn sign(random: &mut Random) -> f64 {
    if random.chance(0.5) { 1.0 } else { -1.0 }
}

/// The logarithm is uniform.
fn log_between(random: &mut Random, low: f64, high: f64) -> f64 {
    random.between(low.ln(), high.ln()).exp()
}

/// One axis of the position stands still, or both of the floor.
fn axes_stuck(random: &mut Random) -> InjectedFault {
    let all =
        [[true, false, false], [false, true, false], [false, false, true], [true, true, false]];
    let axes = pick(&all, random);
    InjectedFault::MocapAxesStuck { axes, noise_m: log_between(random, 1e-5, 5e-3) }
}

/// A vector in any direction with a length that is uniform.
fn vector(random: &mut Random, low_m: f64, high_m: f64) -> [f64; 3] {
    let length_m = random.between(low_m, high_m);
    let (sin, cos) = random.between(0.0, TAU).sin_cos();
    let up = random.between(-1.0, 1.0);
    let level = (1.0 - up * up).sqrt();
    [length_m * level * cos, length_m * level * sin, length_m * up]
}

#[cfg(test)]
mod tests;
