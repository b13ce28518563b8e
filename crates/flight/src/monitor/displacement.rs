//! Displacements of the last seconds by the poses, the drone and the inputs, for motion that shows no axes of the
//! drone.
//!
//! Owns which of the three is a witness: the drone is one only if it agrees with the inputs of a typical vehicle better
//! than the poses do.

use nalgebra::Complex;

use super::FORGET_S;
use super::typical_vehicle::decay;
use super::velocity::{FIXED, FRAMES, TURNING, shortened};

/// Time within which a difference between speeds is forgotten. s
const SPEED_FORGET_S: f64 = 4.0;
/// Displacement by the drone that counts. m
const FLOWN_MIN_M: f64 = 0.6;
/// Displacement by the drone over that by the inputs if the drone is a witness.
const WITNESS_RATIO: std::ops::RangeInclusive<f64> = 0.4..=2.5;
/// Turn of the inputs' axes that does not count: that of the vehicle's own axes in the body of the mocap. rad
const TURN_RAD: f64 = 0.785;
/// Difference between displacements or speeds by poses and by drone that does not count: a fraction of the drone's
/// displacement, or of the larger speed and at least so much. 1, m/s
const TOLERANCE: f64 = 0.25;
const TOLERANCE_MPS: f64 = 0.1;
/// Error of the drone's velocity that shows nothing, beside that tolerance: with it less than the 0.08 m/s of
/// `velocity.rs` is needed. m/s
const DISPLACEMENT_DRIFT_MPS: f64 = 0.05;
/// Time constant of the low-pass filter of both velocities before their speeds are compared: what their ages, which are
/// found to 0.1 s, still differ by makes a small difference. s
const SPEED_TAU_S: f64 = 0.4;

/// Motion of the last seconds by three witnesses, while the drone's axes are not known: lengths of displacements
/// and speeds do not depend on the axes. Displacements show a drift that is flown against, speeds one that is not.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Displacements {
    /// By the poses. m
    pub(super) poses_w_m: Complex<f64>,
    /// Velocity by the poses, low-pass filtered. m/s
    poses_w_mps: Complex<f64>,
    /// By the drone in each frame. m
    pub(super) flown_d_m: [Complex<f64>; FRAMES],
    /// Speed by the drone in each kind of axes, those that are fixed and those that turn with the body.
    drone: [DroneSpeed; 2],
    /// By the inputs of a typical vehicle. m
    pub(super) inputs_w_m: Complex<f64>,
    /// Velocity that follows the inputs, after the lag. m/s
    pub(super) followed_w_mps: Complex<f64>,
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
        moved_w_m: Complex<f64>,
        seen_d_mps: &[Complex<f64>; FRAMES],
        asked_w_mps: Complex<f64>,
        dt_s: f64,
    ) {
        let keep = (-dt_s / FORGET_S).exp();
        let remember =
            |displacement_m| shortened(displacement_m * keep, DISPLACEMENT_DRIFT_MPS * dt_s);
        let keep_difference = (-dt_s / SPEED_FORGET_S).exp();
        let smooth = 1.0 - (-dt_s / SPEED_TAU_S).exp();
        self.followed_w_mps += (asked_w_mps - self.followed_w_mps) * (1.0 - decay(dt_s));
        self.inputs_w_m = remember(self.inputs_w_m) + self.followed_w_mps * dt_s;
        self.poses_w_m = remember(self.poses_w_m) + moved_w_m;
        self.poses_w_mps += (moved_w_m / dt_s - self.poses_w_mps) * smooth;
        let by_poses_mps = self.poses_w_mps.norm();
        for (flown_d_m, seen_d_mps) in self.flown_d_m.iter_mut().zip(seen_d_mps) {
            *flown_d_m = remember(*flown_d_m) + seen_d_mps * dt_s;
        }
        for (drone, seen_d_mps) in
            self.drone.iter_mut().zip([seen_d_mps[FIXED], seen_d_mps[TURNING]])
        {
            drone.velocity_d_mps += (seen_d_mps - drone.velocity_d_mps) * smooth;
            let by_drone_mps = drone.velocity_d_mps.norm();
            let tolerance_mps = (TOLERANCE * by_poses_mps.max(by_drone_mps)).max(TOLERANCE_MPS);
            drone.excess_mps = ((by_poses_mps - by_drone_mps).abs() - tolerance_mps).max(0.0);
            drone.difference_m = drone.difference_m * keep_difference + drone.excess_mps * dt_s;
        }
    }

    /// Whether the speeds by poses and by drone agree.
    pub(super) fn speeds_agree(&self) -> bool {
        self.drone.iter().any(|drone| drone.excess_mps <= 0.0)
    }

    /// By how much the poses differ from the two others, less a tolerance; `None` if those do not agree,
    /// as with a drone whose unit is not ours, or did not move. m
    pub(super) fn difference_m(&self) -> Option<f64> {
        let (inputs_m, poses_m) = (self.inputs_w_m.norm(), self.poses_w_m.norm());
        let difference_m = |frame: usize, drone: &DroneSpeed| {
            let flown_m = self.flown_d_m[frame].norm();
            // A drone whose unit is another differs from the inputs more than the poses do.
            let is_nearer = (flown_m - inputs_m).abs() <= (poses_m - inputs_m).abs();
            let is_witness = flown_m >= FLOWN_MIN_M
                && WITNESS_RATIO.contains(&(flown_m / inputs_m))
                && is_nearer;
            let difference_m = (poses_m - flown_m).abs() - TOLERANCE * flown_m;
            is_witness.then(|| difference_m.max(drone.difference_m))
        };
        let [fixed, turning] = &self.drone;
        Some(difference_m(FIXED, fixed)?.min(difference_m(TURNING, turning)?))
    }

    /// By how much the displacement by the poses differs from `flown_w_m` by the drone, less a tolerance; `None` unless
    /// the drone is closer than half as far from the inputs as the poses are. m
    pub(super) fn vector_difference_m(&self, flown_w_m: Complex<f64>) -> Option<f64> {
        let turn_rad = (self.poses_w_m * flown_w_m.conj()).arg().clamp(-TURN_RAD, TURN_RAD);
        let turned_w_m = self.poses_w_m * Complex::from_polar(1.0, -turn_rad);
        let is_nearer =
            (flown_w_m - self.inputs_w_m).norm() <= 0.5 * (turned_w_m - self.inputs_w_m).norm();
        is_nearer.then(|| (turned_w_m - flown_w_m).norm() - TOLERANCE * flown_w_m.norm())
    }
}

#[cfg(test)]
mod tests;
