//! Time over size: the controller over its horizon, the estimator over its window, the identification
//! over its data.
//!
//! Owns the sizes and the fit: the exponent is the gradient of the line of least squares through the
//! logarithms, 1 where twice the size takes twice the time.

use std::fmt::Write as _;

use anyhow::Result;

use super::comparison::{quantile, sorted};
use super::{Bench, Findings, ident, mhe, mpc};

/// Horizons of the controller. steps
const HORIZONS: [usize; 5] = [13, 25, 50, 100, 200];

/// Windows of the estimator, up to the longest that its settings allow. steps
const WINDOWS: [usize; 5] = [15, 30, 60, 120, 200];

/// Largest exponent that was aimed at.
const GOAL: f64 = 1.1;

/// Threads of the identification.
const THREADS: usize = 1;

/// The times over all sizes, and their exponents.
///
/// # Errors
/// A solve that fails, missing data.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let least = |mut pass: Box<dyn FnMut() -> Result<Vec<f64>> + '_>| -> Result<f64> {
        let mut medians = Vec::new();
        for _ in 0..bench.repetitions {
            medians.push(quantile(&sorted(pass()?), 0.5));
        }
        Ok(quantile(&sorted(medians), 0.0))
    };
    let mut horizon_us = Vec::new();
    for steps in HORIZONS {
        horizon_us.push(least(Box::new(mpc::square_us(steps)?))?);
    }
    let flight = mhe::flight(bench)?;
    let mut window_us = Vec::new();
    for steps in WINDOWS {
        window_us.push(least(Box::new(|| mhe::flight_us(&flight, steps)))?);
    }
    let (data_steps, data_us) = identification(bench)?;
    let [horizons, windows] =
        [HORIZONS, WINDOWS].map(|sizes| sizes.map(|steps| steps as f64).to_vec());
    let parts = [
        ("MPC over the horizon", "least median", horizons, horizon_us),
        ("MHE over the window", "least median", windows, window_us),
        ("identification over its data", "median", data_steps, data_us),
    ];
    let mut table =
        "| | sizes, steps | times, us | of passes | exponent |\n|---|---|---|---|---|\n".to_owned();
    let mut raw = String::new();
    for (name, statistic, sizes, us) in &parts {
        let exponent = exponent(sizes, us);
        let verdict = if exponent <= GOAL { "met" } else { "**missed**" };
        let [listed, times] = [sizes.as_slice(), us].map(|values| {
            values.iter().map(|value| format!("{value:.1}")).collect::<Vec<_>>().join(" / ")
        });
        writeln!(
            table,
            "| {name} | {listed} | {times} | {statistic} | {exponent:.3} (goal {GOAL} {verdict}) |"
        )?;
        for (steps, us) in sizes.iter().zip(us) {
            writeln!(raw, "\"{name}\",\"{steps} steps\",{statistic},,{us:.3},,")?;
        }
    }
    Ok(Findings { table, raw })
}

/// Steps of the data and the time of the whole program over them. us
fn identification(bench: &Bench) -> Result<(Vec<f64>, Vec<f64>)> {
    let ours = ident::Ours::build(bench, ident::TOLERANCE_LEAST)?;
    let mut curve = (Vec::new(), Vec::new());
    for times in ident::SIZES {
        let pieces = ident::Pieces::copied(bench, times)?;
        let runs: Result<Vec<ident::Run>> =
            (0..bench.repetitions).map(|_| ours.run(&pieces, THREADS)).collect();
        let runs = runs?;
        curve.0.extend(runs.first().map(|run| run.steps as f64));
        curve.1.push(quantile(&sorted(runs.iter().map(|run| run.seconds * 1e6)), 0.5));
    }
    Ok(curve)
}

/// Rate (exponent) of the logarithms of `values` over those of `sizes`.
fn exponent(sizes: &[f64], values: &[f64]) -> f64 {
    let logs: Vec<_> = sizes.iter().zip(values).map(|(x, y)| (x.ln(), y.ln())).collect();
    let count = logs.len() as f64;
    let mean_x = logs.iter().map(|(x, _)| x).sum::<f64>() / count;
    let mean_y = logs.iter().map(|(_, y)| y).sum::<f64>() / count;
    let both = logs.iter().map(|(x, y)| (x - mean_x) * (y - mean_y)).sum::<f64>();
    both / logs.iter().map(|(x, _)| (x - mean_x).powi(2)).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::exponent;

    #[test]
    fn the_exponent_is_that_of_the_power() {
        let sizes = [1.0, 2.0, 5.0, 40.0];
        for power in [0.0, 1.0, 2.5] {
            let values = sizes.map(|size: f64| 3.0 * size.powf(power));
            let found = exponent(&sizes, &values);
            assert!((found - power).abs() < 1e-12, "{found} instead of {power}");
        }
    }
}
