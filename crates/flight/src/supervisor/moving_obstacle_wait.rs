//! Waiting for the moving obstacle to pass, before a landing or take-off.
//!
//! Owns when the obstacle was near last, and how long a vehicle at the end of its mission waits for it: a landing
//! evades nothing.

use super::Supervisor;
use super::condition_timer::{LeakyTimer, elapsed_s};
use super::evidence::{Evidence, ObstacleApproach, Phase};
use crate::forgetting::LEAK_RATIO;

/// Longest wait at the end of a mission for an obstacle that was near, and how much longer while it comes near. s, s
const OBSTACLE_WAIT_MAX_S: f64 = 60.0;
const OBSTACLE_WAIT_EXTENSION_S: f64 = 10.0;

/// The obstacle was near until it has kept away for so long: a person who pauses or turns walks on. s
const OBSTACLE_CLEAR_S: f64 = 4.0;

/// Longest time in sum, a fifth of the time without an approach subtracted, in which an approach explains that the
/// vehicle is off its reference: somebody may pace beside a vehicle that does not obey. One that was explained for so
/// long has to be left alone for [`APPROACH_RECOVERY_S`] before another approach does. s, s
const APPROACHED_MAX_S: f64 = 20.0;
const APPROACH_RECOVERY_S: f64 = 5.0;

/// When the moving obstacle was near last. ns
#[derive(Debug, Clone, Default)]
pub(super) struct MovingObstacleTimes {
    /// It came near.
    came_ns: Option<i64>,
    /// It came near, or walked so near that it could.
    near_ns: Option<i64>,
}

impl Supervisor {
    /// Updates whether the moving obstacle comes near, or walks so near that it could; and for how long it has been
    /// near, or not seen, while the vehicle cannot evade it.
    pub(super) fn update_obstacle_timers(&mut self, e: &Evidence) {
        if e.obstacles.approach == ObstacleApproach::Predicted {
            self.moving_obstacle.came_ns = Some(e.t_ns);
        }
        if e.obstacles.approach != ObstacleApproach::No {
            self.moving_obstacle.near_ns = Some(e.t_ns);
        }
        if self.is_flying() && !e.is_by_hand() {
            let came = self.was_approached_recently(e.t_ns);
            self.timers.approached.update(came, e.t_ns);
            self.timers.approached.limit(APPROACHED_MAX_S + LEAK_RATIO * APPROACH_RECOVERY_S);
        } else {
            self.timers.approached = LeakyTimer::default();
        }
        let obeys = self.hover.is_over() && self.takes_sticks(e);
        let is_helpless = self.phase == Phase::TakingOff || self.phase == Phase::Flying && !obeys;
        let counts = is_helpless && e.obstacles.is_near_or_unseen() && !self.is_dry_run;
        self.timers.obstacle_near.update(counts, e.t_ns);
    }

    /// Whether the moving obstacle came near within [`OBSTACLE_CLEAR_S`] before `t_ns`, and not for too long: the
    /// vehicle may still evade it, or return.
    pub(crate) fn was_approached(&self, t_ns: i64) -> bool {
        self.was_approached_recently(t_ns) && self.believes_approach()
    }

    /// Whether an approach may explain that the vehicle is off its reference.
    pub(crate) fn believes_approach(&self) -> bool {
        !self.timers.approached.exceeds(APPROACHED_MAX_S)
    }

    /// Whether the moving obstacle came near within [`OBSTACLE_CLEAR_S`] before `t_ns`.
    fn was_approached_recently(&self, t_ns: i64) -> bool {
        self.moving_obstacle
            .came_ns
            .is_some_and(|came_ns| elapsed_s(came_ns, t_ns) < OBSTACLE_CLEAR_S)
    }

    /// Whether the moving obstacle was near within the last [`OBSTACLE_CLEAR_S`].
    pub(super) fn was_obstacle_near(&self, e: &Evidence) -> bool {
        self.moving_obstacle
            .near_ns
            .is_some_and(|near_ns| elapsed_s(near_ns, e.t_ns) < OBSTACLE_CLEAR_S)
    }

    /// Whether the mission has been done, and the vehicle has waited, for long enough. A landing evades nothing: the
    /// vehicle first waits for an obstacle that was near, or is not seen.
    pub(super) fn is_final_wait_over(&self, e: &Evidence) -> bool {
        let wait_s = if e.obstacles.approach == ObstacleApproach::Predicted {
            OBSTACLE_WAIT_MAX_S + OBSTACLE_WAIT_EXTENSION_S
        } else if self.was_obstacle_near(e) || e.obstacles.is_unseen {
            OBSTACLE_WAIT_MAX_S
        } else {
            0.0
        };
        self.timers.mission_done.has_lasted(e.t_ns, self.table.finish_hold_s + wait_s)
    }

    /// Whether a vehicle whose mission is done waits at its last target, for the moving obstacle or for its hold time.
    pub(super) fn waits_for_moving_obstacle(&self, e: &Evidence) -> bool {
        self.timers.mission_done.holds() && !self.is_final_wait_over(e)
    }
}

#[cfg(test)]
mod tests;
