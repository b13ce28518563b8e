//! May we fly, and what happens when something is wrong.
//!
//! Owns the phases of a flight: whether control may steer, when to take off and when to land. It
//! decides from the evidence of each tick and knows no clock, link or estimator. What a fault
//! leads to stands in `fault.rs`.
//!
//! ```text
//! Idle -- asked to fly, nothing wrong --> TakingOff -- risen --> Flying
//!   |                                         |                    |
//!   |  drone flies: ordered to land,          |  fault             |  mission done, fault
//!   |  or it took off unasked                 |                    |  (some brake first)
//!   v                                         v                    v
//! Landing <-----------------------------------+--------------------+
//!   |-- down --> Landed
//!   '-- timeout --> LandingUnconfirmed, which goes on ordering to land until the vehicle is down
//!
//! any phase -- emergency stop --> MotorsStopped
//! ```

mod airborne;
mod blocked;
mod braking;
mod condition_timer;
mod conditions;
mod evidence;
mod fault;
mod geofence;
mod hover_after_take_off;
mod moving_obstacle_wait;
mod person_gone;
mod settings;
mod staleness;
mod take_off;
mod timers;

pub(crate) use self::braking::SLOW_MPS;
pub use self::evidence::{
    Decision, DroneReport, EstimatedMotion, Evidence, HandInput, Incidents, ObstacleApproach,
    ObstacleEvidence, Operator, Outage, Phase, PlanClearance, PoseEvidence, Start,
    TrackingEvidence,
};
pub use self::fault::{Fault, FaultSet, Pilot, Reaction};
pub use self::geofence::{CLIMB_MAX_M, GROUND_MAX_M, Room, RoomTable};
pub use self::settings::{FailsafeTable, SupervisorSettings, SupervisorTable};

use self::airborne::LandingConfirmation;
use self::blocked::Blockage;
use self::braking::{ControlMode, Descent};
use self::condition_timer::{elapsed_s, exceeds};
use self::hover_after_take_off::HoverAfterTakeOff;
use self::moving_obstacle_wait::MovingObstacleTimes;
use self::take_off::TakeOffEvidence;
use self::timers::Timers;
use crate::drone::{DroneOrder, LAND_PERIOD};
use crate::forgetting::LeakySum;

/// Take-off is ordered again when the drone still reports to be grounded after this time: the order
/// may be lost, but a drone spinning up must not receive the order twice. s
const TAKE_OFF_RETRY_S: f64 = 3.0;

/// The controller brakes for so long after a plan led out of the room or into an obstacle. s
const BRAKE_S: f64 = 0.4;

/// A drone that reports for so long that it flies took off without our order. s
const FLYING_UNORDERED_S: f64 = 1.0;

/// How long a vehicle must look grounded to count as down. s
const DOWN_HOLD_S: f64 = 1.0;

/// What is wrong at a tick, under the pilot whose reactions count.
#[derive(Debug, Clone, Copy)]
struct Assessment {
    pilot: Pilot,
    faults: FaultSet,
    /// The strongest reaction to `faults` under `pilot`.
    reaction: Reaction,
}

/// The state machine of a flight; see the top of this file.
#[derive(Debug, Clone)]
pub struct Supervisor {
    table: SupervisorTable,
    /// Where the vehicle may be; `None`: anywhere.
    room: Option<Room>,
    /// Dry run: the vehicle is carried by hand, and its status does not count.
    is_dry_run: bool,
    phase: Phase,
    /// When the phase began. ns
    phase_since_ns: i64,
    /// The first tick. ns
    began_ns: Option<i64>,
    hover: HoverAfterTakeOff,
    timers: Timers,
    take_off: TakeOffEvidence,
    landing: LandingConfirmation,
    blockage: Blockage,
    moving_obstacle: MovingObstacleTimes,
    /// The descent of a vehicle that brakes before a landing; `None` before it is slow.
    descent: Option<Descent>,
    /// When landing or a stop of the motors was ordered. ns
    end_ordered_ns: Option<i64>,
    /// Ticks in which a solver failed, less half of those without a failure.
    failures: LeakySum,
    /// Periods missed, less a part of one for each tick.
    late_periods: LeakySum,
    /// What the controller did in the tick before.
    control: ControlMode,
    /// What ended the flight.
    ended_by: FaultSet,
}

impl Supervisor {
    /// A supervisor before its first tick.
    pub fn new(settings: SupervisorSettings, start: Start) -> Self {
        Self {
            table: settings.table,
            room: settings.room,
            phase: match start {
                Start::Grounded => Phase::Idle,
                Start::Airborne | Start::Carried => Phase::Flying,
            },
            is_dry_run: start == Start::Carried,
            phase_since_ns: 0,
            began_ns: None,
            hover: HoverAfterTakeOff::default(),
            timers: Timers::default(),
            take_off: TakeOffEvidence::default(),
            landing: LandingConfirmation::default(),
            blockage: Blockage::default(),
            moving_obstacle: MovingObstacleTimes::default(),
            descent: None,
            end_ordered_ns: None,
            failures: LeakySum::default(),
            late_periods: LeakySum::default(),
            control: ControlMode::Off,
            ended_by: FaultSet::default(),
        }
    }

    /// The phase after the latest tick.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// The decision on one tick. `t_ns` must not decrease from call to call.
    ///
    /// Sticks pass only in [`Phase::Flying`], those of the controller only on a fresh pose; a
    /// take-off is ordered only before any landing, and a landing or a stop of the motors is ordered
    /// until it is confirmed.
    ///
    /// Real time: no allocation, constant cost.
    pub fn decide(&mut self, e: &Evidence) -> Decision {
        self.update_timers(e);
        let found = self.assess(e);
        self.update_braking(e, &found);
        let next = self.next_phase(e, &found);
        if next != self.phase {
            self.enter(next, e, &found);
        }
        self.decision(e, &found)
    }

    /// What is wrong, by the evidence and the timers of this tick.
    fn assess(&self, e: &Evidence) -> Assessment {
        let (pilot, faults) = (self.reacting_pilot(e), self.faults(e));
        Assessment { pilot, faults, reaction: faults.reaction(pilot) }
    }

    /// Begins the phase `next`.
    fn enter(&mut self, next: Phase, e: &Evidence, found: &Assessment) {
        self.phase = next;
        self.phase_since_ns = e.t_ns;
        match next {
            Phase::Flying => self.hover.confirm(e.t_ns),
            Phase::Landing | Phase::LandingUnconfirmed | Phase::MotorsStopped => {
                if next == Phase::MotorsStopped {
                    self.end_ordered_ns = None;
                }
                self.note_ending(found);
            }
            Phase::Landed => self.note_confirmation(e),
            Phase::TakingOff => self.hover.begin(e.pose),
            Phase::Idle => {}
        }
    }

    /// Notes the present faults that end a flight.
    fn note_ending(&mut self, found: &Assessment) {
        self.ended_by = self.ended_by.union(found.faults.ending_flight(found.pilot));
    }

    /// Who steers, and what is ordered, in the phase of this tick.
    fn decision(&mut self, e: &Evidence, found: &Assessment) -> Decision {
        let Assessment { pilot, faults, reaction } = *found;
        let is_steerable = self.phase == Phase::Flying && self.takes_sticks(e);
        let is_braking =
            is_steerable && (self.timers.braking.holds() || reaction == Reaction::Brake);
        let may_steer = is_steerable
            && (is_braking || reaction < Reaction::Hold)
            && (self.hover.is_over() || pilot == Pilot::Person);
        self.control = ControlMode::of(may_steer && pilot == Pilot::Controller, is_braking);
        Decision {
            phase: self.phase,
            pilot: may_steer.then_some(pilot),
            is_braking,
            order: self.order(e, reaction),
            faults: faults.union(self.ended_by),
            ended_by: self.ended_by,
            pose_is_airborne: self.pose_is_airborne(e),
        }
    }

    /// Whose reactions count. On the ground a hand on the sticks may be an accident: there the person
    /// has to report so.
    fn reacting_pilot(&self, e: &Evidence) -> Pilot {
        let is_hand_deliberate = self.phase != Phase::Idle || e.operator == Operator::FlyByHand;
        if e.is_by_hand() && is_hand_deliberate { Pilot::Person } else { Pilot::Controller }
    }

    fn next_phase(&self, e: &Evidence, found: &Assessment) -> Phase {
        let reaction = found.reaction;
        let asks_to_fly = matches!(e.operator, Operator::Fly | Operator::FlyByHand);
        let asks_to_land = e.operator == Operator::Land || e.incidents.ends_flight();
        match self.phase {
            _ if reaction == Reaction::EmergencyStop => Phase::MotorsStopped,
            Phase::Idle if asks_to_land && self.drone_reports_flying(e) == Some(true) => {
                Phase::Landing
            }
            // On the ground no other fault orders a landing.
            Phase::Idle if reaction == Reaction::Land && self.has_flown_before_order() => {
                Phase::Landing
            }
            Phase::Idle if asks_to_fly && reaction < Reaction::StayDown => Phase::TakingOff,
            Phase::TakingOff | Phase::Flying if reaction == Reaction::Land => Phase::Landing,
            Phase::TakingOff if reaction == Reaction::BrakeAndLand => Phase::Landing,
            Phase::Flying if self.has_braked(e, found) => Phase::Landing,
            Phase::TakingOff if self.is_take_off_complete(e) => Phase::Flying,
            Phase::Landing if self.is_down(e) => Phase::Landed,
            Phase::Landing if self.is_landing_overdue(e) => Phase::LandingUnconfirmed,
            Phase::Idle
            | Phase::TakingOff
            | Phase::Flying
            | Phase::Landing
            | Phase::Landed
            | Phase::LandingUnconfirmed
            | Phase::MotorsStopped => self.phase,
        }
    }

    /// Whether the emergency stop was not ordered yet: it is, whatever shows the drone down.
    fn is_first_stop(&self) -> bool {
        self.phase == Phase::MotorsStopped && self.end_ordered_ns.is_none()
    }

    /// The order of this tick, after the phase is known.
    fn order(&mut self, e: &Evidence, reaction: Reaction) -> Option<DroneOrder> {
        let is_due = |ordered_ns: Option<i64>, after_s| {
            ordered_ns.is_none_or(|ordered_ns| elapsed_s(ordered_ns, e.t_ns) >= after_s)
        };
        match self.phase {
            Phase::TakingOff
                if self.take_off.ordered_ns.is_none()
                    || (is_due(self.take_off.ordered_ns, TAKE_OFF_RETRY_S)
                        && self.may_repeat_take_off(e)
                        && reaction < Reaction::StayDown) =>
            {
                self.take_off.ordered_ns = Some(e.t_ns);
                Some(DroneOrder::TakeOff)
            }
            Phase::Landing | Phase::LandingUnconfirmed | Phase::MotorsStopped
                if is_due(self.end_ordered_ns, LAND_PERIOD.seconds())
                    && (self.is_first_stop() || !self.is_down(e)) =>
            {
                self.end_ordered_ns = Some(e.t_ns);
                if self.phase == Phase::MotorsStopped {
                    Some(DroneOrder::EmergencyStop)
                } else {
                    Some(DroneOrder::Land)
                }
            }
            _ => None,
        }
    }
}

#[cfg(test)]
#[expect(clippy::large_types_passed_by_value, reason = "tests change copies of the evidence")]
mod tests;
