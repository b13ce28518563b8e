//! Whether a flight would take what was identified: no parameter file is written that it refuses.

use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use horizon_estim::NORMAL_HALF_WIDTH;
use horizon_model::rows::stick;
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, ModelKind};
use tello_io::config;

use super::fit::Contradiction;
use super::job::Job;
use super::report::{DelayMinimum, FitReport, ParameterRow};
use super::warnings::{EXCITATION_MIN, is_set_by_prior};
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

/// Root mean square below which a stick rested: what its axis did is noise. 1
const REST_MAX: f64 = 0.1 * EXCITATION_MIN;

/// The values of a parameter file: the estimates, but the prior where every stick of the axis rested (`input_rms`) or
/// the logs add little to it (`prior_std`), and the nearest bound of the flight's estimator where that lies within the
/// 95 % interval, which the logs then do not exclude. Reports of which that is so.
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
            // That its sticks rested is a note of its own.
            if !has_rested(row.name, input_rms) {
                notes.push(format!(
                    "{} is {value} in the parameter file, its prior: move the sticks that show it more; if they were \
                     moved, the vehicle did not answer them, or the other way round",
                    row.name
                ));
            }
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

/// Whether every stick that shows the parameter of `row` rested, or the logs add little to its prior.
fn is_unknown(row: &ParameterRow, input_rms: &[f64], prior_std: f64) -> bool {
    has_rested(row.name, input_rms)
        || row.std_laplace.is_nan()
        || is_set_by_prior(row.std_laplace, prior_std)
}

/// Whether every stick that shows the parameter `name` rested.
pub(super) fn has_rested(name: &str, input_rms: &[f64]) -> bool {
    sticks_of(name).iter().all(|stick| input_rms.get(*stick).is_some_and(|rms| *rms < REST_MAX))
}

/// The sticks that show a parameter, by the axis that its name ends with.
pub(super) fn sticks_of(name: &str) -> &'static [usize] {
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

/// One in so many steps must be used: what remains after outages is else no flight, but chance.
const USED_PARTS_MIN: usize = 3;

/// Why a drone seems not to follow its sticks.
const UNFOLLOWED: &str = "the link was bad, the vehicle was carried or is unlike `lost_commands` (null in the settings \
                          takes every step), the object is turned (--turn), or the clocks of sticks and poses drift \
                          apart";

/// Mistakes in logs that look like an unlikely parameter.
const MISTAKES: &str = "; or the units (m, rad), axes, sticks or period of the logs are others, or the sticks are \
                        shifted in time or exchanged";

/// Refuses the `file` of `fit` if the logs do not determine it, or if the job names a flight that would not take it.
///
/// # Errors
/// The reason.
pub(super) fn accept(
    job: &Job<'_>,
    fit: &FitReport,
    contradictions: &[Contradiction],
    file: &ParameterFile,
) -> Result<()> {
    check_steps(job, fit)?;
    if let Some(contradiction) = contradictions.iter().find(|found| found.is_refused()) {
        bail!("{}", contradiction.sentence());
    }
    check_ends(job, fit, file)?;
    let Some(flight) = job.flight else { return Ok(()) };
    file.check()?;
    let mut flight = flight.clone();
    let mhe = &flight.cycle.mhe;
    let beyond =
        fit.parameters.iter().zip(mhe.p_lb.iter().zip(&mhe.p_ub)).find(|(row, (lo, hi))| {
            let entry = file.parameters.get(row.name).filter(|_| row.name == THETA_0);
            entry.is_some_and(|entry| entry.value < **lo || entry.value > **hi)
        });
    if let Some((ParameterRow { value, .. }, _)) = beyond {
        let advice = turn_advice(job, *value, "");
        bail!("{THETA_0} = {value:.4} is beyond cycle.mhe.p_lb or p_ub: {advice}");
    }
    flight.cycle.take(file).map_err(|error| anyhow!("{error:#}{MISTAKES}"))?;
    cycle::build(&flight).map(drop)?;
    Ok(())
}

/// Refuses a fit to a small part of the logs.
fn check_steps(job: &Job<'_>, fit: &FitReport) -> Result<()> {
    let lengths = job.logs.iter().map(|log| log.recording.o.len());
    let steps: usize = lengths.clone().sum();
    ensure!(
        2 * fit.steps_lost <= steps,
        "in {} of {steps} steps the drone did not follow its sticks, what is left shows little of it: \
         {UNFOLLOWED}{MISTAKES}",
        fit.steps_lost
    );
    let steps: usize = lengths.filter(|length| *length >= job.table.piece_steps_min).sum();
    ensure!(
        USED_PARTS_MIN * fit.steps >= steps,
        "only {} of {steps} steps can be used, the others are outages or pieces between them that are too short \
         (piece_steps_min): {UNFOLLOWED}{MISTAKES}",
        fit.steps
    );
    Ok(())
}

/// Refuses a dead time or a parameter at the end of its range.
fn check_ends(job: &Job<'_>, fit: &FitReport, file: &ParameterFile) -> Result<()> {
    if let Some(row) = fit.delay.iter().find(|row| row.verdict == DelayMinimum::EndOfRange) {
        bail!(
            "the dead time of {} is not the {} s that it was kept at, but at the end of the searched range or beyond \
             (delay.dead_time_max_s): the sticks are early against the poses, or the model is another",
            row.sticks,
            row.dead_time_s
        );
    }
    let undetermined = fit.parameters.iter().find(|row| {
        let entry = file.parameters.get(row.name);
        let is_written = entry.is_some_and(|entry| entry.value.total_cmp(&row.value).is_eq());
        // A dead zone of 0 is a vehicle without one.
        let is_none = row.name.starts_with("dead_") && row.value <= 0.0;
        row.is_at_bound && is_written && !is_none
    });
    match undetermined {
        Some(ParameterRow { name: THETA_0, value, .. }) => bail!(
            "{THETA_0} = {value:.4} lies at its bound (map.p_lb, map.p_ub): {}",
            turn_advice(job, *value, " or more")
        ),
        Some(ParameterRow { name, value, .. }) => bail!(
            "{name} = {value:.4} lies at its bound (map.p_lb, map.p_ub): the logs do not determine it{MISTAKES}"
        ),
        None => Ok(()),
    }
}

const THETA_0: &str = "theta_0";

/// What to do about an object that is turned so far, `or_more`.
fn turn_advice(job: &Job<'_>, theta_0_rad: f64, or_more: &str) -> String {
    let turn_rad = job.table.turn_rad + theta_0_rad;
    format!(
        "the object is turned against the drone by {turn_rad:.2} rad{or_more}; align it in the motion capture before it \
         flies, and read these logs with the whole turn (--turn, turn_rad), which leaves {THETA_0} near 0"
    )
}

#[cfg(test)]
mod tests;
