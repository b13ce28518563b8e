//! Whether the vehicle stays where it is under large inputs: it is held by a hand, caught in a net or pressed against a
//! wall.
//!
//! Sways of the hand look like answers to the inputs now and then, so that the link monitor finds an outage and its end
//! in turns, and neither time limit of an outage is reached. With the estimated position x and the sent inputs of the
//! three translations `u_w`, world frame (`docs/model.md`, section 6):
//!
//! ```text
//! q <- 0, x_0 <- x                  once |x - x_0| > 0.4 m, in the first tick, and while a person steers
//! q <- exp(-dt / T) q + dt u_w      in each period in which the controller flies the mission and the link is up
//! ```
//!
//! In all other periods (an outage, a hold) nothing is added to q and nothing is forgotten.

use horizon_model::rows::{Pose, Sticks, pos_w, pose, stick};
use nalgebra::Vector3;

use crate::commanded::inputs_w;
use crate::forgetting::decay;

/// The vehicle has moved when it is further away from `x_0`. m
const MOVED_M: f64 = 0.4;
/// T, the forgetting time of the inputs: a steady input of 0.5, as wind asks for in a hover, adds up to 2 s at most. s
const FORGETTING_S: f64 = 4.0;

/// Weight of throttle beside roll and pitch, in `u_w`: the link monitor does not test the height, so that an outage in
/// a climb looks like a vehicle that is held. Full throttle alone adds up to 2.4 s in 10 s. 1
const THROTTLE: f64 = 0.65;

/// Inputs that moved nothing.
#[derive(Debug, Clone, Default)]
pub(super) struct Immobility {
    /// `x_0`, where they began. m
    begun_at_w: Option<Vector3<f64>>,
    /// Measured yaw of the newest estimate. rad
    theta_rad: f64,
    /// q, in the world frame but for a turn by `theta_0`. s of full deflection
    pressed_w_s: Vector3<f64>,
}

impl Immobility {
    /// Takes the estimate `pose_hat`, world frame. m, rad
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn observe_pose(&mut self, pose_hat: &Pose) {
        let at_w = pos_w(pose_hat);
        if self.begun_at_w.is_none_or(|from_w| (at_w - from_w).norm() > MOVED_M) {
            (self.begun_at_w, self.pressed_w_s) = (Some(at_w), Vector3::zeros());
        }
        self.theta_rad = pose_hat[pose::THETA];
    }

    /// One period of `dt_s` begins, in which the controller flies the mission by `u_sent` and its inputs are found to
    /// act.
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn add_input(&mut self, u_sent: &Sticks, dt_s: f64) {
        // The direction of flight is psi = theta + theta_0. theta_0 hardly changes within T: it turns q about z and
        // leaves |q|, all that is compared.
        let u_w = inputs_w(u_sent, self.theta_rad).push(THROTTLE * u_sent[stick::THROTTLE]);
        self.pressed_w_s = decay(dt_s, FORGETTING_S) * self.pressed_w_s + dt_s * u_w;
    }

    /// Forgets all inputs: a person steers.
    pub(super) fn restart(&mut self) {
        self.begun_at_w = None;
    }

    /// |q|; beyond `failsafe.pressed_s` the vehicle counts as immobile. s of full deflection
    pub(super) fn pressed_s(&self) -> f64 {
        self.pressed_w_s.norm()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DT_S: f64 = 0.02;

    /// |q| after `steps` periods with the input `u(step)` at the pose `at(step)`.
    fn pressed_s(steps: u32, u: impl Fn(f64) -> Sticks, at: impl Fn(f64) -> Pose) -> f64 {
        let mut immobility = Immobility::default();
        for t_s in (0..steps).map(|step| DT_S * f64::from(step)) {
            immobility.observe_pose(&at(t_s));
            immobility.add_input(&u(t_s), DT_S);
        }
        immobility.pressed_s()
    }

    /// An input of one axis.
    fn along(row: usize, value: f64) -> Sticks {
        let mut u = Sticks::zeros();
        u[row] = value;
        u
    }

    #[test]
    fn steady_inputs_add_up_while_the_vehicle_sways() {
        let sway = |t_s: f64| Pose::new(0.15 * (5.0 * t_s).sin(), 1.0, -2.0, 0.3);
        for (row, weight) in [(stick::ROLL, 1.0), (stick::PITCH, 1.0), (stick::THROTTLE, 0.65)] {
            for u in [-1.0, 0.4] {
                let found_s = pressed_s(150, |_| along(row, u), sway);
                // 4 (1 - exp(-3 / 4)) = 2.11.
                let expected_s = 2.11 * weight * u.abs();
                assert!((found_s - expected_s).abs() < 0.01, "{row} {u}: {found_s} s");
            }
        }
        assert!(pressed_s(150, |_| along(stick::YAW, 1.0), sway).abs() < 1e-12);
        let long_s = pressed_s(3000, |_| along(stick::PITCH, 0.5), sway);
        assert!((long_s - 2.0).abs() < 0.01, "{long_s} s");
    }

    #[test]
    fn what_was_before_a_person_steered_does_not_count() {
        let mut immobility = Immobility::default();
        for _ in 0..100 {
            immobility.observe_pose(&Pose::zeros());
            immobility.add_input(&along(stick::PITCH, 1.0), DT_S);
        }
        immobility.restart();
        immobility.observe_pose(&Pose::zeros());
        assert!(immobility.pressed_s().abs() < 1e-12);
    }

    #[test]
    fn inputs_to_and_fro_and_motion_do_not() {
        let still = |_| Pose::zeros();
        let to_and_fro = |t_s: f64| along(stick::ROLL, (2.0 * t_s).sin().signum());
        assert!(pressed_s(500, to_and_fro, still) < 1.6);
        // 0.25 m/s: 0.4 m in 1.6 s.
        let slow = |t_s: f64| Pose::new(0.25 * t_s, 0.0, 0.0, 0.0);
        assert!(pressed_s(500, |_| along(stick::PITCH, 1.0), slow) < 1.65);
    }

    #[test]
    fn a_vehicle_that_turns_presses_in_its_direction_in_the_world() {
        // A stick that turns against the heading asks for one direction.
        let turning = |t_s: f64| Pose::new(0.0, 0.0, 0.0, t_s);
        let against =
            |t_s: f64| Sticks::from([t_s.sin(), 0.0, 0.0, 0.0]) + along(stick::PITCH, t_s.cos());
        let (turned_s, straight_s) = (
            pressed_s(150, against, turning),
            pressed_s(150, |_| along(stick::PITCH, 1.0), |_| Pose::zeros()),
        );
        assert!((turned_s - straight_s).abs() < 1e-9, "{turned_s} s, {straight_s} s");
    }
}
