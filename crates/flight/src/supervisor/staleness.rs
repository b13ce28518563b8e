//! Whether the motion capture still shows where the vehicle is.
//!
//! Owns the limits of staleness (`stale_s`: hold, `lost_s`: land) and the conditions of stillness and jumps. The
//! gate checks the age of a pose once more, by its own limit.

use super::evidence::Evidence;
use super::{Supervisor, exceeds};

impl Supervisor {
    /// Whether there has been no pose, or only poses that stand still, for longer than `lost_s`.
    pub(super) fn is_pose_lost(&self, e: &Evidence) -> bool {
        // A person who carries the vehicle may take time to show it to the cameras.
        let age_s = e.pose_age_s.or_else(|| (!self.is_dry_run).then(|| self.running_s(e)));
        let is_lost = |time_s| exceeds(time_s, self.table.lost_s);
        age_s.is_some_and(is_lost) || self.still_s(e).is_some_and(is_lost)
    }

    /// Whether the stream repeats an old pose, or its poses have stood still for longer than `stale_s`.
    pub(super) fn is_pose_frozen(&self, e: &Evidence) -> bool {
        let is_still = self.still_s(e).is_some_and(|still_s| exceeds(still_s, self.table.stale_s));
        is_still || (self.is_pose_stale(e) && e.poses.is_repeated)
    }

    /// For how long the poses have stood still while the vehicle moved: in flight, or in a climb that the drone
    /// reports. s
    fn still_s(&self, e: &Evidence) -> Option<f64> {
        let in_climb_s = || self.timers.still_in_climb.elapsed_s(e.t_ns);
        e.findings.frozen_s.filter(|_| self.is_flying()).or_else(in_climb_s)
    }

    /// Whether the poses have jumped further than `jump_m`, at once or in several steps.
    pub(super) fn has_pose_jumped(&self, e: &Evidence) -> bool {
        let limit_m = self.table.jump_m;
        e.poses.jump_m.is_some_and(|jump_m| exceeds(jump_m, limit_m))
            || exceeds(e.poses.shift_m, limit_m)
    }

    /// Whether the newest pose is too old to steer by, or there is none.
    pub(super) fn is_pose_stale(&self, e: &Evidence) -> bool {
        e.pose_age_s.is_none_or(|age_s| exceeds(age_s, self.table.stale_s))
    }
}

#[cfg(test)]
mod tests;
