//! Whether a flight would take what was identified: no parameter file is written that it refuses.

use std::path::Path;

use anyhow::Result;
use tello_flight::Start;
use tello_flight::cycle::{self, FlightTable, ModelKind};
use tello_io::config;

use super::fitted::Job;
use super::report::Fit;
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

/// The parameter file of a fit, or why the flight of the job would refuse it.
///
/// # Errors
/// The settings cannot be written as JSON.
pub(super) fn parameter_file(job: &Job<'_>, fit: &Fit) -> Result<Result<ParameterFile, String>> {
    let known = |value: f64| value.is_finite().then_some(value);
    let entries = fit.parameters.iter().map(|row| {
        let entry = ParameterEntry {
            value: row.value,
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
    let file = ParameterFile {
        format: FORMAT,
        model: job.table.model,
        parameters: entries.collect(),
        dead_time_s: fit.dead_time_s.clone(),
        data: data.collect(),
        settings: serde_json::to_value(job.table)?,
        covariance: fit.covariance.clone(),
        flown: None,
        revision: REVISION.to_owned(),
    };
    let is_taken = |flight: &FlightTable| {
        file.check()?;
        let mut flight = flight.clone();
        flight.cycle.take(&file)?;
        cycle::build(&flight).map(drop)?;
        anyhow::Ok(())
    };
    let refused = job.flight.and_then(|flight| is_taken(flight).err());
    Ok(match refused {
        Some(error) => Err(format!("{error:#}")),
        None => Ok(file),
    })
}
