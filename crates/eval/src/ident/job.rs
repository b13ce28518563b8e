//! Task and result of an identification: rows of names and numbers instead of types.

use std::fmt;
use std::ops::Range;

use horizon_model::Row;
use tello_flight::cycle::FlightTable;

use super::Observer;
use super::predict::AddErrors;
use super::report::{DelayRow, FitReport};
use super::resamples::{BootstrapPlan, ResampleFile};
use super::table::IdentFileTable;
use crate::parameter_file::ParameterFile;
use crate::recordings::Loaded;

/// Task of an identification: settings and logs.
pub struct Job<'a> {
    /// Name of the settings in messages and results: that of their file.
    pub name: &'a str,
    /// Model, weights, bounds and start of the fit.
    pub table: &'a IdentFileTable,
    /// Recordings whose pieces are fitted.
    pub logs: &'a [Loaded],
    /// Resamples of the bootstrap; `None` for the sandwich alone.
    pub bootstrap: Option<&'a BootstrapPlan>,
    /// Settings of the flight that takes the parameters and may refuse them; `None`: none takes them.
    pub flight: Option<&'a FlightTable>,
    /// Shown the progress; may ask to stop.
    pub observer: &'a dyn Observer,
    /// Whether anything is made of the estimates along the pieces.
    pub keeps_estimates: bool,
}

/// A fit with all that figures and files are made of; rows instead of types.
pub struct FitResult {
    /// The fit for reports.
    pub fit: FitReport,
    /// Rows of the states.
    pub(super) state_rows: &'static [Row],
    /// Rows of the observations.
    pub(super) observation_rows: &'static [Row],
    /// Estimates along the pieces.
    pub(super) traces: Vec<Trace>,
    /// Estimates of the bootstrap.
    pub resamples: Option<Resampled>,
    /// Cost over the dead times, if they were searched.
    pub(super) delay: Vec<DelayResult>,
    /// Whether the solver converged.
    pub has_converged: bool,
    /// The parameters for the flight; `None` if it would refuse them (`FitReport::refused`).
    pub parameter_file: Option<ParameterFile>,
    /// The fitted model as a forecast.
    pub(super) predict: Box<dyn AddErrors>,
}

/// Estimates of a bootstrap.
#[derive(Debug)]
pub struct Resampled {
    /// As they are kept: at the dead times of all pieces.
    pub file: ResampleFile,
    /// Estimates of the requested resamples, each at its own dead times. Unit of each row
    pub(super) estimates: Vec<Vec<f64>>,
}

impl fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Job").field("name", &self.name).finish_non_exhaustive()
    }
}

impl fmt::Debug for FitResult {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("FitResult").field("fit", &self.fit).finish_non_exhaustive()
    }
}

/// The estimate along one piece: for each row its values over the steps.
pub(super) struct Trace {
    /// Position of its log.
    pub(super) log: usize,
    /// Steps of the log.
    pub(super) steps: Range<usize>,
    /// States, one value per step; no rows if they are not kept. Unit of each row
    pub(super) s: Vec<Vec<f64>>,
    /// Simulation from the first state of the piece and the applied inputs alone: observed rows, one value per step; no
    /// rows if they are not kept. Unit of each row
    pub(super) simulated: Vec<Vec<f64>>,
    /// Weighted residuals of the transitions, one value fewer than steps; no rows if they are not kept. 1
    pub(super) transition_residuals: Vec<Vec<f64>>,
    /// Weighted residuals of the observations, one value per step; NaN where nothing was observed. 1
    pub(super) observation_residuals: Vec<Vec<f64>>,
}

/// Cost over the dead time of a group of sticks.
pub(super) struct DelayResult {
    /// The estimate.
    pub(super) row: DelayRow,
    /// Dead times at which the cost was computed, ascending. s
    pub(super) dead_time_s: Vec<f64>,
    /// Half the sum of squares there. 1
    pub(super) cost: Vec<f64>,
}

/// Tasks and logs of tests.
#[cfg(test)]
pub(super) mod fixtures {
    use std::collections::BTreeSet;

    use super::Job;
    use crate::ident::IdentFileTable;
    use crate::ident::flights::Flight;
    use crate::recordings::Loaded;

    /// A task without bootstrap and flight.
    pub(in crate::ident) fn job<'a>(table: &'a IdentFileTable, logs: &'a [Loaded]) -> Job<'a> {
        Job {
            name: "ident.json",
            table,
            logs,
            bootstrap: None,
            flight: None,
            observer: &(),
            keeps_estimates: false,
        }
    }

    /// A real log from which nothing was left out.
    pub(in crate::ident) fn log(path: &str, recording: Flight) -> Loaded {
        Loaded {
            path: path.into(),
            sha256: String::new(),
            is_simulated: false,
            recording,
            skipped: Vec::new(),
            motions: BTreeSet::new(),
        }
    }
}
