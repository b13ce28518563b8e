//! One coordinate under white jerk: filter and smoother, robust by Student-t weights.
//!
//! Owns the state (value, rate, acceleration) and the two recursions. Which samples count is decided
//! by the caller.

use nalgebra::{Matrix3, RowVector3, Vector3};

/// Rows of the state of one coordinate.
mod row {
    pub(super) const VALUE: usize = 0;
    pub(super) const RATE: usize = 1;
    pub(super) const ACCELERATION: usize = 2;
}

/// Degrees of freedom of the noise. 1
const DOF: f64 = 3.0;
/// Reweighted passes: a fixed number, so that the cost does not depend on the noise.
const PASSES: usize = 12;
/// Standard deviation of the first value about the first sample (unit of the coordinate), of the first rate (unit/s)
/// and of the first acceleration (unit/s^2).
const START_SD: Vector3<f64> = Vector3::new(10.0, 1.0, 3.0);

/// Noise of one coordinate.
#[derive(Debug, Clone, Copy)]
pub(super) struct Noise {
    /// Spectral density of the jerk. unit^2/s^5
    pub(super) jerk: f64,
    /// Scale of a sample's Student-t noise. unit
    pub(super) scale: f64,
}

/// One coordinate at one step: of position (unit m) or heading (unit rad).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Estimate {
    /// Its value. unit
    pub(super) value: f64,
    /// First derivative by time. unit/s
    pub(super) rate: f64,
    /// Second derivative by time. unit/s^2
    pub(super) acceleration: f64,
}

impl From<Vector3<f64>> for Estimate {
    fn from(s: Vector3<f64>) -> Self {
        Self { value: s[row::VALUE], rate: s[row::RATE], acceleration: s[row::ACCELERATION] }
    }
}

/// Prediction and update of one step by the forward recursion, for the backward one.
#[derive(Debug, Clone, Copy)]
struct Step {
    /// Predicted value, rate and acceleration. Unit of the coordinate over powers of s
    s_pred: Vector3<f64>,
    covariance_pred: Matrix3<f64>,
    /// Gain, innovation and its variance; absent where nothing was observed.
    update: Option<(Vector3<f64>, f64, f64)>,
}

/// Estimates from all samples: the smoother of Rauch, Tung and Striebel (AIAA Journal 3, 1965) in the modified form of
/// Bryson and Frazier (Bierman, Automatica 9, 1973), which inverts no matrix, repeated with the weight
/// `(nu + 1) / (nu + r^2)` of every sample.
pub(super) fn smooth(samples: &[Option<f64>], noise: Noise, dt_s: f64) -> Vec<Estimate> {
    let variance = noise.scale.powi(2);
    let mut variances = vec![variance; samples.len()];
    let mut estimates = Vec::new();
    for _ in 0..PASSES {
        let steps = forward(samples, noise.jerk, dt_s, |k, _, _| variances[k]).1;
        estimates = backward(&steps, dt_s);
        for ((sample, estimate), v) in samples.iter().zip(&estimates).zip(&mut variances) {
            let r = sample.map_or(0.0, |sample| (sample - estimate.value) / noise.scale);
            *v = variance * (DOF + r * r) / (DOF + 1.0);
        }
    }
    estimates
}

/// Estimates from the samples up to each step: Kalman filter whose sample variance grows with the
/// innovation as in [`smooth`], but never shrinks.
pub(super) fn track(samples: &[Option<f64>], noise: Noise, dt_s: f64) -> Vec<Estimate> {
    let variance = noise.scale.powi(2);
    let robust = |_, innovation: f64, variance_pred: f64| {
        let r2 = innovation.powi(2) / (variance_pred + variance);
        variance * ((DOF + r2) / (DOF + 1.0)).max(1.0)
    };
    forward(samples, noise.jerk, dt_s, robust).0
}

/// Filtered estimates and what [`backward`] needs. `variance` of a sample is asked with its step, the
/// innovation and the variance of the prediction.
fn forward(
    samples: &[Option<f64>],
    jerk: f64,
    dt_s: f64,
    variance: impl Fn(usize, f64, f64) -> f64,
) -> (Vec<Estimate>, Vec<Step>) {
    let step_by_state = step_by_state(dt_s);
    let noise = jerk * noise_shape(dt_s);
    let first = samples.iter().flatten().next().copied().unwrap_or(0.0);
    let mut s = Vector3::new(first, 0.0, 0.0);
    let mut covariance = Matrix3::from_diagonal(&START_SD.component_mul(&START_SD));
    let mut estimates = Vec::with_capacity(samples.len());
    let mut steps = Vec::with_capacity(samples.len());
    for (k, sample) in samples.iter().enumerate() {
        if k > 0 {
            s = step_by_state * s;
            covariance = step_by_state * covariance * step_by_state.transpose() + noise;
        }
        let mut step = Step { s_pred: s, covariance_pred: covariance, update: None };
        if let Some(sample) = sample {
            let innovation = sample - s[row::VALUE];
            let variance_pred = covariance[(row::VALUE, row::VALUE)];
            let variance_sum = variance_pred + variance(k, innovation, variance_pred);
            let gain: Vector3<f64> = covariance.column(row::VALUE) / variance_sum;
            s += gain * innovation;
            covariance -= gain * covariance.row(row::VALUE);
            covariance = 0.5 * (covariance + covariance.transpose());
            step.update = Some((gain, innovation, variance_sum));
        }
        estimates.push(s.into());
        steps.push(step);
    }
    (estimates, steps)
}

/// Smoothed estimates: `s_pred - P_pred lambda`, the adjoint `lambda` run from the last step back.
fn backward(steps: &[Step], dt_s: f64) -> Vec<Estimate> {
    let adjoint_step = step_by_state(dt_s).transpose();
    let mut lambda = Vector3::zeros();
    let mut estimates: Vec<Estimate> = steps
        .iter()
        .rev()
        .map(|step| {
            if let Some((gain, innovation, variance)) = step.update {
                lambda[row::VALUE] -= gain.dot(&lambda) + innovation / variance;
            }
            let s = step.s_pred - step.covariance_pred * lambda;
            lambda = adjoint_step * lambda;
            s.into()
        })
        .collect();
    estimates.reverse();
    estimates
}

fn step_by_state(dt_s: f64) -> Matrix3<f64> {
    Matrix3::from_rows(&[
        RowVector3::new(1.0, dt_s, dt_s.powi(2) / 2.0),
        RowVector3::new(0.0, 1.0, dt_s),
        RowVector3::new(0.0, 0.0, 1.0),
    ])
}

/// Covariance that white jerk of density one adds in a step.
fn noise_shape(dt_s: f64) -> Matrix3<f64> {
    let [dt1, dt2, dt3, dt4, dt5] = [1, 2, 3, 4, 5].map(|power| dt_s.powi(power));
    Matrix3::from_rows(&[
        RowVector3::new(dt5 / 20.0, dt4 / 8.0, dt3 / 6.0),
        RowVector3::new(dt4 / 8.0, dt3 / 3.0, dt2 / 2.0),
        RowVector3::new(dt3 / 6.0, dt2 / 2.0, dt1),
    ])
}

#[cfg(test)]
mod tests {
    use horizon_model::check::amax;
    use nalgebra::{SMatrix, SVector};

    use super::*;

    const STEPS: usize = 6;
    const ROWS: usize = 3 * STEPS;

    #[test]
    fn two_steps_are_one_of_their_length_and_short_ones_integrate_the_jerk() {
        for (a_s, b_s) in [(0.02, 0.02), (0.3, 1.1), (2.0, 0.5)] {
            let (after_b, both) = (step_by_state(b_s), step_by_state(a_s + b_s));
            let gap = amax(&(after_b * step_by_state(a_s) - both));
            assert!(gap < 1e-14, "gap {gap:e} of {a_s} s and {b_s} s");
            let noise = after_b * noise_shape(a_s) * after_b.transpose() + noise_shape(b_s);
            let gap = amax(&(noise - noise_shape(a_s + b_s)));
            assert!(gap < 1e-13, "gap {gap:e} of {a_s} s and {b_s} s");
        }
        let dt_s = 1e-7;
        let rate = (step_by_state(dt_s) - step_by_state(-dt_s)) / (2.0 * dt_s);
        let generator = Matrix3::new(0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0);
        assert!(amax(&(rate - generator)) < 1e-9, "{rate}");
        let density = noise_shape(dt_s) / dt_s;
        let jerk_alone = Matrix3::from_diagonal(&Vector3::new(0.0, 0.0, 1.0));
        assert!(amax(&(density - jerk_alone)) < 1e-6, "{density}");
    }

    #[test]
    fn the_recursions_are_the_least_squares_of_all_samples_at_once() {
        let (dt_s, jerk) = (0.5, 0.7);
        let samples = [Some(1.0), Some(1.4), None, Some(0.3), Some(-0.2), None];
        let variances = [0.04, 0.01, 1.0, 0.09, 0.02, 1.0];
        let mut information = SMatrix::<f64, ROWS, ROWS>::zeros();
        let mut right = SVector::<f64, ROWS>::zeros();
        let start = START_SD.map(|sd| sd.powi(-2));
        information.fixed_view_mut::<3, 3>(0, 0).copy_from(&Matrix3::from_diagonal(&start));
        right[row::VALUE] = start[row::VALUE] * 1.0;
        let weight = (jerk * noise_shape(dt_s)).try_inverse().unwrap();
        for k in 1..STEPS {
            let mut residual = SMatrix::<f64, 3, ROWS>::zeros();
            residual.fixed_view_mut::<3, 3>(0, 3 * k - 3).copy_from(&-step_by_state(dt_s));
            residual.fixed_view_mut::<3, 3>(0, 3 * k).copy_from(&Matrix3::identity());
            information += residual.transpose() * weight * residual;
        }
        for (k, (sample, variance)) in samples.iter().zip(variances).enumerate() {
            let Some(sample) = sample else { continue };
            information[(3 * k, 3 * k)] += 1.0 / variance;
            right[3 * k] += sample / variance;
        }
        let expected = information.cholesky().unwrap().solve(&right);
        let (filtered, steps) = forward(&samples, jerk, dt_s, |k, _, _| variances[k]);
        let smoothed = backward(&steps, dt_s);
        for (k, at) in smoothed.iter().enumerate() {
            let got = Vector3::new(at.value, at.rate, at.acceleration);
            let gap = amax(&(got - expected.fixed_rows::<3>(3 * k)));
            assert!(gap < 1e-9, "gap {gap:e} at step {k}");
        }
        assert_eq!(filtered.last(), smoothed.last());
    }
}
