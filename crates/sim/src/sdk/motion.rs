//! Movements by a distance or an angle, flown by the drone itself.

use horizon_model::rows::{Pose, Sticks, pose};

use crate::DT_S;
use crate::drone::Truth;

/// Stick per distance to go. 1/m
const STICK_PER_M: f64 = 0.3;
/// Stick per angle to go. 1/rad
const STICK_PER_RAD: f64 = 0.5;
/// Added to a stick: the dead zone of real ones. 1
const STICK_MIN: f64 = 0.14;
/// Largest stick. 1
const STICK_MAX: f64 = 0.5;
/// Distance at which a place counts as reached. m
const NEAR_M: f64 = 0.08;
/// Angle at which a heading counts as reached. rad
const NEAR_RAD: f64 = 0.05;
/// Speed below which the drone counts as standing. m/s, rad/s
const SLOW: f64 = 0.12;
/// Longest duration of a movement. s
const DURATION_MAX_S: f64 = 20.0;
/// Duration of a flip. s
const FLIP_S: f64 = 1.5;

/// A running movement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct SdkMotion {
    /// m, rad
    goal: Pose,
    /// Since its beginning. s
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
        let is_late = self.lasts_s > DURATION_MAX_S;
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

/// Stick for what is left `to_go`, in the unit of `near`; neutral within half of `near`. 1
fn stick(to_go: f64, gain: f64, near: f64) -> f64 {
    if to_go.abs() < 0.5 * near {
        0.0
    } else {
        (gain * to_go + STICK_MIN * to_go.signum()).clamp(-STICK_MAX, STICK_MAX)
    }
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;
    use horizon_model::rows::stick as row;

    use super::*;
    use crate::ReceivedOrders;
    use crate::drone::DronePhase;
    use crate::plant::Velocity;

    fn truth(pose: Pose, velocity: Velocity) -> Truth {
        Truth {
            pose,
            velocity,
            phase: DronePhase::Flying,
            link_is_up: true,
            battery_pct: 90.0,
            motor_s: 1.0,
            received: ReceivedOrders::default(),
        }
    }

    fn at_rest(pose: Pose) -> Truth {
        truth(pose, Velocity::default())
    }

    /// Facing +y.
    const FROM: Pose = Pose::new(1.0, 2.0, 1.5, std::f64::consts::FRAC_PI_2);

    #[test]
    fn a_goal_lies_where_the_nose_points_and_to_its_left() {
        for (cm, expected) in [
            ([100, 0, 0], [1.0, 3.0, 1.5]),
            ([0, 50, 0], [0.5, 2.0, 1.5]),
            ([0, -50, 20], [1.5, 2.0, 1.7]),
        ] {
            let goal = SdkMotion::go(cm, &FROM).goal;
            let gap = [pose::X, pose::Y, pose::Z].map(|row| (goal[row] - expected[row]).abs());
            assert!(gap.iter().all(|gap| *gap < 1e-12), "{cm:?}: {goal}");
            assert!((goal[pose::THETA] - FROM[pose::THETA]).abs() <= 0.0);
        }
        let turned = SdkMotion::turn(-90, &FROM).goal;
        assert!(amax(&(turned - Pose::new(1.0, 2.0, 1.5, 0.0))) < 1e-12, "{turned}");
    }

    #[test]
    fn sticks_lead_towards_the_goal_in_the_frame_of_the_vehicle() {
        for (mut motion, row, sign) in [
            (SdkMotion::go([60, 0, 0], &FROM), row::PITCH, 1.0),
            (SdkMotion::go([-60, 0, 0], &FROM), row::PITCH, -1.0),
            (SdkMotion::go([0, 60, 0], &FROM), row::ROLL, -1.0),
            (SdkMotion::go([0, 0, 60], &FROM), row::THROTTLE, 1.0),
        ] {
            let (u, reply) = motion.steer(&at_rest(FROM));
            let mut expected = Sticks::zeros();
            // 0.3 per metre and what the dead zone takes.
            expected[row] = sign * (0.3 * 0.6 + 0.14);
            assert!(amax(&(u - expected)) < 1e-12 && reply.is_none(), "{u}, not {expected}");
        }
        let (u, _) = SdkMotion::turn(30, &FROM).steer(&at_rest(FROM));
        assert!((u[row::YAW] - (0.5 * 30.0_f64.to_radians() + 0.14)).abs() < 1e-12, "{u}");
        let (u, _) = SdkMotion::go([500, 0, 0], &FROM).steer(&at_rest(FROM));
        assert!((u[row::PITCH] - STICK_MAX).abs() < 1e-12, "{u}");
    }

    #[test]
    fn a_movement_is_over_where_the_vehicle_stands_at_its_goal() {
        let goal = SdkMotion::go([100, 0, 0], &FROM).goal;
        let beside = |m: f64, rad: f64| goal + Pose::new(0.0, m, 0.0, rad);
        let drifting = Velocity { z_mps: -0.13, ..Velocity::default() };
        for (truth, is_over) in [
            (at_rest(beside(0.07, 0.04)), true),
            (at_rest(beside(0.09, 0.0)), false),
            (at_rest(beside(0.0, -0.06)), false),
            (at_rest(goal + Pose::new(0.0, 0.0, -0.09, 0.0)), false),
            (truth(goal, drifting), false),
            (truth(goal, Velocity { z_mps: -0.11, ..drifting }), true),
        ] {
            let (u, reply) = SdkMotion::go([100, 0, 0], &FROM).steer(&truth);
            assert_eq!(reply, is_over.then_some("ok"), "{truth:?}");
            assert!(!is_over || u == Sticks::zeros(), "{u}");
        }
    }

    #[test]
    fn a_flip_takes_its_time_and_a_movement_times_out() {
        let steps = |mut motion: SdkMotion, truth: &Truth| {
            (1..2000).find_map(|step: u32| Some((step, motion.steer(truth).1?))).unwrap()
        };
        // 1.5 s and, one step later, 20 s of 20 ms; the sum of the steps is rounded.
        let (step, reply) = steps(SdkMotion::flip(&FROM), &at_rest(FROM));
        assert!((75..=76).contains(&step) && reply == "ok", "{step}: {reply}");
        let (step, reply) = steps(SdkMotion::go([300, 0, 0], &FROM), &at_rest(FROM));
        assert!((1000..=1001).contains(&step) && reply == "error Run timeout", "{step}: {reply}");
    }

    #[test]
    fn half_as_near_as_needed_no_stick_is_given() {
        for (to_go, expected) in
            [(0.039, 0.0), (0.041, 0.3 * 0.041 + 0.14), (-0.5, -0.29), (-9.0, -0.5)]
        {
            let u = stick(to_go, STICK_PER_M, NEAR_M);
            assert!((u - expected).abs() < 1e-12, "{u} for {to_go} m");
        }
    }
}
