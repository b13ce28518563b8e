//! The moving obstacle is let past before a landing or take-off.
//!
//! Owns when it was near last, and how long a vehicle at the end of its mission waits for it: a landing evades nothing.

use super::Supervisor;
use super::condition_timer::{LeakyTimer, elapsed_s};
use super::evidence::{Evidence, Phase};
use crate::forgetting::LEAK_RATIO;

/// Longest wait at the end of a mission for an obstacle that was near, and how much longer while it comes near. s, s
const LET_PAST_S: f64 = 60.0;
const LET_PAST_AGAIN_S: f64 = 10.0;

/// The obstacle was near until it has kept away for so long: a person who pauses or turns walks on. s
const KEEPS_AWAY_S: f64 = 4.0;

/// Longest time in sum, a fifth of the time without an approach subtracted, in which an approach explains that the
/// vehicle is off its reference: somebody may pace beside a vehicle that does not obey. One that was explained for so
/// long has to be left alone for [`REGAIN_S`] before another approach does. s, s
const APPROACHED_MAX_S: f64 = 20.0;
const REGAIN_S: f64 = 5.0;

/// When the moving obstacle was near last. ns
#[derive(Debug, Clone, Default)]
pub(super) struct MovingObstacleTimes {
    /// It came near.
    came_ns: Option<i64>,
    /// It came near, or walked so near that it could.
    near_ns: Option<i64>,
}

impl Supervisor {
    /// Notes whether the moving obstacle comes near, or walks so near that it could; and for how long it has been near,
    /// or not seen, while the vehicle cannot evade it.
    pub(super) fn remember_obstacle(&mut self, e: &Evidence) {
        if e.obstacles.is_approached {
            self.moving_obstacle.came_ns = Some(e.t_ns);
        }
        if e.obstacles.is_approached || e.obstacles.may_be_approached {
            self.moving_obstacle.near_ns = Some(e.t_ns);
        }
        if self.is_flying() && !e.is_by_hand {
            let came = self.came_lately(e.t_ns);
            self.timers.approached.update(came, e.t_ns);
            self.timers.approached.limit(APPROACHED_MAX_S + LEAK_RATIO * REGAIN_S);
        } else {
            self.timers.approached = LeakyTimer::default();
        }
        let obeys = self.settling.is_over() && self.takes_sticks(e);
        let is_helpless = self.phase == Phase::TakingOff || self.phase == Phase::Flying && !obeys;
        let counts = is_helpless && e.obstacles.is_near_or_unseen() && !self.is_carried;
        self.timers.obstacle_near.update(counts, e.t_ns);
    }

    /// Whether the moving obstacle came near within [`KEEPS_AWAY_S`] before `t_ns`, and not for too long: the vehicle
    /// may still evade it, or return.
    pub(crate) fn was_approached(&self, t_ns: i64) -> bool {
        self.came_lately(t_ns) && self.believes_approach()
    }

    /// Whether an approach may explain that the vehicle is off its reference.
    pub(crate) fn believes_approach(&self) -> bool {
        !self.timers.approached.exceeds(APPROACHED_MAX_S)
    }

    /// Whether the moving obstacle came near within [`KEEPS_AWAY_S`] before `t_ns`.
    fn came_lately(&self, t_ns: i64) -> bool {
        self.moving_obstacle.came_ns.is_some_and(|came_ns| elapsed_s(came_ns, t_ns) < KEEPS_AWAY_S)
    }

    /// Whether the moving obstacle was near within the last [`KEEPS_AWAY_S`].
    pub(super) fn was_obstacle_near(&self, e: &Evidence) -> bool {
        self.moving_obstacle
            .near_ns
            .is_some_and(|near_ns| elapsed_s(near_ns, e.t_ns) < KEEPS_AWAY_S)
    }

    /// Whether the mission has been done for long enough. A landing evades nothing: an obstacle that was near, or is
    /// not seen, is let past first.
    pub(super) fn is_held_out(&self, e: &Evidence) -> bool {
        let let_past_s = if e.obstacles.is_approached {
            LET_PAST_S + LET_PAST_AGAIN_S
        } else if self.was_obstacle_near(e) || e.obstacles.is_unseen {
            LET_PAST_S
        } else {
            0.0
        };
        self.timers.mission_done.has_lasted(e.t_ns, self.table.finish_hold_s + let_past_s)
    }

    /// Whether a vehicle whose mission is done lets somebody past, or waits at its last target.
    pub(super) fn lets_past(&self, e: &Evidence) -> bool {
        self.timers.mission_done.holds() && !self.is_held_out(e)
    }
}

#[cfg(test)]
mod tests;
