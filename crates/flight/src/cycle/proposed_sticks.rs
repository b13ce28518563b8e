//! The sticks that the pilot of a tick proposes, the plan's or the person's, limited and blended; and those that are
//! sent.

use horizon_model::rows::Sticks;

use super::{Cycle, Inbox, Vehicle};
use crate::Pilot;
use crate::gate::Approved;

impl<M: Vehicle<NS, NP>, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR> {
    /// The sticks that `pilot` proposes; neutral without one. Begins, advances or ends the hand-over between pilots.
    pub(super) fn proposed_sticks(&mut self, pilot: Option<Pilot>, inbox: &Inbox) -> Sticks {
        let u_pilot = match (pilot, inbox.manual) {
            (Some(Pilot::Person), Some(u_hand)) => Sticks::from(u_hand),
            (Some(Pilot::Controller), _) => {
                let u_plan = self.planner.sticks();
                self.link.as_ref().map_or(u_plan, |link| link.limited(&u_plan))
            }
            (Some(Pilot::Person) | None, _) => {
                self.hand_over.end();
                return Sticks::zeros();
            }
        };
        let u_newest = self.fifo.newest();
        pilot.map_or(u_pilot, |pilot| self.hand_over.blend(pilot, &u_pilot, u_newest, self.dt_s))
    }

    /// The sticks of this tick as they are sent, or were by another program; neutral in a dry run.
    pub(super) fn sent(&self, approved: Approved, inbox: &Inbox) -> Sticks {
        match inbox.flown {
            Some(flown) => Sticks::from(flown),
            None if self.is_dry_run => Sticks::zeros(),
            None => approved.sticks(),
        }
    }
}

#[cfg(test)]
mod tests;
