//! What can go wrong in a flight, and the only place that decides what happens then.

mod causes;

use std::fmt::{self, Debug, Formatter};

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use strum::VariantArray;

/// Defines [`Fault`] by a row for each: name on terminals, reaction under the controller, reaction under a person.
macro_rules! faults {
    ($($(#[$meta:meta])* $fault:ident: $name:literal, $controller:ident, $person:ident;)+) => {
        /// Something that is wrong at a tick.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        #[derive(Serialize, Deserialize, JsonSchema, VariantArray)]
        #[serde(rename_all = "snake_case")]
        pub enum Fault {
            $($(#[$meta])* $fault,)+
        }

        impl Fault {
            /// Name on terminals.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$fault => $name,)+
                }
            }

            /// Reaction to the fault under `pilot`. A new fault does not compile without its reactions.
            ///
            /// A person flies by sight: what makes the controller blind, or warns it of a wall, takes no
            /// sticks from the person. It counts again when the person hands back.
            ///
            /// Real time: no allocation, constant cost.
            pub fn reaction(self, pilot: Pilot) -> Reaction {
                let (controller, person) = match self {
                    $(Self::$fault => (Reaction::$controller, Reaction::$person),)+
                };
                match pilot {
                    Pilot::Controller => controller,
                    Pilot::Person => person,
                }
            }
        }
    };
}

faults! {
    /// The newest accepted position or heading is older than `stale_s`, or there never was one.
    MocapStale: "mocap stale", Hold, Note;
    /// No position, or no heading, was accepted for longer than `lost_s`.
    MocapLost: "mocap lost", Land, Note;
    /// The stream goes on and the poses stand still while the vehicle flies.
    MocapFrozen: "mocap frozen", Hold, Note;
    /// A pose further than `jump_m` from any possible flight was accepted, at once or in several steps: another object,
    /// or new axes.
    MocapJumped: "mocap jumped", Land, Note;
    /// Too many accepted poses of the newest 12 s were further from the pose before than a vehicle flies
    /// (`pose_plausibility.rs`). The object is found in two places, or the poses are noise.
    MocapRough: "mocap rough", Land, Note;
    /// Before the take-off the poses of the last `standing.for_s` do not agree.
    MocapUnsettled: "mocap unsettled", StayDown, Note;
    /// Before the take-off neither frame numbers nor time stamps have kept pace with time for two seconds: poses cannot
    /// be dated.
    MocapUndated: "mocap undated", StayDown, Note;
    /// The poses differ from the drone's own velocity, height or turn by more than their errors.
    #[serde(rename = "witness_doubtful")]
    PoseDoubtful: "mocap and drone differ", Hold, Note;
    /// The poses differ from the drone's own measurements by so much, or for so long, that they cannot be flown by.
    #[serde(rename = "witness_disagrees")]
    PoseInconsistent: "mocap and drone disagree", Land, Note;
    /// The vehicle moves in another direction than commanded, or turns otherwise by the poses than by the drone's own
    /// heading: the heading is wrong.
    HeadingWrong: "heading wrong", Land, Note;
    /// Before the take-off the vehicle is outside of the room, high above its floor or inside of an obstacle: another
    /// object, other units or other axes.
    StartMisplaced: "start misplaced", StayDown, Note;
    /// The plan leads outside of the room or into an obstacle that does not move, or did so just now.
    PlanBlocked: "plan blocked", Brake, Note;
    /// The vehicle makes no progress, by one of two signs. Plans were blocked for more than 3 s in sum, a fifth of the
    /// time without a blocked plan subtracted. For 3 s the vehicle stayed within 0.4 m, with an obstacle that does not
    /// move between the vehicle and a reference that stood.
    BlockedLong: "blocked too long", BrakeAndLand, Note;
    /// The vehicle is inside of an obstacle that does not move.
    ObstacleEntered: "inside of an obstacle", Land, Note;
    /// The position of the moving obstacle is unknown: plans cannot keep away from it.
    ObstacleUnseen: "obstacle unseen", Brake, Note;
    /// For 0.3 s in the take-off, until the drone executes sticks, the moving obstacle comes near or its position is
    /// unknown.
    ObstacleApproaches: "obstacle approaches", Land, Note;
    /// Where plans know no walls, or by hand: the vehicle would come to rest outside of the room.
    FenceNear: "fence near", Hold, Note;
    /// The vehicle is outside of the room.
    FenceLeft: "outside of the room", Land, Note;
    /// The vehicle does not follow its reference, by one of four signs:
    ///
    /// - For 0.3 s its distance exceeds the least one so far by more than `failsafe.tracking_m`.
    /// - For 0.3 s it is by more than 0.45 m lower than it was, and below the reference: it sinks or is pulled down.
    ///   Within 0.6 m of an obstacle this does not count.
    /// - For 4 s in sum, a fifth of the other time subtracted, its velocity differs by more than 0.6 m/s: it
    ///   oscillates. What leads away from the reference counts by its square, at most twofold.
    /// - For 1.5 s its heading differs by more than 1 rad. In an outage this counts only while the vehicle turns.
    TrackingLost: "off the reference", Land, Note;
    /// The vehicle does not move, by one of three signs:
    ///
    /// - Inputs of `failsafe.pressed_s` in one direction have moved nothing: it is held, caught or blocked.
    /// - It came to rest at once while its inputs drove it on: it has hit something.
    /// - It stands still below its reference, for 1.2 s while it is steered, for 2.4 s in an outage.
    Immobile: "immobile", Land, Note;
    /// For 0.3 s the vehicle is faster than `failsafe.speed_mps`.
    TooFast: "too fast", Land, Note;
    /// For 3 s an axis acts later than the largest correction of its dead time allows for: roll and pitch by more
    /// than 0.08 s, throttle or yaw by more than 0.15 s.
    DeadTimeLong: "sticks act late", Land, Note;
    /// The mission takes much longer than planned.
    // A mission does not bind a person.
    MissionOverdue: "mission overdue", BrakeAndLand, Note;
    /// In a command outage the drone goes on with an old command.
    // A drone that keeps an old command ignores the brake; a drone that a draught carries executes it.
    OutageHeld: "old command held", Brake, Note;
    /// A command outage lasts longer than `failsafe.outage_s`, or `failsafe.outage_alone_s` while nothing confirms it.
    OutageLong: "outage too long", Land, Note;
    /// For 0.5 s the drone has not confirmed an outage that the link monitor has found. If its commands act
    /// nevertheless, the vehicle would be outside of the room by now.
    OutageUnsafe: "outage near a wall", Land, Note;
    /// The drone has not reported yet, or before the take-off not for `drone_silent_s`.
    DroneUnheard: "drone unheard", StayDown, StayDown;
    /// Before the take-off the drone reports that it flies.
    DroneAloft: "drone already flies", StayDown, StayDown;
    /// Before the take-off the drone has reported for a second that it flies: it took off without our order.
    TookOffUnasked: "took off unasked", Land, Land;
    /// The drone has not reported for longer than `drone_silent_s`.
    // A silent drone may still execute orders: a person who sees it can judge that.
    DroneSilent: "drone silent", BrakeAndLand, Note;
    /// The drone reports for a second that it stands, in flight or after it flew in the take-off. It landed by itself,
    /// fell or was caught.
    NotFlying: "not flying", Land, Land;
    /// The battery is below `battery_low_pct` or above 100 %, or the drone reports it as low.
    BatteryLow: "battery low", StayDown, StayDown;
    /// For 1 s the battery is below `battery_critical_pct`, or the drone reports it as critical.
    BatteryCritical: "battery critical", BrakeAndLand, Land;
    /// The estimator has no estimate.
    EstimatorFailed: "estimator failed", Hold, Note;
    /// The controller has no plan; the previous one goes on.
    // The shifted plan goes on; SolverFailing is the limit.
    ControllerFailed: "controller failed", Note, Note;
    /// Estimator or controller failed in more than `solver_failures_max` ticks; a tick without a failure subtracts
    /// half.
    SolverFailing: "solver failing", Land, Note;
    /// The loop missed more than `late_periods_max` periods in a short time.
    TicksLate: "ticks late", Land, Land;
    /// The take-off was not confirmed within `take_off_timeout_s`. Or the drone has reported to fly for 3 s and has not
    /// risen: it is held.
    TakeOffTimeout: "take-off not confirmed", Land, Land;
    /// The landing was not confirmed within `landing_timeout_s`.
    LandingTimeout: "landing not confirmed", Land, Land;
    /// The guardian has ended or does not answer: nothing would land the drone of a program that dies.
    GuardianLost: "guardian lost", Land, Land;
    /// Guardian or sender landed the drone because the program, or its control thread, stood still.
    ProgramStalled: "program stood still", Land, Land;
    /// The sticks that a person holds have been neutral for `failsafe.person_gone_s`, or for 5 s during which the
    /// vehicle was outside of the room or too fast: nobody steers.
    PersonGone: "person gone", Land, Land;
    /// A timer released a key or a stick in the person's place.
    // Sticks that were released are neutral already.
    InputExpired: "key or stick expired", Note, Note;
    /// The landing is confirmed by the poses alone: the drone did not report, or its height contradicted it.
    LandedByPose: "landed by the pose alone", Note, Note;
    /// The landing is confirmed by the drone alone: there was no pose, or it came to the floor by a jump.
    LandedByDrone: "landed by the drone alone", Note, Note;
    /// The operator asks to land.
    OperatorStop: "operator stop", Land, Land;
    /// The operator asks for the motors to stop.
    #[serde(alias = "operator_cut")]
    OperatorEmergencyStop: "operator emergency stop", EmergencyStop, EmergencyStop;
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
    /// The flight ends by landing at once, in any case; a vehicle on the ground stays there.
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
}

/// A set of faults.
///
/// Real time: no allocation, at most one pass over the faults.
#[derive(Clone, Copy, PartialEq, Eq, Default)]
pub struct FaultSet(u64);

const _: () = assert!(Fault::ALL.len() <= 64, "a fault without a bit in FaultSet");

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
