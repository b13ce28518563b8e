//! The moving obstacle: its predicted position.
//!
//! Owns two predictions, by its present velocity and by its low-pass filtered velocity, the acceleration that it has
//! shown, and which measured positions count. The velocity is that of an alpha-beta filter.

use nalgebra::Vector3;

/// Fading memory of the alpha-beta filter, per tick (Brookner, *Tracking and Kalman Filtering Made Easy*, 1998, chapter
/// 1): after a gap of `n` ticks the gains are `1 - FADING^2n` of the position and `(1 - FADING^n)^2` of the velocity,
/// critically damped. Without a gap they are 0.7 and 0.2: the velocity follows a change by 90 % within 0.12 s; 0.5 mm
/// of noise in the positions cause 6 mm/s. 1
const FADING: f64 = 0.5477;

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

/// Time without a position after which the obstacle counts as unseen, and after which its motion is no longer
/// extrapolated: a person behind another object walks on. s, s
const UNSEEN_S: f64 = 0.5;
const FORGET_S: f64 = 2.0;

/// Time after which an obstacle that was found counts as seen: its velocity is known then. s
const FOUND_S: f64 = 0.3;

/// Largest mean velocity over a gap that is a motion, as of a person who walked on while hidden. m/s
const WALK_MAX_MPS: f64 = 2.5;

/// Largest innovation that counts as motion: a person who turns round while walking at 2 m/s causes 0.08 m in a tick. m
const JUMP_M: f64 = 0.3;
/// Growth of that limit while no position counts: after a real jump the obstacle is followed again within 0.1 s per
/// 0.5 m. m/s
const JUMP_GROWTH_MPS: f64 = 5.0;

/// Speed above which a position that is repeated to the bit is that of a stream that has stopped: no obstacle stops
/// between two ticks from this speed. m/s
const REPEATED_MPS: f64 = 0.5;
/// Below this speed noise is what changes a position. If it has changed in each measurement for [`NOISE_S`], a position
/// that is repeated to the bit for [`STREAM_STUCK_S`] is that of a stream that has stopped. m/s, s, s
const STILL_MPS: f64 = 0.1;
const NOISE_S: f64 = 1.0;
const STREAM_STUCK_S: f64 = 0.3;

/// Position and motion of one obstacle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct MovingObstacle {
    /// `None`: the position is unknown.
    motion: Option<ObstacleMotion>,
    /// How long the obstacle has been followed since it was found. s
    found_s: f64,
    stream: RepeatedPositions,
}

/// Finds out whether a stream of positions has stopped and repeats the newest one.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct RepeatedPositions {
    /// The newest finite position, whether it counted or not, world frame. m
    newest_w: Option<Vector3<f64>>,
    /// Time in which an obstacle at rest had another position in each measurement, up to [`NOISE_S`]. s
    changing_s: f64,
    /// For how long the newest position has been repeated. s
    repeated_s: f64,
    /// Whether the stream has stopped at that position.
    is_stuck: bool,
}

impl RepeatedPositions {
    /// Whether the stream has stopped, by the position `seen_w` (world frame, m) that came `period_s` after the one
    /// before, of an obstacle with the speed `speed_mps` so far.
    fn has_stopped(&mut self, seen_w: Vector3<f64>, speed_mps: f64, period_s: f64) -> bool {
        let is_repeated = self.newest_w.replace(seen_w) == Some(seen_w);
        self.repeated_s = if is_repeated { self.repeated_s + period_s } else { 0.0 };
        let has_noise = self.changing_s >= NOISE_S;
        if !has_noise && speed_mps < STILL_MPS {
            self.changing_s = if is_repeated { 0.0 } else { self.changing_s + period_s };
        }
        let stops = speed_mps > REPEATED_MPS || (has_noise && self.repeated_s >= STREAM_STUCK_S);
        self.is_stuck = is_repeated && (stops || self.is_stuck);
        self.is_stuck
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct ObstacleMotion {
    /// Position, world frame. m
    pos_w: Vector3<f64>,
    /// The newest position that counted, world frame. m
    seen_w: Vector3<f64>,
    /// Velocity, world frame. m/s
    vel_w: Vector3<f64>,
    /// `v_l`: `vel_w`, low-pass filtered with [`CHANGE_S`]. m/s
    lagged_vel_w: Vector3<f64>,
    /// `vel_w`, low-pass filtered with [`MEAN_S`]. m/s
    mean_vel_w: Vector3<f64>,
    /// Mean square of the acceleration; zero at the first position. m^2/s^4
    accel_squared: f64,
    /// Time since the newest position that counted. s
    unseen_s: f64,
}

impl MovingObstacle {
    /// Follows the obstacle by a period of `dt_s`, in which its position `seen_w` (world frame, m) was measured or not
    /// at all. A position does not count if it is not finite, the origin, which systems report for a body that they
    /// have lost, a jump, or that of a stream that has stopped.
    pub(super) fn follow(&mut self, seen_w: Option<[f64; 3]>, dt_s: f64) {
        let counts =
            |at_w: &Vector3<f64>| at_w.iter().all(|x| x.is_finite()) && *at_w != Vector3::zeros();
        let speed_mps = self.motion.map_or(0.0, |motion| motion.vel_w.norm());
        let seen_w = seen_w
            .map(Vector3::from)
            .filter(counts)
            .filter(|at_w| !self.stream.has_stopped(*at_w, speed_mps, dt_s));
        self.motion = match self.motion {
            Some(before) => before.after(seen_w, dt_s),
            None => seen_w.map(ObstacleMotion::at_rest),
        };
        self.found_s = if self.motion.is_some() { self.found_s + dt_s } else { 0.0 };
    }

    /// Whether its position is unknown or older than [`UNSEEN_S`], or its velocity is not known yet.
    pub(super) fn is_unseen(&self) -> bool {
        let is_seen = |motion: ObstacleMotion| motion.unseen_s <= UNSEEN_S;
        !self.motion.is_some_and(is_seen) || self.found_s < FOUND_S
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
        Self::with_velocity(pos_w, Vector3::zeros())
    }

    /// Found at `pos_w` with the velocity `vel_w`. m, m/s
    fn with_velocity(pos_w: Vector3<f64>, vel_w: Vector3<f64>) -> Self {
        Self {
            pos_w,
            seen_w: pos_w,
            vel_w,
            lagged_vel_w: vel_w,
            mean_vel_w: vel_w,
            accel_squared: 0.0,
            unseen_s: 0.0,
        }
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
        let gap_s = self.unseen_s + dt_s;
        let seen_w = pos_w + innovation_w;
        if innovation_w.norm() > JUMP_M {
            let mean_w = (seen_w - self.seen_w) / gap_s;
            let is_motion = mean_w.norm() <= WALK_MAX_MPS;
            let there =
                Self::with_velocity(seen_w, if is_motion { mean_w } else { Vector3::zeros() });
            return Some(Self { accel_squared: self.accel_squared, ..there });
        }
        let fading =
            FADING.powi(i32::try_from(horizon_model::whole(gap_s / dt_s)).unwrap_or(i32::MAX));
        let vel_w = self.vel_w + innovation_w * ((1.0 - fading).powi(2) / gap_s);
        let change_w = vel_w - self.lagged_vel_w;
        let squared = (change_w / CHANGE_S.max(gap_s)).norm_squared();
        let approach = |time_s: f64| (gap_s / time_s).min(1.0);
        Some(Self {
            pos_w: pos_w + innovation_w * (1.0 - fading.powi(2)),
            seen_w,
            vel_w,
            lagged_vel_w: self.lagged_vel_w + change_w * approach(CHANGE_S),
            mean_vel_w: self.mean_vel_w + (vel_w - self.mean_vel_w) * approach(MEAN_S),
            accel_squared: self.accel_squared
                + (squared - self.accel_squared) * approach(ACCEL_MEAN_S),
            unseen_s: 0.0,
        })
    }
}

#[cfg(test)]
mod tests;
