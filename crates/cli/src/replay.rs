//! `tello-ctl replay`: a recorded flight through the same tick again.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use tello_eval::flight_log::TickRecord;
use tello_eval::replay::{self, Options, Replayed};
use tello_eval::report;
use tello_flight::cycle::FlightTable;
use tello_io::atomic_file;

use crate::fly::Playback;
use crate::{Verdict, interrupt, stdio};

/// Run recorded flights through the loop again: compare, or see how far ahead the estimator sees.
///
/// LOG is a log of tello-ctl (MCAP), or CSV flights of the thesis (tag,step,v1,v2,v3,v4), also converted
/// to MCAP, and folders of them. A log of ours is repeated with its own settings, or with those of
/// --config and --params, and must come out bit by bit equal; the first difference of every channel is
/// shown.
///
/// CSV flights run through filter and estimator with their own sticks. At every tick the estimator, which
/// knows nothing later, is asked where the vehicle will be 0.2, 0.6 and 1 s later. It is given the sticks
/// that were really sent in between, and lets them act after the dead times of its settings, or not at
/// all while its link monitor reports an outage. The answer is held against the recorded pose of
/// that time, if the filter of --config accepts it and it is above 0.3 m. A pose that another estimator
/// wrote, as in the closed-loop logs of the thesis, is no measurement: errors below a few centimetres
/// are also that estimator's. Settings and constant velocity are judged on the same moments.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 equal (or CSV flights that were judged), 1 different, or not judged: torn, a tick \
missing, never steered, never airborne or without an accepted pose, 2 not readable or without a tick."
)]
pub(crate) struct Arguments {
    /// One log of ours, or recordings and folders of recordings.
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Settings of the controller, in place of the log's own; the mission of a log of ours stays.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Run CSV flights through these settings, too, and show both.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Identified parameters, in place of the settings' prior and dead times.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Write the repeated flight to this log [default for one CSV flight: logs/NAME-replay.mcap, for
    /// several: none].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Write a page that plays the flight of a log of ours as `fly --view` shows it: one file that needs no
    /// server and no network. An older one is replaced.
    #[arg(long, value_name = "FILE")]
    view: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let Arguments { logs, config, against, params, out, view, json } = arguments;
    let options = Options {
        config: config.as_deref(),
        against: against.as_deref(),
        params: params.as_deref(),
        out: out.as_deref(),
    };
    if let (Some(log), Some(page)) = (out, view) {
        ensure!(log != page, "--out and --view are both {}: choose two names", log.display());
    }
    interrupt::leave_no_unfinished_file()?;
    let replayed = match view {
        Some(page) => played(logs, &options, page)?,
        None => replay::run(logs, &options, None)?,
    };
    stdio::report(&replayed, *json)?;
    Ok(if replayed.is_good() { Verdict::Good } else { Verdict::Bad })
}

/// Repeats a log and writes a page that plays it.
fn played(logs: &[PathBuf], options: &Options<'_>, page: &Path) -> Result<Replayed> {
    report::replaces_a_page(page)?;
    let mut playback: Option<Playback> = None;
    let mut watch = |flight: &FlightTable, tick: &TickRecord| -> Result<()> {
        if playback.is_none() {
            playback = Some(Playback::new(flight)?);
        }
        playback.iter_mut().try_for_each(|playback| playback.add(tick))
    };
    let replayed = replay::run(logs, options, Some(&mut watch))?;
    let playback = playback.context("no tick of the log is whole: there is nothing to play")?;
    let note = replayed.verdict().filter(|_| !replayed.is_good());
    let note = note.map(|verdict| format!("This is the repeated flight; the log is {verdict}"));
    let html = playback.page(note.as_deref())?;
    atomic_file::write_contents(page, true, html)?;
    Ok(replayed)
}
