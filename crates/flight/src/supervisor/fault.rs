//! What can go wrong in a flight, and the only place that decides what happens then.

mod causes;

use std::fmt::{self, Debug, Formatter};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// Something that is wrong at a tick.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Serialize,
    Deserialize,
    JsonSchema,
    VariantArray,
)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// The newest accepted position or heading is older than `stale_s`, or there never was one.
    MocapStale,
    /// No position, or no heading, was accepted for longer than `lost_s`.
    MocapLost,
    /// The stream goes on and the poses stand still while the vehicle flies.
    MocapFrozen,
    /// A pose further than `jump_m` from any possible flight was accepted, at once or in several steps: another object,
    /// or new axes.
    MocapJumped,
    /// Too many accepted poses of the newest 12 s were further from the pose before than a vehicle flies
    /// (`pose_plausibility.rs`). The object is found in two places, or the poses are noise.
    MocapRough,
    /// Before the take-off the poses of the last `standing.for_s` do not agree.
    MocapUnsettled,
    /// Before the take-off neither frame numbers nor time stamps have kept pace with time for two seconds: poses cannot
    /// be dated.
    MocapUndated,
    /// The poses differ from the drone's own velocity, height or turn by more than their errors.
    #[serde(rename = "witness_doubtful")]
    PoseDoubtful,
    /// The poses differ from the drone's own measurements by so much, or for so long, that they cannot be flown by.
    #[serde(rename = "witness_disagrees")]
    PoseInconsistent,
    /// The vehicle moves in another direction than commanded, or turns otherwise by the poses than by the drone's own
    /// heading: the heading is wrong.
    HeadingWrong,
    /// Before the take-off the vehicle is outside of the room, high above its floor or inside of an obstacle: another
    /// object, other units or other axes.
    StartMisplaced,
    /// The plan leads outside of the room or into an obstacle that does not move, or did so just now.
    PlanBlocked,
    /// The vehicle does not get on, by one of two signs. Plans were blocked for more than 3 s in sum, a fifth of the
    /// time without a blocked plan subtracted. For 3 s the vehicle stayed within 0.4 m, with an obstacle that does not
    /// move between the vehicle and a reference that stood.
    BlockedLong,
    /// The vehicle is inside of an obstacle that does not move.
    ObstacleEntered,
    /// The position of the moving obstacle is unknown: plans cannot keep away from it.
    ObstacleUnseen,
    /// For 0.3 s in the take-off, until the drone obeys sticks, the moving obstacle comes near or its position is
    /// unknown.
    ObstacleApproaches,
    /// Where plans know no walls, or by hand: the vehicle would come to rest outside of the room.
    FenceNear,
    /// The vehicle is outside of the room.
    FenceLeft,
    /// The vehicle does not follow its reference, by one of four signs:
    ///
    /// - For 0.3 s its distance exceeds the least one so far by more than `failsafe.tracking_m`.
    /// - For 0.3 s it is by more than 0.45 m lower than it was, and below the reference: it sinks or is pulled down.
    ///   Within 0.6 m of an obstacle this does not count.
    /// - For 4 s in sum, a fifth of the other time subtracted, its velocity differs by more than 0.6 m/s: it
    ///   oscillates. What leads away from the reference counts by its square, at most twofold.
    /// - For 1.5 s its heading differs by more than 1 rad. In an outage this counts only while the vehicle turns.
    TrackingLost,
    /// The vehicle does not move, by one of three signs:
    ///
    /// - Inputs of `failsafe.pressed_s` in one direction have moved nothing: it is held, caught or blocked.
    /// - It came to rest at once while its inputs drove it on: it has hit something.
    /// - It stands still below its reference, for 1.2 s while it is steered, for 2.4 s in an outage.
    Immobile,
    /// For 0.3 s the vehicle is faster than `failsafe.speed_mps`.
    TooFast,
    /// For 3 s an axis acts later than the largest correction of its dead time allows for: roll and pitch by more
    /// than 0.08 s, throttle or yaw by more than 0.15 s.
    DeadTimeLong,
    /// The mission takes much longer than planned.
    MissionOverdue,
    /// In a command outage the drone goes on with an old command.
    OutageHeld,
    /// A command outage lasts longer than `failsafe.outage_s`, or `failsafe.outage_alone_s` while nothing confirms it.
    OutageLong,
    /// For 0.5 s the drone has not confirmed an outage that the link monitor has found. If its commands act
    /// nevertheless, the vehicle has left the room.
    OutageUnsafe,
    /// The drone has not reported yet, or before the take-off not for `drone_silent_s`.
    DroneUnheard,
    /// Before the take-off the drone reports that it flies.
    DroneAloft,
    /// Before the take-off the drone has reported for a second that it flies: it took off without our order.
    TookOffUnasked,
    /// The drone has not reported for longer than `drone_silent_s`.
    DroneSilent,
    /// The drone reports for a second that it stands, in flight or after it flew in the take-off. It landed by itself,
    /// fell or was caught.
    NotFlying,
    /// The battery is below `battery_low_pct` or above 100 %, or the drone calls it low.
    BatteryLow,
    /// For 1 s the battery is below `battery_critical_pct`, or the drone calls it critical.
    BatteryCritical,
    /// The estimator has no estimate.
    EstimatorFailed,
    /// The controller has no plan; the previous one goes on.
    ControllerFailed,
    /// Estimator or controller failed in more than `solver_failures_max` ticks; one without a failure makes up for half
    /// a failure.
    SolverFailing,
    /// The loop missed more than `late_periods_max` periods in a short time.
    TicksLate,
    /// The take-off was not confirmed within `take_off_timeout_s`. Or the drone has reported to fly for 3 s and has not
    /// risen: it is held.
    TakeOffTimeout,
    /// The landing was not confirmed within `landing_timeout_s`.
    LandingTimeout,
    /// The guardian has ended or does not answer: nothing would land the drone of a program that dies.
    GuardianLost,
    /// Guardian or sender landed the drone because the program, or its control thread, stood still.
    ProgramStalled,
    /// The sticks that a person holds have been neutral for `failsafe.person_gone_s`, or for 5 s during which the
    /// vehicle was outside of the room or too fast: nobody steers.
    PersonGone,
    /// A timer released a key or a stick in the person's place.
    InputExpired,
    /// The landing is confirmed by the poses alone: the drone did not report, or its height contradicted it.
    LandedByPose,
    /// The landing is confirmed by the drone alone: there was no pose, or it came to the floor by a jump.
    LandedByDrone,
    /// The operator asks to land.
    OperatorStop,
    /// The operator asks for the motors to stop.
    #[serde(alias = "operator_cut")]
    OperatorEmergencyStop,
}

/// Who steers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Pilot {
    /// The controller, by the poses of the motion capture.
    Controller,
    /// A person, by sight.
    Person,
}

/// What a fault leads to, mildest first; of several the strongest counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Reaction {
    /// Nothing but a line in the log.
    Note,
    /// A vehicle on the ground stays there; a flight goes on.
    StayDown,
    /// The controller brings the vehicle to rest while it lasts; a vehicle on the ground stays there.
    Brake,
    /// Neutral sticks while it lasts; a vehicle on the ground stays there.
    Hold,
    /// The controller brings the vehicle to rest, then the flight ends as by `Land`. For what leaves poses and
    /// controller trusted.
    BrakeAndLand,
    /// The flight ends by landing at once, whatever comes later; a vehicle on the ground stays there.
    Land,
    /// The motors stop at once and the vehicle falls.
    EmergencyStop,
}

impl Fault {
    /// Whether a flight that this fault ended was cut short: not if the operator landed it, nor by how a landing was
    /// confirmed.
    pub(crate) fn ends_early(self) -> bool {
        !matches!(self, Self::OperatorStop | Self::LandedByPose | Self::LandedByDrone)
    }

    /// Behind "landed": in brackets the names of what cut the flight short; empty if nothing did.
    pub fn ending_names(ended_by: &[Self]) -> String {
        let early = ended_by.iter().filter(|fault| fault.ends_early());
        let names: Vec<&str> = early.map(|fault| fault.name()).collect();
        if names.is_empty() { String::new() } else { format!(" ({})", names.join(", ")) }
    }

    /// All faults, in the order of their declaration.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Name on terminals.
    pub fn name(self) -> &'static str {
        match self {
            Self::MocapStale => "mocap stale",
            Self::MocapLost => "mocap lost",
            Self::MocapFrozen => "mocap frozen",
            Self::MocapJumped => "mocap jumped",
            Self::MocapRough => "mocap rough",
            Self::MocapUnsettled => "mocap unsettled",
            Self::MocapUndated => "mocap undated",
            Self::PoseDoubtful => "mocap and drone differ",
            Self::PoseInconsistent => "mocap and drone disagree",
            Self::HeadingWrong => "heading wrong",
            Self::StartMisplaced => "start misplaced",
            Self::PlanBlocked => "plan blocked",
            Self::BlockedLong => "blocked too long",
            Self::ObstacleEntered => "inside of an obstacle",
            Self::ObstacleUnseen => "obstacle unseen",
            Self::ObstacleApproaches => "obstacle approaches",
            Self::FenceNear => "fence near",
            Self::FenceLeft => "outside of the room",
            Self::TrackingLost => "off the reference",
            Self::Immobile => "immobile",
            Self::TooFast => "too fast",
            Self::DeadTimeLong => "sticks act late",
            Self::MissionOverdue => "mission overdue",
            Self::OutageHeld => "old command held",
            Self::OutageLong => "outage too long",
            Self::OutageUnsafe => "outage near a wall",
            Self::DroneUnheard => "drone unheard",
            Self::DroneAloft => "drone already flies",
            Self::TookOffUnasked => "took off unasked",
            Self::DroneSilent => "drone silent",
            Self::NotFlying => "not flying",
            Self::BatteryLow => "battery low",
            Self::BatteryCritical => "battery critical",
            Self::EstimatorFailed => "estimator failed",
            Self::ControllerFailed => "controller failed",
            Self::SolverFailing => "solver failing",
            Self::TicksLate => "ticks late",
            Self::TakeOffTimeout => "take-off not confirmed",
            Self::LandingTimeout => "landing not confirmed",
            Self::GuardianLost => "guardian lost",
            Self::ProgramStalled => "program stood still",
            Self::PersonGone => "person gone",
            Self::InputExpired => "key or stick expired",
            Self::LandedByPose => "landed by the pose alone",
            Self::LandedByDrone => "landed by the drone alone",
            Self::OperatorStop => "operator stop",
            Self::OperatorEmergencyStop => "operator emergency stop",
        }
    }

    /// Reaction to the fault under `pilot`. No wildcard: a new fault does not compile without a reaction.
    ///
    /// A person flies by sight: what makes the controller blind, or warns it of a wall, takes no
    /// sticks from the person. It counts again when the person hands back.
    ///
    /// Real time: no allocation, constant cost.
    pub fn reaction(self, pilot: Pilot) -> Reaction {
        let (controller, person) = match self {
            // The shifted plan goes on, SolverFailing is the limit; sticks that were released are neutral already.
            Self::ControllerFailed
            | Self::InputExpired
            | Self::LandedByPose
            | Self::LandedByDrone => (Reaction::Note, Reaction::Note),
            Self::BatteryLow | Self::DroneUnheard | Self::DroneAloft => {
                (Reaction::StayDown, Reaction::StayDown)
            }
            Self::StartMisplaced | Self::MocapUnsettled | Self::MocapUndated => {
                (Reaction::StayDown, Reaction::Note)
            }
            // A drone that keeps an old command ignores the brake; one that is carried by a draught does not.
            Self::PlanBlocked | Self::ObstacleUnseen | Self::OutageHeld => {
                (Reaction::Brake, Reaction::Note)
            }
            Self::MocapStale
            | Self::MocapFrozen
            | Self::PoseDoubtful
            | Self::EstimatorFailed
            | Self::FenceNear => (Reaction::Hold, Reaction::Note),
            // A silent drone may still obey, and a person who sees it can judge that. A mission does not bind a person.
            Self::DroneSilent | Self::MissionOverdue | Self::BlockedLong => {
                (Reaction::BrakeAndLand, Reaction::Note)
            }
            Self::BatteryCritical => (Reaction::BrakeAndLand, Reaction::Land),
            Self::MocapLost
            | Self::MocapJumped
            | Self::MocapRough
            | Self::PoseInconsistent
            | Self::HeadingWrong
            | Self::FenceLeft
            | Self::ObstacleEntered
            | Self::ObstacleApproaches
            | Self::TrackingLost
            | Self::Immobile
            | Self::TooFast
            | Self::DeadTimeLong
            | Self::OutageLong
            | Self::OutageUnsafe
            | Self::SolverFailing => (Reaction::Land, Reaction::Note),
            Self::TookOffUnasked
            | Self::NotFlying
            | Self::TicksLate
            | Self::TakeOffTimeout
            | Self::LandingTimeout
            | Self::GuardianLost
            | Self::ProgramStalled
            | Self::PersonGone
            | Self::OperatorStop => (Reaction::Land, Reaction::Land),
            Self::OperatorEmergencyStop => (Reaction::EmergencyStop, Reaction::EmergencyStop),
        };
        match pilot {
            Pilot::Controller => controller,
            Pilot::Person => person,
        }
    }
}

/// A set of faults.
///
/// Real time: no allocation, at most one pass over the faults.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultSet(u64);

impl FaultSet {
    /// Adds `fault` if `is_present`; takes none away.
    pub fn set(&mut self, fault: Fault, is_present: bool) {
        self.0 |= u64::from(is_present) << fault as u32;
    }

    /// Whether `fault` is in the set.
    pub fn contains(self, fault: Fault) -> bool {
        self.0 >> fault as u32 & 1 == 1
    }

    /// Whether nothing is wrong.
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The faults in the order of their declaration.
    pub fn iter(self) -> impl Iterator<Item = Fault> {
        Fault::ALL.iter().copied().filter(move |fault| self.contains(*fault))
    }

    /// Faults in either set.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// The faults of this set that end a flight under `pilot`.
    #[must_use]
    pub fn ending_flight(self, pilot: Pilot) -> Self {
        let mut ending = Self::default();
        for fault in self.iter() {
            ending.set(fault, fault.reaction(pilot) >= Reaction::BrakeAndLand);
        }
        ending
    }

    /// The strongest reaction under `pilot`, [`Reaction::Note`] without any fault.
    pub fn reaction(self, pilot: Pilot) -> Reaction {
        self.iter().map(|fault| fault.reaction(pilot)).max().unwrap_or(Reaction::Note)
    }
}

impl Debug for FaultSet {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.debug_set().entries(self.iter()).finish()
    }
}

#[cfg(test)]
mod tests;
