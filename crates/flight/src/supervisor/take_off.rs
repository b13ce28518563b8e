//! Where and when a vehicle may take off, and how long a take-off may be in progress.
//!
//! Owns the conditions of the first and of a repeated order to take off. Whether a take-off is complete:
//! `airborne.rs`; the hover after it: `hover_after_take_off.rs`.

use super::Supervisor;
use super::condition_timer::elapsed_s;
use super::evidence::Evidence;
use crate::drone::{TAKE_OFF_TAIL, TAKE_OFF_UNSEEN};

/// Longest time after which an order to take off is repeated: a link that returns later must not start a drone beside
/// which a person stands by then. s
const TAKE_OFF_REPEAT_MAX_S: f64 = 10.0;

/// Whether the drone has shown that it received the order to take off, the surest sign last.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default)]
pub(super) enum TakeOffSeen {
    #[default]
    No,
    /// The height of the drone or its poses rose.
    Measured,
    /// The drone reported that it flies.
    Reported,
}

/// The order to take off, what has shown that the drone received it, and the heights before.
#[derive(Debug, Clone, Default)]
pub(super) struct TakeOffEvidence {
    /// When the take-off was ordered last. ns
    pub(super) ordered_ns: Option<i64>,
    /// What has shown that the drone received the order.
    pub(super) seen: TakeOffSeen,
    /// Height of the poses on the ground. m
    pub(super) ground_m: Option<f64>,
    /// Height by the drone on the ground. m
    pub(super) drone_ground_m: Option<f64>,
}

impl Supervisor {
    /// Whether the vehicle stands where one may take off, as far as that is known.
    pub(super) fn may_start(&self, e: &Evidence) -> bool {
        let is_in_room = self.room.zip(e.pose).is_none_or(|(room, at)| room.may_start_at(&at));
        is_in_room && !e.obstacles.blocks_take_off && !self.was_obstacle_near(e)
    }

    /// Whether the order to take off may be sent again: the drone shows no sign of the first one, stands where it
    /// stood, and nobody has come near.
    pub(super) fn may_repeat_take_off(&self, e: &Evidence) -> bool {
        self.drone_reports_flying(e) == Some(false)
            && self.take_off.seen == TakeOffSeen::No
            && elapsed_s(self.phase_since_ns, e.t_ns) < TAKE_OFF_REPEAT_MAX_S
            && !self.hover.was_moved()
            && self.may_start(e)
    }

    /// Whether the time in which an ordered take-off may still be in progress is over.
    pub(super) fn is_past_take_off(&self, e: &Evidence) -> bool {
        let is_seen = self.take_off.seen != TakeOffSeen::No;
        let tail_s = if is_seen { TAKE_OFF_TAIL } else { TAKE_OFF_UNSEEN }.seconds();
        self.take_off.ordered_ns.is_none_or(|ordered_ns| elapsed_s(ordered_ns, e.t_ns) >= tail_s)
    }
}

#[cfg(test)]
mod tests;
