//! Commands of the program: batches, flights with a log, identification, replay, report.
//!
//! Settings come as JSON objects with the keys that differ from the built-in ones; results go as the JSON that the
//! commands print with `--json`.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use pyo3::prelude::*;
use serde_json::Value;
use tello_eval::flight_log::TickRecord;
use tello_eval::ident::{self, BootstrapPlan, FileUsed, IdentFileTable, IdentReport, Job};
use tello_eval::part_file::PartNumber;
use tello_eval::replay::{self as replays, TickObserver};
use tello_eval::{REVISION, recordings, report as reports};
use tello_flight::Start;
use tello_flight::cycle::FlightTable;
use tello_io::log::LogReader;
use tello_io::{atomic_file, config};
use tello_sim::batch::{Batch, Contender};
use tello_sim::{SimTable, logged_flight};

use crate::long_call::{self, Stop};
use crate::{TelloError, settings};

/// Mission, settings of the controller and settings of the simulator, as JSON.
type Flown = (Option<String>, String, String);

/// The built-in settings of `"fly"`, `"sim"` or `"ident"`, or the built-in `"mission"`, as JSON.
#[pyfunction]
pub(crate) fn defaults(kind: &str) -> PyResult<String> {
    let built_in = || -> Result<Option<Value>> {
        Ok(match kind {
            "fly" => Some(serde_json::to_value(config::fly(None, None)?.0)?),
            "mission" => Some(serde_json::to_value(config::fly(None, None)?.1)?),
            "sim" => Some(serde_json::to_value(tello_sim::settings(None)?)?),
            "ident" => Some(serde_json::to_value(ident::settings(None)?)?),
            _ => None,
        })
    };
    match built_in().map_err(crate::raised)? {
        Some(table) => Ok(table.to_string()),
        None => Err(TelloError::new_err(format!(
            "kind: expected fly, mission, sim or ident, given {kind}"
        ))),
    }
}

/// The flight of the settings in `config` (JSON, keys that differ) and of a mission (JSON), or the built-in one.
pub(crate) fn flight(config: &str, mission: Option<&str>, start: Start) -> Result<FlightTable> {
    let (fly, built_in) = config::fly(None, None)?;
    let fly = settings::merged("config", &fly, config).map_err(as_cause)?;
    let mission = match mission {
        Some(mission) => config::parse(mission).context("mission")?,
        None => built_in,
    };
    Ok(config::flight(&fly, mission, start))
}

fn simulator(changes: &str) -> Result<SimTable> {
    settings::merged("sim", &tello_sim::settings(None)?, changes).map_err(as_cause)
}

/// An exception of ours as the cause of an error.
#[expect(clippy::needless_pass_by_value, reason = "for `map_err`")]
fn as_cause(error: PyErr) -> anyhow::Error {
    anyhow::anyhow!("{error}")
}

/// Flies seeds in virtual time on all cores; the table of `sim --batch N --json`.
#[pyfunction]
#[pyo3(signature = (seed, count, flown, hover_s))]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn batch(
    py: Python<'_>,
    seed: u64,
    count: u64,
    flown: Flown,
    hover_s: Option<f64>,
) -> PyResult<String> {
    long_call::run(py, |stop| {
        let (mission, config, sim) = &flown;
        let flight = flight(config, mission.as_deref(), Start::Airborne)?;
        let contender = Contender::new(flight, hover_s)?;
        let seeds = seed..seed.saturating_add(count);
        let stopped = || stop.is_asked();
        let flown = tello_sim::batch::fly(&[contender], &simulator(sim)?, seeds, &stopped, &|| {})?;
        Ok(serde_json::to_string(&Batch::of(&flown.concat()))?)
    })
}

/// Flies one seed in virtual time and leaves its log, as `sim --log FILE`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn fly(py: Python<'_>, log: PathBuf, seed: u64, flown: Flown) -> PyResult<String> {
    long_call::run(py, |stop| {
        let (mission, config, sim) = &flown;
        let flight = flight(config, mission.as_deref(), Start::Airborne)?;
        let (sim, is_stopped) = (simulator(sim)?, || stop.is_asked());
        let logged = logged_flight::fly_until(&flight, &sim, seed, &log, &is_stopped)?;
        Ok(serde_json::to_string(&logged)?)
    })
}

/// Identifies the vehicle from logs, as `ident --json`.
#[pyfunction]
#[pyo3(signature = (logs, table, bootstrap, seed, out))]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn identify(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    table: &str,
    bootstrap: Option<u64>,
    seed: u64,
    out: Option<PathBuf>,
) -> PyResult<String> {
    let table: IdentFileTable =
        settings::merged("settings", &ident::settings(None).map_err(crate::raised)?, table)?;
    long_call::run(py, |stop| {
        let report = identified(&logs, &table, (bootstrap, seed), out.as_deref(), stop)?;
        Ok(serde_json::to_string(&report)?)
    })
}

fn identified(
    logs: &[PathBuf],
    table: &IdentFileTable,
    (bootstrap, seed): (Option<u64>, u64),
    out: Option<&Path>,
    stop: &Stop,
) -> Result<IdentReport> {
    table.check()?;
    let (logs, files_skipped) = ident::load_logs(logs, table)?;
    let plan = bootstrap.map(|resamples| BootstrapPlan {
        resamples,
        seed,
        shard: PartNumber::ONLY,
        part: None,
        earlier: Vec::new(),
    });
    let flight = ident::flight_settings(table.model, None)?;
    let job = Job {
        name: "python",
        table,
        logs: &logs,
        bootstrap: plan.as_ref(),
        flight: flight.as_ref(),
        observer: stop,
        keeps_estimates: out.is_some(),
    };
    let result = ident::fit(&job)?;
    let mut written = Vec::new();
    if let Some(dir) = out {
        fs::create_dir_all(dir).with_context(|| format!("cannot make {}", dir.display()))?;
        written = ident::write(dir, &job, &result)?;
    }
    stop.check()?;
    Ok(IdentReport {
        fit: result.fit,
        against: Vec::new(),
        comparison: None,
        dt_s: table.dt_s,
        files_used: logs.into_iter().map(FileUsed::from).collect(),
        files_skipped,
        // The caller has a clock.
        seconds: 0.0,
        written,
        revision: REVISION,
    })
}

/// Runs recorded flights through the loop again, as `replay --json`.
#[pyfunction]
#[pyo3(signature = (logs, config, out))]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn replay(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    config: Option<PathBuf>,
    out: Option<PathBuf>,
) -> PyResult<String> {
    long_call::run(py, |stop| {
        let options = replays::Options {
            config: config.as_deref(),
            against: None,
            params: None,
            out: out.as_deref(),
        };
        let mut watch = |_: &FlightTable, _: &TickRecord| stop.check();
        // Recordings of others have no ticks to stop at, and are short.
        let watch: Option<TickObserver<'_>> =
            if has_ticks(&logs)? { Some(&mut watch) } else { None };
        Ok(serde_json::to_string(&replays::run(&logs, &options, watch)?)?)
    })
}

/// Whether a flight of ours is among the logs.
fn has_ticks(logs: &[PathBuf]) -> Result<bool> {
    let is_ours = |path: &PathBuf| {
        LogReader::open(path).is_ok_and(|log| !recordings::rows::is_recording(&log))
    };
    Ok(recordings::find(logs)?.0.iter().any(is_ours))
}

/// Makes the page of recorded flights, as `report --json`.
#[pyfunction]
#[expect(clippy::needless_pass_by_value, reason = "arguments come from Python by value")]
pub(crate) fn report(
    py: Python<'_>,
    logs: Vec<PathBuf>,
    against: Vec<PathBuf>,
    out: PathBuf,
) -> PyResult<String> {
    long_call::run(py, |stop| {
        reports::replaces_a_page(&out)?;
        let page = reports::page_of(&logs, &against, &out)?;
        stop.check()?;
        atomic_file::write_contents(&out, true, &page.html)?;
        Ok(serde_json::to_string(&page.report)?)
    })
}
