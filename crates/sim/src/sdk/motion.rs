//! Movements by a distance or an angle, flown by the drone itself.

use horizon_model::rows::{Pose, Sticks, pose};

use crate::DT_S;
use crate::drone::Truth;

/// Stick per metre and per radian of distance to go, and the dead zone of real sticks added.
const STICK_PER_M: f64 = 0.3;
const STICK_PER_RAD: f64 = 0.5;
const STICK_MIN: f64 = 0.14;
const STICK_MAX: f64 = 0.5;
/// How near counts as there.
const NEAR_M: f64 = 0.08;
const NEAR_RAD: f64 = 0.05;
/// Speed below which the drone counts as standing. m/s, rad/s
const SLOW: f64 = 0.12;
/// Longest movement. s
const PATIENCE_S: f64 = 20.0;
/// Duration of a flip. s
const FLIP_S: f64 = 1.5;

/// A running movement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SdkMotion {
    goal: Pose,
    lasts_s: f64,
    /// Not over before. s
    least_s: f64,
}

impl SdkMotion {
    /// To `cm` forward, left and up from `from`.
    pub(super) fn go(cm: [i16; 3], from: &Pose) -> Self {
        let [forward_m, left_m, up_m] = cm.map(|cm| f64::from(cm) / 100.0);
        let (sin, cos) = from[pose::THETA].sin_cos();
        let mut goal = *from;
        goal[pose::X] += cos * forward_m - sin * left_m;
        goal[pose::Y] += sin * forward_m + cos * left_m;
        goal[pose::Z] += up_m;
        Self { goal, lasts_s: 0.0, least_s: 0.0 }
    }

    /// By `deg` counter-clockwise.
    pub(super) fn turn(deg: i16, from: &Pose) -> Self {
        let mut goal = *from;
        goal[pose::THETA] += f64::from(deg).to_radians();
        Self { goal, lasts_s: 0.0, least_s: 0.0 }
    }

    /// A flip, without its motion: holds `from` for its time.
    pub(super) fn flip(from: &Pose) -> Self {
        Self { goal: *from, lasts_s: 0.0, least_s: FLIP_S }
    }

    /// Sticks of the coming step, and the reply once the movement is over.
    pub(super) fn steer(&mut self, truth: &Truth) -> (Sticks, Option<&'static str>) {
        self.lasts_s += DT_S;
        let to_go = self.goal - truth.pose;
        let speed = truth.velocity;
        let is_near = to_go[pose::X].hypot(to_go[pose::Y]).max(to_go[pose::Z].abs()) < NEAR_M
            && to_go[pose::THETA].abs() < NEAR_RAD;
        let speeds = [speed.x_mps, speed.y_mps, speed.z_mps, speed.yaw_radps];
        let is_slow = speeds.iter().all(|speed| speed.abs() < SLOW);
        let is_late = self.lasts_s > PATIENCE_S;
        if is_late || (is_near && is_slow && self.lasts_s >= self.least_s) {
            let reply = if is_late { "error Run timeout" } else { "ok" };
            return (Sticks::zeros(), Some(reply));
        }
        let (sin, cos) = truth.pose[pose::THETA].sin_cos();
        let forward_m = cos * to_go[pose::X] + sin * to_go[pose::Y];
        let right_m = sin * to_go[pose::X] - cos * to_go[pose::Y];
        let u = Sticks::new(
            stick(right_m, STICK_PER_M, NEAR_M),
            stick(forward_m, STICK_PER_M, NEAR_M),
            stick(to_go[pose::THETA], STICK_PER_RAD, NEAR_RAD),
            stick(to_go[pose::Z], STICK_PER_M, NEAR_M),
        );
        (u, None)
    }
}

fn stick(to_go: f64, gain: f64, near: f64) -> f64 {
    if to_go.abs() < 0.5 * near {
        0.0
    } else {
        (gain * to_go + STICK_MIN * to_go.signum()).clamp(-STICK_MAX, STICK_MAX)
    }
}
