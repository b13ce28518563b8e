//! The file in which identified parameters go from `ident` to `fly`, `replay` and `sim`.
//!
//! Owns the format, its checks, and what of a controller's settings a file replaces; what of a simulator's
//! is `identified_plant` of `tello-sim`. How parameters are found is not known here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use horizon_model::setting::{SettingError, finite, in_range, not_negative, vector};
use horizon_model::{DEAD_TIME_MAX_S, Kinematic, Model, Row};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use tello_flight::cycle::{CycleTable, ModelKind};
use tello_io::atomic_file::write_json;
use tello_io::config;

/// The format that this program writes, and the only one that it reads.
pub const FORMAT: u32 = 1;

/// Identified parameters of a vehicle model, and where they come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ParameterFile {
    /// Version of this format: 1
    pub format: u32,
    /// The vehicle model.
    pub model: ModelKind,
    /// Each parameter of the model, by the name of its row.
    pub parameters: BTreeMap<String, ParameterEntry>,
    /// From sending sticks until they act: roll, pitch, yaw, throttle. s, 0..=2
    pub dead_time_s: Vec<f64>,
    /// The logs that the parameters were identified from.
    pub data: Vec<DataFile>,
    /// The complete settings of the identification.
    pub settings: serde_json::Value,
    /// Covariance of the parameters, in the order of the model's rows; null if unknown, as in files from before
    /// it was written. Product of the units of the rows
    #[serde(default)]
    pub covariance: Option<Vec<Vec<f64>>>,
    /// The flights that changed the values since the identification; null without any.
    #[serde(default)]
    pub flown: Option<FlightHistory>,
    /// Git revision of the program that wrote the file.
    pub revision: String,
}

/// The flights that changed a vehicle file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct FlightHistory {
    /// How many. >= 1
    pub flights: u32,
    /// Start of the first of them, UTC.
    pub first: String,
    /// Start of the last of them, UTC.
    pub last: String,
    /// Whether they were simulated: such a file is none of a real drone.
    pub is_simulated: bool,
}

/// One identified parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The key of an `Option` counts as optional unless stated otherwise, here and in `present`.
#[schemars(extend("required" = ["value", "std", "lower", "upper", "unit"]))]
pub struct ParameterEntry {
    /// The estimate. In `unit`
    pub value: f64,
    /// Its standard deviation, >= 0; null if unknown. In `unit`
    #[serde(deserialize_with = "tello_flight::present")]
    pub std: Option<f64>,
    /// Lower end of the 95 % interval; null if unknown. In `unit`
    #[serde(deserialize_with = "tello_flight::present")]
    pub lower: Option<f64>,
    /// Upper end of the 95 % interval, at least `lower`; null if unknown. In `unit`
    #[serde(deserialize_with = "tello_flight::present")]
    pub upper: Option<f64>,
    /// SI unit of all four; `1` for a ratio.
    pub unit: String,
}

/// A log that parameters were identified from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DataFile {
    /// Where it was read.
    pub path: PathBuf,
    /// SHA-256 of its bytes, hexadecimal.
    pub sha256: String,
    /// Steps in it.
    pub steps: usize,
    /// Whether its vehicle was simulated; missing if not, or if the log does not state it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub is_simulated: bool,
}

/// Settings that a parameter file replaces a part of.
pub trait TakesParameters {
    /// Replaces what `file`, which is checked, knows better.
    ///
    /// # Errors
    /// The file is of a model that these settings cannot use, or does not fit to the rest of them.
    fn take(&mut self, file: &ParameterFile) -> Result<()>;
}

/// Lets `settings` take the parameter file at `path`, if there is one.
///
/// # Errors
/// As [`ParameterFile::read`] and [`TakesParameters::take`], with the name of the file.
pub fn apply(path: Option<&Path>, settings: &mut impl TakesParameters) -> Result<()> {
    let Some(path) = path else { return Ok(()) };
    let file = ParameterFile::read(path)?;
    settings.take(&file).with_context(|| of(path))
}

/// Where settings that fail have their parameters from.
pub fn of(path: &Path) -> String {
    format!("with the parameters of {}", path.display())
}

impl ParameterFile {
    /// The checked file at `path`.
    ///
    /// # Errors
    /// It cannot be read or is not JSON, a key is missing or unknown, or a value breaks its rule.
    pub fn read(path: &Path) -> Result<Self> {
        let file: Self = config::load(path)?;
        file.check().with_context(|| format!("in {}", path.display()))?;
        Ok(file)
    }

    /// Writes the file, in place of what was there.
    ///
    /// # Errors
    /// A value breaks its rule, or the disk refuses.
    pub fn write(&self, path: &Path) -> Result<()> {
        self.check()?;
        write_json(path, true, self)
    }

    /// The parameters in the order of the model's rows. Unit of each row
    pub fn values(&self) -> Vec<f64> {
        let value = |row: &Row| self.parameters.get(row.name).map(|entry| entry.value);
        self.model.parameters().iter().filter_map(value).collect()
    }

    /// Checks everything.
    ///
    /// # Errors
    /// The first value that breaks its rule.
    pub fn check(&self) -> Result<(), SettingError> {
        in_range("format", self.format, FORMAT..=FORMAT)?;
        let (model, rows) = (self.model.name(), self.model.parameters());
        for row in rows {
            let Some(entry) = self.parameters.get(row.name) else {
                let names = rows.iter().map(|row| row.name).collect::<Vec<_>>().join(", ");
                let rule = format!("a value for each of {names}");
                return Err(under_parameters(SettingError::new(row.name, "nothing", rule)));
            };
            let entry = entry.check(row).map_err(|error| error.under(row.name));
            entry.map_err(under_parameters)?;
        }
        if let Some(name) = self.parameters.keys().find(|name| rows.iter().all(|r| r.name != *name))
        {
            let rule = format!("the parameters of {model}");
            return Err(SettingError::new("parameters", name, rule));
        }
        vector("dead_time_s", &self.dead_time_s, &Kinematic::INPUT, |key, value| {
            in_range(key, value, 0.0..=DEAD_TIME_MAX_S)
        })?;
        if let Some(covariance) = &self.covariance {
            check_covariance(covariance, rows.len())?;
        }
        if let Some(flown) = &self.flown {
            in_range("flights", flown.flights, 1..=u32::MAX)
                .map_err(|error| error.under("flown"))?;
        }
        Ok(())
    }
}

/// Checks that a covariance is square, finite and symmetric, and that no correlation is beyond 1.
fn check_covariance(covariance: &[Vec<f64>], rows: usize) -> Result<(), SettingError> {
    let refused = |value: String, rule: &str| Err(SettingError::new("covariance", value, rule));
    let widths = covariance.iter().map(Vec::len);
    if covariance.len() != rows || widths.clone().any(|width| width != rows) {
        let value = format!("{} rows of {:?}", covariance.len(), widths.max().unwrap_or(0));
        return refused(value, &format!("{rows} rows of {rows} numbers"));
    }
    for (i, row) in covariance.iter().enumerate() {
        for (j, value) in row.iter().enumerate() {
            let (twin, limit) = (covariance[j][i], (row[i] * covariance[j][j]).sqrt());
            // False for a NaN, too.
            let is_good = value.abs() <= limit * (1.0 + 1e-6)
                && (value - twin).abs() <= 1e-6 * limit
                && limit.is_finite()
                && row[i] >= 0.0;
            if !is_good {
                return refused(
                    format!("{value} at [{i}][{j}]"),
                    "symmetric, correlations of -1..=1",
                );
            }
        }
    }
    Ok(())
}

fn under_parameters(error: SettingError) -> SettingError {
    error.under("parameters")
}

impl ParameterEntry {
    fn check(&self, row: &Row) -> Result<(), SettingError> {
        finite("value", self.value)?;
        self.std.map(|std| not_negative("std", std)).transpose()?;
        let lower = self.lower.map(|lower| finite("lower", lower)).transpose()?;
        let upper = self.upper.map(|upper| finite("upper", upper)).transpose()?;
        if let (Some(lower), Some(upper)) = (lower, upper)
            && lower > upper
        {
            return Err(SettingError::new("lower", lower, format!("at most upper = {upper}")));
        }
        if self.unit != row.unit {
            return Err(SettingError::new("unit", format!("{:?}", self.unit), row.unit));
        }
        Ok(())
    }
}

impl TakesParameters for CycleTable {
    /// `mhe.p_prior` and `dead_time_s`.
    fn take(&mut self, file: &ParameterFile) -> Result<()> {
        if file.model != self.model {
            let (theirs, ours) = (file.model.name(), self.model.name());
            bail!(
                "they are of the model {theirs}, and the loop runs {ours}: identify {ours}, or give \
                 settings with the model {theirs}"
            );
        }
        let p = file.values();
        let bounds = self.mhe.p_lb.iter().zip(&self.mhe.p_ub);
        for ((row, value), (lo, hi)) in file.model.parameters().iter().zip(&p).zip(bounds) {
            if !(lo..=hi).contains(&value) {
                bail!(
                    "{} = {value} {} lies outside the bounds of the estimator, {lo} ..= {hi}: widen \
                     cycle.mhe.p_lb and cycle.mhe.p_ub in the settings of the flight (`fly --config`, \
                     `ident --flight`), or identify with bounds inside of them",
                    row.name,
                    row.unit,
                );
            }
        }
        self.mhe.p_prior = p;
        self.dead_time_s.clone_from(&file.dead_time_s);
        Ok(())
    }
}

#[cfg(test)]
mod tests;
