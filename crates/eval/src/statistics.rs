//! Quantiles, and intervals of what many flights have in common.

use horizon_estim::{NORMAL_HALF_WIDTH, multiplicities};

/// Resamples of the bootstrap.
const RESAMPLES: u64 = 2000;

/// How differences are summed up.
#[derive(Debug, Clone, Copy)]
pub enum Centre {
    /// By the middle one.
    Median,
    /// By their mean.
    Mean,
}

/// The `fraction` quantile of `values`, in their unit, linear between order statistics; `None` without values.
pub fn quantile(values: &[f64], fraction: f64) -> Option<f64> {
    quantiles(values, [fraction]).map(|[quantile]| quantile)
}

/// Several quantiles of the same values, in their unit, at `fractions` in 0..=1; `None` without values.
pub fn quantiles<const N: usize>(values: &[f64], fractions: [f64; N]) -> Option<[f64; N]> {
    if values.is_empty() {
        return None;
    }
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    Some(fractions.map(|fraction| quantile_of_sorted(&sorted, fraction)))
}

/// Linear between order statistics.
fn quantile_of_sorted(sorted: &[f64], fraction: f64) -> f64 {
    let place = fraction.clamp(0.0, 1.0) * (sorted.len() - 1) as f64;
    let below = horizon_model::whole(place);
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}

impl Centre {
    /// The centre of `values`, in their unit; `None` without any.
    pub fn of(self, values: &[f64]) -> Option<f64> {
        match self {
            Self::Median => quantile(values, 0.5),
            Self::Mean if values.is_empty() => None,
            Self::Mean => Some(values.iter().sum::<f64>() / values.len() as f64),
        }
    }
}

/// 95 % of the centres of resampled `differences` lie between the two, in their unit; `None` without any.
///
/// Cost: 2000 resamples of all differences, sorted for a median.
pub fn interval(differences: &[f64], centre: Centre, seed: u64) -> Option<[f64; 2]> {
    let mut sample = Vec::with_capacity(differences.len());
    let mut centres = Vec::new();
    for resample in 0..RESAMPLES {
        sample.clear();
        for (value, times) in
            differences.iter().zip(multiplicities(seed, resample, differences.len()))
        {
            sample.extend(std::iter::repeat_n(*value, times as usize));
        }
        centres.push(centre.of(&sample)?);
    }
    Some([quantile(&centres, 0.025)?, quantile(&centres, 0.975)?])
}

/// 95 % interval of a rate after `hits` of `trials`, by Wilson's score (1927); 0 to 1 without trials.
pub fn rate_interval(hits: usize, trials: usize) -> [f64; 2] {
    const Z: f64 = NORMAL_HALF_WIDTH;
    if trials == 0 {
        return [0.0, 1.0];
    }
    let (n, rate) = (trials as f64, hits as f64 / trials as f64);
    let centre = rate + Z * Z / (2.0 * n);
    let half = Z * (rate * (1.0 - rate) / n + Z * Z / (4.0 * n * n)).sqrt();
    [-1.0, 1.0].map(|sign| ((centre + sign * half) / (1.0 + Z * Z / n)).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let values = [4.0, 1.0, 3.0, 2.0];
        for (fraction, expected) in [(0.0, 1.0), (0.5, 2.5), (1.0, 4.0), (0.95, 3.85)] {
            let got = quantile(&values, fraction).unwrap();
            assert!((got - expected).abs() < 1e-12, "{fraction}: {got}");
        }
        assert_eq!(quantile(&[], 0.5), None);
    }

    #[test]
    fn the_interval_of_a_rate_is_wilsons() {
        let [low, high] = rate_interval(0, 0);
        assert!(low == 0.0 && high > 0.999);
        // Wilson (1927): no hit in n trials gives an upper end of z^2 / (n + z^2).
        let [low, high] = rate_interval(0, 100);
        assert!(low.abs() < 1e-12, "{low}");
        assert!((high - 3.841_458_82 / 103.841_458_82).abs() < 1e-8, "{high}");
        // The ends solve (p - k / n)^2 = z^2 p (1 - p) / n.
        for end in rate_interval(7, 50) {
            let misfit = (end - 0.14).powi(2) - 3.841_458_82 * end * (1.0 - end) / 50.0;
            assert!(misfit.abs() < 1e-9, "{end}: {misfit}");
        }
        assert!((rate_interval(50, 50)[1] - 1.0).abs() < 1e-12);
    }
}
