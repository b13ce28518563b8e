//! Distortion of a measured pose by injected faults.
//!
//! Owns the noise of these faults and their order: first another object takes the drone's place, then
//! what is wrong about the measurement acts on it. When the result arrives is `frame_lag`'s.

use std::f64::consts::PI;

use horizon_model::angle;
use horizon_model::rows::{Pose, pose};

use crate::DT_S;
use crate::fault::{Faults, InjectedFault, Present};
use crate::mocap::{Mocap, MocapReport, reported};
use crate::random::{Purpose, Random};

/// The faults' own noise.
#[derive(Debug, Clone)]
pub(crate) struct Distortion {
    noise: Random,
    /// Whether the newest report shows the other object of [`InjectedFault::MocapSplit`].
    is_elsewhere: bool,
}

impl Distortion {
    pub(crate) fn new(seed: u64) -> Self {
        Self { noise: Random::new(seed, Purpose::FaultNoise), is_elsewhere: false }
    }

    /// The report of `step`, after `last` and in place of `by_chance`.
    pub(crate) fn report(
        &mut self,
        by_chance: MocapReport,
        last: MocapReport,
        faults: &Faults,
        step: u64,
    ) -> MocapReport {
        self.is_elsewhere = false;
        let is_on = |fault| faults.is_on(fault, step);
        if is_on(InjectedFault::MocapSilent) {
            MocapReport::Silent
        } else if is_on(InjectedFault::MocapLost) || faults.present(step).any(is_occluded) {
            MocapReport::Lost
        } else if is_on(InjectedFault::MocapFixed) {
            Mocap::fixed()
        } else if is_on(InjectedFault::MocapFrozen) {
            last
        } else if let MocapReport::Pose(mut o) = by_chance {
            for present in in_order(faults, step) {
                self.distort(&mut o, &present);
            }
            MocapReport::Pose(misread(o, is_on))
        } else {
            by_chance
        }
    }

    /// Another object in the place of the drone, or a measurement that is wrong by a way, a velocity, a frame, a
    /// heading or noise.
    fn distort(&mut self, o: &mut Pose, present: &Present) {
        let (at, elapsed_s) = (present.pose_onset, present.elapsed_s);
        match present.fault {
            InjectedFault::MocapStill {
                offset_w_m: [x_m, y_m, z_m],
                turn_rad,
                noise_m,
                noise_rad,
            } => {
                *o = at + Pose::new(x_m, y_m, z_m, turn_rad);
                self.add_noise(o, noise_m, noise_rad);
            }
            InjectedFault::MocapSplit { offset_w_m: [x_m, y_m, z_m], fraction }
                if self.noise.chance(fraction) =>
            {
                self.is_elsewhere = true;
                *o = at + Pose::new(x_m, y_m, z_m, 0.0);
            }
            InjectedFault::MocapAxesStuck { axes, noise_m } => {
                for row in (pose::X..=pose::Z).filter(|&row| axes[row]) {
                    o[row] = at[row] + noise_m * self.noise.normal();
                }
            }
            InjectedFault::MocapWalker {
                offset_w_m: [x_m, y_m, z_m], noise_m, noise_rad, ..
            } => {
                *o = at + Pose::new(x_m, y_m, z_m, 0.0) + walked(present, elapsed_s);
                self.add_noise(o, noise_m, noise_rad);
            }
            InjectedFault::MocapShifted { offset_w_m: [x_m, y_m, z_m] } => {
                *o += Pose::new(x_m, y_m, z_m, 0.0);
            }
            InjectedFault::MocapDrift { velocity_w_mps: [x, y, z], yaw_radps } => {
                *o += Pose::new(x, y, z, yaw_radps) * elapsed_s;
                *o = reported(*o);
            }
            InjectedFault::MocapFrame { turn_rad, is_mirrored, scale } => {
                in_frame(o, turn_rad, is_mirrored, scale);
                o[pose::THETA] += turn_rad;
                *o = reported(*o);
            }
            InjectedFault::MocapHeading { turn_rad } => {
                o[pose::THETA] += turn_rad;
                *o = reported(*o);
            }
            InjectedFault::MocapNoise { growth_mps, growth_radps } => {
                self.add_noise(o, growth_mps * elapsed_s, growth_radps * elapsed_s);
            }
            _ => {}
        }
    }

    fn add_noise(&mut self, o: &mut Pose, sd_m: f64, sd_rad: f64) {
        for (row, sd) in [(pose::X, sd_m), (pose::Y, sd_m), (pose::Z, sd_m), (pose::THETA, sd_rad)]
        {
            o[row] += sd * self.noise.normal();
        }
        *o = reported(*o);
    }

    /// How the pose that [`Distortion::report`] gave for `step` changes in it, the true one by `change`: the noise
    /// apart.
    pub(crate) fn change(&self, change: Pose, faults: &Faults, step: u64) -> Pose {
        let is_on = |fault| faults.is_on(fault, step);
        if is_on(InjectedFault::MocapFixed)
            || is_on(InjectedFault::MocapFrozen)
            || is_on(InjectedFault::MocapNan)
        {
            return Pose::zeros();
        }
        let mut change = change;
        for present in in_order(faults, step) {
            match present.fault {
                InjectedFault::MocapStill { .. } => change = Pose::zeros(),
                InjectedFault::MocapSplit { .. } if self.is_elsewhere => change = Pose::zeros(),
                InjectedFault::MocapWalker { .. } => {
                    let elapsed_s = present.elapsed_s;
                    change = walked(&present, elapsed_s) - walked(&present, elapsed_s - DT_S);
                }
                InjectedFault::MocapAxesStuck { axes, .. } => {
                    (pose::X..=pose::Z).filter(|&row| axes[row]).for_each(|row| change[row] = 0.0);
                }
                InjectedFault::MocapDrift { velocity_w_mps: [x, y, z], yaw_radps } => {
                    change += Pose::new(x, y, z, yaw_radps) * DT_S;
                }
                InjectedFault::MocapFrame { turn_rad, is_mirrored, scale } => {
                    in_frame(&mut change, turn_rad, is_mirrored, scale);
                }
                _ => {}
            }
        }
        if is_on(InjectedFault::MocapMillimetres) {
            in_millimetres(&mut change);
        }
        change
    }
}

/// The present faults in the order in which they act: those that put another object in the drone's place come first.
fn in_order(faults: &Faults, step: u64) -> impl Iterator<Item = Present> {
    let replaces = |present: &Present| {
        matches!(
            present.fault,
            InjectedFault::MocapStill { .. }
                | InjectedFault::MocapSplit { .. }
                | InjectedFault::MocapWalker { .. }
                | InjectedFault::MocapAxesStuck { .. }
        )
    };
    let others = faults.present(step).filter(move |present| !replaces(present));
    faults.present(step).filter(replaces).chain(others)
}

/// Displacement of a walker since the onset, after `elapsed_s`; zero of another fault.
fn walked(present: &Present, elapsed_s: f64) -> Pose {
    let InjectedFault::MocapWalker { radius_m, speed_mps, .. } = present.fault else {
        return Pose::zeros();
    };
    let turn_rad = speed_mps / radius_m * elapsed_s;
    let theta = present.pose_onset[pose::THETA];
    let around = |theta: f64| radius_m * theta.sin();
    // The circle lies to the left of the heading at the onset.
    let x_m = around(theta + turn_rad) - around(theta);
    let y_m = around(theta - PI / 2.0 + turn_rad) - around(theta - PI / 2.0);
    Pose::new(x_m, y_m, 0.0, turn_rad)
}

/// `o`, or a change of it, in a frame that is mirrored, scaled and turned; its heading is not turned.
fn in_frame(o: &mut Pose, turn_rad: f64, is_mirrored: bool, scale: f64) {
    let sign = if is_mirrored { -1.0 } else { 1.0 };
    let (x, y) = (scale * o[pose::X], sign * scale * o[pose::Y]);
    let (sin, cos) = turn_rad.sin_cos();
    o[pose::X] = cos * x - sin * y;
    o[pose::Y] = sin * x + cos * y;
    o[pose::Z] *= scale;
    o[pose::THETA] *= sign;
}

/// `o`, or a change of it, with x, y and z in another unit.
fn in_millimetres(o: &mut Pose) {
    for row in [pose::X, pose::Y, pose::Z] {
        o[row] *= 1000.0;
    }
}

/// Whether the object is occluded: at the onset, and again after each period.
fn is_occluded(present: Present) -> bool {
    // Half a step: the times of a period are whole numbers of steps up to rounding.
    let elapsed_s = present.elapsed_s + DT_S / 2.0;
    matches!(present.fault, InjectedFault::MocapOccluded { period_s, lost_s }
        if elapsed_s.rem_euclid(period_s) < lost_s)
}

/// The pose `o` as the faults without values report it.
fn misread(mut o: Pose, is_on: impl Fn(InjectedFault) -> bool) -> Pose {
    if is_on(InjectedFault::MocapNan) {
        o[pose::Y] = f64::NAN;
    }
    if is_on(InjectedFault::MocapFar) {
        o[pose::X] += 10.0;
    }
    if is_on(InjectedFault::MocapAside) {
        o[pose::X] += 3.0;
    }
    if is_on(InjectedFault::MocapFlipped) {
        o[pose::THETA] = angle::wrap(o[pose::THETA] + PI);
    }
    if is_on(InjectedFault::MocapMillimetres) {
        in_millimetres(&mut o);
    }
    o
}

#[cfg(test)]
mod tests;
