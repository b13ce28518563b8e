//! Seeded random streams whose values never change.
//!
//! Owns the generator and the distributions of the simulator. One stream per purpose: a draw more in
//! one of them does not shift another, so that a new sensor fault leaves every seeded gust as it was.
//! There is no global generator and no seed from the machine here.

use std::f64::consts::TAU;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Purpose of a stream. The number selects the stream and must never be reused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// Spread of the vehicle's parameters over flights.
    Vehicle = 1,
    /// Where and how fast a flight starts.
    Start = 2,
    /// Disturbance velocity.
    Disturbance = 3,
    /// Lost commands.
    Radio = 4,
    /// Stalls of the pose stream.
    Stall = 5,
    /// Lost poses.
    Zero = 6,
    /// Heading flips.
    Flip = 7,
    /// Measurement noise.
    Noise = 8,
    /// Keys of a simulated pilot.
    Pilot = 9,
    /// Datagrams on their way to the drone.
    Uplink = 10,
    /// Datagrams on their way from the drone.
    Downlink = 11,
    /// Faults of a campaign.
    Campaign = 12,
    /// Inputs that act during an outage of the command link.
    Outage = 13,
    /// Noise of the faults on order.
    FaultNoise = 14,
    /// Wind, gusts and optical flow of the rigid body.
    RigidBody = 15,
}

/// One stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random(ChaCha8Rng);

impl Random {
    /// The stream of `seed` for `purpose`, from its beginning.
    pub fn new(seed: u64, purpose: Purpose) -> Self {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        generator.set_stream(purpose as u64);
        Self(generator)
    }

    /// Uniform in `[0, 1)`, a multiple of 2^-53.
    pub fn uniform(&mut self) -> f64 {
        const STEP: f64 = 1.0 / (1_u64 << 53) as f64;
        (self.0.next_u64() >> 11) as f64 * STEP
    }

    /// Uniform in `[lo, hi)`, in their unit.
    pub fn between(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.uniform()
    }

    /// True with the given probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.uniform() < probability
    }

    /// Standard normal, Box and Muller 1958. Two uniforms per value; the sine's twin is not kept.
    pub fn normal(&mut self) -> f64 {
        // 1 - uniform lies in (0, 1]: its logarithm is finite.
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (TAU * self.uniform()).cos()
    }

    /// Student's t with three degrees of freedom: heavy tails, variance 3.
    pub(crate) fn student_t3(&mut self) -> f64 {
        let numerator = self.normal();
        let chi_square = (0..3).map(|_| self.normal().powi(2)).sum::<f64>();
        numerator / (chi_square / 3.0).sqrt()
    }

    /// Exponential with the given mean, in its unit.
    pub fn exponential(&mut self, mean: f64) -> f64 {
        -mean * (1.0 - self.uniform()).ln()
    }

    /// Log-normal: the logarithm is normal around `median.ln()` with deviation `sigma`; in the unit of the median.
    pub(crate) fn log_normal(&mut self, median: f64, sigma: f64) -> f64 {
        median * (sigma * self.normal()).exp()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const DRAWS: u32 = 200_000;

    /// Mean and mean square of many draws.
    fn moments(mut draw: impl FnMut() -> f64) -> (f64, f64) {
        let (mut sum, mut squares) = (0.0, 0.0);
        for _ in 0..DRAWS {
            let value = draw();
            sum += value;
            squares += value * value;
        }
        (sum / f64::from(DRAWS), squares / f64::from(DRAWS))
    }

    #[test]
    fn the_first_values_never_change() {
        let mut random = Random::new(1, Purpose::Vehicle);
        let uniforms = [random.uniform(), random.uniform(), random.uniform()];
        assert_eq!(uniforms.map(f64::to_bits), GOLDEN_UNIFORMS.map(f64::to_bits), "{uniforms:?}");
        // Logarithm and cosine come from the platform and may differ in the last bit.
        let normals = [random.normal(), random.normal()];
        for (got, expected) in normals.into_iter().zip(GOLDEN_NORMALS) {
            assert!((got - expected).abs() < 1e-14, "{normals:?}");
        }
    }

    const GOLDEN_UNIFORMS: [f64; 3] =
        [0.851_912_160_844_185_2, 0.050_913_366_002_028_115, 0.558_752_549_630_846_5];
    const GOLDEN_NORMALS: [f64; 2] = [0.448_755_096_439_204_47, 0.709_920_559_665_615_4];

    #[test]
    fn streams_and_seeds_differ() {
        let first = |seed, purpose| Random::new(seed, purpose).uniform().to_bits();
        assert_ne!(first(1, Purpose::Stall), first(1, Purpose::Zero));
        assert_ne!(first(1, Purpose::Stall), first(2, Purpose::Stall));
        assert_eq!(first(7, Purpose::Noise), first(7, Purpose::Noise));
    }

    #[test]
    fn distributions_have_their_moments() {
        let mut random = Random::new(2, Purpose::Noise);
        // Four standard errors of each estimate over 200 000 draws.
        let (mean, square) = moments(|| random.uniform());
        assert!((mean - 0.5).abs() < 2.6e-3 && (square - 1.0 / 3.0).abs() < 2.7e-3, "{mean}");
        let (mean, square) = moments(|| random.normal());
        assert!(mean.abs() < 9e-3 && (square - 1.0).abs() < 1.3e-2, "{mean} {square}");
        let (mean, square) = moments(|| random.exponential(3.0));
        assert!((mean - 3.0).abs() < 2.7e-2 && (square - 18.0).abs() < 0.75, "{mean} {square}");
        let (mean, _) = moments(|| random.log_normal(4.0, 0.6).ln());
        assert!((mean - 4.0_f64.ln()).abs() < 5.4e-3, "{mean}");
    }

    #[test]
    fn student_t_has_its_quantiles() {
        // 50 % of |t3| lie below 0.7649, 95 % below 3.1824; four standard errors of a proportion.
        let mut random = Random::new(3, Purpose::Noise);
        for (quantile, proportion, tolerance) in [(0.7649, 0.5, 4.5e-3), (3.1824, 0.95, 2e-3)] {
            let (fraction, _) =
                moments(|| f64::from(u8::from(random.student_t3().abs() < quantile)));
            assert!((fraction - proportion).abs() < tolerance, "{fraction} below {quantile}");
        }
    }
}
