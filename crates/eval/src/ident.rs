//! Identification of a vehicle from recorded flights.
//!
//! Owns the way from recordings to parameters with their uncertainty: pieces, estimate, dead times,
//! bootstrap, notes for the user, comparison of models by prediction, files and figures. The estimate
//! itself is `horizon-estim`.

mod acceptance;
mod compare;
mod fit;
mod flights;
mod inverted_sticks;
mod job;
mod logs;
mod output;
mod pictures;
mod predict;
mod report;
mod resamples;
mod table;
mod warnings;

use std::path::Path;

use anyhow::{Context, Result};
use serde_json::Value;
use tello_io::config;

pub use acceptance::flight_settings;
pub use compare::{Comparison, Errors, Ranked, compare};
pub use fit::fit;
pub use job::{FitResult, Job};
pub use logs::{load_judged, load_logs};
pub use output::{is_earlier, results, write};
pub use pictures::save_prediction;
pub use report::{
    Bootstrap, DelayMinimum, DelayRow, FileUsed, FitReport, IdentReport, ParameterRow,
};
pub use resamples::{BootstrapPlan, ResampleFile};
pub use table::{IdentFileTable, Stick};

/// The built-in settings of the identification, as JSON.
pub const BUILT_IN: &str = include_str!("../../../configs/ident.json");

/// The settings in `path`, or the built-in ones.
///
/// # Errors
/// All mistakes of the file, as [`config::Problems`].
pub fn settings(path: Option<&Path>) -> Result<IdentFileTable> {
    let Some(path) = path else {
        return config::parse(BUILT_IN).context("in the built-in configs/ident.json");
    };
    let template = |_: &Value| config::parse(BUILT_IN).ok();
    config::problems(path, template, IdentFileTable::check).into_result()?;
    config::load(path)
}

/// The caller of a long computation: it is shown the progress and may ask to stop.
pub trait Observer: Sync {
    /// Whether the computation shall stop as soon as possible.
    fn is_stopped(&self) -> bool {
        false
    }

    /// A part of the computation begins, of `count` equal steps if that is known.
    fn begin(&self, _part: &str, _count: Option<u64>) {}

    /// One step of the part is done.
    fn advance(&self) {}

    /// The part is done.
    fn end(&self) {}
}

/// Shows nothing and never stops.
impl Observer for () {}
