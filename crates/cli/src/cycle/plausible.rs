//! What the motion capture says about itself: repeated poses, and places that no vehicle gets to.
//!
//! Owns the signs that a stream goes on and is wrong: it repeats one pose to the last digit, or it is
//! further away than a vehicle flies. What follows from them is the supervisor's to say.

use tello_estim::{Filtered, Verdict};
use tello_io::clock::TimeNs;
use tello_model::rows::{Pose, pose};

/// Repetitions in a row that are no coincidence: a vehicle in the air never stands still to a tenth of
/// a millimetre and a ten-thousandth of a radian.
const REPEATS_MIN: u32 = 3;

/// No vehicle of ours is faster. In 25 minutes of real flights poses that are accepted exceed it by 0.38 m
/// at most, after a refusal, and by 0.27 m otherwise. m/s
const SPEED_MAX_MPS: f64 = 2.0;

/// The newest poses, seen one by one.
#[derive(Debug, Clone, Default)]
pub(super) struct Plausibility {
    raw: Option<Pose>,
    repeats: u32,
    /// The last pose that the filter let through, and when it was measured.
    accepted: Option<(Pose, TimeNs)>,
    jump_m: Option<f64>,
}

impl Plausibility {
    /// A tick begins.
    pub(super) fn open(&mut self) {
        self.jump_m = None;
    }

    /// Forgets the place of the vehicle.
    pub(super) fn restart(&mut self) {
        self.accepted = None;
    }

    /// Takes a raw pose, measured at `at`, and what the filter made of it.
    pub(super) fn judge(&mut self, raw: Option<&Pose>, filtered: &Filtered, at: TimeNs) {
        let Some(raw) = raw else { return };
        self.repeats =
            if self.raw.as_ref() == Some(raw) { self.repeats.saturating_add(1) } else { 0 };
        self.raw = Some(*raw);
        let Some(now) = filtered.o.filter(|_| filtered.position == Verdict::Accepted) else {
            return;
        };
        if let Some((before, before_at)) = self.accepted.replace((now, at)) {
            let distance_m = (now - before).fixed_rows::<3>(pose::X).norm();
            let excess_m = distance_m - SPEED_MAX_MPS * at.since(before_at).seconds().max(0.0);
            self.jump_m = Some(self.jump_m.map_or(excess_m, |before_m| before_m.max(excess_m)));
        }
    }

    /// Whether the stream repeats itself.
    pub(super) fn is_repeated(&self) -> bool {
        self.repeats >= REPEATS_MIN
    }

    /// By how much the accepted poses of this tick are further apart than a vehicle flies; `None` without
    /// one. m
    pub(super) fn jump_m(&self) -> Option<f64> {
        self.jump_m
    }
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
