//! What of the raw observations is believed, and how old it is.
//!
//! Owns the way from the sightings of a tick to the rows that the estimator may use.

use nalgebra::SVector;
use tello_control::Phase;
use tello_estim::{Filtered, Observed, Verdict};
use tello_io::clock::TimeNs;
use tello_model::Model;
use tello_model::angle::wrap;
use tello_model::rows::{Pose, pose, stick};

use super::{Cycle, HeldObservations, Inbox, Outcome};

impl<M, const NS: usize, const NP: usize, const NR: usize> Cycle<M, NS, NP, NR>
where
    M: Model<NS, { stick::COUNT }, { pose::COUNT }, NP>,
{
    /// Steps 1 and 2 of section 4.3.11: what of the raw observations is believed.
    ///
    /// `None` until the filter has seen its first valid pose.
    pub(super) fn sense(
        &mut self,
        inbox: &Inbox,
        out: &mut Outcome,
    ) -> Option<Observed<{ pose::COUNT }>> {
        self.memory.drone = inbox.drone.or(self.memory.drone);
        let (mut is_position_new, mut is_heading_new) = (false, false);
        let mut o = None;
        self.memory.o_seen = None;
        self.plausibility.open();
        // The filter is told of a tick without a sighting, too: its limits grow.
        let nothing = inbox.sightings.is_empty().then_some(None);
        for sighting in inbox.sightings.iter().map(Some).chain(nothing) {
            let raw = sighting.and_then(|sighting| sighting.pose.as_ref());
            let at = sighting.map_or(inbox.now, |sighting| sighting.measured_at);
            self.stand(raw, at);
            let filtered = self.filter.update(raw);
            let filtered = self.doubt_heading(filtered);
            out.see(sighting, &filtered);
            self.plausibility.judge(raw, &filtered, at);
            let is_news = !self.is_frozen();
            let measured_at = Some(at);
            if filtered.position == Verdict::Accepted && is_news {
                is_position_new = true;
                self.memory.position_at = measured_at;
                self.memory.o_seen = filtered.o;
            }
            if filtered.heading == Verdict::Accepted && is_news {
                is_heading_new = true;
                self.memory.heading_at = measured_at;
            }
            o = filtered.o;
        }
        Some(self.believe(o?, is_position_new, is_heading_new))
    }

    /// On the ground: a pose that contradicts the ones before begins anew.
    fn stand(&mut self, raw: Option<&Pose>, at: TimeNs) {
        let is_standing = self.supervisor.phase() == Phase::Idle;
        let finite = raw.filter(|raw| raw.iter().all(|row| row.is_finite()));
        let Some(raw) = finite.filter(|_| is_standing) else { return };
        if self.start.see(raw, at) {
            self.filter.restart();
            self.plausibility.restart();
            self.mhe.restart();
        }
    }

    /// Refuses an accepted heading that is too far from the estimate: the filter gives in to whatever is
    /// repeated for long enough.
    fn doubt_heading(&mut self, filtered: Filtered) -> Filtered {
        let is_flying = self.supervisor.phase() == Phase::Flying && !self.is_carried;
        let is_judged = is_flying && self.mhe.is_started();
        let Some(o) = filtered.o.filter(|_| is_judged && filtered.heading == Verdict::Accepted)
        else {
            return filtered;
        };
        let theta_hat_rad = self.mhe.s_hat()[pose::THETA];
        if wrap(o[pose::THETA] - theta_hat_rad).abs() <= self.jump_rad {
            return filtered;
        }
        self.filter.refuse_heading(theta_hat_rad)
    }

    /// Whether the stream repeats itself while the vehicle flies. On the ground it may.
    pub(super) fn is_frozen(&self) -> bool {
        let is_in_flight = self.supervisor.phase() == Phase::Flying && !self.is_carried;
        is_in_flight && self.plausibility.is_repeated()
    }

    /// The rows of a filtered observation that the estimator may use.
    fn believe(
        &self,
        o: SVector<f64, { pose::COUNT }>,
        is_position_new: bool,
        is_heading_new: bool,
    ) -> Observed<{ pose::COUNT }> {
        let uses_held = self.held == HeldObservations::Use;
        let mut is_present = [is_position_new || uses_held; pose::COUNT];
        is_present[pose::THETA] = is_heading_new || uses_held;
        Observed { o, is_present }
    }

    /// Age of the older of the newest position and the newest heading; `None` before the first.
    pub(super) fn pose_age_s(&self, inbox: &Inbox) -> Option<f64> {
        let oldest = self.memory.position_at?.min(self.memory.heading_at?);
        Some(inbox.now.since(oldest).seconds())
    }
}
