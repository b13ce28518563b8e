//! Files of an identification: parameters, report, estimates, figures.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use crate::REVISION;
use crate::recordings::Loaded;
use anyhow::{Context, Result};
use serde_json::Value;
use tello_flight::cycle::{RowsRecord, Topic};
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::log::{Channel, Head, LogWriter};
use tello_io::{atomic_file, config};

use super::job::{FitResult, Job, Resampled, Trace};
use super::pictures;

/// Writes everything to `dir`, which exists, and returns what a user would open; of a part of a bootstrap
/// its estimates alone.
///
/// # Errors
/// A file cannot be written; the error names it.
pub fn write(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<Vec<PathBuf>> {
    let mut written = Vec::new();
    if let (Some(Resampled { file, .. }), Some(plan)) = (&result.resamples, job.bootstrap) {
        written.push(file.save(dir, plan)?);
        if plan.part.is_some() {
            return Ok(written);
        }
    }
    let parameters = dir.join("parameters.json");
    match &result.parameter_file {
        Some(file) => {
            // What flights identified is nowhere else.
            if has_flown(&parameters) {
                written.push(keep_earlier(&parameters)?);
            }
            file.write(&parameters)?;
            written.push(parameters);
        }
        // Those of an earlier run are none of this one.
        None if parameters.exists() => written.push(keep_earlier(&parameters)?),
        None => {}
    }
    let (estimates, figures) = (dir.join("estimates"), dir.join("figures"));
    let (estimates_written, figures_written) = rayon::join(
        || write_estimates(&estimates, job, result),
        || pictures::save(&figures, job, result),
    );
    estimates_written.and(figures_written)?;
    written.extend([estimates, figures]);
    Ok(written)
}

/// Files of results in `dir`, each with the time of its last change. Files that a run does not change are of an earlier
/// run.
pub fn results(dir: &Path) -> BTreeMap<PathBuf, SystemTime> {
    let files = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = ["estimates", "figures"].map(|name| dir.join(name));
    let parts = folders.iter().flat_map(|folder| files(folder).map(|file| file.path()));
    let changed =
        |path: PathBuf| fs::metadata(&path).and_then(|it| it.modified()).map(|at| (path, at));
    parts.chain([dir.join("bootstrap.json")]).flat_map(changed).collect()
}

/// Whether flights changed the parameter file at `path`.
fn has_flown(path: &Path) -> bool {
    let file = config::load::<Value>(path);
    file.is_ok_and(|file| file.get("flown").is_some_and(|flown| !flown.is_null()))
}

/// Whether `path` is what [`write()`] kept of an earlier run.
pub fn is_earlier(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with("parameters.earlier"))
}

/// Gives `parameters.json` the name `parameters.earlier.json`, or a numbered one: a file of what flights
/// identified stays.
fn keep_earlier(parameters: &Path) -> Result<PathBuf> {
    let name = |number: u32| match number {
        1 => "parameters.earlier.json".to_owned(),
        number => format!("parameters.earlier-{number}.json"),
    };
    let mut names = (1..).map(|number| parameters.with_file_name(name(number)));
    let earlier = names.find(|name| !has_flown(name)).context("no name is left")?;
    fs::rename(parameters, &earlier)
        .with_context(|| format!("cannot rename {}", parameters.display()))?;
    Ok(earlier)
}

/// One CSV and one MCAP file for each log that has a piece: the states of every step, and the
/// observations beside them in the CSV.
fn write_estimates(dir: &Path, job: &Job<'_>, result: &FitResult) -> Result<()> {
    if job.table.clear_estimates && dir.exists() {
        clear_estimates(dir).with_context(|| format!("cannot clear {}", dir.display()))?;
    }
    fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
    for (position, log) in job.logs.iter().enumerate() {
        let traces: Vec<&Trace> =
            result.traces.iter().filter(|trace| trace.log == position).collect();
        if traces.is_empty() {
            continue;
        }
        // Logs of several folders may have one name.
        let name = log.path.file_stem().unwrap_or_default().to_string_lossy();
        let path = |kind: &str| dir.join(format!("{:03}-{name}.{kind}", position + 1));
        let csv = estimates_csv(job, result, log, &traces);
        atomic_file::write_contents(&path("csv"), true, csv)?;
        atomic_file::write(&path("mcap"), true, |part| write_mcap(part, job, result, &traces))?;
    }
    Ok(())
}

/// Removes the estimates of an earlier run, and nothing else.
fn clear_estimates(dir: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(dir)? {
        let path = entry?.path();
        if path.is_file()
            && path.file_name().is_some_and(|name| is_of_estimates(&name.to_string_lossy()))
        {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Whether estimates are written to a file of this name: `001-flight.csv`.
fn is_of_estimates(name: &str) -> bool {
    let is_number = |number: &str| number.len() >= 3 && number.bytes().all(|b| b.is_ascii_digit());
    let stem = name.strip_suffix(".csv").or_else(|| name.strip_suffix(".mcap"));
    stem.and_then(|stem| stem.split_once('-')).is_some_and(|(number, _)| is_number(number))
}

fn estimates_csv(job: &Job<'_>, result: &FitResult, log: &Loaded, traces: &[&Trace]) -> String {
    let mut csv = "piece,step,time_s".to_owned();
    for row in result.state_rows {
        csv += ",";
        csv += row.name;
    }
    for row in result.observation_rows {
        csv += ",o_";
        csv += row.name;
    }
    csv += "\n";
    for (piece, trace) in traces.iter().enumerate() {
        for (k, step) in trace.steps.clone().enumerate() {
            // Writing to a string cannot fail.
            write!(csv, "{piece},{step},{:.3}", step as f64 * job.table.dt_s).ok();
            for column in &trace.s {
                write!(csv, ",{:.6}", column[k]).ok();
            }
            let observed = &log.recording.o[step];
            for (value, is_present) in observed.o.iter().zip(observed.is_present) {
                csv += ",";
                if is_present {
                    write!(csv, "{value:.6}").ok();
                }
            }
            csv += "\n";
        }
    }
    csv
}

fn write_mcap(path: &Path, job: &Job<'_>, result: &FitResult, traces: &[&Trace]) -> Result<()> {
    let settings = serde_json::to_string_pretty(job.table)?;
    let head = Head {
        started_unix_ns: 0,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        revision: REVISION.to_owned(),
        documents: BTreeMap::from([("ident.json".to_owned(), settings)]),
    };
    let channel = Channel {
        topic: Topic::State.name(),
        schema_name: Topic::State.schema_name(),
        schema: Topic::State.schema(result.state_rows, &[]).into(),
    };
    let mut log = LogWriter::create(path, &head, &[channel])?;
    let mut values = Vec::with_capacity(result.state_rows.len());
    for trace in traces {
        for (k, step) in trace.steps.clone().enumerate() {
            values.clear();
            values.extend(trace.s.iter().map(|column| column[k]));
            let step = step as u64;
            let t = TimeNs(0).after(SpanNs::from_seconds(step as f64 * job.table.dt_s));
            let record = RowsRecord { step, rows: result.state_rows, values: &values };
            log.write(Topic::State.name(), t, &record)?;
        }
    }
    log.finish()?;
    Ok(())
}

#[cfg(test)]
mod tests;
