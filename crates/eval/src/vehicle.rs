//! The vehicle file: a parameter file that each flight changes.
//!
//! Owns what a flight may change in it and by how much. A date is an argument: nothing here reads a clock.

use std::path::Path;

use anyhow::{Context, Result, bail, ensure};
use horizon_estim::NORMAL_HALF_WIDTH;
use horizon_model::DEAD_TIME_MAX_S;
use horizon_model::rows::stick;
use tello_flight::cycle::{CycleTable, ParameterEstimate};

use crate::REVISION;
use crate::parameter_file::{
    FORMAT, FlightHistory, ParameterEntry, ParameterFile, TakesParameters as _,
};

/// Most that a flight changes a parameter by, in standard deviations of the estimator's prior. 1
const STEP_MAX: f64 = 3.0;

/// A parameter whose standard deviation is a larger fraction of its prior's was not excited: it stays. 1
const EXCITED_MAX: f64 = 0.7;

/// A flight, for the file.
#[derive(Debug, Clone, Copy)]
pub struct FlightDone<'a> {
    /// By its estimator, at the end of the flying phase.
    pub found: &'a ParameterEstimate,
    /// Its start, UTC.
    pub date: &'a str,
    /// Whether it was simulated.
    pub is_simulated: bool,
}

/// A parameter, or the dead times, that a flight changed.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed {
    /// Name of its row, or `dead_time`.
    pub name: &'static str,
    /// Before the flight. Unit of the row; of the dead times that of roll. s
    pub before: f64,
    /// After the flight. Unit of the row; of the dead times that of roll. s
    pub after: f64,
}

/// Lets `settings` take the vehicle file at `path`, if it exists. A vehicle that never flew has none: then
/// `settings` stay as they are.
///
/// # Errors
/// It cannot be read, breaks a rule, does not fit to the settings, is of simulated flights where `is_simulated` is
/// false or the other way round, or its folder does not exist.
pub fn before_flight(path: &Path, settings: &mut CycleTable, is_simulated: bool) -> Result<()> {
    if !path.exists() {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            bail!("{} cannot be made: no folder {}", path.display(), folder.display());
        }
        return Ok(());
    }
    // A pipe would be waited for.
    ensure!(path.is_file(), "{} is no file", path.display());
    let file = ParameterFile::read(path)?;
    file.check_is_simulated(is_simulated).with_context(|| format!("in {}", path.display()))?;
    settings.take(&file).with_context(|| format!("with the vehicle of {}", path.display()))
}

/// Changes the vehicle file at `path`, or makes it, by what a flight with `settings` identified, if anything. The
/// file is replaced as a whole.
///
/// # Errors
/// As [`ParameterFile::read`], [`ParameterFile::update_parameters`] and [`ParameterFile::write`]; the file is of
/// real flights and this one is simulated, or the other way round.
pub fn after_flight(
    path: &Path,
    settings: &CycleTable,
    flight: &FlightDone<'_>,
) -> Result<Vec<Changed>> {
    let mut file = if path.exists() {
        ParameterFile::read(path)?
    } else {
        ParameterFile::of_settings(settings)
    };
    file.check_is_simulated(flight.is_simulated)?;
    let changed = file.update_parameters(settings, flight)?;
    if !changed.is_empty() {
        file.write(path)?;
    }
    Ok(changed)
}

impl ParameterFile {
    /// The prior of `settings` as a file, for a vehicle of which nothing else is known.
    pub fn of_settings(settings: &CycleTable) -> Self {
        let rows = settings.model.parameters().iter();
        let entry = |value: f64, unit: &str| ParameterEntry {
            value,
            std: None,
            lower: None,
            upper: None,
            unit: unit.to_owned(),
        };
        let parameters = rows.zip(&settings.mhe.p_prior);
        Self {
            format: FORMAT,
            model: settings.model,
            parameters: parameters
                .map(|(row, value)| (row.name.to_owned(), entry(*value, row.unit)))
                .collect(),
            dead_time_s: settings.dead_time_s.clone(),
            data: Vec::new(),
            settings: serde_json::Value::Null,
            covariance: None,
            flown: None,
            revision: REVISION.to_owned(),
        }
    }

    /// Refuses what simulated flights identified.
    ///
    /// # Errors
    /// Its flights, or logs that it was identified from, were simulated.
    pub fn check_is_real(&self) -> Result<()> {
        self.check_is_simulated(false)
    }

    fn check_is_simulated(&self, is_simulated: bool) -> Result<()> {
        if let Some(log) = self.data.iter().find(|log| log.is_simulated && !is_simulated) {
            bail!("its log {} was simulated: it is no file of a real drone", log.path.display());
        }
        match &self.flown {
            Some(flown) if flown.is_simulated && !is_simulated => {
                bail!("its flights were simulated: it is no file of a real drone")
            }
            Some(flown) if !flown.is_simulated && is_simulated => {
                bail!("its flights were real: a simulated flight would spoil it")
            }
            _ => Ok(()),
        }
    }

    /// Takes over what `flight`, flown with `settings`, identified: of each parameter that was excited the estimate,
    /// within the bounds of the estimator and within 3 standard deviations of its prior around the value
    /// before; the dead times as they were corrected, of each axis no further than the flight does
    /// ([`CycleTable::dead_time_min_ratio`]). Returns what changed; of a flight that excited nothing the file stays as
    /// it is.
    ///
    /// # Errors
    /// Estimate or covariance are none of this model, or not finite.
    pub fn update_parameters(
        &mut self,
        settings: &CycleTable,
        flight: &FlightDone<'_>,
    ) -> Result<Vec<Changed>> {
        let rows = self.model.parameters();
        self.check_estimate(settings, flight.found)?;
        let ParameterEstimate { p, covariance, dead_time_change_s } = flight.found;
        let mhe = &settings.mhe;
        let mut changed = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            let (std, prior_std) = (covariance[i][i].max(0.0).sqrt(), 1.0 / mhe.c_p[i]);
            let Some(entry) = self.parameters.get_mut(row.name) else { continue };
            if std > EXCITED_MAX * prior_std {
                continue;
            }
            let (before, step) = (entry.value, STEP_MAX * prior_std);
            let after = p[i].clamp(before - step, before + step).clamp(mhe.p_lb[i], mhe.p_ub[i]);
            let half = NORMAL_HALF_WIDTH * std;
            entry.value = after;
            (entry.std, entry.lower, entry.upper) =
                (Some(std), Some(after - half), Some(after + half));
            changed.push(Changed { name: row.name, before, after });
        }
        if let (Some(longer_s), Some(before)) =
            (&dead_time_change_s, self.dead_time_s.first().copied())
        {
            let min_ratio = settings.dead_time_min_ratio();
            let axes = self.dead_time_s.iter_mut().zip(&settings.dead_time_s).zip(longer_s.iter());
            for ((after, before), longer_s) in axes {
                let flown_s = (before + longer_s).max(min_ratio * before);
                *after = flown_s.min(DEAD_TIME_MAX_S);
            }
            let after = self.dead_time_s[stick::ROLL];
            changed.push(Changed { name: "dead_time", before, after });
        }
        if !changed.is_empty() {
            self.covariance = Some(covariance.clone());
            REVISION.clone_into(&mut self.revision);
            self.count_flight(flight);
        }
        Ok(changed)
    }

    /// Refuses an estimate of another model, and one that is not finite.
    fn check_estimate(&self, settings: &CycleTable, found: &ParameterEstimate) -> Result<()> {
        let count = self.model.parameters().len();
        let ParameterEstimate { p, covariance, dead_time_change_s } = found;
        if self.model != settings.model || p.len() != count || covariance.len() != count {
            bail!(
                "the flight was of the model {} with {} parameters, the file is of {}",
                settings.model.name(),
                p.len(),
                self.model.name()
            );
        }
        let is_square = covariance.iter().all(|row| row.len() == count);
        let dead_times = dead_time_change_s.iter().flatten();
        let values = p.iter().chain(covariance.iter().flatten()).chain(dead_times);
        if !is_square || !values.copied().all(f64::is_finite) {
            bail!("the estimate at the end of the flight is not finite: the file stays as it was");
        }
        Ok(())
    }

    fn count_flight(&mut self, flight: &FlightDone<'_>) {
        let last = flight.date.to_owned();
        self.flown = Some(match self.flown.take() {
            Some(flown) => {
                FlightHistory { flights: flown.flights.saturating_add(1), last, ..flown }
            }
            None => FlightHistory {
                flights: 1,
                first: last.clone(),
                last,
                is_simulated: flight.is_simulated,
            },
        });
    }
}

#[cfg(test)]
mod tests;
