//! Firmware of the simulated drone: take-off, landing, its own safety.
//!
//! Owns the phases of a flight, the latched sticks, the silence watchdog and the battery. How the
//! vehicle moves is [`crate::plant`]'s, how orders arrive is in `wire`'s.

use horizon_model::rows::{Pose, Sticks, pose};
use tello_io::tello::DroneOrder;

use crate::DT_S;
use crate::command_link::CommandLink;
use crate::firmware::{CancelledBy, DroneTable};
use crate::plant::{External, Plant, STANDING_M, Velocity};

/// From the order until the motors lift. s
const SPIN_UP_S: f64 = 1.0;
/// Speed of climb while taking off; sticks are ignored. m/s
const CLIMB_MPS: f64 = 0.35;
/// Height at which the drone takes sticks; it coasts to about 1 m. m
const HOVER_M: f64 = 0.92;
/// After a take-off order the drone does not hear an order to land for this long. s
const LAND_IGNORED_S: f64 = 3.0;
/// Speed of descent while landing. m/s
const DESCENT_MPS: f64 = 0.35;
/// The drone lands when it has heard nothing for this long. s
const SILENCE_MAX_S: f64 = 15.0;
/// Charge below which the drone refuses to take off, and below which it lands; the real ones are not published. %
const TAKE_OFF_MIN_PCT: f64 = 10.0;
const FLIGHT_MIN_PCT: f64 = 5.0;

/// Phase of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DronePhase {
    /// On the ground, the motors stand.
    Grounded,
    /// Motors on, climbing; sticks are ignored.
    TakingOff,
    /// Following the sticks.
    Flying,
    /// Descending; sticks are ignored unless [`crate::LandingTable`] has them applied.
    Landing(Cause),
    /// Motors stopped in the air.
    Falling,
}

/// Why the drone lands.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// An order to land.
    Order,
    /// No packet for 15 s. Any packet calls this landing off.
    Silence,
    /// The charge is low.
    Battery,
}

/// Answer to an order to land.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LandAnswer {
    /// It lands, or stands already.
    Accepted,
    /// Nothing.
    Unheard,
    /// That it does not land.
    Refused,
}

/// Number of orders that the drone received, executed or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReceivedOrders {
    /// To take off.
    pub take_offs: u32,
    /// To take off, with the drone off the ground already.
    pub take_offs_aloft: u32,
    /// To land.
    pub landings: u32,
    /// Emergency stops.
    pub emergency_stops: u32,
    /// Sticks.
    pub sticks: u32,
    /// Sticks during a landing on order.
    pub sticks_in_landing: u32,
}

/// The drone as it really is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Pose; heading continuous. m, rad
    pub pose: Pose,
    /// Velocity in the world frame.
    pub velocity: Velocity,
    /// Phase of the flight.
    pub phase: DronePhase,
    /// Whether the sticks of the last step arrived.
    pub link_is_up: bool,
    /// Charge. %
    pub battery_pct: f64,
    /// Time with motors on. s
    pub motor_s: f64,
    /// Orders received so far.
    pub received: ReceivedOrders,
}

/// The simulated drone.
#[derive(Debug, Clone)]
pub struct Drone {
    plant: Plant,
    command_link: CommandLink,
    link_is_up: bool,
    phase: DronePhase,
    /// Since the last change of phase. s
    phase_s: f64,
    /// Sticks as last received; they act until replaced.
    u_latched: Sticks,
    /// Applied sticks before the present outage of the link.
    u_received: Sticks,
    /// Since anything was heard. s
    silent_s: f64,
    battery_pct: f64,
    firmware: DroneTable,
    motor_s: f64,
    received: ReceivedOrders,
    /// Since the first order to land of this flight. s
    first_land_s: Option<f64>,
    /// Orders to land of this flight.
    landing_orders: u32,
    /// Whether sticks are received and not executed.
    are_sticks_stuck: bool,
    /// Whether orders to land are refused.
    refuses_land: bool,
}

impl Drone {
    /// A drone in `phase` under neutral sticks, moved by `plant`; answers by `firmware`, charge in %.
    pub fn new(
        plant: Plant,
        command_link: CommandLink,
        phase: DronePhase,
        battery_pct: f64,
        firmware: DroneTable,
    ) -> Self {
        Self {
            plant,
            command_link,
            link_is_up: true,
            phase,
            phase_s: 0.0,
            u_latched: Sticks::zeros(),
            u_received: Sticks::zeros(),
            silent_s: 0.0,
            battery_pct,
            firmware,
            motor_s: 0.0,
            received: ReceivedOrders::default(),
            first_land_s: None,
            landing_orders: 0,
            are_sticks_stuck: false,
            refuses_land: false,
        }
    }

    /// Simulates one step of [`DT_S`].
    pub fn advance(&mut self) {
        self.link_is_up = self.command_link.step();
        let is_held = !self.link_is_up && self.command_link.is_held;
        if !is_held {
            self.u_received = self.u_latched;
        }
        let (u, is_obeyed) = (self.u_received, self.link_is_up || is_held);
        match self.phase {
            DronePhase::Grounded => self.plant.step_grounded(),
            DronePhase::TakingOff if self.phase_s < SPIN_UP_S => self.plant.step_grounded(),
            DronePhase::TakingOff => self.plant.step_automatic(CLIMB_MPS),
            DronePhase::Flying => self.plant.step(&u, is_obeyed),
            DronePhase::Landing(_) if self.firmware.landing.keeps_sticks => {
                let u = if is_obeyed { u } else { Sticks::zeros() };
                self.plant.step_sinking(&u, -DESCENT_MPS);
            }
            DronePhase::Landing(_) => self.plant.step_automatic(-DESCENT_MPS),
            DronePhase::Falling => self.plant.step_falling(),
        }
        self.phase_s += DT_S;
        self.silent_s += DT_S;
        self.first_land_s = self.first_land_s.map(|since_s| since_s + DT_S);
        if !matches!(self.phase, DronePhase::Grounded | DronePhase::Falling) {
            self.motor_s += DT_S;
            let drain_pct = self.firmware.drain_pct_per_s * DT_S;
            self.battery_pct = (self.battery_pct - drain_pct).max(0.0);
        }
        if let Some(phase) = self.next_phase() {
            self.enter(phase);
        }
    }

    /// Applies the faults of the present step.
    pub(crate) fn apply_faults(
        &mut self,
        are_sticks_stuck: bool,
        refuses_land: bool,
        external: External,
    ) {
        self.plant.set_external(external);
        self.are_sticks_stuck = are_sticks_stuck;
        self.refuses_land = refuses_land;
    }

    /// Starts anew: sticks are level, and the motors stop on the ground or, if it `falls`, in the air.
    pub(crate) fn reboot(&mut self, falls: bool) {
        self.steer(Sticks::zeros());
        let is_on_ground = self.phase == DronePhase::TakingOff && self.phase_s < SPIN_UP_S;
        if is_on_ground {
            self.enter(DronePhase::Grounded);
        } else if falls {
            self.stop_motors();
        }
    }

    /// Starts the watchdog again, since a datagram arrived, and calls the landing of the watchdog off.
    pub(crate) fn reset_watchdog(&mut self) {
        self.silent_s = 0.0;
        if self.phase == DronePhase::Landing(Cause::Silence) {
            self.enter(DronePhase::Flying);
        }
    }

    /// Counts a received order, whether it is executed or not.
    pub(crate) fn count_order(&mut self, order: DroneOrder) {
        let is_aloft = match self.phase {
            DronePhase::Grounded => false,
            DronePhase::TakingOff => self.phase_s > SPIN_UP_S,
            DronePhase::Flying | DronePhase::Landing(_) | DronePhase::Falling => true,
        };
        match order {
            DroneOrder::TakeOff => {
                self.received.take_offs += 1;
                self.received.take_offs_aloft += u32::from(is_aloft);
            }
            DroneOrder::Land => self.received.landings += 1,
            DroneOrder::EmergencyStop => self.received.emergency_stops += 1,
        }
    }

    /// Counts received sticks.
    pub(crate) fn count_sticks(&mut self) {
        self.received.sticks += 1;
        let is_landing = self.phase == DronePhase::Landing(Cause::Order);
        self.received.sticks_in_landing += u32::from(is_landing);
    }

    /// Executes sticks from a host: they act, and call a landing off where they do that.
    pub(crate) fn obey_sticks(&mut self, u: Sticks) {
        if self.are_sticks_stuck {
            return;
        }
        self.steer(u);
        if self.firmware.is_stopped_by(&u) {
            self.stop_motors();
        }
        if self.is_landing_cancelled_by(&u) {
            self.cancel_landing();
        }
    }

    /// Whether `u` calls the present landing off, if there is one.
    pub(crate) fn is_landing_cancelled_by(&self, u: &Sticks) -> bool {
        match self.firmware.landing.cancelled_by {
            CancelledBy::Nothing => false,
            CancelledBy::Deflection => u.amax() > 0.0,
            CancelledBy::AnySticks => true,
        }
    }

    /// Latches the sticks `u` (rows `stick`; 1, -1..=1). They act while flying, until replaced. The range is not
    /// checked.
    pub fn steer(&mut self, u: Sticks) {
        self.u_latched = u;
    }

    /// Takes off. Whether the order was accepted: standing, with enough charge. Repeating it while
    /// taking off or flying changes nothing.
    pub fn take_off(&mut self) -> bool {
        match self.phase {
            DronePhase::Grounded if self.battery_pct >= TAKE_OFF_MIN_PCT => {
                self.enter(DronePhase::TakingOff);
                true
            }
            DronePhase::Grounded | DronePhase::Landing(_) | DronePhase::Falling => false,
            DronePhase::TakingOff | DronePhase::Flying => true,
        }
    }

    /// Lands. Whether the order was accepted: not in the first seconds of a take-off, nor in a fall.
    pub fn land(&mut self) -> bool {
        match self.phase {
            DronePhase::TakingOff if self.phase_s < LAND_IGNORED_S => false,
            DronePhase::TakingOff | DronePhase::Flying | DronePhase::Landing(Cause::Silence) => {
                self.enter(DronePhase::Landing(Cause::Order));
                true
            }
            DronePhase::Grounded | DronePhase::Landing(Cause::Order | Cause::Battery) => true,
            DronePhase::Falling => false,
        }
    }

    /// Lands, unless the switches of [`crate::LandingTable`] or a fault keep it from that.
    pub(crate) fn receive_land(&mut self) -> LandAnswer {
        if self.phase != DronePhase::Grounded {
            self.landing_orders = self.landing_orders.saturating_add(1);
            self.first_land_s.get_or_insert(0.0);
            if self.is_land_ignored(self.landing_orders) {
                return LandAnswer::Unheard;
            }
            if self.firmware.landing.is_refused || self.refuses_land {
                return LandAnswer::Refused;
            }
        }
        if self.land() { LandAnswer::Accepted } else { LandAnswer::Unheard }
    }

    /// Whether an order to land would be refused or not heard, by the switches or a fault.
    pub(crate) fn ignores_land(&self) -> bool {
        let is_unheard = self.is_land_ignored(self.landing_orders.saturating_add(1));
        is_unheard || self.firmware.landing.is_refused || self.refuses_land
    }

    /// Whether the order to land of this number is not heard.
    fn is_land_ignored(&self, number: u32) -> bool {
        let landing = self.firmware.landing;
        number <= landing.deaf_count || self.first_land_s.unwrap_or_default() < landing.deaf_s
    }

    /// Stops the motors, at once and in any phase.
    pub(crate) fn stop_motors(&mut self) {
        if self.phase != DronePhase::Grounded {
            self.enter(DronePhase::Falling);
        }
    }

    /// Whether it stops the motors when the text SDK asks for it.
    pub(crate) fn obeys_text_emergency(&self) -> bool {
        self.firmware.emergency.text
    }

    /// Calls an ordered landing off. Whether there was one.
    pub(crate) fn cancel_landing(&mut self) -> bool {
        let is_landing = self.phase == DronePhase::Landing(Cause::Order);
        if is_landing {
            self.enter(DronePhase::Flying);
        }
        is_landing
    }

    /// How it moves.
    pub fn plant(&self) -> &Plant {
        &self.plant
    }

    /// The drone as it really is.
    pub fn truth(&self) -> Truth {
        Truth {
            pose: *self.plant.pose(),
            velocity: self.plant.velocity(),
            phase: self.phase,
            link_is_up: self.link_is_up,
            battery_pct: self.battery_pct,
            motor_s: self.motor_s,
            received: self.received,
        }
    }

    /// The phase that follows, when its time has come.
    fn next_phase(&self) -> Option<DronePhase> {
        let is_left_alone = self.silent_s >= SILENCE_MAX_S && self.firmware.lands_on_silence;
        match self.phase {
            DronePhase::TakingOff if self.height_m() >= HOVER_M => Some(DronePhase::Flying),
            DronePhase::Landing(_) | DronePhase::Falling if self.height_m() <= STANDING_M => {
                Some(DronePhase::Grounded)
            }
            DronePhase::Flying if self.battery_pct < FLIGHT_MIN_PCT => {
                Some(DronePhase::Landing(Cause::Battery))
            }
            DronePhase::Flying if is_left_alone => Some(DronePhase::Landing(Cause::Silence)),
            _ => None,
        }
    }

    fn enter(&mut self, phase: DronePhase) {
        self.phase = phase;
        self.phase_s = 0.0;
        if phase == DronePhase::Grounded {
            (self.first_land_s, self.landing_orders) = (None, 0);
        }
    }

    fn height_m(&self) -> f64 {
        self.plant.pose()[pose::Z]
    }
}

#[cfg(test)]
mod tests;
