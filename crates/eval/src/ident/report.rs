//! Result of an identification: one object for scripts, a table for people.

use std::fmt::{self, Display, Formatter};
use std::path::PathBuf;

use horizon_estim::DelayVerdict;
use schemars::JsonSchema;
use serde::Serialize;

use super::compare::Comparison;
use crate::recordings::FileSkipped;

/// The result of `tello-ctl ident`.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct IdentReport {
    /// The fit of the main settings.
    #[serde(flatten)]
    pub fit: FitReport,
    /// Fits of the settings named by `--against`.
    pub against: Vec<FitReport>,
    /// Prediction on logs that were not used for the fit.
    pub comparison: Option<Comparison>,
    /// Period of the logs. s
    pub dt_s: f64,
    /// Logs that were used.
    pub files_used: Vec<FileUsed>,
    /// Logs that were not used.
    pub files_skipped: Vec<FileSkipped>,
    /// Time for all of it. s
    pub seconds: f64,
    /// Files that were written.
    pub written: Vec<PathBuf>,
    /// This revision.
    pub revision: &'static str,
}

/// A log that was used.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct FileUsed {
    /// Where it was read.
    pub path: PathBuf,
    /// Hash of its bytes.
    pub sha256: String,
    /// Steps in it.
    pub steps: usize,
    /// Parts of the log that were left out, and why.
    pub skipped: Vec<String>,
}

/// One model fitted to the logs.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct FitReport {
    /// Name of the settings.
    pub settings: String,
    /// Name of the model.
    pub model: &'static str,
    /// Estimate. Unit of each row
    pub p: Vec<f64>,
    /// Standard deviations of `p`, by a bootstrap of enough pieces, else by Laplace. Unit of each row
    pub std: Vec<f64>,
    /// Covariance of `p` as `std`, row by row; null if some row has none. Product of the units of the rows
    pub covariance: Option<Vec<Vec<f64>>>,
    /// Each parameter by name.
    pub parameters: Vec<ParameterRow>,
    /// Dead time of roll, pitch, yaw and throttle. s
    pub dead_time_s: Vec<f64>,
    /// How the dead times were found; empty where they were given.
    pub delay: Vec<DelayRow>,
    /// Half the sum of squares at the estimate. 1
    pub cost: f64,
    /// Steps of Levenberg-Marquardt.
    pub iterations: u32,
    /// Why the solver stopped.
    pub stop: &'static str,
    /// Time of the solve. s
    pub solve_seconds: f64,
    /// Pieces of logs.
    pub pieces: usize,
    /// Steps in the pieces.
    pub steps: usize,
    /// Steps left out because the drone ignored its sticks.
    pub steps_lost: usize,
    /// The bootstrap, if there is one.
    pub bootstrap: Option<Bootstrap>,
    /// Whether deviations, intervals and covariance are those of the bootstrap.
    pub is_resampled: bool,
    /// Warnings to read before using the estimate.
    pub verdict: Vec<String>,
    /// Why a flight would refuse the parameters; then no parameter file is written.
    pub refused: Option<String>,
}

/// One parameter of a fit.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct ParameterRow {
    /// Name.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// Estimate. In `unit`
    pub value: f64,
    /// Standard deviation, see [`FitReport::std`]. In `unit`
    pub std: f64,
    /// Standard deviation by Laplace's approximation. In `unit`
    pub std_laplace: f64,
    /// 95 % interval. In `unit`
    pub lower: f64,
    /// 95 % interval. In `unit`
    pub upper: f64,
    /// Whether the estimate lies at a bound.
    pub is_at_bound: bool,
}

/// Dead time of a group of sticks.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct DelayRow {
    /// Sticks that have this dead time.
    pub sticks: String,
    /// Estimate; what was given if the likelihood does not decide. s
    pub dead_time_s: f64,
    /// Whether the likelihood has a maximum.
    pub verdict: DelayMinimum,
    /// Standard deviation; null without a maximum of the likelihood. s
    pub std_s: Option<f64>,
    /// 95 % interval. s
    pub lower_s: Option<f64>,
    /// 95 % interval. s
    pub upper_s: Option<f64>,
}

/// Minimum of the cost over a dead time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum DelayMinimum {
    /// The cost has a minimum inside of the searched range.
    Minimum,
    /// The cost is least at zero: there is no dead time.
    Zero,
    /// The cost is least at the upper end of the range.
    EndOfRange,
    /// The cost does not decide.
    Undecided,
}

impl From<DelayVerdict> for DelayMinimum {
    fn from(verdict: DelayVerdict) -> Self {
        match verdict {
            DelayVerdict::Minimum => Self::Minimum,
            DelayVerdict::Zero => Self::Zero,
            DelayVerdict::EndOfRange => Self::EndOfRange,
            DelayVerdict::Undecided => Self::Undecided,
        }
    }
}

/// Statistics of the resamples.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct Bootstrap {
    /// Resamples finished.
    pub resamples: usize,
    /// Resamples among them whose solve did not converge.
    pub unconverged: usize,
    /// Different samples of the pieces among them.
    pub distinct: usize,
    /// Resamples that were asked for.
    pub asked: u64,
    /// Seed of the draws.
    pub seed: u64,
    /// Time of all resamples. s
    pub seconds: f64,
    /// Mean of the estimates. Unit of each row
    pub mean: Vec<f64>,
    /// Correlation of the parameters, row by row. 1, -1..=1
    pub correlation: Vec<Vec<f64>>,
}

impl Bootstrap {
    /// Whether every resample that was asked for is finished.
    pub fn is_whole(&self) -> bool {
        self.resamples as u64 == self.asked
    }
}

impl Display for IdentReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let steps: usize = self.files_used.iter().map(|file| file.steps).sum();
        writeln!(f, "logs          {} used, {steps} steps", self.files_used.len())?;
        for FileUsed { path, steps, skipped, .. } in &self.files_used {
            // A CSV has no time: a person sees whether its rows are periods.
            let (seconds, rate_hz) = (*steps as f64 * self.dt_s, 1.0 / self.dt_s);
            write!(f, "  {}: {steps} steps, {seconds:.1} s at {rate_hz:.0} Hz", path.display())?;
            skipped.iter().try_for_each(|part| write!(f, "; {part}"))?;
            writeln!(f)?;
        }
        for file in &self.files_skipped {
            writeln!(f, "  not used: {}: {}", file.path.display(), file.why)?;
        }
        if self.against.is_empty() {
            self.fit.fmt(f)?;
        } else {
            rows(f, std::iter::once(&self.fit).chain(&self.against))?;
        }
        if let Some(comparison) = &self.comparison {
            write!(f, "{comparison}")?;
        }
        for path in &self.written {
            writeln!(f, "written       {}", path.display())?;
        }
        Ok(())
    }
}

/// Several fits, one row each.
fn rows<'a>(f: &mut Formatter<'_>, fits: impl Iterator<Item = &'a FitReport>) -> fmt::Result {
    for fit in fits {
        write!(f, "{:<32} cost {:>10.3}  ", fit.settings, fit.cost)?;
        for row in &fit.parameters {
            write!(f, " {} {:.4}{}", row.name, row.value, if row.is_at_bound { "*" } else { "" })?;
        }
        writeln!(f)?;
        for sentence in &fit.verdict {
            writeln!(f, "  {sentence}")?;
        }
    }
    writeln!(f, "* at its bound")
}

impl Display for FitReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "model         {} ({})", self.model, self.settings)?;
        writeln!(f, "pieces        {}, {} steps", self.pieces, self.steps)?;
        if self.steps_lost > 0 {
            writeln!(f, "left out      {} steps with lost commands", self.steps_lost)?;
        }
        writeln!(
            f,
            "cost          {:.6}, {} iterations, {}, {:.3} s",
            self.cost, self.iterations, self.stop, self.solve_seconds
        )?;
        let source = if self.is_resampled { "bootstrap" } else { "Laplace" };
        writeln!(f, "{:<13} {:>10} {:>9}  95 % interval ({source})", "parameter", "value", "std")?;
        for row in &self.parameters {
            writeln!(
                f,
                "{:<13} {:>10.5} {:>9.5}  {:>9.4} .. {:<9.4} {}{}",
                row.name,
                row.value,
                row.std,
                row.lower,
                row.upper,
                row.unit,
                if row.is_at_bound { ", at its bound" } else { "" }
            )?;
        }
        for row in &self.delay {
            write!(f, "{:<13} {:>10.4}", row.sticks, row.dead_time_s)?;
            if let (Some(std), Some(lower), Some(upper)) = (row.std_s, row.lower_s, row.upper_s) {
                write!(f, " {std:>9.4}  {lower:>9.4} .. {upper:<9.4}")?;
            }
            writeln!(f, " s, dead time")?;
        }
        if let Some(bootstrap) = &self.bootstrap {
            self.write_bootstrap(bootstrap, f)?;
        }
        // What matters most comes before its details.
        if let Some(why) = &self.refused {
            writeln!(f, "refused       no parameter file, since fly would refuse it: {why}")?;
        }
        for sentence in &self.verdict {
            writeln!(f, "note          {sentence}")?;
        }
        Ok(())
    }
}

impl FitReport {
    fn write_bootstrap(&self, bootstrap: &Bootstrap, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "bootstrap     {} of {} resamples, {} distinct, {} not converged, seed {}, {:.1} s",
            bootstrap.resamples,
            bootstrap.asked,
            bootstrap.distinct,
            bootstrap.unconverged,
            bootstrap.seed,
            bootstrap.seconds
        )?;
        writeln!(f, "correlation")?;
        for (row, line) in self.parameters.iter().zip(&bootstrap.correlation) {
            write!(f, "  {:<11}", row.name)?;
            for entry in line {
                write!(f, " {entry:>6.2}")?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

#[cfg(test)]
pub(super) mod tests;
