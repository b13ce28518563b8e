//! Whether a flight would take what was identified: no parameter file is written that it refuses.

use std::path::Path;

use anyhow::{Error, Result};
use horizon_estim::NORMAL_HALF_WIDTH;
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, ModelKind};
use tello_io::config;

use super::job::Job;
use super::report::{Fit, ParameterRow};
use crate::REVISION;
use crate::parameter_file::{
    DataFile, FORMAT, ParameterEntry, ParameterFile, TakesParameters as _,
};

/// The settings of the flight in `path`, or the built-in ones if they run `model`; `None` if they do not.
///
/// # Errors
/// As [`config::fly`].
pub fn flight_settings(model: ModelKind, path: Option<&Path>) -> Result<Option<FlightTable>> {
    let (table, mission) = config::fly(path, None)?;
    let runs_it = path.is_some() || table.cycle.model == model;
    Ok(runs_it.then(|| config::flight(&table, mission, Start::Grounded)))
}

/// The values of a parameter file: the estimates, but the nearest bound of the flight's estimator where that lies
/// within the 95 % interval, which the logs then do not exclude. Reports of which that is so.
pub(super) fn accepted_values(
    job: &Job<'_>,
    parameters: &[ParameterRow],
) -> (Vec<f64>, Vec<String>) {
    let flight = job.flight.filter(|flight| flight.cycle.model == job.table.model);
    let bounds = flight.map(|flight| (&flight.cycle.mhe.p_lb[..], &flight.cycle.mhe.p_ub[..]));
    let (p_lb, p_ub) = bounds.unwrap_or_default();
    let mut notes = Vec::new();
    let values = parameters.iter().enumerate().map(|(i, row)| {
        let bounds = p_lb.get(i).zip(p_ub.get(i));
        let value = bounds.map_or(row.value, |(lo, hi)| nearest_bound(row, *lo, *hi));
        if value.total_cmp(&row.value).is_ne() {
            notes.push(format!(
                "{} is {value} in the parameter file, the bound of the flight's estimator: these logs \
                 do not exclude it",
                row.name
            ));
        }
        value
    });
    (values.collect(), notes)
}

/// The value of `row`, or the nearest of its bounds if that lies within its 95 % interval, by the resamples or by the
/// Laplace approximation: the resamples of a few pieces may have no width at all.
fn nearest_bound(row: &ParameterRow, lo: f64, hi: f64) -> f64 {
    // Like clamp, but without a panic for bounds that are none.
    let bound = row.value.max(lo).min(hi);
    let half = NORMAL_HALF_WIDTH * row.std_laplace;
    let is_near = (bound - row.value).abs() <= half;
    if is_near || (row.lower..=row.upper).contains(&bound) { bound } else { row.value }
}

/// The parameter file of a fit with these `values`.
///
/// # Errors
/// The settings cannot be written as JSON.
pub(super) fn parameter_file(job: &Job<'_>, fit: &Fit, values: &[f64]) -> Result<ParameterFile> {
    let known = |value: f64| value.is_finite().then_some(value);
    let entries = fit.parameters.iter().zip(values).map(|(row, value)| {
        let entry = ParameterEntry {
            value: *value,
            std: known(row.std),
            lower: known(row.lower),
            upper: known(row.upper),
            unit: row.unit.to_owned(),
        };
        (row.name.to_owned(), entry)
    });
    let data = job.logs.iter().map(|log| DataFile {
        path: log.path.clone(),
        sha256: log.sha256.clone(),
        steps: log.recording.o.len(),
    });
    Ok(ParameterFile {
        format: FORMAT,
        model: job.table.model,
        parameters: entries.collect(),
        dead_time_s: fit.dead_time_s.clone(),
        data: data.collect(),
        settings: serde_json::to_value(job.table)?,
        covariance: fit.covariance.clone(),
        flown: None,
        revision: REVISION.to_owned(),
    })
}

/// Why the flight of the job would refuse `file`; `None` if it takes it, or if the job names no flight.
pub(super) fn refusal(job: &Job<'_>, file: &ParameterFile) -> Option<Error> {
    let is_taken = |flight: &FlightTable| {
        file.check()?;
        let mut flight = flight.clone();
        flight.cycle.take(file)?;
        cycle::build(&flight).map(drop)?;
        anyhow::Ok(())
    };
    job.flight.and_then(|flight| is_taken(flight).err())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bound_is_taken_that_the_interval_holds() {
        let row = |value: f64, half: f64| ParameterRow {
            name: "tau_a",
            unit: "s",
            value,
            std: half / 2.0,
            std_laplace: half / 2.0,
            lower: value - half,
            upper: value + half,
            is_at_bound: false,
        };
        for (value, half, expected) in [
            (0.03, 0.1, 0.05),
            (0.03, 0.01, 0.03),
            (0.5, 0.2, 0.4),
            (0.5, 0.05, 0.5),
            (0.2, 0.5, 0.2),
            (0.03, f64::INFINITY, 0.05),
        ] {
            let got = nearest_bound(&row(value, half), 0.05, 0.4);
            assert!((got - expected).abs() < 1e-15, "{value} +- {half}: {got}");
        }
        assert!(nearest_bound(&row(f64::NAN, 0.1), 0.05, 0.4).is_nan());
        // One piece is resampled to itself: an interval without width, beside the one of its curvature.
        let resampled = |std_laplace: f64| ParameterRow { std_laplace, ..row(0.03, 0.0) };
        for (std_laplace, expected) in [(0.18, 0.05), (0.005, 0.03), (f64::NAN, 0.03)] {
            let got = nearest_bound(&resampled(std_laplace), 0.05, 0.4);
            assert!((got - expected).abs() < 1e-15, "{std_laplace}: {got}");
        }
    }
}
