//! Whether a flight would take what was identified: no parameter file is written that it refuses.

use std::path::Path;

use anyhow::{Result, bail, ensure};
use horizon_estim::NORMAL_HALF_WIDTH;
use horizon_model::rows::stick;
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, ModelKind};
use tello_io::config;

use super::job::Job;
use super::report::{FitReport, ParameterRow};
use super::verdict::{EXCITATION_MIN, is_set_by_prior};
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

/// A value of a parameter file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Accepted {
    /// In the unit of the row.
    value: f64,
    /// Whether the number is the prior, which has no deviation by these logs.
    is_prior: bool,
}

/// The values of a parameter file: the estimates, but the prior where no stick of the axis was moved much
/// (`input_rms`) and the logs show less than it (`prior_std`), and the nearest bound of the flight's estimator where
/// that lies within the 95 % interval, which the logs then do not exclude. Reports of which that is so.
pub(super) fn accepted_values(
    job: &Job<'_>,
    parameters: &[ParameterRow],
    input_rms: &[f64],
    prior_std: &[f64],
) -> (Vec<Accepted>, Vec<String>) {
    let flight = job.flight.filter(|flight| flight.cycle.model == job.table.model);
    let bounds = flight.map(|flight| (&flight.cycle.mhe.p_lb[..], &flight.cycle.mhe.p_ub[..]));
    let (p_lb, p_ub) = bounds.unwrap_or_default();
    let mut notes = Vec::new();
    let values = parameters.iter().enumerate().map(|(i, row)| {
        let bounds = p_lb.get(i).zip(p_ub.get(i));
        if is_unknown(row, input_rms, prior_std[i]) {
            let prior = job.table.map.p_prior[i];
            let value = bounds.map_or(prior, |(lo, hi)| within(prior, *lo, *hi));
            notes.push(format!(
                "{} is {value} in the parameter file, its prior: no stick that shows it was moved much",
                row.name
            ));
            return Accepted { value, is_prior: true };
        }
        let value = bounds.map_or(row.value, |(lo, hi)| nearest_bound(row, *lo, *hi));
        if value.total_cmp(&row.value).is_ne() {
            notes.push(format!(
                "{} is {value} in the parameter file, the bound of the flight's estimator: these logs \
                 do not exclude it",
                row.name
            ));
        }
        Accepted { value, is_prior: false }
    });
    (values.collect(), notes)
}

/// Whether no stick that shows the parameter of `row` was moved much, and the logs show less of it than its prior.
fn is_unknown(row: &ParameterRow, input_rms: &[f64], prior_std: f64) -> bool {
    let is_still = sticks_of(row.name).iter().all(|stick| input_rms[*stick] < EXCITATION_MIN);
    is_still && (row.std_laplace.is_nan() || is_set_by_prior(row.std_laplace, prior_std))
}

/// The sticks that show a parameter, by the axis that its name ends with.
fn sticks_of(name: &str) -> &'static [usize] {
    match name.rsplit_once('_') {
        Some((_, "v")) => &[stick::THROTTLE],
        Some((_, "a")) => &[stick::YAW],
        _ => &[stick::ROLL, stick::PITCH],
    }
}

/// The value of `row`, or the nearest of its bounds if that lies within its 95 % interval, by the resamples or by the
/// Laplace approximation: the resamples of a few pieces may have no width at all.
fn nearest_bound(row: &ParameterRow, lo: f64, hi: f64) -> f64 {
    let bound = within(row.value, lo, hi);
    let half = NORMAL_HALF_WIDTH * row.std_laplace;
    let is_near = (bound - row.value).abs() <= half;
    if is_near || (row.lower..=row.upper).contains(&bound) { bound } else { row.value }
}

/// Like clamp, but without a panic for bounds that are none.
fn within(value: f64, lo: f64, hi: f64) -> f64 {
    value.max(lo).min(hi)
}

/// The parameter file of a fit with these `values`.
///
/// # Errors
/// The settings cannot be written as JSON.
pub(super) fn parameter_file(
    job: &Job<'_>,
    fit: &FitReport,
    values: &[Accepted],
) -> Result<ParameterFile> {
    let entries = fit.parameters.iter().zip(values).map(|(row, Accepted { value, is_prior })| {
        let known = |value: f64| (value.is_finite() && !is_prior).then_some(value);
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
        is_simulated: log.is_simulated,
    });
    Ok(ParameterFile {
        format: FORMAT,
        model: job.table.model,
        parameters: entries.collect(),
        dead_time_s: fit.dead_time_s.clone(),
        data: data.collect(),
        settings: serde_json::to_value(job.table)?,
        covariance: fit.covariance.clone().filter(|_| !values.iter().any(|value| value.is_prior)),
        flown: None,
        revision: REVISION.to_owned(),
    })
}

/// Refuses the `file` of `fit` if the logs do not determine it, or if the job names a flight that would not take it.
///
/// # Errors
/// The reason.
pub(super) fn accept(job: &Job<'_>, fit: &FitReport, file: &ParameterFile) -> Result<()> {
    let steps: usize = job.logs.iter().map(|log| log.recording.o.len()).sum();
    ensure!(
        2 * fit.steps_lost <= steps,
        "in {} of {steps} steps the drone did not follow its sticks: what is left shows little of it; are axes \
         exchanged, is the object turned (--turn), or the link bad?",
        fit.steps_lost
    );
    let undetermined = fit.parameters.iter().find(|row| {
        let entry = file.parameters.get(row.name);
        let is_written = entry.is_some_and(|entry| entry.value.total_cmp(&row.value).is_eq());
        // A dead zone of 0 is a vehicle without one.
        let is_none = row.name.starts_with("dead_") && row.value <= 0.0;
        row.is_at_bound && is_written && !is_none
    });
    if let Some(ParameterRow { name, value, .. }) = undetermined {
        bail!(
            "{name} = {value} lies at its bound (map.p_lb, map.p_ub): the logs do not determine it"
        );
    }
    let Some(flight) = job.flight else { return Ok(()) };
    file.check()?;
    let mut flight = flight.clone();
    flight.cycle.take(file)?;
    cycle::build(&flight).map(drop)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_parameter_has_its_sticks() {
        use horizon_model::{Kinematic, Lagged, Model};
        let horizontal = [stick::ROLL, stick::PITCH];
        let of = |name: &str| match name {
            "lambda_v" | "tau_v" | "dead_v" => &[stick::THROTTLE][..],
            "lambda_a" | "tau_a" | "dead_a" => &[stick::YAW],
            _ => &horizontal,
        };
        for row in Kinematic::PARAMETER.iter().chain(&Lagged::PARAMETER) {
            assert_eq!(sticks_of(row.name), of(row.name), "{}", row.name);
        }
    }

    #[test]
    fn a_prior_is_kept_where_sticks_rested_and_the_logs_tell_less() {
        let row = |std_laplace: f64| ParameterRow {
            name: "tau_v",
            unit: "s",
            value: 0.7,
            std: std_laplace,
            std_laplace,
            lower: 0.5,
            upper: 0.9,
            is_at_bound: false,
        };
        let rms = |throttle: f64| {
            let mut rms = [0.3; stick::COUNT];
            rms[stick::THROTTLE] = throttle;
            rms
        };
        for (std_laplace, throttle, expected) in
            [(0.3, 0.04, true), (f64::NAN, 0.04, true), (0.1, 0.04, false), (0.3, 0.06, false)]
        {
            let got = is_unknown(&row(std_laplace), &rms(throttle), 0.4);
            assert_eq!(got, expected, "{std_laplace}, {throttle}");
        }
    }

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
