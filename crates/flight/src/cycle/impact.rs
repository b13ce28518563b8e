//! Whether a vehicle that its inputs drive on has come to rest at once: it has hit something, or was caught.
//!
//! A vehicle whose commands are lost levels and slows down within a time constant of 0.6 s; a brake is asked for by
//! its inputs. What is faster is a deceleration of 2.8 m/s^2 at least. With the position x (x and y of an accepted
//! pose, world frame) and the applied inputs `u_w`, in the direction e of the motion before, it has hit something if
//! for two poses
//!
//! ```text
//! v = (x(t - 0.2 s) - x(t - 0.4 s)) / 0.2 s,    |v| >= 0.9 m/s,    e = v / |v|
//! e' (x(t) - x(t - 0.12 s)) / 0.12 s <= |v| / 4
//! e' u_w >= 0.05    from t - 0.8 s to t: a brake may act 0.25 s earlier or 0.4 s later than it is taken to
//! ```
//!
//! A larger step than a vehicle flies, or a step back larger than a bounce, is an error of the poses, not a motion. No
//! impact is found until both compared positions are newer than it. After missing poses, the poses behind the gap have
//! to show the impact alone.
//!
//! The inputs are turned by the heading alone: `theta_0` turns them by less than a corner does.

use horizon_model::rows::{Pose, Sticks, pos_w};
use nalgebra::Vector2;

use super::DT_S;
use super::pose_plausibility::SPEED_MAX_MPS;
use crate::commanded::inputs_w;
use crate::ring::Ring;

/// Ages of the positions that are compared, and of the inputs, in periods of [`DT_S`]: 0.12 s, 0.2 s, 0.4 s and 0.8 s
/// of the equations. periods
const AGE_STOPPED: usize = 6;
const AGE_BEFORE_STOP: usize = 10;
const AGE_APPROACH: usize = 20;
const AGE_INPUTS: usize = 40;

/// How much older than that a position may be: a source of 20 Hz has one in 2.5 periods. periods
const LATER: usize = 2;

/// Least speed before; slower vehicles hit nothing hard. m/s
const SPEED_MIN_MPS: f64 = 0.9;
/// Largest speed after the stop over the speed before. 1
const REMAINING_SPEED_RATIO: f64 = 0.25;
/// Least input along the motion. 1
const INPUT_MIN: f64 = 0.05;
/// Poses for which all this must hold: one may be an outlier.
const STOPPED_POSES_MIN: u32 = 2;

/// Largest step back of a vehicle, which bounces off slowly: rate times time plus offset. After a gap of more than
/// [`BACK_STEP_AGE_MAX`] periods the offset alone: a step that looks like a stop leads back by little there. m/s, m,
/// periods
const BACK_STEP_MPS: f64 = 0.5;
const BACK_STEP_M: f64 = 0.02;
const BACK_STEP_AGE_MAX: usize = 2;
/// Any step that exceeds [`SPEED_MAX_MPS`] by more. m
const STEP_M: f64 = 0.05;

/// The newest positions and inputs.
#[derive(Debug, Clone)]
pub(super) struct Impact {
    /// Position, if there was a pose, and applied input of each period. m, 1
    ring: Ring<(Option<Vector2<f64>>, Vector2<f64>)>,
    /// Newest poses in a row that show a stop.
    stopped_poses: u32,
    /// Periods since a step that no vehicle makes.
    since_jump: usize,
    /// Periods between the two newest positions.
    pose_spacing: usize,
    /// Periods since positions were missing.
    since_gap: usize,
}

impl Impact {
    /// Nothing was seen yet.
    pub(super) fn new() -> Self {
        let ring = Ring::new((None, Vector2::zeros()), AGE_INPUTS + 1);
        Self { ring, stopped_poses: 0, since_jump: usize::MAX, pose_spacing: 1, since_gap: 0 }
    }

    /// A period has ended in which `u_applied` was applied at the heading `theta_rad`; `seen` is the new pose in it, if
    /// there is one.
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn observe_period(
        &mut self,
        seen: Option<&Pose>,
        u_applied: &Sticks,
        theta_rad: f64,
    ) {
        let position_w = seen.map(|seen| pos_w(seen).xy());
        self.ring.push((position_w, inputs_w(u_applied, theta_rad)));
        let has_jumped = position_w.is_some() && self.has_jumped();
        self.since_jump = if has_jumped { 0 } else { self.since_jump.saturating_add(1) };
        self.since_gap = self.since_gap.saturating_add(1);
        // A tick without a position decides nothing.
        if position_w.is_some() {
            let spacing = self.newest_spacing();
            let before = std::mem::replace(&mut self.pose_spacing, spacing);
            if self.pose_spacing > before + LATER {
                self.since_gap = 0;
            }
            self.stopped_poses = if self.stops() { self.stopped_poses + 1 } else { 0 };
        }
    }

    /// Whether the vehicle has hit something now.
    pub(super) fn has_hit(&self) -> bool {
        self.stopped_poses >= STOPPED_POSES_MIN
    }

    fn stops(&self) -> bool {
        if self.since_jump <= AGE_APPROACH + LATER || self.since_gap < AGE_STOPPED {
            return false;
        }
        let Some(velocity_w_mps) = self.velocity(AGE_BEFORE_STOP, AGE_APPROACH) else {
            return false;
        };
        let Some(left_w_mps) = self.velocity(0, AGE_STOPPED) else { return false };
        let speed_mps = velocity_w_mps.norm();
        let along_w = velocity_w_mps / speed_mps.max(f64::MIN_POSITIVE);
        let is_driven = || self.ring.iter().all(|(_, u_w)| u_w.dot(&along_w) >= INPUT_MIN);
        speed_mps >= SPEED_MIN_MPS
            && along_w.dot(&left_w_mps) <= REMAINING_SPEED_RATIO * speed_mps
            && is_driven()
    }

    /// Periods between the newest position and the one before.
    fn newest_spacing(&self) -> usize {
        let count = self.ring.len();
        (1..count).find(|age| self.position_at(*age).is_some()).unwrap_or(count)
    }

    /// Whether the newest step is larger than a vehicle flies, or leads back further than it bounces.
    fn has_jumped(&self) -> bool {
        let Some(((to_w, _), (from_w, age))) = self.position(0).zip(self.position(1)) else {
            return false;
        };
        let (step_w, time_s) = (to_w - from_w, DT_S * age as f64);
        let back_step_mps = if age > BACK_STEP_AGE_MAX { 0.0 } else { BACK_STEP_MPS };
        let leads_back =
            |v: Vector2<f64>| -step_w.dot(&v) > (back_step_mps * time_s + BACK_STEP_M) * v.norm();
        step_w.norm() > SPEED_MAX_MPS * time_s + STEP_M
            || self.velocity(AGE_BEFORE_STOP, AGE_APPROACH).is_some_and(leads_back)
    }

    /// Mean velocity between two ages. m/s
    fn velocity(&self, newer: usize, older: usize) -> Option<Vector2<f64>> {
        let ((to_w, newer), (from_w, older)) = (self.position(newer)?, self.position(older)?);
        Some((to_w - from_w) / (DT_S * (older - newer) as f64))
    }

    /// The first position that is at least so old, and its age.
    fn position(&self, age: usize) -> Option<(Vector2<f64>, usize)> {
        (age..=age + LATER).find_map(|age| Some((self.position_at(age)?, age)))
    }

    /// The position that is exactly so old, less than the length of the ring.
    fn position_at(&self, age: usize) -> Option<Vector2<f64>> {
        self.ring.back(age).0
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::rows::stick;

    use super::*;

    /// First time at which a vehicle along x has hit something, if its speed is `speed_mps(t)` and its pitch
    /// `pitch(t)`, with a pose in each tick for which there `is_pose`. s
    fn hit_s(
        speed_mps: impl Fn(f64) -> f64,
        pitch: impl Fn(f64) -> f64,
        is_pose: impl Fn(u32) -> bool,
    ) -> Option<f64> {
        let (mut impact, mut x_m) = (Impact::new(), 0.0);
        (0..250).find_map(|k| {
            let t_s = f64::from(k) * DT_S;
            x_m += speed_mps(t_s) * DT_S;
            let noise_m = 2e-3 * f64::from(k * 37 % 11) / 11.0;
            let pose = Pose::new(x_m + noise_m, 0.0, 1.0, 0.0);
            let mut u = Sticks::zeros();
            u[stick::PITCH] = pitch(t_s);
            impact.observe_period(Some(&pose).filter(|_| is_pose(k)), &u, 0.0);
            impact.has_hit().then_some(t_s)
        })
    }

    fn always(_: u32) -> bool {
        true
    }

    #[test]
    fn a_vehicle_that_is_driven_into_something_has_hit_it_within_half_a_second() {
        let hits = |t_s: f64| if t_s < 2.0 { 1.0 } else { 0.0 };
        let slides = |t_s: f64| if t_s < 2.0 { 1.0 } else { 0.15 };
        let bounces = |t_s: f64| if t_s < 2.0 { 1.2 } else { -0.5 * (-(t_s - 2.0) / 0.3).exp() };
        let fast = |t_s: f64| if t_s < 2.0 { 1.6 } else { 0.3 };
        for (name, speed_mps) in [
            ("hits", &hits as &dyn Fn(f64) -> f64),
            ("slides", &slides),
            ("bounces", &bounces),
            ("fast", &fast),
        ] {
            for (rate, every) in [("50 Hz", 1), ("25 Hz", 2)] {
                let found_s = hit_s(speed_mps, |_| 0.5, |k| k % every == 0);
                let is_soon = found_s.is_some_and(|at_s| (2.05..2.5).contains(&at_s));
                assert!(is_soon, "{name}, {rate}: {found_s:?} s");
            }
        }
    }

    #[test]
    fn a_brake_and_a_lost_command_are_none() {
        // It brakes, so much later than its inputs are taken to act.
        for (later_s, accel_mps2) in [(-0.25, 3.0), (-0.1, 4.0), (0.0, 5.0), (0.3, 3.0), (0.4, 3.0)]
        {
            let after_s = |t_s: f64| (t_s - 2.0 - later_s).max(0.0);
            let brakes = |t_s: f64| (1.2 - accel_mps2 * after_s(t_s)).max(0.0);
            let found_s = hit_s(brakes, |t_s| if t_s < 2.0 { 0.5 } else { -0.5 }, always);
            assert_eq!(found_s, None, "{later_s} s, {accel_mps2} m/s^2");
        }
        // Its commands are lost: it levels, or brakes by itself.
        for lag_s in [0.6, 0.4, 0.3, 0.25] {
            let levels = |t_s: f64| 1.5 * (-(t_s - 2.0).max(0.0) / lag_s).exp();
            assert_eq!(hit_s(levels, |_| 0.5, always), None, "lag {lag_s} s");
        }
        let by_itself = |t_s: f64| (1.2 - 1.5 * (t_s - 2.0).max(0.0)).max(0.0);
        assert_eq!(hit_s(by_itself, |_| 0.5, always), None);
        // One that goes on, and a slow one.
        assert_eq!(hit_s(|t_s| if t_s < 2.0 { 1.6 } else { 0.5 }, |_| 0.5, always), None);
        assert_eq!(hit_s(|t_s| if t_s < 2.0 { 0.85 } else { 0.0 }, |_| 0.5, always), None);
    }

    #[test]
    fn a_stream_that_stalls_and_an_outlier_are_none() {
        let flies = |_: f64| 1.2;
        for length in 1..40 {
            assert_eq!(hit_s(flies, |_| 0.5, |k| !(100..100 + length).contains(&k)), None);
        }
        let outlier = |t_s: f64| match t_s {
            t_s if (2.0..2.02).contains(&t_s) => -8.0,
            t_s if (2.02..2.04).contains(&t_s) => 10.4,
            _ => 1.2,
        };
        assert_eq!(hit_s(outlier, |_| 0.5, always), None);
        // A stall, behind which the object is elsewhere.
        for (length, by_m) in (1..10)
            .flat_map(|length| [-0.09, -0.1, -0.12, -0.15, -0.2, -0.28].map(|by_m| (length, by_m)))
        {
            for speed_mps in [0.95, 1.2, 1.6] {
                let shifted = |t_s: f64| {
                    let is_step = (2.0..2.02 - 1e-9).contains(&t_s);
                    speed_mps + if is_step { by_m / DT_S } else { 0.0 }
                };
                let hit_s = hit_s(shifted, |_| 0.5, |k| !(100..100 + length).contains(&k));
                assert_eq!(hit_s, None, "{by_m} m behind {length} periods at {speed_mps} m/s");
            }
        }
        // Longer ones, and one that stays, of poses that come in every or in every second period.
        for by_m in [-0.09, -0.1, -0.15, -0.2, -0.28, -0.39, 0.25, 0.39] {
            for (length, speed_mps) in [1, 2, 3, 4, 5, 6, 7, 200]
                .into_iter()
                .flat_map(|length| [0.4, 0.6, 0.95, 1.2, 1.6].map(|speed_mps| (length, speed_mps)))
            {
                let is_out = |t_s: f64| (2.0..2.0 + DT_S * f64::from(length) - 1e-9).contains(&t_s);
                let shifted = |t_s: f64| {
                    let step =
                        f64::from(u8::from(is_out(t_s))) - f64::from(u8::from(is_out(t_s - DT_S)));
                    speed_mps + by_m * step / DT_S
                };
                for is_pose in [always, |k: u32| k.is_multiple_of(2)] {
                    let hit_s = hit_s(shifted, |_| 0.5, is_pose);
                    assert_eq!(hit_s, None, "{by_m} m for {length} periods at {speed_mps} m/s");
                }
            }
        }
    }
}
