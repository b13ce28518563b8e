//! Whether a flight would take what was identified: no parameter file is written that it refuses.

use std::path::Path;

use anyhow::{Result, anyhow, bail, ensure};
use horizon_estim::NORMAL_HALF_WIDTH;
use horizon_model::rows::stick;
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, ModelKind};
use tello_io::config;

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
            notes.push(format!(
                "{} is {value} in the parameter file, its prior: move the sticks that show it more",
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

/// Whether every stick that shows the parameter of `row` rested, or the logs add little to its prior.
fn is_unknown(row: &ParameterRow, input_rms: &[f64], prior_std: f64) -> bool {
    let has_rested = sticks_of(row.name).iter().all(|stick| input_rms[*stick] < REST_MAX);
    has_rested || row.std_laplace.is_nan() || is_set_by_prior(row.std_laplace, prior_std)
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

/// One in so many steps must be used: what remains after outages is else no flight, but chance.
const USED_PARTS_MIN: usize = 3;

/// Mistakes in logs that look like an unlikely parameter.
const MISTAKES: &str = "; or the units (m, rad), axes, sticks or period of the logs are others, or the sticks are \
                        shifted in time or exchanged";

/// Refuses the `file` of `fit` if the logs do not determine it, or if the job names a flight that would not take it.
///
/// # Errors
/// The reason.
pub(super) fn accept(job: &Job<'_>, fit: &FitReport, file: &ParameterFile) -> Result<()> {
    let lengths = job.logs.iter().map(|log| log.recording.o.len());
    let steps: usize = lengths.clone().sum();
    ensure!(
        2 * fit.steps_lost <= steps,
        "in {} of {steps} steps the drone did not follow its sticks: what is left shows little of it; are axes \
         exchanged, is the object turned (--turn), or the link bad?",
        fit.steps_lost
    );
    let steps: usize = lengths.filter(|length| *length >= job.table.piece_steps_min).sum();
    ensure!(
        USED_PARTS_MIN * fit.steps >= steps,
        "only {} of {steps} steps can be used, the others are outages or pieces between them that are too short \
         (piece_steps_min): are axes exchanged, or the link bad?",
        fit.steps
    );
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
    if let Some(ParameterRow { name, value, .. }) = undetermined {
        bail!(
            "{name} = {value} lies at its bound (map.p_lb, map.p_ub): the logs do not determine it{MISTAKES}"
        );
    }
    let Some(flight) = job.flight else { return Ok(()) };
    file.check()?;
    let mut flight = flight.clone();
    flight.cycle.take(file).map_err(|error| anyhow!("{error:#}{MISTAKES}"))?;
    cycle::build(&flight).map(drop)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use horizon_estim::{Observed, Recording};
    use horizon_model::rows::Sticks;

    use super::super::report::DelayRow;
    use super::*;
    use crate::recordings::Loaded;

    /// Why a fit to one log of 900 steps is refused that is in order but for `change`.
    fn refusal(change: impl Fn(&mut FitReport)) -> String {
        let recording =
            Recording { u: vec![Sticks::zeros(); 900], o: vec![Observed::missing(); 900] };
        let logs = [Loaded {
            path: "a".into(),
            sha256: String::new(),
            is_simulated: false,
            recording,
            skipped: vec![],
            motions: BTreeSet::new(),
        }];
        let job = Job {
            name: "ident.json",
            table: &crate::ident::settings(None).unwrap(),
            logs: &logs,
            bootstrap: None,
            flight: None,
            observer: &(),
            keeps_estimates: false,
        };
        let mut fit = crate::ident::report::tests::fit();
        change(&mut fit);
        let values = [Accepted { value: fit.parameters[0].value, is_prior: false }];
        let file = parameter_file(&job, &fit, &values).unwrap();
        accept(&job, &fit, &file).err().map_or_else(String::new, |why| why.to_string())
    }

    #[test]
    fn a_fit_to_little_of_a_log_or_with_a_dead_time_out_of_range_is_refused() {
        let delay = |verdict| DelayRow {
            sticks: "yaw".to_owned(),
            dead_time_s: 0.04,
            verdict,
            std_s: None,
            lower_s: None,
            upper_s: None,
        };
        assert_eq!(refusal(|fit| fit.steps = 300), "");
        let why = refusal(|fit| (fit.steps, fit.steps_lost) = (299, 400));
        assert!(why.starts_with("only 299 of 900 steps can be used"), "{why}");
        let why = refusal(|fit| fit.steps_lost = 451);
        assert!(why.starts_with("in 451 of 900 steps"), "{why}");
        for verdict in [DelayMinimum::Minimum, DelayMinimum::Zero, DelayMinimum::Undecided] {
            assert_eq!(refusal(|fit| fit.delay = vec![delay(verdict)]), "", "{verdict:?}");
        }
        let why = refusal(|fit| fit.delay = vec![delay(DelayMinimum::EndOfRange)]);
        assert!(why.starts_with("the dead time of yaw is not the 0.04 s"), "{why}");
        let why = refusal(|fit| fit.parameters[0].is_at_bound = true);
        assert!(why.contains("units") && why.contains("shifted in time or exchanged"), "{why}");
    }

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
    fn a_prior_is_kept_where_sticks_rested_or_the_logs_add_little() {
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
        for (std_laplace, throttle, expected) in [
            (0.3, 0.04, true),
            (f64::NAN, 0.04, true),
            (0.1, 0.04, false),
            (0.1, 0.004, true),
            (0.3, 0.2, true),
            (0.1, 0.2, false),
        ] {
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
