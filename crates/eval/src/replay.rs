//! A recorded flight through the same tick again.
//!
//! A log of ours is repeated and compared, channel by channel and bit by bit. A CSV flight of the
//! thesis, converted or not, has no inbox to repeat: its poses and sticks run through filter and
//! estimator, which are asked at each tick where the vehicle will be.

mod compare;
mod drawn_log;
mod forecast_errors;
mod recording;

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use serde::Serialize;
use tello_flight::cycle::FlightTable;
use tello_io::log::LogReader;

use crate::flight_log::TickRecord;
use crate::recordings::{self, FileSkipped, rows};

/// How flights are repeated.
#[derive(Debug, Clone, Copy, Default)]
pub struct Options<'a> {
    /// Settings of the controller, in place of the log's own.
    pub config: Option<&'a Path>,
    /// Run recordings of others through these settings, too.
    pub against: Option<&'a Path>,
    /// Identified parameters, in place of the settings' prior and dead times.
    pub params: Option<&'a Path>,
    /// Write the repeated flight to this log.
    pub out: Option<&'a Path>,
}

/// Watches a log of ours while it is repeated: gets the settings, and each tick with its logged times.
pub type TickObserver<'a> = &'a mut dyn FnMut(&FlightTable, &TickRecord) -> Result<()>;

/// Result of a replay.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Replayed {
    /// A log of ours, compared bit by bit.
    Compared(compare::ReplayReport),
    /// Recordings of others with forecasts.
    Forecast(recording::ForecastReport),
}

impl Replayed {
    /// Conclusion about a log of this program, in a line; `None` for other recordings.
    pub fn verdict(&self) -> Option<String> {
        match self {
            Self::Compared(report) => Some(report.verdict()),
            Self::Forecast(_) => None,
        }
    }

    /// Whether a log of ours is equal, or every recording was judged.
    pub fn is_good(&self) -> bool {
        match self {
            Self::Compared(report) => report.is_equal,
            Self::Forecast(report) => report.is_judged(),
        }
    }
}

impl Display for Replayed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Compared(report) => report.fmt(f),
            Self::Forecast(report) => report.fmt(f),
        }
    }
}

/// Repeats one log of ours, or recordings and folders of recordings.
///
/// # Errors
/// A file cannot be read, or what is asked for does not fit to it; the first error of `watch`.
pub fn run(
    logs: &[PathBuf],
    options: &Options<'_>,
    watch: Option<TickObserver<'_>>,
) -> Result<Replayed> {
    let (logs, unnamed) = recordings::find(logs)?;
    if let Some(FileSkipped { path, why }) = unnamed.first() {
        bail!("{}: {why}", path.display());
    }
    let mut flights = Vec::with_capacity(logs.len());
    for log in &logs {
        let is_mcap = recordings::is_mcap(log)?;
        if is_mcap && !rows::is_recording(&LogReader::open(log)?) {
            if logs.len() > 1 {
                bail!("{} is a log of tello-ctl: it is repeated alone", log.display());
            }
            if options.against.is_some() {
                bail!("--against is for recordings of others: a log of tello-ctl has its settings");
            }
            return compare::run(log, options, watch).map(Replayed::Compared);
        }
        flights.push(rows::read(log, is_mcap)?);
    }
    if watch.is_some() {
        bail!("--view is for a log of tello-ctl: recordings of others have no plans and no phases");
    }
    recording::run(&logs, &flights, options).map(Replayed::Forecast)
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    fn refused(name: &str, content: &str, watch: Option<TickObserver<'_>>) -> String {
        let name = format!("tello-ctl-replay-{}-{name}", std::process::id());
        let path = std::env::temp_dir().join(name);
        fs::write(&path, content).unwrap();
        let refused = run(std::slice::from_ref(&path), &Options::default(), watch);
        fs::remove_file(&path).unwrap();
        format!("{:#}", refused.unwrap_err())
    }

    #[test]
    fn an_empty_file_is_no_flight_and_a_recording_of_others_has_nothing_to_watch() {
        let error = refused("empty.log", "", None);
        assert!(error.ends_with("is empty: there is no flight in it"), "{error}");
        let ticks = "pos,0,0,0,1,0\ninput,0,0,0,0,0\npos,1,0,0,1,0\ninput,1,0,0,0,0\n";
        let error = refused("watched.log", ticks, Some(&mut |_, _| Ok(())));
        assert!(error.starts_with("--view is for a log of tello-ctl"), "{error}");
    }
}
