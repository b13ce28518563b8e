//! What control thread and sockets know at the end of a flight.

use std::fmt::{self, Display, Formatter};

use schemars::JsonSchema;
use serde::Serialize;
use tello_flight::cycle::ParameterEstimate;
use tello_flight::{Decision, FaultSet, Phase};
use tello_io::tello::LinkCounters;

/// Result of the flight, as the control thread knows it.
#[derive(Debug, Clone, Default)]
pub struct LoopEnd {
    /// Phase after the last tick.
    pub phase: Phase,
    /// Faults of the last tick.
    pub faults_last: FaultSet,
    /// Every fault that was present at some time after the take-off was ordered.
    pub faults: FaultSet,
    /// Faults that ended the flight.
    pub ended_by: FaultSet,
    /// Targets reached.
    pub targets_reached: usize,
    /// Whether the mocap ever gave a frame.
    pub has_frames: bool,
    /// Orders that the link did not take; the supervisor repeats them.
    pub orders_lost: u64,
    /// Sightings that a tick had no room for.
    pub sightings_dropped: u64,
    /// Records that the logger could not take.
    pub records_dropped: u64,
    /// Parameter estimate at the end of the flying phase; `None` if it did not fly.
    pub found: Option<ParameterEstimate>,
}

impl LoopEnd {
    /// Takes the decision of a tick, if it made one.
    pub fn note(&mut self, decision: Option<Decision>) {
        let Some(decision) = decision else { return };
        self.phase = decision.phase;
        self.faults_last = decision.faults;
        self.ended_by = decision.ended_by;
        if decision.phase != Phase::Idle {
            self.faults = self.faults.union(decision.faults);
        }
    }
}

/// Counts of the sockets; all zero in a flight without trouble. Lost commands leave no trace here: see
/// [`Outages`](crate::metrics::Outages).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, JsonSchema)]
pub struct Links {
    /// Sightings that found the tick full.
    pub sightings_dropped: u64,
    /// Packets of the drone that were refused.
    pub drone_malformed: u64,
    /// Reports of the drone that found the queue full.
    pub drone_overflow: u64,
    /// Stick packets that the sender made neutral because control was silent.
    pub watchdog_neutral: u64,
    /// Times that the sender landed the drone because control was silent.
    pub watchdog_landings: u64,
    /// Times that the guardian landed the drone, or may have, because this program stood still.
    pub guardian_landings: u64,
    /// Guardians that ended before the flight, or did not answer: it is landed then.
    pub guardians_lost: u64,
    /// Orders that the link did not take at first.
    pub orders_lost: u64,
}

impl Links {
    pub(super) fn of(drone: &LinkCounters, end: &LoopEnd) -> Self {
        Self {
            sightings_dropped: end.sightings_dropped,
            drone_malformed: drone.malformed.get(),
            drone_overflow: drone.overflow.get(),
            watchdog_neutral: drone.neutralised.get(),
            watchdog_landings: drone.watchdog_landings.get(),
            guardian_landings: drone.guardian_landings.get(),
            guardians_lost: drone.guardians_lost.get(),
            orders_lost: end.orders_lost,
        }
    }
}

impl Display for Links {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{} sightings dropped; drone {} malformed, {} statuses unread; \
             watchdog {} neutral, {} landings; guardian {} landings, {} lost; {} orders lost",
            self.sightings_dropped,
            self.drone_malformed,
            self.drone_overflow,
            self.watchdog_neutral,
            self.watchdog_landings,
            self.guardian_landings,
            self.guardians_lost,
            self.orders_lost
        )
    }
}
