//! Displacements of the last seconds by the poses, by the drone and by the inputs, compared while the drone's axes are
//! not known.
//!
//! Owns when the drone contradicts the poses: only if it agrees better with the motion of a typical vehicle under the
//! inputs than the poses do.

use nalgebra::Complex;

use super::FORGET_S;
use super::typical_vehicle::lag_decay;
use super::velocity::{AXES_KINDS, FIXED, TURNING, shortened};
use crate::forgetting::decay;

/// Time constant with which a difference between speeds is forgotten. s
const SPEED_FORGET_S: f64 = 4.0;
/// Least displacement by the drone with which the poses are compared. m
const FLOWN_MIN_M: f64 = 0.6;
/// Displacement by the drone over that by the inputs with which the drone's unit is ours. 1
const UNIT_RATIO: std::ops::RangeInclusive<f64> = 0.4..=2.5;
/// Turn between poses and drone that does not count: the rigid body of the mocap may be turned to the vehicle. rad
const TURN_RAD: f64 = 0.785;
/// Difference between poses and drone that does not count: of displacements a fraction of the drone's, of speeds the
/// same fraction of the larger one and at least [`TOLERANCE_MPS`]. 1, m/s
const TOLERANCE: f64 = 0.25;
const TOLERANCE_MPS: f64 = 0.1;
/// Error of the drone's velocity that is not counted, in addition to that tolerance; therefore less than the 0.08 m/s
/// of `velocity.rs`. m/s
const DISPLACEMENT_DRIFT_MPS: f64 = 0.05;
/// Time constant of the low-pass filter of both velocities before their speeds are compared: the age of the reports is
/// found to 0.1 s only, and what remains must make a small difference. s
const SPEED_TAU_S: f64 = 0.4;

/// Motion of the last seconds by poses, drone and inputs. Lengths of displacements and speeds do not depend on the
/// drone's axes. Displacements show a drift of the poses that the controller flies against, speeds any other drift.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Displacements {
    /// By the poses. m
    pub(super) poses_w_m: Complex<f64>,
    /// Velocity by the poses, low-pass filtered. m/s
    poses_w_mps: Complex<f64>,
    /// By the drone in each kind of axes. m
    pub(super) drone_d_m: [Complex<f64>; AXES_KINDS],
    /// Speed by the drone in each kind of axes, those that are fixed and those that turn with the body.
    drone_speeds: [DroneSpeed; 2],
    /// By the inputs of a typical vehicle. m
    pub(super) inputs_w_m: Complex<f64>,
    /// Velocity that follows the inputs, after the lag. m/s
    pub(super) inputs_w_mps: Complex<f64>,
}

/// Speed by the drone in one kind of axes.
#[derive(Debug, Clone, Copy, Default)]
struct DroneSpeed {
    /// Low-pass filtered. m/s
    velocity_d_mps: Complex<f64>,
    /// Difference between the speeds by poses and by drone, less a tolerance. m/s
    excess_mps: f64,
    /// Exponentially forgotten integral of `excess_mps`. m
    difference_m: f64,
}

impl Displacements {
    /// Adds a period.
    pub(super) fn add(
        &mut self,
        poses_w_m: Complex<f64>,
        drone_d_mps: &[Complex<f64>; AXES_KINDS],
        commanded_w_mps: Complex<f64>,
        dt_s: f64,
    ) {
        let keep = decay(dt_s, FORGET_S);
        let remember =
            |displacement_m| shortened(displacement_m * keep, DISPLACEMENT_DRIFT_MPS * dt_s);
        let keep_difference = decay(dt_s, SPEED_FORGET_S);
        let smooth = 1.0 - decay(dt_s, SPEED_TAU_S);
        self.inputs_w_mps += (commanded_w_mps - self.inputs_w_mps) * (1.0 - lag_decay(dt_s));
        self.inputs_w_m = remember(self.inputs_w_m) + self.inputs_w_mps * dt_s;
        self.poses_w_m = remember(self.poses_w_m) + poses_w_m;
        self.poses_w_mps += (poses_w_m / dt_s - self.poses_w_mps) * smooth;
        let by_poses_mps = self.poses_w_mps.norm();
        for (drone_d_m, drone_d_mps) in self.drone_d_m.iter_mut().zip(drone_d_mps) {
            *drone_d_m = remember(*drone_d_m) + drone_d_mps * dt_s;
        }
        for (drone, drone_d_mps) in
            self.drone_speeds.iter_mut().zip([drone_d_mps[FIXED], drone_d_mps[TURNING]])
        {
            drone.velocity_d_mps += (drone_d_mps - drone.velocity_d_mps) * smooth;
            let by_drone_mps = drone.velocity_d_mps.norm();
            let tolerance_mps = (TOLERANCE * by_poses_mps.max(by_drone_mps)).max(TOLERANCE_MPS);
            drone.excess_mps = ((by_poses_mps - by_drone_mps).abs() - tolerance_mps).max(0.0);
            drone.difference_m = drone.difference_m * keep_difference + drone.excess_mps * dt_s;
        }
    }

    /// Whether the speeds by poses and by drone agree, in one kind of axes at least.
    pub(super) fn speeds_agree(&self) -> bool {
        self.drone_speeds.iter().any(|drone| drone.excess_mps <= 0.0)
    }

    /// Difference of poses and drone by lengths and speeds, less a tolerance; `None` if the drone does not agree with
    /// the inputs better than the poses do, hardly moved, or has another unit. m
    pub(super) fn difference_m(&self) -> Option<f64> {
        let (inputs_m, poses_m) = (self.inputs_w_m.norm(), self.poses_w_m.norm());
        let difference_m = |kind: usize, drone: &DroneSpeed| {
            let drone_m = self.drone_d_m[kind].norm();
            // A drone with another unit differs from the inputs more than the poses do.
            let is_nearer = (drone_m - inputs_m).abs() <= (poses_m - inputs_m).abs();
            let is_comparable =
                drone_m >= FLOWN_MIN_M && UNIT_RATIO.contains(&(drone_m / inputs_m)) && is_nearer;
            let difference_m = (poses_m - drone_m).abs() - TOLERANCE * drone_m;
            is_comparable.then(|| difference_m.max(drone.difference_m))
        };
        let [fixed, turning] = &self.drone_speeds;
        Some(difference_m(FIXED, fixed)?.min(difference_m(TURNING, turning)?))
    }

    /// Difference of the displacement by the poses and `drone_w_m` by the drone, world frame, less a tolerance; `None`
    /// unless the drone's difference from the inputs is half of that of the poses at most. m
    pub(super) fn vector_difference_m(&self, drone_w_m: Complex<f64>) -> Option<f64> {
        let turn_rad = (self.poses_w_m * drone_w_m.conj()).arg().clamp(-TURN_RAD, TURN_RAD);
        let turned_w_m = self.poses_w_m * Complex::from_polar(1.0, -turn_rad);
        let is_nearer =
            (drone_w_m - self.inputs_w_m).norm() <= 0.5 * (turned_w_m - self.inputs_w_m).norm();
        is_nearer.then(|| (turned_w_m - drone_w_m).norm() - TOLERANCE * drone_w_m.norm())
    }
}

#[cfg(test)]
mod tests;
