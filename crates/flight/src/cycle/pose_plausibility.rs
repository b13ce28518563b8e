//! What the motion capture shows about itself: repeated poses, and positions that no vehicle gets to.
//!
//! Owns the signs that a stream goes on and is wrong: it repeats one position to the last digit, or it is
//! further away than a vehicle flies. The supervisor decides what follows from them.
//!
//! Poses are rough if so many ticks among so many have a step that exceeds the speed of a vehicle by so much:
//!
//! | rule       | excess   | ticks   | among     |
//! |------------|----------|---------|-----------|
//! | `QUICK`    | 0.1 m    | 5       | 50        |
//! | `SLOW`     | 0.1 m    | 7       | 200       |
//! | `SLOWEST`  | 0.1 m    | 8       | 600       |
//! | `UNSTEADY` | 0.05 m   | 20      | 200       |

use horizon_estim::Observed;
use horizon_model::rows::{Pose, pos_w, pose};
use nalgebra::Vector3;

use crate::time::TimeNs;
use crate::{Acceptance, Filtered};

/// Repetitions in a row that are no coincidence: a vehicle in the air never stands still to a tenth of
/// a millimetre, along x and y at once. In real flights both repeat at times, but never twice in a row unless the
/// stream stalls; a height repeats up to 5 times, so that it shows nothing alone: docs/benchmarks/2026-11-27-poses.
const REPEATS_MIN: u32 = 3;

/// Speed of a step between poses that is no jump: full sticks along one axis reach 1.8 m/s. m/s
pub(super) const SPEED_MAX_MPS: f64 = 2.0;

/// Longest time for which a position may have been repeated while the vehicle flew on: a longer one ends a flight. s
const REPEATED_MAX_S: f64 = 1.0;

/// Excess from which on poses are rough, as those of an object that is found in two positions in turn. m
const ROUGH_M: f64 = 0.1;

/// The same of two positions that are nearer to each other, which takes many such steps. m
const UNSTEADY_M: f64 = 0.05;

/// For so many ticks, a second at 50 Hz, the poses after a rough one show neither whether commands act nor how late
/// they do.
const ROUGH_TICKS: u32 = 50;

/// So many events in so many ticks are no coincidence.
struct EventRate {
    count: usize,
    ticks: u32,
}

/// Rough ticks in quick, slow and very slow succession. Real flights have one within a second at most, and two in a
/// whole flight (docs/benchmarks/2026-11-27-poses). A single outlier jumps there and back: two of them within a second,
/// or three within four, do not count.
const QUICK: EventRate = EventRate { count: 5, ticks: ROUGH_TICKS };
const SLOW: EventRate = EventRate { count: 7, ticks: 4 * ROUGH_TICKS };
const SLOWEST: EventRate = EventRate { count: 8, ticks: 12 * ROUGH_TICKS };

/// Ticks with an excess above [`UNSTEADY_M`]: three within four seconds at most in those flights.
const UNSTEADY: EventRate = EventRate { count: 20, ticks: 4 * ROUGH_TICKS };

/// How many ticks ago the newest events were, the newest first.
#[derive(Debug, Clone)]
struct Recent<const N: usize>([u32; N]);

impl<const N: usize> Default for Recent<N> {
    fn default() -> Self {
        Self([u32::MAX; N])
    }
}

impl<const N: usize> Recent<N> {
    fn begin_tick(&mut self) {
        self.0 = self.0.map(|ticks| ticks.saturating_add(1));
    }

    /// An event of this tick, which counts once.
    fn note(&mut self) {
        if !self.0.contains(&0) {
            self.0.rotate_right(1);
            if let Some(newest) = self.0.first_mut() {
                *newest = 0;
            }
        }
    }

    /// Ticks since the newest one; the largest number before the first.
    fn newest(&self) -> u32 {
        self.0.first().copied().unwrap_or(u32::MAX)
    }

    fn has(&self, rate: &EventRate) -> bool {
        self.0[rate.count - 1] < rate.ticks
    }
}

#[derive(Debug, Clone, Copy)]
struct Accepted {
    pose: Pose,
    measured_at: TimeNs,
    /// When its place was measured first: a stalled stream repeats it.
    arrived_at: TimeNs,
}

/// The newest poses, seen one by one.
#[derive(Debug, Clone, Default)]
pub(super) struct Plausibility {
    raw: Option<Pose>,
    repeats: u32,
    /// The last pose that the filter let through.
    accepted: Option<Accepted>,
    jump_m: Option<f64>,
    drop_m: Option<f64>,
    /// Sum of what rough steps exceed a vehicle's speed by, world frame: steps there and back cancel. m
    shift_w: Vector3<f64>,
    rough: Recent<{ SLOWEST.count }>,
    unsteady: Recent<{ UNSTEADY.count }>,
}

impl Plausibility {
    /// A tick begins.
    pub(super) fn begin_tick(&mut self) {
        (self.jump_m, self.drop_m) = (None, None);
        self.rough.begin_tick();
        self.unsteady.begin_tick();
    }

    /// Whether poses have jumped within the last second: they then show nothing about vehicle and commands.
    pub(super) fn has_jumped(&self) -> bool {
        self.rough.newest() < ROUGH_TICKS
    }

    /// The rows of `observed` that show the commands: none after a jump.
    pub(super) fn steady(&self, observed: &Observed<{ pose::COUNT }>) -> Observed<{ pose::COUNT }> {
        let has_jumped = self.has_jumped();
        Observed { o: observed.o, is_present: observed.is_present.map(|it| it && !has_jumped) }
    }

    /// Forgets the position of the vehicle.
    pub(super) fn restart(&mut self) {
        self.accepted = None;
    }

    /// Forgets by how much the poses were shifted: the vehicle stands, and may be carried.
    pub(super) fn reset_shift(&mut self) {
        self.shift_w = Vector3::zeros();
    }

    /// Takes a raw pose, measured at `at`, and what the filter made of it.
    pub(super) fn check(&mut self, raw: Option<&Pose>, filtered: &Filtered, at: TimeNs) {
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

    /// Takes the step from the accepted pose `before` to `now`, measured at `at`. Its time is that since the position
    /// before was measured first, up to a second: some systems repeat the last pose of an object that they do not see.
    /// A descent has the time since the pose alone.
    fn take_step(&mut self, before: Accepted, now: &Pose, at: TimeNs) {
        let since_s = at.since(before.measured_at).seconds().max(0.0);
        let repeated_s = before.measured_at.since(before.arrived_at).seconds().min(REPEATED_MAX_S);
        let flown_m = SPEED_MAX_MPS * (since_s + repeated_s);
        let larger = |so_far: Option<f64>, new: f64| so_far.map_or(new, |so_far| so_far.max(new));
        let step_w = pos_w(now) - pos_w(&before.pose);
        let length_m = step_w.norm();
        let jump_m = length_m - flown_m;
        self.jump_m = Some(larger(self.jump_m, jump_m));
        self.drop_m = Some(larger(self.drop_m, -step_w.z - SPEED_MAX_MPS * since_s));
        if jump_m > UNSTEADY_M {
            self.unsteady.note();
        }
        if jump_m > ROUGH_M {
            self.rough.note();
            self.shift_w += step_w * (jump_m / length_m);
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

    /// Whether poses jump again and again, in whatever direction: an object that is found in two positions, or noise.
    pub(super) fn is_rough(&self) -> bool {
        [QUICK, SLOW, SLOWEST].iter().any(|rate| self.rough.has(rate))
            || self.unsteady.has(&UNSTEADY)
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
mod tests;
