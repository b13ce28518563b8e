//! What the motion capture says about itself: repeated poses, and places that no vehicle gets to.
//!
//! Owns the signs that a stream goes on and is wrong: it repeats one place to the last digit, or it is
//! further away than a vehicle flies. What follows from them is the supervisor's to say.

use horizon_estim::Observed;
use horizon_model::rows::{Pose, pos_w, pose};
use nalgebra::Vector3;

use crate::time::TimeNs;
use crate::{Acceptance, Filtered};

/// Repetitions in a row that are no coincidence: a vehicle in the air never stands still to a tenth of
/// a millimetre, along x and y at once. In real flights both repeat at times, but never twice in a row unless the stream
/// stalls; a height repeats up to 5 times, so that it shows nothing alone: docs/benchmarks/2026-11-27-poses.
const REPEATS_MIN: u32 = 3;

/// Speed of a step between poses that is no jump: full sticks along one axis reach 1.8 m/s. m/s
const SPEED_MAX_MPS: f64 = 2.0;

/// Excess from which on poses are rough, as those of an object that is found in two places in turn. m
const ROUGH_M: f64 = 0.1;

/// For so many ticks after a rough pose the poses tell neither whether commands act nor how late they do: a second at
/// 50 Hz.
const ROUGH_TICKS: u32 = 50;

/// So many rough ticks among so many are no coincidence.
struct Burst {
    count: usize,
    ticks: u32,
}

/// Of jumps in quick succession and of slow ones. Real flights have one rough tick within a second at most, and two in a
/// whole flight (docs/benchmarks/2026-11-27-poses). Three single outliers, which jump there and back, are six.
const QUICK: Burst = Burst { count: 5, ticks: ROUGH_TICKS };
const SLOW: Burst = Burst { count: 7, ticks: 4 * ROUGH_TICKS };

#[derive(Debug, Clone, Copy)]
struct Accepted {
    pose: Pose,
    measured_at: TimeNs,
    /// When its place was measured first: a stalled stream repeats it.
    arrived_at: TimeNs,
}

/// The newest poses, seen one by one.
#[derive(Debug, Clone)]
pub(super) struct Plausibility {
    raw: Option<Pose>,
    repeats: u32,
    /// The last pose that the filter let through.
    accepted: Option<Accepted>,
    jump_m: Option<f64>,
    drop_m: Option<f64>,
    /// Sum of what rough steps exceed a vehicle's speed by, world frame: steps there and back cancel. m
    shift_w: Vector3<f64>,
    /// How many ticks ago the poses were rough, the newest first.
    rough_ago: [u32; SLOW.count],
}

impl Default for Plausibility {
    fn default() -> Self {
        Self {
            raw: None,
            repeats: 0,
            accepted: None,
            jump_m: None,
            drop_m: None,
            shift_w: Vector3::zeros(),
            rough_ago: [u32::MAX; SLOW.count],
        }
    }
}

impl Plausibility {
    /// A tick begins.
    pub(super) fn open(&mut self) {
        (self.jump_m, self.drop_m) = (None, None);
        self.rough_ago = self.rough_ago.map(|ticks| ticks.saturating_add(1));
    }

    /// What of `observed` tells about the commands: nothing while poses are rough.
    pub(super) fn steady(&self, observed: &Observed<{ pose::COUNT }>) -> Observed<{ pose::COUNT }> {
        let [newest, ..] = self.rough_ago;
        let is_rough = newest < ROUGH_TICKS;
        Observed { o: observed.o, is_present: observed.is_present.map(|it| it && !is_rough) }
    }

    /// Forgets the place of the vehicle.
    pub(super) fn restart(&mut self) {
        self.accepted = None;
    }

    /// Forgets by how much the poses were shifted: the vehicle stands, and may be carried.
    pub(super) fn stand(&mut self) {
        self.shift_w = Vector3::zeros();
    }

    /// Takes a raw pose, measured at `at`, and what the filter made of it.
    pub(super) fn judge(&mut self, raw: Option<&Pose>, filtered: &Filtered, at: TimeNs) {
        let Some(raw) = raw else { return };
        let before = self.raw.replace(*raw);
        let is_repeated = before.is_some_and(|before| {
            [pose::X, pose::Y].into_iter().all(|row| before[row].to_bits() == raw[row].to_bits())
        });
        self.repeats = if is_repeated { self.repeats.saturating_add(1) } else { 0 };
        let Some(now) = filtered.o.filter(|_| filtered.position == Acceptance::Accepted) else {
            return;
        };
        let accepted = Accepted { pose: now, measured_at: at, arrived_at: at };
        if let Some(before) = self.accepted.replace(accepted) {
            self.take_step(before, &now, at);
        }
    }

    /// Takes the step from the accepted pose `before` to `now`, measured at `at`.
    fn take_step(&mut self, before: Accepted, now: &Pose, at: TimeNs) {
        let excess_m =
            |way_m: f64, since: TimeNs| way_m - SPEED_MAX_MPS * at.since(since).seconds().max(0.0);
        let larger = |so_far: Option<f64>, new: f64| so_far.map_or(new, |so_far| so_far.max(new));
        let step_w = pos_w(now) - pos_w(&before.pose);
        let length_m = step_w.norm();
        let jump_m = excess_m(length_m, before.measured_at);
        self.jump_m = Some(larger(self.jump_m, jump_m));
        let drop_m = excess_m(-step_w.z, before.measured_at);
        self.drop_m = Some(larger(self.drop_m, drop_m));
        // At most once in a tick.
        if jump_m > ROUGH_M && !self.rough_ago.contains(&0) {
            self.rough_ago.rotate_right(1);
            let [newest, ..] = &mut self.rough_ago;
            *newest = 0;
        }
        let shift_m = excess_m(length_m, before.arrived_at);
        if shift_m > ROUGH_M {
            self.shift_w += step_w * (shift_m / length_m);
        }
        if length_m <= 0.0
            && let Some(accepted) = &mut self.accepted
        {
            accepted.arrived_at = before.arrived_at;
        }
    }

    /// Whether the stream repeats itself.
    pub(super) fn is_repeated(&self) -> bool {
        self.repeats >= REPEATS_MIN
    }

    /// Whether poses jump again and again, in whatever direction: an object that is found in two places, or noise.
    pub(super) fn is_rough(&self) -> bool {
        [QUICK, SLOW].into_iter().any(|Burst { count, ticks }| self.rough_ago[count - 1] < ticks)
    }

    /// By how much the accepted poses of this tick are further apart than a vehicle flies; `None` without
    /// one. m
    pub(super) fn jump_m(&self) -> Option<f64> {
        self.jump_m
    }

    /// By how much rough steps have shifted the accepted poses since the take-off. m
    pub(super) fn shift_m(&self) -> f64 {
        self.shift_w.norm()
    }

    /// As [`Plausibility::jump_m`], for the downward part of the step alone. m
    pub(super) fn drop_m(&self) -> Option<f64> {
        self.drop_m
    }
}

#[cfg(test)]
mod tests {
    use crate::time::SpanNs;

    use super::*;

    fn filtered(o: Pose, position: Acceptance, heading: Acceptance) -> Filtered {
        Filtered { o: Some(o), position, heading }
    }

    const HERE: Pose = Pose::new(1.0, 2.0, 1.0, 0.1);

    /// The moment so many milliseconds after the first pose.
    fn at(ms: i64) -> TimeNs {
        TimeNs(0).after(SpanNs::from_ms(ms))
    }

    #[test]
    fn a_pose_is_as_much_too_far_as_a_vehicle_does_not_fly() {
        let there = HERE + Pose::new(0.3, 0.4, 0.0, 0.0);
        for (ms, jump_m) in [(20, 0.46), (250, 0.0), (1000, -1.5)] {
            let mut plausibility = Plausibility::default();
            let accepted = |o| filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.judge(Some(&HERE), &accepted(HERE), at(0));
            assert_eq!(plausibility.jump_m(), None, "the first");
            plausibility.judge(Some(&there), &accepted(there), at(ms));
            let found_m = plausibility.jump_m().unwrap();
            assert!((found_m - jump_m).abs() < 1e-9, "{ms} ms: {found_m} m");
            plausibility.open();
            assert_eq!(plausibility.jump_m(), None);
        }
    }

    #[test]
    fn a_drop_is_what_the_largest_descent_of_a_tick_exceeds_a_vehicles() {
        let mut plausibility = Plausibility::default();
        let mut see = |dz_m: f64, ms| {
            let o = HERE + Pose::new(0.0, 0.0, dz_m, 0.0);
            plausibility.judge(
                Some(&o),
                &filtered(o, Acceptance::Accepted, Acceptance::Accepted),
                at(ms),
            );
            plausibility.drop_m()
        };
        assert_eq!(see(0.0, 0), None);
        // 2 m/s for 20 ms are 0.04 m.
        assert!((see(-0.5, 20).unwrap() - 0.46).abs() < 1e-9);
        assert!((see(-0.6, 40).unwrap() - 0.46).abs() < 1e-9, "the largest of the tick");
        assert!((see(-1.3, 60).unwrap() - 0.66).abs() < 1e-9);
        plausibility.open();
        assert_eq!(plausibility.drop_m(), None);
        let up = HERE + Pose::new(0.0, 0.0, 0.5, 0.0);
        plausibility.judge(
            Some(&up),
            &filtered(up, Acceptance::Accepted, Acceptance::Accepted),
            at(80),
        );
        assert!((plausibility.drop_m().unwrap() + 1.84).abs() < 1e-9, "a climb");
    }

    #[test]
    fn what_jumps_between_two_places_tells_nothing_of_the_commands_for_a_second() {
        let mut plausibility = Plausibility::default();
        let observed = Observed { o: HERE, is_present: [true, true, true, false] };
        let mut see = |x_m: f64, ms| {
            let o = HERE + Pose::new(x_m, 0.0, 0.0, 0.0);
            plausibility.open();
            let accepted = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.judge(Some(&o), &accepted, at(ms));
            plausibility.steady(&observed).is_present
        };
        // 1.9 m/s and 3 m/s for 20 ms are steady, 0.25 m are not.
        assert_eq!(see(0.0, 0), observed.is_present);
        assert_eq!(see(0.038, 20), observed.is_present);
        assert_eq!(see(0.098, 40), observed.is_present);
        assert_eq!(see(0.348, 60), [false; pose::COUNT]);
        for k in 1..50 {
            assert_eq!(see(0.348, 60 + 20 * k), [false; pose::COUNT], "{k} ticks later");
        }
        assert_eq!(see(0.348, 1060), observed.is_present);
    }

    #[test]
    fn an_object_in_two_places_is_rough_and_one_that_is_moved_at_times_is_not() {
        let rough_after = |period_ticks: i64| {
            let mut plausibility = Plausibility::default();
            (0..500).find(|k| {
                let o = HERE + Pose::new(0.2 * (k / period_ticks % 2) as f64, 0.0, 0.0, 0.0);
                plausibility.open();
                let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
                plausibility.judge(Some(&o), &seen, at(20 * k));
                plausibility.is_rough()
            })
        };
        assert_eq!(rough_after(1), Some(5));
        assert_eq!(rough_after(12), Some(60));
        assert_eq!(rough_after(13), Some(91));
        assert_eq!(rough_after(33), Some(231));
        assert_eq!(rough_after(34), None);
    }

    #[test]
    fn a_jump_counts_for_fifty_ticks_with_four_others() {
        for (last, is_rough) in [(50, true), (51, false)] {
            let mut plausibility = Plausibility::default();
            let mut x_m = 0.0;
            for k in 0..=last {
                plausibility.open();
                // The first pose is none that jumped.
                x_m += if [1, 10, 20, 30, last].contains(&k) { 0.2 } else { 0.0 };
                let o = HERE + Pose::new(x_m, 0.0, 0.0, 0.0);
                let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
                plausibility.judge(Some(&o), &seen, at(20 * k));
            }
            assert_eq!(plausibility.is_rough(), is_rough, "{last}");
        }
    }

    #[test]
    fn refused_poses_are_not_the_vehicles_and_time_goes_on() {
        let mut plausibility = Plausibility::default();
        plausibility.judge(
            Some(&HERE),
            &filtered(HERE, Acceptance::Accepted, Acceptance::Accepted),
            at(0),
        );
        let there = HERE + Pose::new(0.6, 0.0, 0.0, 0.0);
        for k in 1..4 {
            let held = filtered(HERE, Acceptance::Held, Acceptance::Held);
            plausibility.judge(Some(&there), &held, at(20 * k));
            assert_eq!(plausibility.jump_m(), None);
        }
        let seen = filtered(there, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.judge(Some(&there), &seen, at(80));
        assert!((plausibility.jump_m().unwrap() - 0.44).abs() < 1e-9);
        plausibility.restart();
        plausibility.open();
        plausibility.judge(
            Some(&HERE),
            &filtered(HERE, Acceptance::Accepted, Acceptance::Held),
            at(100),
        );
        assert_eq!((plausibility.jump_m(), plausibility.drop_m()), (None, None), "begun anew");
    }

    /// The shift after poses at these x, 20 ms apart.
    fn shift_m(x_m: &[f64]) -> f64 {
        let mut plausibility = Plausibility::default();
        for (x_m, ms) in x_m.iter().zip((0..).step_by(20)) {
            let o = HERE + Pose::new(*x_m, 0.0, 0.0, 0.0);
            let seen = filtered(o, Acceptance::Accepted, Acceptance::Accepted);
            plausibility.judge(Some(&o), &seen, at(ms));
        }
        plausibility.shift_m()
    }

    #[test]
    fn rough_steps_one_way_add_up_and_those_there_and_back_cancel() {
        for (x_m, expected_m) in [
            (&[0.0, 0.13, 0.13][..], 0.0),
            (&[0.0, 0.34, 0.36, 0.7], 0.6),
            (&[0.0, 0.34, 0.34, 0.0], 0.04),
            // Stalled for 0.2 s at 1.5 m/s.
            (&[0.0, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.03, 0.33], 0.0),
        ] {
            let found_m = shift_m(x_m);
            assert!((found_m - expected_m).abs() < 1e-9, "{x_m:?}: {found_m} m");
        }
        let mut carried = Plausibility { shift_w: Vector3::repeat(1.0), ..Plausibility::default() };
        carried.stand();
        assert!(carried.shift_m().abs() < 1e-12);
    }

    #[test]
    fn only_equal_poses_in_a_row_are_repetitions() {
        let mut plausibility = Plausibility::default();
        let seen = filtered(HERE, Acceptance::Accepted, Acceptance::Accepted);
        for _ in 0..3 {
            plausibility.judge(Some(&HERE), &seen, at(0));
            plausibility.judge(None, &seen, at(0));
        }
        assert!(!plausibility.is_repeated());
        plausibility.judge(Some(&HERE), &seen, at(0));
        assert!(plausibility.is_repeated());
        // Height and heading that go on do not make a place a new one.
        let turned = HERE + Pose::new(0.0, 0.0, 0.1, 0.1);
        plausibility.judge(Some(&turned), &seen, at(0));
        assert!(plausibility.is_repeated());
        let moved = HERE + Pose::new(1e-4, 0.0, 0.0, 0.0);
        let seen = filtered(moved, Acceptance::Accepted, Acceptance::Accepted);
        plausibility.judge(Some(&moved), &seen, at(0));
        assert!(!plausibility.is_repeated());
    }
}
