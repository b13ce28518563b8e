//! The figures of an identification, each as SVG and PNG.

use std::path::{Path, PathBuf};

use super::report::{DelayMinimum, ParameterRow};
use crate::figure::{
    self, BootstrapRow, DelayCurve, FitRow, ForecastLine, ForecastPanel, ResidualRow, ShiftRow,
};
use anyhow::Result;
use horizon_model::rows::{Pose, Sticks, gain, pose, stick};
use horizon_model::{Kinematic, Model, Row};

use super::compare::{Comparison, HORIZONS_S};
use super::job::{FitResult, Job, Resampled, Trace};

/// Longest part of a log in the figure of the fit and of the shift; more is a black bar. s
const SHOWN_S: f64 = 60.0;

/// Lags of the autocorrelation. steps
const LAGS: usize = 50;

pub(super) fn save(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<()> {
    save_fit(dir, job, result)?;
    save_shift(dir, job, result)?;
    save_residuals(dir, job, result)?;
    if !result.delay.is_empty() {
        let curves: Vec<DelayCurve<'_>> = result
            .delay
            .iter()
            .map(|curve| DelayCurve {
                name: &curve.row.sticks,
                dead_time_s: &curve.dead_time_s,
                cost: &curve.cost,
                minimum_s: if matches!(
                    curve.row.verdict,
                    DelayMinimum::Minimum | DelayMinimum::Zero
                ) {
                    curve.row.dead_time_s
                } else {
                    f64::NAN
                },
                interval_s: [curve.row.lower_s, curve.row.upper_s]
                    .map(|end| end.unwrap_or(f64::NAN)),
            })
            .collect();
        figure::save(dir, "delay", &figure::delay_profile("Likelihood of the dead time", &curves))?;
    }
    save_bootstrap(dir, result)
}

/// Thesis figure 5.2, of the log with the most estimates.
fn save_fit(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<()> {
    let Some((log, traces)) = longest(result) else { return Ok(()) };
    let dt_s = job.table.dt_s;
    let first = traces.first().map_or(0, |trace| trace.steps.start);
    let shown = steps_shown(dt_s);
    let recording = &job.logs[log].recording;
    let end = recording.o.len().min(first + shown);
    let time_s: Vec<f64> = (first..end).map(|k| k as f64 * dt_s).collect();
    let pieces: Vec<_> = traces
        .iter()
        .filter(|trace| trace.steps.start < end)
        .map(|trace| trace.steps.start - first..trace.steps.end.min(end) - first)
        .collect();
    let column = |pick: fn(&Trace) -> &Vec<Vec<f64>>, row: usize| {
        let mut values = vec![f64::NAN; end - first];
        for trace in &traces {
            for (k, s) in trace.steps.clone().zip(&pick(trace)[row]) {
                if k < end {
                    values[k - first] = *s;
                }
            }
        }
        values
    };
    let seen = |k: usize, row: usize| {
        let o = &recording.o[k];
        if o.is_present[row] { o.o[row] } else { f64::NAN }
    };
    let curves = |(row, of): (usize, &Row)| FitRow {
        row: *of,
        observed: (first..end).map(|k| seen(k, row)).collect(),
        estimated: column(|trace| &trace.s, row),
        simulated: column(|trace| &trace.simulated, row),
    };
    let rows: Vec<FitRow> = result.observation_rows.iter().enumerate().map(curves).collect();
    // The rest of a long log is not drawn.
    let part = if end < recording.o.len() {
        format!(", {:.0} s of {:.0} s", time_s.len() as f64 * dt_s, recording.o.len() as f64 * dt_s)
    } else {
        String::new()
    };
    let name = file_name(&job.logs[log].path);
    let title = format!("{} fitted to {name}{part}", result.fit.model);
    figure::save(dir, "fit", &figure::fit(&title, &time_s, &pieces, &rows))?;
    Ok(())
}

/// Thesis figure 5.1: changes of the pose beside the cumulative input (its equation 5.1), scaled.
fn save_shift(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<()> {
    let Some((log, _)) = longest(result) else { return Ok(()) };
    let (dt_s, recording) = (job.table.dt_s, &job.logs[log].recording);
    let end = recording.o.len().min(steps_shown(dt_s));
    let gains = result.fit.parameters.iter().map(|row| row.value);
    let p = nalgebra::SVector::from_iterator(gains.take(gain::COUNT));
    let Some(start) = recording.o.iter().position(|o| o.is_present.iter().all(|seen| *seen)) else {
        return Ok(());
    };
    // The measured heading turns the sticks, as in the thesis.
    let cumulative = |u: &[Sticks]| {
        let mut s = recording.o[start].o;
        let mut theta = s[pose::THETA];
        let origin = s;
        let mut sums = Vec::with_capacity(end);
        for (k, u) in u.iter().enumerate().take(end) {
            let o = &recording.o[k];
            if o.is_present[pose::THETA] {
                theta = o.o[pose::THETA];
            }
            let turn = s[pose::THETA];
            s[pose::THETA] = theta;
            let moved = Kinematic.step(&s, u, &p, dt_s) - s;
            s[pose::THETA] = turn;
            sums.push(s - origin);
            s += moved;
        }
        sums
    };
    let dead_time_s = Sticks::from_column_slice(&result.fit.dead_time_s);
    let sent = cumulative(&recording.u);
    let applied = cumulative(&recording.applied(&dead_time_s, dt_s));
    let time_s: Vec<f64> = (0..end).map(|k| k as f64 * dt_s).collect();
    let curves = |(row, stick): (usize, usize)| {
        let moved = recording.o.iter().take(end).map(|o| {
            if o.is_present[row] { o.o[row] - recording.o[start].o[row] } else { f64::NAN }
        });
        let moved: Vec<f64> = moved.collect();
        // As the thesis: scaled, since the delay is to be seen and not the gain.
        let scale = scale_between(applied.iter().map(|s| s[row]), &moved);
        let of = |sums: &[Pose]| sums.iter().map(|s| scale * s[row]).collect();
        let (cumulative, shifted) = (of(&sent), of(&applied));
        let row = Kinematic::STATE[row];
        ShiftRow { row, moved, cumulative, shifted, dead_time_s: dead_time_s[stick] }
    };
    let stick_of = [stick::PITCH, stick::PITCH, stick::THROTTLE, stick::YAW];
    let rows: Vec<ShiftRow> = stick_of.into_iter().enumerate().map(curves).collect();
    let title = format!("Delay in {}", file_name(&job.logs[log].path));
    figure::save(dir, "delay_shift", &figure::delay_shift(&title, &time_s, &rows))?;
    Ok(())
}

/// Figures of the residuals of observations and transitions.
fn save_residuals(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<()> {
    type Pick = fn(&Trace) -> &Vec<Vec<f64>>;
    let kinds: [(&str, &[Row], Pick); 2] = [
        ("observations", result.observation_rows, |trace| &trace.observation_residuals),
        ("transitions", result.state_rows, |trace| &trace.transition_residuals),
    ];
    for (kind, names, residuals) in kinds {
        let of = |(row, named): (usize, &Row)| ResidualRow {
            // Weighted residuals have no unit.
            row: Row::linear(named.name, "1"),
            pieces: result.traces.iter().map(|trace| &*residuals(trace)[row]).collect(),
        };
        let rows: Vec<ResidualRow<'_>> = names.iter().enumerate().map(of).collect();
        let title = format!("Weighted residuals of the {kind}");
        let picture = figure::residuals(&title, job.table.dt_s, LAGS, &rows);
        figure::save(dir, &format!("residuals_{kind}"), &picture)?;
    }
    Ok(())
}

/// Thesis figure 5.3.
fn save_bootstrap(dir: &Path, result: &FitResult) -> Result<()> {
    let Some(Resampled { estimates, .. }) = &result.resamples else { return Ok(()) };
    let of = |(k, row): (usize, &ParameterRow)| BootstrapRow {
        row: Row::linear(row.name, row.unit),
        estimate: row.value,
        samples: estimates.iter().map(|p| p[k]).collect(),
        laplace_std: Some(row.std_laplace),
    };
    let rows: Vec<BootstrapRow> = result.fit.parameters.iter().enumerate().map(of).collect();
    let title = format!("{} resamples of the pieces", estimates.len());
    figure::save(dir, "bootstrap", &figure::bootstrap(&title, &rows))?;
    Ok(())
}

/// Saves the figure of the prediction error over the horizon in `figures` of `out`, as SVG and PNG; returns the paths.
/// `dt_s` is the period of the comparison. s
///
/// # Errors
/// A file cannot be written.
pub fn save_prediction(out: &Path, comparison: &Comparison, dt_s: f64) -> Result<[PathBuf; 2]> {
    type Pick = fn(&crate::forecast::HorizonErrors) -> f64;
    let quantities: [(Row, Pick); 3] = [
        (Row::linear("x-y", "m"), |errors| errors.horizontal.rmse),
        (Row::linear("z", "m"), |errors| errors.vertical.rmse),
        (Row::linear("theta", "rad"), |errors| errors.heading.rmse),
    ];
    let panels = quantities.map(|(row, pick)| {
        let lines = comparison.models.iter().map(|model| {
            let points = model.smoothed.curve.iter();
            let points = points.map(|errors| (errors.steps as f64 * dt_s, pick(errors))).collect();
            ForecastLine { model: &model.name, points }
        });
        ForecastPanel { row, lines: lines.collect() }
    });
    let picture = figure::forecast("Prediction error, smoothed start", &HORIZONS_S, &panels);
    figure::save(&out.join("figures"), "prediction", &picture)
}

/// The log with the most estimated steps, and its pieces.
fn longest(result: &FitResult) -> Option<(usize, Vec<&Trace>)> {
    let logs = result.traces.iter().map(|trace| trace.log).max()? + 1;
    let of = |log: usize| -> Vec<&Trace> {
        result.traces.iter().filter(|trace| trace.log == log).collect()
    };
    let steps = |log: &usize| of(*log).iter().map(|trace| trace.steps.len()).sum::<usize>();
    // `max_by_key` takes the last of equals: reversed, the first.
    let log = (0..logs).rev().max_by_key(steps)?;
    Some((log, of(log)))
}

fn file_name(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Factor that brings `values` nearest to what is known of `goal`; 1 if they do not move.
fn scale_between(values: impl Iterator<Item = f64>, goal: &[f64]) -> f64 {
    let known = values.zip(goal).filter(|(_, goal)| goal.is_finite());
    let (product, square) =
        known.fold((0.0, 0.0), |(product, square), (v, goal)| (product + v * goal, square + v * v));
    if square > 0.0 { product / square } else { 1.0 }
}

fn steps_shown(dt_s: f64) -> usize {
    horizon_model::whole(SHOWN_S / dt_s)
}

#[cfg(test)]
mod tests;
