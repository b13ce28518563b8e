//! The likelihood of a sample whose noise has heavy tails (Huber, *Robust estimation of a location parameter*, 1964).

/// Error, in standard deviations, from which on a sample counts linearly. 1
const HUBER: f64 = 2.0;
/// Error, in standard deviations, beyond which a sample is left out: a heading that is wrong may be so by any angle. 1
const CAP: f64 = 6.0;

/// Log likelihood of `error` with `variance`, up to a constant, and the weight of the sample (Huber).
pub(super) fn huber(error: f64, variance: f64) -> (f64, f64) {
    let deviations = error.abs() / variance.sqrt();
    (log_likelihood(deviations, variance), (HUBER / deviations).min(1.0))
}

/// Log likelihood and weight as by [`huber`], for samples with outliers of any size, which have no weight and all the
/// same likelihood.
pub(super) fn capped(error: f64, variance: f64) -> (f64, f64) {
    let deviations = error.abs() / variance.sqrt();
    let weight = if deviations > CAP { 0.0 } else { (HUBER / deviations).min(1.0) };
    (log_likelihood(deviations.min(CAP), variance), weight)
}

fn log_likelihood(deviations: f64, variance: f64) -> f64 {
    let rho = deviations.min(HUBER) * (2.0 * deviations - deviations.min(HUBER));
    -0.5 * (rho + variance.ln())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_counts_squared_then_linearly_then_no_more() {
        let cost = |error: f64| -huber(error, 4.0).0 - 0.5 * 4.0_f64.ln();
        let capped_cost = |error: f64| -capped(error, 4.0).0 - 0.5 * 4.0_f64.ln();
        // 1, 2, 4, 6 and 50 standard deviations.
        for (error, expected, expected_capped, weight_capped) in [
            (2.0, 0.5, 0.5, 1.0),
            (-4.0, 2.0, 2.0, 1.0),
            (8.0, 6.0, 6.0, 0.5),
            (12.0, 10.0, 10.0, 1.0 / 3.0),
            (100.0, 98.0, 10.0, 0.0),
        ] {
            assert!((cost(error) - expected).abs() < 1e-12, "{error}");
            assert!((capped_cost(error) - expected_capped).abs() < 1e-12, "{error}");
            let weight = (4.0 / error.abs()).min(1.0);
            assert!((huber(error, 4.0).1 - weight).abs() < 1e-12, "{error}");
            assert!((capped(error, 4.0).1 - weight_capped).abs() < 1e-12, "{error}");
        }
    }
}
