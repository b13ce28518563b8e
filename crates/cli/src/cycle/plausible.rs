//! What the motion capture says about itself: repeated poses, and places that it insists on.
//!
//! Owns the two signs that a stream goes on and is wrong: it repeats one pose to the last digit, and
//! it makes the filter refuse its poses until it believes one far away. What follows from them is the
//! supervisor's to say.

use tello_control::Jump;
use tello_estim::{Filtered, Verdict};
use tello_model::angle::wrap;
use tello_model::rows::{Pose, pose};

/// Repetitions in a row that are no coincidence: a vehicle in the air never stands still to a tenth of
/// a millimetre and a ten-thousandth of a radian.
const REPEATS_MIN: u32 = 3;

/// Refusals in a row after which an accepted pose counts as a jump. A stall of the stream is no refusal.
const REFUSED_MIN: u32 = 3;

/// The newest poses, seen one by one.
#[derive(Debug, Clone, Default)]
pub(super) struct Plausibility {
    raw: Option<Pose>,
    repeats: u32,
    /// The last pose that the filter let through.
    accepted: Option<Pose>,
    position_refused: u32,
    heading_refused: u32,
    jump: Option<Jump>,
}

impl Plausibility {
    /// A tick begins.
    pub(super) fn open(&mut self) {
        self.jump = None;
    }

    /// Takes a raw pose and what the filter made of it.
    pub(super) fn judge(&mut self, raw: Option<&Pose>, filtered: &Filtered) {
        let Some(raw) = raw else { return };
        self.repeats =
            if self.raw.as_ref() == Some(raw) { self.repeats.saturating_add(1) } else { 0 };
        self.raw = Some(*raw);
        let (Some(before), Some(now)) = (self.accepted, filtered.o) else {
            self.accepted = filtered.o;
            return;
        };
        let mut moved = now - before;
        moved[pose::THETA] = wrap(moved[pose::THETA]);
        let [x, y, z, turn_rad] = moved.into();
        let has_moved = settle(&mut self.position_refused, filtered.position);
        // A heading is judged only with a position that is believed.
        let has_turned = filtered.position == Verdict::Accepted
            && settle(&mut self.heading_refused, filtered.heading);
        if has_moved || has_turned {
            let distance_m = if has_moved { x.hypot(y).hypot(z) } else { 0.0 };
            let turn_rad = if has_turned { turn_rad.abs() } else { 0.0 };
            self.jump = Some(Jump { distance_m, turn_rad });
        }
        self.accepted = Some(now);
    }

    /// Whether the stream repeats itself.
    pub(super) fn is_repeated(&self) -> bool {
        self.repeats >= REPEATS_MIN
    }

    /// How far the vehicle jumped in this tick, if poses were refused before.
    pub(super) fn jump(&self) -> Option<Jump> {
        self.jump
    }
}

/// Counts refusals; whether a row of them ends with an acceptance.
fn settle(refused: &mut u32, verdict: Verdict) -> bool {
    match verdict {
        Verdict::Held => *refused = refused.saturating_add(1),
        Verdict::Accepted => return std::mem::take(refused) >= REFUSED_MIN,
        Verdict::Missing => {}
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filtered(o: Pose, position: Verdict, heading: Verdict) -> Filtered {
        Filtered { o: Some(o), position, heading }
    }

    const HERE: Pose = Pose::new(1.0, 2.0, 1.0, 0.1);

    /// One accepted pose at `HERE`, then `refused` refusals.
    fn after(refused: u32, position: Verdict, heading: Verdict) -> Plausibility {
        let mut plausibility = Plausibility::default();
        let seen = filtered(HERE, Verdict::Accepted, Verdict::Accepted);
        plausibility.judge(Some(&HERE), &seen);
        for k in 0..refused {
            let raw = Pose::new(9.0 + f64::from(k), 9.0, 1.0, 3.0);
            plausibility.judge(Some(&raw), &filtered(HERE, position, heading));
        }
        plausibility
    }

    #[test]
    fn a_pose_accepted_after_refusals_is_a_jump_of_its_distance() {
        let there = Pose::new(4.0, 6.0, 1.0, 0.1);
        for (refused, distance_m) in [(0, None), (2, None), (3, Some(5.0)), (50, Some(5.0))] {
            let mut plausibility = after(refused, Verdict::Held, Verdict::Held);
            let seen = filtered(there, Verdict::Accepted, Verdict::Accepted);
            plausibility.judge(Some(&there), &seen);
            assert_eq!(plausibility.jump().map(|jump| jump.distance_m), distance_m, "{refused}");
            plausibility.open();
            assert_eq!(plausibility.jump(), None);
        }
    }

    #[test]
    fn a_heading_accepted_after_refusals_is_a_turn_the_short_way_round() {
        let turned = HERE + Pose::new(0.01, 0.0, 0.0, -5.0);
        let mut plausibility = after(40, Verdict::Accepted, Verdict::Held);
        let seen = filtered(turned, Verdict::Accepted, Verdict::Accepted);
        plausibility.judge(Some(&turned), &seen);
        let jump = plausibility.jump().unwrap();
        assert!((jump.turn_rad - (std::f64::consts::TAU - 5.0)).abs() < 1e-12, "{jump:?}");
        assert!(jump.distance_m <= 0.0, "{jump:?}");
    }

    #[test]
    fn only_equal_poses_in_a_row_are_repetitions() {
        let mut plausibility = Plausibility::default();
        let seen = filtered(HERE, Verdict::Accepted, Verdict::Accepted);
        for _ in 0..3 {
            plausibility.judge(Some(&HERE), &seen);
            plausibility.judge(None, &seen);
        }
        assert!(!plausibility.is_repeated());
        plausibility.judge(Some(&HERE), &seen);
        assert!(plausibility.is_repeated());
        let moved = HERE + Pose::new(1e-4, 0.0, 0.0, 0.0);
        plausibility.judge(Some(&moved), &filtered(moved, Verdict::Accepted, Verdict::Accepted));
        assert!(!plausibility.is_repeated());
    }
}
