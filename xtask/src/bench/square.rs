//! The closed loop along a square, recorded once from converged solves and replayed by every program.

use anyhow::{Result, ensure};
use horizon_model::rows::{Pose, Sticks};
use horizon_model::{Kinematic, Model};
use nalgebra::SVector;
use tello_flight::clip_target;

use super::mpc::{self, Case, DT_S};

/// Corners of the square, x and y. m
const CORNERS: [[f64; 2]; 4] = [[0.0, 0.0], [1.5, 0.0], [1.5, 1.5], [0.0, 1.5]];
/// Height of the square. m
const ALTITUDE: f64 = 1.3;

/// A corner is reached within this, metres and radians alike.
const REACH: f64 = 0.2;

/// Distance from the vehicle to which a target is clipped, norm over x, y, z and theta. m and rad
const CLIP: f64 = 0.3;

/// Standard deviation of what disturbs each step. m, rad
const NOISE: [f64; 4] = [2e-3, 2e-3, 2e-3, 3e-3];

/// Seed of the disturbance.
const SEED: u64 = 7;

/// Numbers with mean 0 and variance 1 that any machine repeats: sums of twelve uniform ones from the
/// generator of Steele, Lea and Flood, 2014 (`SplitMix64`).
#[derive(Debug)]
pub(super) struct Noise(u64);

impl Noise {
    /// The numbers of `seed`.
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// A vector with these standard deviations.
    pub(super) fn vector<const N: usize>(&mut self, sd: &[f64; N]) -> SVector<f64, N> {
        SVector::from(sd.map(|sd| sd * self.normal()))
    }

    fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.uniform()).sum::<f64>() - 6.0
    }
}

/// The corner of the square that is flown to.
#[derive(Debug, Default)]
pub(super) struct Corners {
    count: usize,
}

impl Corners {
    /// Where to from `at`.
    pub(super) fn next(&mut self, at: &Pose) -> Pose {
        let [x, y] = CORNERS[self.count % CORNERS.len()];
        let target = Pose::new(x, y, ALTITUDE, 0.0);
        if (target - at).norm() < REACH {
            self.count += 1;
        }
        target
    }
}

/// The first `count` problems of the flight with this horizon.
///
/// # Errors
/// A solve that fails.
pub(super) fn record(horizon_steps: usize, count: usize) -> Result<Vec<Case>> {
    let mut mpc = mpc::controller(horizon_steps, horizon_control::InputCost::Absolute, 1e-13)?;
    let p = SVector::from([1.29, 0.445, 0.994, 0.033]);
    let (mut noise, mut corners) = (Noise::new(SEED), Corners::default());
    let mut s_0 = Pose::new(0.0, 0.0, 0.9, 0.5);
    let mut cases = Vec::with_capacity(count);
    for _ in 0..count {
        let s_ref = clip_target(&corners.next(&s_0), &s_0, CLIP);
        let case = Case { p, u_before: Sticks::zeros(), s_0, s_ref };
        mpc.shift();
        let report = mpc::solve(&mut mpc, &case, &vec![case.s_ref; horizon_steps])?;
        ensure!(report.has_new_plan(), "a solve of the square ended by {:?}", report.stop);
        s_0 = Kinematic.step(&s_0, &mpc.plan()[0], &p, DT_S) + noise.vector(&NOISE);
        cases.push(case);
    }
    Ok(cases)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_square_is_flown_round_with_targets_that_are_near() {
        let cases = record(13, 1000).unwrap();
        for corner in CORNERS {
            let nearest = cases
                .iter()
                .map(|case| (case.s_0[0] - corner[0]).hypot(case.s_0[1] - corner[1]))
                .fold(f64::INFINITY, f64::min);
            assert!(nearest < REACH, "{nearest} m from {corner:?}");
        }
        for case in &cases {
            let away = (case.s_ref - case.s_0).fixed_rows::<3>(0).norm();
            assert!(away < CLIP + 1e-9, "{away} m");
        }
        let again = record(13, 20).unwrap();
        assert!(again.iter().zip(&cases).all(|(one, other)| one.s_0 == other.s_0));
    }

    #[test]
    fn the_noise_has_its_standard_deviation() {
        let mut noise = Noise::new(SEED);
        let drawn: Vec<f64> = (0..20_000).map(|_| noise.vector(&[0.5])[0]).collect();
        let mean = drawn.iter().sum::<f64>() / drawn.len() as f64;
        let variance = drawn.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / drawn.len() as f64;
        assert!(mean.abs() < 0.015 && (variance.sqrt() - 0.5).abs() < 0.01, "{mean}, {variance}");
    }
}
