//! When the control loop ends.

use tello_flight::Phase;
use tello_flight::cycle::{Inbox, Operator};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::tello::DroneStatus;

/// Time that the loop goes on after the flight, so that the log shows the drone on the ground.
const SETTLE: SpanNs = SpanNs::from_ms(500);

/// Time in which a drone that reports to fly is ordered to land while its landing is unconfirmed.
const SETTLE_UNCONFIRMED: SpanNs = SpanNs::from_ms(15_000);

/// Whether the loop ends, by the phases so far.
pub(super) struct EndCondition {
    ground_wait: SpanNs,
    is_flying: bool,
    /// When the phase was last one that goes on.
    went_on_at: TimeNs,
}

impl EndCondition {
    pub(super) fn new(ground_wait: SpanNs) -> Self {
        Self { ground_wait, is_flying: false, went_on_at: TimeNs(0) }
    }

    pub(super) fn receive(&mut self, status: Option<DroneStatus>) {
        self.is_flying = status.map_or(self.is_flying, |status| status.is_flying);
    }

    pub(super) fn update(
        &mut self,
        inbox: &Inbox,
        phase: Phase,
        pose_is_airborne: Option<bool>,
    ) -> bool {
        // A person who holds the sticks may take time before the take-off.
        let person_holds_sticks = phase == Phase::Idle && inbox.manual.is_some();
        if matches!(phase, Phase::TakingOff | Phase::Flying | Phase::Landing) || person_holds_sticks
        {
            self.went_on_at = inbox.now;
        }
        let has_waited = inbox.now.since(self.went_on_at);
        match phase {
            Phase::TakingOff | Phase::Flying | Phase::Landing => false,
            Phase::Idle => {
                let is_ended = inbox.operator == Operator::Land || inbox.incidents.ends_flight();
                is_ended || has_waited > self.ground_wait
            }
            // The drone has time to receive the order again, and the log to show it on the ground.
            Phase::LandingUnconfirmed | Phase::MotorsStopped
                if self.is_flying || pose_is_airborne == Some(true) =>
            {
                has_waited > SETTLE_UNCONFIRMED
            }
            Phase::Landed | Phase::LandingUnconfirmed | Phase::MotorsStopped => has_waited > SETTLE,
        }
    }
}

#[cfg(test)]
mod tests;
