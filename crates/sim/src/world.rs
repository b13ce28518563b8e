//! The simulated room in virtual time.
//!
//! Owns what belongs together in one flight: drone, motion capture, faults and the step count; one
//! call of [`World::advance`] is one step of 20 ms. Who calls it, and when, decides between virtual
//! and real time. The bytes of the drone are `wire`'s.

use std::f64::consts::PI;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_io::vicon::{Body, format_line};
use tello_model::angle;
use tello_model::rows::{Pose, pose};
use tello_model::setting::{SettingError, finite, in_range};

use crate::DT_S;
use crate::drone::{Drone, Phase, Truth};
use crate::fault::{Fault, Faults, ScriptedFault};
use crate::firmware::DroneTable;
use crate::mocap::{Mocap, Report, Shot};
use crate::plant::{Plant, PlantParams, PlantTable, STANDING_M, VariationTable, Velocity};
use crate::profile::Profile;
use crate::radio::Radio;
use crate::random::{Purpose, Random};

/// Settings of the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimTable {
    /// How good sensor and link are.
    pub profile: Profile,
    /// Whether every seed draws its own vehicle and start around the nominal ones; otherwise the
    /// vehicle is the nominal one and starts at rest exactly where it is told.
    pub has_spread: bool,
    /// Where the flight starts.
    pub start: Start,
    /// Name of the drone in the motion capture system, without spaces.
    pub object: String,
    /// Charge at the start. %, 0..=100.
    pub battery_pct: f64,
    /// The drone beside the way it flies, and the air around it.
    pub drone: DroneTable,
    /// Nominal vehicle.
    pub plant: PlantTable,
    /// What is different about the vehicle of every seed.
    pub variation: VariationTable,
    /// Faults on order, beside those of the profile.
    pub faults: Vec<ScriptedFault>,
}

/// Where a flight starts.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Start {
    /// Standing on the floor.
    Ground {
        /// World x. m.
        x: f64,
        /// World y. m.
        y: f64,
        /// Measured yaw. rad.
        theta: f64,
    },
    /// In flight, near the first target.
    Air {
        /// World x of the target. m.
        x: f64,
        /// World y of the target. m.
        y: f64,
        /// Height of the target. m, > 0.
        z: f64,
        /// Measured yaw of the target. rad.
        theta: f64,
    },
}

/// How the valid flights of the thesis were handed over to the controller, relative to the first
/// target: mean and deviation.
mod scatter {
    /// Horizontal position, per axis. m.
    pub(super) const XY_M: (f64, f64) = (0.0, 0.10);
    /// Height. m.
    pub(super) const Z_M: (f64, f64) = (-0.08, 0.03);
    /// Heading. rad.
    pub(super) const THETA_RAD: (f64, f64) = (0.03, 0.05);
    /// Horizontal velocity, per axis. m/s.
    pub(super) const VELOCITY_MPS: (f64, f64) = (0.0, 0.16);
}

/// One simulated flight.
#[derive(Debug, Clone)]
pub struct World {
    pub(crate) drone: Drone,
    pub(crate) faults: Faults,
    pub(crate) firmware: DroneTable,
    pub(crate) seed: u64,
    mocap: Mocap,
    object: String,
    step: u64,
    report: Report,
}

impl World {
    /// The flight of `seed` at its step 0.
    ///
    /// # Errors
    /// A value of `table` that breaks its rule.
    pub fn new(table: &SimTable, seed: u64) -> Result<Self, SettingError> {
        let nominal = PlantParams::try_from(table.plant).map_err(|error| error.under("plant"))?;
        let battery_pct = in_range("battery_pct", table.battery_pct, 0.0..=100.0)?;
        let firmware = table.drone.checked().map_err(|error| error.under("drone"))?;
        if table.object.is_empty() || table.object.contains(char::is_whitespace) {
            return Err(SettingError::new("object", &table.object, "a name without spaces"));
        }
        let (params, (phase, pose, velocity)) = if table.has_spread {
            let params = nominal.draw(&mut Random::new(seed, Purpose::Vehicle));
            (params, table.start.draw(&mut Random::new(seed, Purpose::Start)))
        } else {
            (nominal, table.start.exact())
        };
        let params = params.varied(&table.variation).map_err(|error| error.under("variation"))?;
        for (key, value) in ["x", "y", "z", "theta"].into_iter().zip(pose.iter()) {
            finite(key, *value).map_err(|error| error.under("start"))?;
        }
        let plant = Plant::new(params, pose, velocity, seed)?;
        let radio = Radio::new(table.profile, seed);
        let mut world = Self {
            drone: Drone::new(plant, radio, phase, battery_pct, firmware.drain_pct_per_s),
            firmware,
            seed,
            faults: Faults::new(table.faults.clone())?,
            mocap: Mocap::new(table.profile, seed),
            object: table.object.clone(),
            step: 0,
            report: Report::Silent,
        };
        world.report = world.look();
        Ok(world)
    }

    /// Lives through one step with what the drone was last told.
    pub fn advance(&mut self) {
        self.drone.advance();
        self.step += 1;
        self.report = self.look();
    }

    /// Steps since the start.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// What the motion capture says about the present step.
    pub fn report(&self) -> Report {
        self.report
    }

    /// The drone as it really is.
    pub fn truth(&self) -> Truth {
        self.drone.truth()
    }

    /// Switches a fault on or off, beside the script.
    pub fn set_fault(&mut self, fault: Fault, is_on: bool) {
        self.faults.set(fault, is_on);
    }

    /// What the motion capture sends about the present step; `None` while it is silent.
    ///
    /// The simulated drone flies level.
    pub fn shot(&self) -> Option<Shot<'_>> {
        let is_other = self.faults.is_on(Fault::MocapOther, self.step);
        let object = if is_other { "wand" } else { &self.object };
        let name = object.as_bytes();
        let body = match self.report {
            Report::Pose(o) => Some(Body {
                name,
                pos_w: [o[pose::X], o[pose::Y], o[pose::Z]],
                angles: [0.0, 0.0, o[pose::THETA]],
            }),
            Report::Lost => None,
            Report::Silent => return None,
        };
        // Two years at 50 Hz.
        let frame = u32::try_from(self.step).unwrap_or(u32::MAX);
        Some(Shot { frame, rate_hz: 1.0 / DT_S, object, body })
    }

    /// Appends what the relay sends for the present step: a line, or nothing while it is silent.
    pub fn relay_line(&self, to: &mut Vec<u8>) {
        if let Some(Shot { frame, rate_hz, object, body }) = self.shot() {
            format_line(frame.into(), rate_hz, object, body.as_ref(), to);
        }
    }

    /// The report about the present pose, by chance and on order.
    fn look(&mut self) -> Report {
        let by_chance = self.mocap.observe(&self.drone.truth().pose);
        let is_on = |fault| self.faults.is_on(fault, self.step);
        if is_on(Fault::MocapSilent) {
            Report::Silent
        } else if is_on(Fault::MocapLost) {
            Report::Lost
        } else if is_on(Fault::MocapGhost) {
            Mocap::ghost()
        } else if is_on(Fault::MocapFrozen) {
            self.report
        } else if let Report::Pose(o) = by_chance {
            Report::Pose(distorted(o, is_on))
        } else {
            by_chance
        }
    }
}

/// The pose `o` as the faults that are on report it.
fn distorted(mut o: Pose, is_on: impl Fn(Fault) -> bool) -> Pose {
    if is_on(Fault::MocapNan) {
        o[pose::Y] = f64::NAN;
    }
    if is_on(Fault::MocapFar) {
        o[pose::X] += 10.0;
    }
    if is_on(Fault::MocapAside) {
        o[pose::X] += 3.0;
    }
    if is_on(Fault::MocapFlipped) {
        o[pose::THETA] = angle::wrap(o[pose::THETA] + PI);
    }
    if is_on(Fault::MocapMillimetres) {
        for row in [pose::X, pose::Y, pose::Z] {
            o[row] *= 1000.0;
        }
    }
    o
}

impl Start {
    /// Phase, pose and velocity, exactly as told and at rest.
    fn exact(self) -> (Phase, Pose, Velocity) {
        let rest = Velocity::default();
        match self {
            Self::Ground { x, y, theta } => {
                (Phase::Grounded, Pose::new(x, y, STANDING_M, theta), rest)
            }
            Self::Air { x, y, z, theta } => (Phase::Flying, Pose::new(x, y, z, theta), rest),
        }
    }

    /// Phase, pose and velocity as they vary between flights. A drone on the floor stands where it
    /// was put.
    fn draw(self, random: &mut Random) -> (Phase, Pose, Velocity) {
        let (phase, mut at, mut velocity) = self.exact();
        if phase == Phase::Flying {
            let mut draw = |(mean, sd): (f64, f64)| mean + sd * random.normal();
            at[pose::X] += draw(scatter::XY_M);
            at[pose::Y] += draw(scatter::XY_M);
            at[pose::Z] = (at[pose::Z] + draw(scatter::Z_M)).max(STANDING_M);
            at[pose::THETA] += draw(scatter::THETA_RAD);
            velocity.x_mps = draw(scatter::VELOCITY_MPS);
            velocity.y_mps = draw(scatter::VELOCITY_MPS);
        }
        (phase, at, velocity)
    }
}

#[cfg(test)]
pub(crate) mod tests;
