//! The simulated room in virtual time.
//!
//! Owns what belongs together in one flight: drone, motion capture, faults and the step count; one
//! call of [`World::advance`] is one step of 20 ms. Who calls it, and when, decides between virtual
//! and real time. The bytes of the drone are `drone_packets`'s.

mod drone_packets;
mod start;

use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, Sticks, pose};
use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_io::mocap::{Body, format_line};

use crate::command_link::CommandLink;
use crate::distortion::Distortion;
use crate::drone::{Drone, Truth};
use crate::drone_status::Reporter;
use crate::fault::{Faults, InjectedFault, Present, ScriptedFault};
use crate::firmware::DroneTable;
use crate::frame_lag::{Lag, TakenFrame};
use crate::mocap::{Mocap, MocapFrame, MocapReport};
use crate::plant::{External, Plant, PlantParams, PlantTable, VariationTable};
use crate::profile::Profile;
use crate::random::{Purpose, Random};
use crate::second_object::PasserTable;
use crate::{DT_S, frames, held_by_hand};
pub(crate) use drone_packets::whole_percent;
pub use start::SimStart;

/// Settings of the simulator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SimTable {
    /// How good sensor and link are.
    pub profile: Profile,
    /// Whether every seed draws its own vehicle and start around the nominal ones; otherwise the
    /// vehicle is the nominal one and starts at rest exactly at the given pose.
    pub has_spread: bool,
    /// Where the flight starts.
    pub start: SimStart,
    /// Name of the drone in the motion capture system, without spaces.
    pub object: String,
    /// Charge at the start. %, 0..=100
    pub battery_pct: f64,
    /// Firmware properties of the drone, and its radio link.
    pub drone: DroneTable,
    /// Nominal vehicle.
    pub plant: PlantTable,
    /// Deviations that the vehicle of every seed has from the nominal one.
    pub variation: VariationTable,
    /// Faults on order, beside those of the profile.
    pub faults: Vec<ScriptedFault>,
    /// A second object that moves, seen exactly: by each tick in virtual time, over sockets as the object `passer`.
    /// Null: none.
    pub passer: Option<PasserTable>,
    /// How old a pose is when it is sent: exposure, processing, and the wait for a tick that does not begin with
    /// its frame. s, 0..=0.02
    pub mocap_age_s: f64,
    /// Frames of the motion capture per second: those between two steps of 20 ms go on with the change of the step
    /// before. In virtual time there is one by step at most. Hz, 4..=500
    pub mocap_rate_hz: f64,
}

/// One simulated flight.
#[derive(Debug, Clone)]
pub struct World {
    drone: Drone,
    faults: Faults,
    /// Firmware properties of the drone.
    pub(crate) firmware: DroneTable,
    /// Seed of the flight.
    pub(crate) seed: u64,
    reporter: Reporter,
    /// Whether the drone knows a host: not after it started anew.
    is_connected: bool,
    is_rebooting: bool,
    mocap: Mocap,
    distortion: Distortion,
    lag: Lag,
    object: String,
    passer: Option<PasserTable>,
    step: u64,
    report: MocapReport,
    /// Age of the poses that are sent, as a fraction of a step.
    age_steps: f64,
    /// The true pose of the step before.
    earlier: Pose,
    /// Frames of the motion capture per second. Hz
    pub(crate) mocap_rate_hz: f64,
}

impl World {
    /// The flight of `seed` at its step 0.
    ///
    /// # Errors
    /// A value of `table` that breaks its rule.
    pub fn new(table: &SimTable, seed: u64) -> Result<Self, SettingError> {
        let passer = table.passer.as_ref().map_or(Ok(()), PasserTable::check);
        passer.map_err(|error| error.under("passer"))?;
        let nominal = PlantParams::try_from(table.plant).map_err(|error| error.under("plant"))?;
        let battery_pct = in_range("battery_pct", table.battery_pct, 0.0..=100.0)?;
        table.start.check().map_err(|error| error.under("start"))?;
        let age_s = in_range("mocap_age_s", table.mocap_age_s, 0.0..=DT_S)?;
        let mocap_rate_hz = in_range("mocap_rate_hz", table.mocap_rate_hz, 4.0..=500.0)?;
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
        let plant = Plant::new(params, pose, velocity, seed)?;
        let command_link = CommandLink::new(table.profile, seed).with_outages(firmware.outage);
        let drone = Drone::new(plant, command_link, phase, battery_pct, firmware);
        let mut world = Self {
            reporter: Reporter::new(firmware.status, &drone.truth()),
            drone,
            firmware,
            is_connected: true,
            is_rebooting: false,
            seed,
            faults: Faults::new(table.faults.clone())?,
            mocap: Mocap::new(table.profile, seed),
            distortion: Distortion::new(seed),
            lag: Lag::default(),
            object: table.object.clone(),
            passer: table.passer,
            step: 0,
            report: MocapReport::Silent,
            age_steps: age_s / DT_S,
            earlier: pose,
            mocap_rate_hz,
        };
        world.observe();
        Ok(world)
    }

    /// Simulates one step with the last command of the drone.
    pub fn advance(&mut self) {
        self.receive_second_controllers();
        self.earlier = self.drone.truth().pose;
        self.drone.advance();
        self.reporter.advance(&self.drone.truth(), self.drone.plant().own_error_w_mps());
        self.step += 1;
        self.observe();
    }

    /// The simulated drone.
    pub fn drone(&self) -> &Drone {
        &self.drone
    }

    /// The simulated drone, for hosts of the text SDK.
    pub(crate) fn drone_mut(&mut self) -> &mut Drone {
        &mut self.drone
    }

    /// Whether the drone knows a host.
    pub(crate) fn is_connected(&self) -> bool {
        self.is_connected
    }

    /// Sets whether the drone knows a host.
    pub(crate) fn set_connected(&mut self, is_connected: bool) {
        self.is_connected = is_connected;
    }

    /// Steps since the start.
    pub fn step(&self) -> u64 {
        self.step
    }

    /// Report of the motion capture about the present step.
    pub fn report(&self) -> MocapReport {
        self.report
    }

    /// The drone as it really is.
    pub fn truth(&self) -> Truth {
        self.drone.truth()
    }

    /// Switches a fault on or off, beside the script.
    pub(crate) fn set_fault(&mut self, fault: InjectedFault, is_on: bool) {
        self.faults.set(fault, is_on);
    }

    /// Whether `fault`, with these values, is present.
    pub fn has_fault(&self, fault: InjectedFault) -> bool {
        self.faults.is_on(fault, self.step)
    }

    /// Whether sticks of ours do not act, or not alone: the drone ignores packets, starts anew or knows no host,
    /// its sticks are stuck, commands get lost, or another controller sends.
    pub(crate) fn ignores_sticks(&self) -> bool {
        let is_shared =
            |present: Present| matches!(present.fault, InjectedFault::SecondController { .. });
        self.ignores_commands()
            || !self.is_connected
            || !self.truth().link_is_up
            || self.has_fault(InjectedFault::DroneSticksStuck)
            || self.faults.present(self.step).any(is_shared)
    }

    /// Whether an order to land would not be executed now.
    pub(crate) fn ignores_land(&self) -> bool {
        self.ignores_commands() || !self.is_connected || self.drone.ignores_land()
    }

    /// Frames that arrive from the motion capture in the present step, oldest first. Without a fault of the connection
    /// it is the frame of this step, and none while the motion capture is silent.
    pub fn frames(&self) -> impl Iterator<Item = MocapFrame<'_>> {
        self.lag.frames(&self.object)
    }

    /// Frames of [`World::frames`], each with the change of its pose in a step. m, rad
    pub(crate) fn moving_frames(&self) -> impl Iterator<Item = (MocapFrame<'_>, Pose)> {
        self.lag.moving(&self.object)
    }

    /// Whether there is one frame in each step, at its beginning.
    pub(crate) fn has_frame_by_step(&self) -> bool {
        self.mocap_rate_hz.total_cmp(&(1.0 / DT_S)).is_eq()
    }

    /// How the true pose changed in the step before the present one.
    fn change(&self) -> Pose {
        let mut change = self.drone.truth().pose - self.earlier;
        change[pose::THETA] = wrap(change[pose::THETA]);
        change
    }

    /// Frame of the second object in the present step, with its true place and no delay; `None` if there is no second
    /// object, or it is hidden.
    pub(crate) fn frame_of_passer(&self) -> Option<MocapFrame<'_>> {
        const NAME: &str = "passer";
        let pos_v = self.passer?.seen(self.step, self.seed)?;
        let number = u32::try_from(self.step).ok()?;
        let body = Some(Body { name: NAME.as_bytes(), pos_v, angles: [0.0; 3] });
        Some(MocapFrame { number, rate_hz: 1.0 / DT_S, object: NAME, body })
    }

    /// Appends the lines that arrive from the relay in the present step, one for each of [`World::frames`].
    pub fn relay_line(&self, to: &mut Vec<u8>) {
        for MocapFrame { number, rate_hz, object, body } in self.frames() {
            format_line(number.into(), rate_hz, object, body.as_ref(), to);
        }
    }

    /// Applies the faults of the present step, and observes the drone with the motion capture.
    fn observe(&mut self) {
        let truth = self.drone.truth().pose;
        self.faults.begin(self.step, &truth);
        self.apply_faults_to_drone();
        let by_chance = self.mocap.observe(&self.measured(truth));
        let change = self.change();
        let Self { faults, step, .. } = self;
        self.report = self.distortion.report(by_chance, self.report, faults, *step);
        let change = self.distortion.change(change, faults, *step);
        let pose = match self.report {
            MocapReport::Pose(o) => Some(Some(o)),
            MocapReport::Lost => Some(None),
            MocapReport::Silent => None,
        };
        let is_other = faults.is_on(InjectedFault::MocapOther, *step);
        let taken = pose.map(|pose| TakenFrame { step: *step, is_other, pose, change });
        let taken = taken.filter(|_| frames::is_in_step(*step, self.mocap_rate_hz));
        self.lag.advance(taken, *step, faults, &self.object);
    }

    /// The pose at the time of the measurement that is sent in the present step, where the vehicle is at `now`.
    fn measured(&self, now: Pose) -> Pose {
        if self.age_steps == 0.0 {
            return now;
        }
        let mut change = self.earlier - now;
        change[pose::THETA] = wrap(change[pose::THETA]);
        now + self.age_steps * change
    }

    /// Applies the faults of the present step to the drone.
    fn apply_faults_to_drone(&mut self) {
        let is_on = |fault| self.faults.is_on(fault, self.step);
        let (are_stuck, refuses) =
            (is_on(InjectedFault::DroneSticksStuck), is_on(InjectedFault::DroneRefusesLand));
        let external = self.faults.present(self.step).find_map(|present| match present.fault {
            InjectedFault::DroneHeld { sway_m, lowered_m } => {
                let velocity_w_mps =
                    held_by_hand::velocity_w_mps(sway_m, lowered_m, present.elapsed_s);
                Some(External::Held { velocity_w_mps })
            }
            InjectedFault::DronePushed { velocity_w_mps } => {
                Some(External::Pushed { velocity_w_mps })
            }
            _ => None,
        });
        self.drone.apply_faults(are_stuck, refuses, external.unwrap_or_default());
        let reboot = self.faults.present(self.step).find_map(|present| match present.fault {
            InjectedFault::DroneReboot { falls } => Some(falls),
            _ => None,
        });
        if let Some(falls) = reboot.filter(|_| !self.is_rebooting) {
            self.drone.reboot(falls);
            self.is_connected = false;
        }
        self.is_rebooting = reboot.is_some();
    }

    /// Passes on what other controllers send in the present step, after what ours sent.
    fn receive_second_controllers(&mut self) {
        if self.ignores_commands() {
            return;
        }
        for present in self.faults.present(self.step) {
            let InjectedFault::SecondController { sticks, rate_hz } = present.fault else {
                continue;
            };
            let packets = |time_s: f64| (time_s * rate_hz + 1e-9).floor();
            if packets(present.elapsed_s + DT_S) > packets(present.elapsed_s) {
                self.drone.reset_watchdog();
                self.drone.obey_sticks(Sticks::from(sticks));
            }
        }
    }
}

#[cfg(test)]
pub(crate) mod tests;
