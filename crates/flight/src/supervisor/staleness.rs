//! Whether the motion capture still tells where the vehicle is.
//!
//! Owns the limits of staleness (`stale_s`: hold, `lost_s`: land) and the other conditions of the poses' faults. The
//! gate checks the age of a pose once more, by its own limit.

use super::evidence::{Evidence, Phase};
use super::fault::Fault;
use super::{Supervisor, elapsed_s, exceeds};

impl Supervisor {
    /// What is wrong with the poses.
    pub(super) fn pose_faults(&self, e: &Evidence) -> [(Fault, bool); 8] {
        let table = &self.table;
        let running_s = self.began_ns.map_or(0.0, |began_ns| elapsed_s(began_ns, e.t_ns));
        // A person who carries the vehicle may take time to show it to the cameras.
        let pose_age_s = e.pose_age_s.or((!self.is_carried).then_some(running_s));
        let climbs_still_s = self.since.climbs_still.elapsed_s(e.t_ns);
        let still_s = e.findings.frozen_s.filter(|_| self.is_flying()).or(climbs_still_s);
        let is_still = |limit_s| still_s.is_some_and(|still_s| exceeds(still_s, limit_s));
        let is_lost = pose_age_s.is_some_and(|age_s| exceeds(age_s, table.lost_s));
        let has_jumped = e.jump_m.is_some_and(|jump_m| exceeds(jump_m, table.jump_m));
        let is_repeated = self.is_pose_stale(e) && e.is_pose_repeated;
        [
            (Fault::MocapStale, self.is_pose_stale(e)),
            (Fault::MocapLost, is_lost || is_still(table.lost_s)),
            (Fault::MocapFrozen, is_repeated || is_still(table.stale_s)),
            (
                Fault::MocapJumped,
                self.is_taking_off_or_flying() && (has_jumped || exceeds(e.shift_m, table.jump_m)),
            ),
            (Fault::MocapRough, self.is_taking_off_or_flying() && e.is_pose_rough),
            (Fault::MocapUnsettled, self.phase == Phase::Idle && !e.is_pose_settled),
            (Fault::MocapUndated, self.phase == Phase::Idle && e.incidents.is_mocap_undated),
            (Fault::StartMisplaced, self.phase == Phase::Idle && !self.may_start(e)),
        ]
    }

    /// Whether the vehicle stands where one may take off, as far as that is known.
    pub(super) fn may_start(&self, e: &Evidence) -> bool {
        let is_in_room = self.room.zip(e.pose).is_none_or(|(room, at)| room.may_start_at(&at));
        is_in_room && !e.is_start_barred
    }

    /// Whether the newest pose is too old to steer by, or there is none.
    pub(super) fn is_pose_stale(&self, e: &Evidence) -> bool {
        e.pose_age_s.is_none_or(|age_s| exceeds(age_s, self.table.stale_s))
    }
}

#[cfg(test)]
mod tests;
