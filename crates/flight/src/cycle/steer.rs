//! From the pilot of a tick to its sticks: the plan's or the person's, limited, blended and passed by the gate.

use horizon_model::Model;
use horizon_model::rows::{Sticks, pose, stick};

use super::{Cycle, Inbox};
use crate::Pilot;
use crate::gate::Approved;

impl<M, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// The sticks of the pilot that may steer: as wished, and as the gate lets them through.
    pub(super) fn steer(&mut self, pilot: Option<Pilot>, inbox: &Inbox) -> (Sticks, Approved) {
        let (dt_s, u_newest) = (self.dt_s, self.fifo.newest());
        match (pilot, inbox.manual) {
            (Some(pilot @ Pilot::Person), Some(u_hand)) => {
                let u_wish = self.hand_over.blend(pilot, &Sticks::from(u_hand), u_newest, dt_s);
                (u_wish, self.gate.pass_manual(&u_wish))
            }
            (Some(pilot @ Pilot::Controller), _) => {
                let u_plan = self.planner.sticks();
                let u_plan = self.link.as_ref().map_or(u_plan, |link| link.limited(&u_plan));
                let u_plan = self.until_proven(u_plan);
                let u_wish = self.hand_over.blend(pilot, &u_plan, u_newest, dt_s);
                (u_wish, self.gate.pass(&u_wish, self.pose_age_s(inbox)))
            }
            (Some(Pilot::Person) | None, _) => {
                self.hand_over.end();
                (Sticks::zeros(), Approved::neutral())
            }
        }
    }

    /// `u_plan` as far as sticks go before a flight has shown after its take-off that inputs and poses have the same
    /// axes.
    fn until_proven(&self, u_plan: Sticks) -> Sticks {
        let limit = self.monitors.unproven_stick_max().filter(|_| self.memory.has_taken_off);
        limit.map_or(u_plan, |limit| u_plan.map(|u| u.clamp(-limit, limit)))
    }

    /// Whether the drone is sent sticks: in the text SDK not before a take-off is over.
    pub(super) fn takes_sticks(&self) -> bool {
        self.memory.drone.is_none_or(|status| status.takes_sticks)
    }
}
