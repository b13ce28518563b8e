//! Input and output of the supervisor at a tick.

use horizon_model::rows::{Pose, PoseRate};
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::fault::{Fault, FaultSet, Pilot};
use crate::drone::DroneOrder;
use crate::monitor::Findings;

/// Where a flight begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Start {
    /// On the ground, with a take-off.
    Grounded,
    /// In the air; control starts at once.
    Airborne,
    /// Carried by hand, the motors stand: control plans at once and nothing is sent.
    Carried,
}

/// Part of a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// On the ground, waiting for the order to fly and for everything it takes.
    #[default]
    Idle,
    /// Take-off ordered and not yet confirmed.
    TakingOff,
    /// In the air; control steers unless something is wrong.
    Flying,
    /// Landing ordered, repeatedly; never taken back.
    Landing,
    /// Down. The end.
    Landed,
    /// The landing was not confirmed in time; it is ordered until the vehicle is down. The end.
    #[serde(alias = "fault")]
    LandingUnconfirmed,
    /// Emergency stop: the motors are stopped, repeatedly until the vehicle is down. The end.
    #[serde(alias = "cut")]
    MotorsStopped,
}

impl Phase {
    /// Whether the flight is over: nothing steers any more.
    pub fn is_over(self) -> bool {
        match self {
            Self::Landed | Self::LandingUnconfirmed | Self::MotorsStopped => true,
            Self::Idle | Self::TakingOff | Self::Flying | Self::Landing => false,
        }
    }

    /// Whether a flight that ended in this phase, by `ended_by`, did what it was for.
    pub fn is_success(
        self,
        targets_reached: usize,
        targets_count: usize,
        ended_by: &[Fault],
    ) -> bool {
        let is_complete = targets_reached == targets_count;
        self == Self::Landed && is_complete && !ended_by.iter().any(|fault| fault.ends_early())
    }

    /// Name on terminals.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::TakingOff => "taking off",
            Self::Flying => "flying",
            Self::Landing => "landing",
            Self::Landed => "landed",
            Self::LandingUnconfirmed => "landing unconfirmed",
            Self::MotorsStopped => "emergency stop",
        }
    }
}

/// What the person at the controls asks for, the weakest first.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, Deserialize, JsonSchema,
)]
#[serde(rename_all = "snake_case")]
pub enum Operator {
    /// Nothing yet.
    #[default]
    Wait,
    /// Take off and fly the mission.
    Fly,
    /// Take off by hand: with a person at the sticks no pose is needed. As [`Operator::Fly`] once the person
    /// has handed over.
    FlyByHand,
    /// Land now; never taken back.
    Land,
    /// Emergency stop, in any phase; stronger than all else and never taken back.
    #[serde(alias = "cut")]
    EmergencyStop,
}

/// Pose and velocity of the vehicle by the estimate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatedMotion {
    /// Pose, world frame. m, rad
    pub pose: Pose,
    /// Derivative of `pose` by time. m/s, rad/s
    pub rate: PoseRate,
}

/// A command outage as detected from the motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outage {
    /// Time since it was detected. s
    pub for_s: f64,
    /// Whether the drone goes on with the command of its beginning, in place of none.
    pub is_held: bool,
    /// Motion of the vehicle if the detection is wrong and all commands were applied: with the newest estimate of the
    /// parameter, and with the parameter before the flight.
    pub if_applied: [EstimatedMotion; 2],
}

/// Whether a plan stays inside of the room and out of obstacles that do not move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlanClearance {
    /// It does, or there is no plan yet.
    Clear,
    /// It does not.
    Blocked,
    /// Plans know no walls, or the newest one is too old.
    Unknown,
}

/// What the drone reports of itself.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "reports of separate things, not a state")]
pub struct DroneReport {
    /// Age of the report. s
    pub age_s: f64,
    /// Whether it flies.
    pub is_flying: bool,
    /// Whether it is sent sticks: in the text SDK not before a take-off is over.
    pub takes_sticks: bool,
    /// Height over an unknown level. m
    pub height_m: Option<f64>,
    /// Battery charge. %
    pub battery_pct: u8,
    /// Whether it reports its charge as low, by its own threshold.
    pub is_battery_low: bool,
    /// Whether it reports its charge as critical.
    pub is_battery_critical: bool,
}

/// What happened beside the control loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[expect(clippy::struct_excessive_bools, reason = "unrelated events, not a state")]
pub struct Incidents {
    /// The guardian has ended or does not answer: nothing would land the drone of a program that dies.
    pub is_guardian_lost: bool,
    /// Guardian or sender landed the drone, or must be taken to have, because this program stood still.
    pub has_landed_unasked: bool,
    /// Since the tick before, a timer released a key or a stick in the person's place.
    pub has_input_expired: bool,
    /// The numbers of the mocap frames were not yet found to keep pace with time: nothing shows how old a pose is.
    #[serde(default)]
    pub is_mocap_undated: bool,
}

impl Incidents {
    /// Whether one of them ends the flight: the drone is landed, whatever the control loop wants.
    pub fn ends_flight(&self) -> bool {
        self.is_guardian_lost || self.has_landed_unasked
    }
}

/// Whether the moving obstacle comes within the margin of the newest accepted pose during a landing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObstacleApproach {
    /// It does not, there is none, or its position is unknown.
    No,
    /// It could if it turned towards the vehicle.
    Possible,
    /// It does by its present velocity.
    Predicted,
}

/// Whether a person holds the sticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum HandInput {
    /// Nobody does.
    Absent,
    /// A person holds the sticks and leaves them neutral.
    Neutral,
    /// A person holds the sticks and moves them.
    Steering,
}

/// Obstacles beside a position of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleEvidence {
    /// Whether there is a moving obstacle whose position has been unknown for half a second, or always.
    pub is_unseen: bool,
    /// Whether the vehicle stands inside of an obstacle, or would climb into one in its take-off, or the moving
    /// obstacle comes near; false after the take-off.
    pub blocks_take_off: bool,
    /// Whether the moving obstacle comes near. One that is unseen may do so, too, by its predicted position.
    pub approach: ObstacleApproach,
    /// Position of the reference if the straight path there leads through an obstacle that does not move and the moving
    /// obstacle is not in it; else `None`. World frame. m
    pub reference_behind_w: Option<Vector3<f64>>,
    /// Whether the newest accepted pose is inside of an obstacle that does not move.
    pub is_vehicle_inside: bool,
}

impl ObstacleEvidence {
    /// Whether the moving obstacle comes near, or may: its position is unknown.
    pub(super) fn is_near_or_unseen(&self) -> bool {
        self.approach == ObstacleApproach::Predicted || self.is_unseen
    }
}

/// How plausible the poses of the motion capture are by themselves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseEvidence {
    /// Whether the newest poses, three at least, repeat one position in flight; false on the ground.
    pub is_repeated: bool,
    /// How much further the pose of this tick is from the one before than a vehicle flies in the time
    /// between; `None` if no pose was accepted. m
    pub jump_m: Option<f64>,
    /// Length of the sum of all steps since the take-off that were further than a vehicle flies: a step and its return
    /// cancel. m
    pub shift_m: f64,
    /// Whether poses have jumped again and again lately, in whatever direction.
    pub is_rough: bool,
    /// How much deeper the pose of this tick is below the one before than a vehicle descends in the time
    /// between; `None` if no pose was accepted. m
    pub drop_m: Option<f64>,
    /// Whether the poses on the ground have agreed for long enough for a take-off.
    pub is_settled: bool,
}

/// Motion of the vehicle beside its reference, its inputs and the planned time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackingEvidence {
    /// By how much the vehicle has gone away from its reference: its distance less the least one since the mission
    /// began or was resumed. In the descent before a landing, how far it is from where it is held. m
    pub position_growth_m: Option<f64>,
    /// Difference between its horizontal velocity and that of its reference; `None` for constant targets. m/s
    pub velocity_error_mps: Option<f64>,
    /// Whether that difference leads away from the reference, as in a swing and not on the return to it.
    pub is_receding: bool,
    /// By how much its heading has turned away from that of its reference: the difference less the least one since the
    /// mission began or was resumed. rad
    pub heading_growth_rad: Option<f64>,
    /// Height of its reference over it. m
    pub height_deficit_m: Option<f64>,
    /// By how much it has come down below its reference; 0 beside an obstacle. m
    pub sink_depth_m: Option<f64>,
    /// Integral of the inputs in one direction that have not moved the vehicle. s of full deflection
    pub pressed_s: f64,
    /// Whether the vehicle came to rest at once while its inputs drove it on.
    pub has_hit: bool,
    /// By how much the flight of the mission is longer than twice its planned time; negative before. s
    pub overtime_s: f64,
}

/// Everything that a decision rests on, at one tick. An age of NaN counts as too old.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(clippy::struct_excessive_bools, reason = "unrelated observations, not a state")]
pub struct Evidence {
    /// Time of the tick. ns since any fixed moment
    pub t_ns: i64,
    /// Periods without a tick before this one.
    pub skipped: u64,
    /// Age of the older of the newest accepted position and heading with anything new; `None` before
    /// both were there. s
    pub pose_age_s: Option<f64>,
    /// The newest accepted pose, world frame. m, rad
    pub pose: Option<Pose>,
    /// The newest estimate; `None` if there is none.
    pub motion: Option<EstimatedMotion>,
    /// Whether the newest plan stays inside of the room and out of obstacles that do not move.
    pub plan: PlanClearance,
    /// Obstacles and the vehicle.
    pub obstacles: ObstacleEvidence,
    /// Whether the poses are plausible.
    pub poses: PoseEvidence,
    /// What the monitors found.
    pub findings: Findings,
    /// The present command outage.
    pub outage: Option<Outage>,
    /// Whether the sticks act later than the dead times may be corrected.
    pub is_dead_time_long: bool,
    /// The vehicle beside its reference.
    pub tracking: TrackingEvidence,
    /// Speed by the estimate. m/s
    pub speed_mps: f64,
    /// Newest report of the drone; `None` before the first.
    pub drone: Option<DroneReport>,
    /// What the operator asks for.
    pub operator: Operator,
    /// What happened beside the control loop.
    pub incidents: Incidents,
    /// Whether a person holds the sticks.
    pub hand: HandInput,
    /// Whether the last target is reached.
    pub is_mission_done: bool,
    /// Whether the newest estimate failed.
    pub has_estimator_failed: bool,
    /// Whether the newest plan failed.
    pub has_controller_failed: bool,
}

impl Evidence {
    /// Whether a person holds the sticks, neutral ones or not.
    pub fn is_by_hand(&self) -> bool {
        self.hand != HandInput::Absent
    }
}

/// What the supervisor decides for one tick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[must_use]
pub struct Decision {
    /// Phase after the tick.
    pub phase: Phase,
    /// Whose sticks pass; `None`: neutral sticks.
    pub pilot: Option<Pilot>,
    /// Whether the controller brings the vehicle to rest where it is, whatever the mission.
    pub is_braking: bool,
    /// What to send beside the sticks.
    pub order: Option<DroneOrder>,
    /// What is wrong, and what ended the flight.
    pub faults: FaultSet,
    /// What ended the flight alone; empty before.
    pub ended_by: FaultSet,
    /// Whether a fresh pose shows the vehicle above the ground; `None` without such a pose.
    pub pose_is_airborne: Option<bool>,
}

impl Decision {
    /// Whether the sticks of a pilot pass.
    pub fn may_steer(&self) -> bool {
        self.pilot.is_some()
    }
}

#[cfg(test)]
mod tests;
