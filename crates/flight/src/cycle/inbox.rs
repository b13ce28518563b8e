//! All inputs of a tick: a replay repeats the tick from them.

use horizon_model::rows::stick;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Outcome;
use crate::drone::DroneStatus;
use crate::time::TimeNs;
use crate::{Incidents, Operator, Sighting};

/// Most sightings that one tick takes, the newest: of a source of 500 Hz those of more than
/// [`SIGHTING_AGE_MAX`](super::SIGHTING_AGE_MAX), whatever arrives at once.
pub const SIGHTINGS_MAX: usize = 64;

/// Arguments of one tick.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema, Default)]
#[serde(deny_unknown_fields)]
pub struct Inbox {
    /// Ticks since the start of the log.
    pub step: u64,
    /// When the tick began. ns since the start of the log.
    pub now: TimeNs,
    /// Periods without a tick before this one.
    pub skipped: u64,
    /// Mocap samples that arrived since the last tick, oldest first.
    pub sightings: Vec<Sighting>,
    /// Newest status that the drone sent since the last tick.
    pub drone: Option<DroneStatus>,
    /// World x, y, z of the obstacle that moves, if it was seen since the last tick. m
    #[serde(rename = "obstacle", default, skip_serializing_if = "Option::is_none")]
    pub obstacle_w: Option<[f64; 3]>,
    /// What the person at the controls asks for.
    pub operator: Operator,
    /// What happened beside the control loop; nothing in logs from before it was recorded.
    #[serde(default)]
    pub incidents: Incidents,
    /// Sticks of a person who steers; `None`: the controller does. 1
    pub manual: Option<[f64; stick::COUNT]>,
    /// Sticks that another program really sent, in the recording of a foreign flight: they enter the
    /// FIFO in place of ours. `None` in a flight of our own. 1
    pub flown: Option<[f64; stick::COUNT]>,
    /// The solver poll at which the time of the tick was over, counted from 0; `None` if it was in
    /// time. Written after a live tick, so that a replay stops its solvers at the same place.
    pub late_at_poll: Option<u32>,
}

impl Inbox {
    /// The inbox of step 0 with nothing in it, and room for the sightings. The only allocation.
    pub fn new() -> Self {
        Self { sightings: Vec::with_capacity(SIGHTINGS_MAX), ..Self::default() }
    }

    /// Empties the inbox for the tick of `step`, which begins at `now`, and keeps its buffer.
    ///
    /// Real time: no allocation, constant cost.
    pub fn open(&mut self, step: u64, now: TimeNs) {
        let mut sightings = std::mem::take(&mut self.sightings);
        sightings.clear();
        let operator = self.operator;
        *self = Self { step, now, sightings, operator, ..Self::default() };
    }
}

/// Where in a tick the solvers are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TickStage {
    /// The estimator is done.
    Estimated,
    /// The controller is done.
    Planned,
}

/// The clock as a tick may see it: as an answer, never as a time.
pub trait Watch {
    /// Whether the time of the solvers is over; asked once per solver iteration, and before Clarabel takes a
    /// subproblem over.
    fn is_late(&mut self) -> bool;

    /// Called when a stage is done, for the log of solve times.
    fn mark(&mut self, stage: TickStage);

    /// Called once per tick when sticks and order stand, which may be before the solvers run.
    fn send(&mut self, out: &Outcome);

    /// Whether [`Outcome::plan`] is read: the sticks of a whole horizon take time to fill in.
    fn reads_plan(&self) -> bool {
        true
    }
}

/// Virtual time: the solvers run to their iteration limits, or to the poll that a recording has.
#[derive(Debug, Clone, Copy, Default)]
pub struct Unwatched {
    polls: u32,
    late_at_poll: Option<u32>,
    ignores_plan: bool,
}

impl Unwatched {
    /// A watch that is late where the recorded tick was.
    pub fn as_recorded(inbox: &Inbox) -> Self {
        Self::default().late_at(inbox.late_at_poll)
    }

    /// A watch that is late from this poll of a tick on; `None`: never.
    #[must_use]
    pub fn late_at(self, poll: Option<u32>) -> Self {
        Self { late_at_poll: poll, ..self }
    }

    /// A watch for flights of which the sticks count that were sent, not those that were planned.
    pub fn without_plan() -> Self {
        Self { ignores_plan: true, ..Self::default() }
    }
}

impl Watch for Unwatched {
    fn is_late(&mut self) -> bool {
        let is_late = self.late_at_poll.is_some_and(|poll| self.polls >= poll);
        self.polls = self.polls.saturating_add(1);
        is_late
    }

    fn mark(&mut self, _stage: TickStage) {}

    fn send(&mut self, _out: &Outcome) {}

    fn reads_plan(&self) -> bool {
        !self.ignores_plan
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::motion;

    use super::*;
    use crate::cycle::sense::tests::{DT_NS, cycle, sighting};
    use crate::cycle::{Outcome, SIGHTING_AGE_MAX};

    /// The tick after 25 others and a pause of `skipped` periods, which the inbox reports or not. The vehicle has
    /// 0.5 m/s.
    fn after_a_pause(skipped: u64, is_reported: bool) -> Outcome {
        let mut cycle = cycle();
        let mut inbox = Inbox::new();
        let mut out = cycle.new_outcome();
        for step in (0..25).chain([25 + skipped]) {
            let now = TimeNs(step.cast_signed() * DT_NS);
            inbox.open(step, now);
            inbox.skipped = if step >= 25 && is_reported { skipped } else { 0 };
            inbox.sightings.push(sighting(now, 0));
            cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
        }
        out
    }

    #[test]
    fn after_a_pause_the_sticks_in_transit_are_neutral() {
        // Over the dead time of 0.34 s the driven velocity decays with the lag of 0.64 s, along both axes.
        let is_coasting = |is_reported| {
            let out = after_a_pause(20, is_reported);
            [motion::V_X, motion::V_Y]
                .map(|row| out.s_pred[row] / out.s_hat[row])
                .iter()
                .all(|ratio| (0.5..0.75).contains(ratio))
        };
        assert!(is_coasting(true));
        assert!(
            !is_coasting(false),
            "the sticks before the pause were neutral: the test shows nothing"
        );
    }

    #[test]
    fn there_is_room_for_every_young_frame_of_the_fastest_source() {
        const FASTEST_HZ: f64 = 500.0;
        assert!(SIGHTINGS_MAX as f64 > FASTEST_HZ * SIGHTING_AGE_MAX.seconds());
        assert!(Inbox::new().sightings.capacity() >= SIGHTINGS_MAX);
    }
}
