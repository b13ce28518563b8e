//! The moving obstacle: its predicted position.
//!
//! Owns two predictions, by its present velocity and by its low-pass filtered velocity, the acceleration that it has
//! shown, and which measured positions count. The velocity is that of an alpha-beta filter.

use nalgebra::Vector3;

/// Gains of position and velocity of the alpha-beta filter, per tick: critically damped,
/// `beta = 2 - alpha - 2 sqrt(1 - alpha)`. The velocity follows a change by 90 % within 0.12 s; 0.5 mm of noise in the
/// positions cause 6 mm/s. 1
const POSITION_GAIN: f64 = 0.7;
const VELOCITY_GAIN: f64 = 0.205;

/// The acceleration is the change of the velocity over [`CHANGE_S`], and its mean square is low-pass filtered with
/// [`ACCEL_MEAN_S`]: an obstacle that oscillates or turns often does so again. 5 mm of noise in the positions cause
/// 0.3 m/s^2. s
const CHANGE_S: f64 = 0.2;
const ACCEL_MEAN_S: f64 = 1.5;

/// Time constant of the low-pass filtered velocity: an obstacle that oscillates returns within it. s
const MEAN_S: f64 = 2.0;
/// Difference of both velocities up to which one prediction suffices. m/s
const EQUAL_MPS: f64 = 0.15;

/// Largest acceleration in a prediction: with more, the margin leaves no path around the obstacle. m/s^2
const ACCEL_MAX_MPS2: f64 = 1.0;

/// For how long the motion is extrapolated without a measured position. s
const FORGET_S: f64 = 0.5;

/// Largest innovation that counts as motion: a person who turns round while walking at 2 m/s causes 0.08 m in a tick. m
const JUMP_M: f64 = 0.3;
/// Growth of that limit while no position counts: after a real jump the obstacle is followed again within 0.1 s per
/// 0.5 m. m/s
const JUMP_GROWTH_MPS: f64 = 5.0;

/// Speed above which a position that is repeated to the bit is that of a stream that has stopped: no obstacle stops
/// between two ticks from this speed. m/s
const REPEATED_MPS: f64 = 0.5;

/// Position and motion of one obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct MovingObstacle {
    /// `None`: the position is unknown.
    motion: Option<ObstacleMotion>,
    /// The newest finite position, whether it counted or not, world frame. m
    newest_w: Option<Vector3<f64>>,
    /// Whether the stream has stopped at that position while the obstacle moved.
    is_stuck: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct ObstacleMotion {
    /// Position, world frame. m
    pos_w: Vector3<f64>,
    /// Velocity, world frame. m/s
    vel_w: Vector3<f64>,
    /// `vel_w`, low-pass filtered with [`CHANGE_S`]. m/s
    late_vel_w: Vector3<f64>,
    /// `vel_w`, low-pass filtered with [`MEAN_S`]. m/s
    mean_vel_w: Vector3<f64>,
    /// Mean square of the acceleration; zero at the first position. m^2/s^4
    accel_squared: f64,
    /// Time since the newest position that counted. s
    unseen_s: f64,
}

impl MovingObstacle {
    /// Follows the obstacle by a period of `dt_s`, in which its position `seen_w` (world frame, m) was measured or not
    /// at all. A position does not count if it is not finite, a jump, or repeated to the bit while the obstacle moves.
    pub(super) fn follow(&mut self, seen_w: Option<[f64; 3]>, dt_s: f64) {
        let seen_w = seen_w.map(Vector3::from).filter(|at_w| at_w.iter().all(|x| x.is_finite()));
        let is_repeated = seen_w.is_some() && seen_w == self.newest_w;
        let is_moving = self.motion.is_some_and(|motion| motion.vel_w.norm() > REPEATED_MPS);
        if seen_w.is_some() {
            self.newest_w = seen_w;
            self.is_stuck = is_repeated && (is_moving || self.is_stuck);
        }
        let seen_w = seen_w.filter(|_| !self.is_stuck);
        self.motion = match self.motion {
            Some(before) => before.after(seen_w, dt_s),
            None => seen_w.map(ObstacleMotion::at_rest),
        };
    }

    /// Position after `ahead_s` by the present velocity, world frame; `None` if unknown. m
    pub(super) fn position(&self, ahead_s: f64) -> Option<Vector3<f64>> {
        self.motion.map(|motion| motion.pos_w + motion.vel_w * ahead_s)
    }

    /// Position after `ahead_s` by the low-pass filtered velocity, world frame; `None` if unknown, or if both
    /// velocities are about equal. m
    pub(super) fn position_by_mean(&self, ahead_s: f64) -> Option<Vector3<f64>> {
        let motion = self.motion?;
        let differs = (motion.mean_vel_w - motion.vel_w).norm() > EQUAL_MPS;
        differs.then(|| motion.pos_w + motion.mean_vel_w * ahead_s)
    }

    /// Horizontal speed; `None` if unknown. m/s
    pub(super) fn speed_mps(&self) -> Option<f64> {
        self.motion.map(|motion| motion.vel_w.xy().norm())
    }

    /// Acceleration to expect, at most [`ACCEL_MAX_MPS2`]: amplitude of a sine with the root mean square that the
    /// obstacle has shown. m/s^2
    pub(super) fn acceleration_mps2(&self) -> f64 {
        let squared = self.motion.map_or(0.0, |motion| motion.accel_squared);
        (2.0 * squared).sqrt().min(ACCEL_MAX_MPS2)
    }
}

impl ObstacleMotion {
    fn at_rest(pos_w: Vector3<f64>) -> Self {
        let vel_w = Vector3::zeros();
        let (late_vel_w, mean_vel_w) = (vel_w, vel_w);
        Self { pos_w, vel_w, late_vel_w, mean_vel_w, accel_squared: 0.0, unseen_s: 0.0 }
    }

    /// The motion after a period of `dt_s`; `None` after more than [`FORGET_S`] without a position that counts.
    fn after(self, seen_w: Option<Vector3<f64>>, dt_s: f64) -> Option<Self> {
        let pos_w = self.pos_w + self.vel_w * dt_s;
        let limit_m = JUMP_M + JUMP_GROWTH_MPS * self.unseen_s;
        let innovation_w = seen_w.map(|seen_w| seen_w - pos_w);
        let Some(innovation_w) = innovation_w.filter(|it| it.norm() <= limit_m) else {
            let unseen_s = self.unseen_s + dt_s;
            return (unseen_s <= FORGET_S).then_some(Self { pos_w, unseen_s, ..self });
        };
        if innovation_w.norm() > JUMP_M {
            let there = Self::at_rest(pos_w + innovation_w);
            return Some(Self { accel_squared: self.accel_squared, ..there });
        }
        let vel_w = self.vel_w + innovation_w * (VELOCITY_GAIN / dt_s);
        let change_w = vel_w - self.late_vel_w;
        let squared = (change_w / CHANGE_S).norm_squared();
        Some(Self {
            pos_w: pos_w + innovation_w * POSITION_GAIN,
            vel_w,
            late_vel_w: self.late_vel_w + change_w * (dt_s / CHANGE_S).min(1.0),
            mean_vel_w: self.mean_vel_w + (vel_w - self.mean_vel_w) * (dt_s / MEAN_S).min(1.0),
            accel_squared: self.accel_squared
                + (squared - self.accel_squared) * (dt_s / ACCEL_MEAN_S).min(1.0),
            unseen_s: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::*;

    const DT_S: f64 = 0.02;

    /// After `count` periods along x with 1 m/s.
    fn followed(count: u32) -> MovingObstacle {
        let mut obstacle = MovingObstacle::default();
        for k in 0..count {
            obstacle.follow(Some(position_w(k)), DT_S);
        }
        obstacle
    }

    fn position_w(k: u32) -> [f64; 3] {
        [DT_S * f64::from(k), 2.0, 1.0]
    }

    #[test]
    fn a_straight_motion_is_predicted_after_half_a_second() {
        let found = followed(26).position(1.0).unwrap();
        assert!((found - Vector3::new(1.5, 2.0, 1.0)).norm() < 0.05, "{found}");
    }

    #[test]
    fn an_oscillating_obstacle_shows_the_acceleration_of_its_sine_and_a_straight_motion_none() {
        let shown = |motion: &dyn Fn(f64) -> f64| {
            let mut obstacle = MovingObstacle::default();
            for k in 0..500 {
                let t_s = DT_S * f64::from(k);
                obstacle.follow(Some([motion(t_s), 0.8 * t_s, 1.0]), DT_S);
            }
            obstacle.acceleration_mps2()
        };
        assert!(shown(&|t_s| t_s) < 0.1, "straight");
        // 0.3 m at 0.3 Hz: 1.07 m/s^2.
        let slow = shown(&|t_s| 0.3 * (TAU * 0.3 * t_s).sin());
        assert!((0.8..1.2).contains(&slow), "{slow}");
        assert!((shown(&|t_s| 0.3 * (TAU * 0.9 * t_s).sin()) - ACCEL_MAX_MPS2).abs() < 1e-12);
    }

    #[test]
    fn the_mean_velocity_leads_elsewhere_only_where_the_velocity_changes() {
        assert_eq!(followed(500).position_by_mean(1.0), None, "straight");
        let mut obstacle = MovingObstacle::default();
        let mut worst_m: f64 = 0.0;
        for k in 0..500 {
            let t_s = DT_S * f64::from(k);
            obstacle.follow(Some([0.3 * (TAU * t_s).sin(), 0.6 * t_s, 1.0]), DT_S);
            if t_s > 4.0
                && let Some(ahead) = obstacle.position_by_mean(1.0)
            {
                worst_m = worst_m
                    .max((ahead.xy() - Vector3::new(0.0, 0.6 * (t_s + 1.0), 1.0).xy()).norm());
            }
        }
        // The obstacle oscillates by 0.3 m at up to 1.9 m/s: the present velocity alone would err by up to 1.9 m.
        assert!(worst_m < 0.65, "{worst_m}");
    }

    #[test]
    fn what_is_not_seen_goes_on_for_half_a_second_and_is_forgotten() {
        let go_on = |count: u32| {
            let mut obstacle = followed(100);
            for k in 0..count {
                obstacle.follow((k % 2 == 1).then_some([f64::NAN, 0.0, 0.0]), DT_S);
            }
            obstacle.position(0.0)
        };
        let position = go_on(20).unwrap();
        assert!((position.x - 0.02 * 119.0).abs() < 0.02, "{position}");
        assert_eq!(go_on(27), None);
    }

    #[test]
    fn an_outlier_moves_nothing_and_an_obstacle_that_is_elsewhere_is_found() {
        let mut obstacle = followed(100);
        for k in 100..110 {
            let [x, y, z] = position_w(k);
            obstacle.follow(Some([x, y + if k == 100 { 0.5 } else { 0.0 }, z]), DT_S);
            let ahead = obstacle.position(0.5).unwrap();
            let [x, y, z] = position_w(k + 25);
            assert!((ahead - Vector3::new(x, y, z)).norm() < 0.02, "{k}: {ahead}");
        }
        // 1.1 m away: not at once, but before it is forgotten, and at rest at first.
        let there_w = |k: u32| [1.1, 2.0, 1.0 + 1e-4 * f64::from(k % 3)];
        let mut found_after = None;
        for k in 0..24 {
            obstacle.follow(Some(there_w(k)), DT_S);
            let is_there =
                (obstacle.position(0.5).unwrap() - Vector3::from(there_w(k))).norm() < 0.01;
            found_after = found_after.or(is_there.then_some(k));
        }
        assert!(found_after.is_some_and(|k| (8..20).contains(&k)), "{found_after:?}");
    }

    #[test]
    fn a_stream_that_stands_still_is_no_obstacle_that_stops() {
        let mut stuck = followed(100);
        for _ in 0..26 {
            stuck.follow(Some(position_w(99)), DT_S);
        }
        assert_eq!(stuck.position(0.0), None);
        // One that has slowed down and stands is known, also without noise.
        let mut slow = followed(100);
        let mut x_m = position_w(99)[0];
        for k in 0..200 {
            x_m += DT_S * (1.0 - 4.0 * DT_S * f64::from(k)).max(0.0);
            slow.follow(Some([x_m, 2.0, 1.0]), DT_S);
        }
        let stands_w = Vector3::new(x_m, 2.0, 1.0);
        assert!((slow.position(0.5).unwrap() - stands_w).norm() < 1e-3);
        // Also after it was hidden.
        (0..30).for_each(|_| slow.follow(None, DT_S));
        assert_eq!(slow.position(0.0), None);
        slow.follow(Some(stands_w.into()), DT_S);
        assert_eq!(slow.position(0.5), Some(stands_w));
    }
}
