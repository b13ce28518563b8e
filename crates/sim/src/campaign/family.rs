//! Families of faults: what a flight of the campaign may draw, with its values.
//!
//! Owns the times. A family is a fault with a time or of the set-up, or a switch of the drone. One seed, one draw.

mod values;

use std::f64::consts::PI;

use clap::ValueEnum;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use self::values::{log_between, pick, sign};
use crate::random::{Purpose, Random};
use crate::{InjectedFault, ScriptedFault, SimTable};

/// Most faults of a flight that have a time. 1
const FAULTS_MAX: f64 = 3.0;
/// Faults begin within this time after the start. s
const BEGIN_MAX_S: f64 = 18.0;
/// Shortest and longest fault but those that stay; the logarithm is uniform. s
const LENGTH_S: [f64; 2] = [0.1, 10.0];
/// Fraction of the faults that stay. 1
const STAYING: f64 = 0.3;
/// A fault that stays. s
const FOR_EVER_S: f64 = 1e3;
/// Longest stall of the control loop but one that stays. s
const STALL_MAX_S: f64 = 0.4;
/// Probability of each family that is there from the start: a set-up or a switch of the drone. 1
const LASTING: f64 = 0.04;

/// Something that is wrong in a flight: faults with a time, and what lasts for the flight.
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
    #[serde(alias = "ghost")]
    #[value(alias = "ghost")]
    Still,
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
    /// The drone does not execute the order to stop the motors.
    NoEmergency,
    /// A landing goes on with the last sticks.
    LandingKeepsSticks,
    /// The first orders to land, or those of the first seconds, are not heard.
    LandUnheard,
    /// Sticks call a landing off.
    LandingCancelled,
    /// The drone's flying flag is wrong or late.
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

/// Families and settings that a flight drew.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// In the order of their draw, without repetitions.
    pub families: Vec<Family>,
    /// The world with what was drawn.
    pub sim: SimTable,
    /// Begin of the first fault; 0 if something is wrong from the start. s
    pub onset_s: f64,
}

/// The draw of `seed` in `sim`: of all families, or of `only`.
pub fn draw(seed: u64, sim: &SimTable, only: Option<Family>) -> Draw {
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
        match family.effect(random) {
            Effect::Fault(fault) => {
                let [short_s, long_s] = LENGTH_S.map(f64::ln);
                let length_s = random.between(short_s, long_s).exp();
                let is_staying = random.chance(STAYING);
                let begin_s = random.between(0.0, BEGIN_MAX_S);
                let from_s = if family.is_lasting() { 0.0 } else { begin_s };
                let for_s = if family.is_lasting() || is_staying {
                    FOR_EVER_S
                } else if fault == InjectedFault::ControlStalled {
                    length_s.min(STALL_MAX_S)
                } else {
                    length_s
                };
                self.onset_s = self.onset_s.min(from_s);
                self.sim.faults.push(ScriptedFault { fault, from_s, for_s });
            }
            Effect::Switch(set) => {
                self.onset_s = 0.0;
                set(&mut self.sim, random);
            }
        }
        if !self.families.contains(&family) {
            self.families.push(family);
        }
    }
}

/// Change that a family makes to the world.
enum Effect {
    Fault(InjectedFault),
    /// Sets a switch, with values that are drawn.
    Switch(fn(&mut SimTable, &mut Random)),
}

impl Family {
    /// Whether it is there from the start to the end.
    fn is_lasting(self) -> bool {
        match self {
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
            | Self::FrameTurned
            | Self::FrameMirrored
            | Self::FrameScaled
            | Self::HeadingTurned
            | Self::HeadingReport => true,
            Self::Lost
            | Self::Silent
            | Self::Frozen
            | Self::Nan
            | Self::Fixed
            | Self::Far
            | Self::Millimetres
            | Self::OtherSubject
            | Self::Still
            | Self::Stuck
            | Self::AxesStuck
            | Self::Walker
            | Self::Leaving
            | Self::Drift
            | Self::HeightDrift
            | Self::HeadingDrift
            | Self::HeadingStep
            | Self::Noise
            | Self::Occluded
            | Self::Lag
            | Self::LagRamp
            | Self::SlowLink
            | Self::Deaf
            | Self::Mute
            | Self::StuckSticks
            | Self::LandRefused
            | Self::Reboot
            | Self::SecondController
            | Self::Stall => false,
        }
    }

    /// The fault with its values, or the switch.
    fn effect(self, random: &mut Random) -> Effect {
        Effect::Fault(match self {
            Self::Lost => InjectedFault::MocapLost,
            Self::Silent => InjectedFault::MocapSilent,
            Self::Frozen => InjectedFault::MocapFrozen,
            Self::Nan => InjectedFault::MocapNan,
            Self::Fixed => InjectedFault::MocapFixed,
            Self::Far => pick(&[InjectedFault::MocapAside, InjectedFault::MocapFar], random),
            Self::Millimetres => InjectedFault::MocapMillimetres,
            Self::OtherSubject => InjectedFault::MocapOther,
            Self::Still => values::still(random),
            Self::Stuck => values::stuck(random),
            Self::AxesStuck => values::axes_stuck(random),
            Self::Walker => values::walker(random),
            Self::Leaving => values::leaving(random),
            Self::Drift => values::drift(random),
            Self::HeightDrift => values::height_drift(random),
            Self::HeadingDrift => values::heading_drift(random),
            Self::HeadingStep => values::heading_turn(0.3, random),
            Self::Noise => values::noise(random),
            Self::Occluded => values::occluded(random),
            Self::Lag => InjectedFault::MocapLag { delay_s: log_between(random, 0.05, 3.0) },
            Self::LagRamp => InjectedFault::MocapLagRamp { growth: log_between(random, 0.02, 0.9) },
            Self::SlowLink => values::slow_link(random),
            Self::Deaf => InjectedFault::DroneDeaf,
            Self::Mute => InjectedFault::DroneMute,
            Self::StuckSticks => InjectedFault::DroneSticksStuck,
            Self::LandRefused => InjectedFault::DroneRefusesLand,
            Self::Reboot => InjectedFault::DroneReboot { falls: false },
            Self::SecondController => values::second_controller(random),
            Self::Stall => InjectedFault::ControlStalled,
            Self::FrameTurned => values::frame(sign(random) * random.between(0.2, PI), false, 1.0),
            Self::FrameMirrored => values::frame(0.0, true, 1.0),
            Self::FrameScaled => values::frame(0.0, false, log_between(random, 0.8, 1.25)),
            Self::HeadingTurned => values::heading_turn(0.5, random),
            Self::NoEmergency => {
                return Effect::Switch(|sim, _| sim.drone.emergency.binary = false);
            }
            Self::LandingKeepsSticks => {
                return Effect::Switch(|sim, _| sim.drone.landing.keeps_sticks = true);
            }
            Self::LandUnheard => return Effect::Switch(values::set_land_unheard),
            Self::LandingCancelled => return Effect::Switch(values::set_landing_cancelled),
            Self::FlyingFlag => return Effect::Switch(values::set_flying_flag),
            Self::Velocity => return Effect::Switch(values::set_velocity),
            Self::Height => return Effect::Switch(values::set_height),
            Self::NoAutoLand => return Effect::Switch(|sim, _| sim.drone.lands_on_silence = false),
            Self::HeldOutages => return Effect::Switch(values::set_held_outages),
            Self::AlreadyFlying => return Effect::Switch(|sim, _| values::set_already_flying(sim)),
            Self::HeadingReport => return Effect::Switch(values::set_heading_report),
        })
    }
}

#[cfg(test)]
mod tests;
