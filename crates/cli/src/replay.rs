//! `tello-ctl replay`: a recorded flight through the same tick again.
//!
//! A log of ours is repeated and compared, channel by channel and bit by bit. A CSV flight of the
//! thesis, converted or not, has no inbox to repeat: its poses and sticks run through filter and
//! estimator, which are asked at each tick where the vehicle will be.

mod compare;
mod drawn_log;
mod foresight;
mod recording;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use tello_eval::recordings::{self, MCAP_MAGIC, rows};
use tello_io::log::LogReader;

use crate::{Verdict, say};

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
/// all while its link monitor believes that they do not. The answer is held against the recorded pose of
/// that time, if the filter of --config believes it and it is above 0.3 m. A pose that another estimator
/// wrote, as in the closed-loop logs of the thesis, is no measurement: errors below a few centimetres
/// are also that estimator's. Settings and constant velocity are judged on the same moments.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 equal (or CSV flights that flew), 1 different, or not judged: torn, a tick \
missing, never steered or never airborne, 2 not readable or without a tick."
)]
pub(crate) struct Arguments {
    /// One log of ours, or recordings and folders of recordings.
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Settings of the controller, in place of the log's own.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Run CSV flights through these settings, too, and show both.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Identified parameters (model kinematic), in place of the settings' prior and dead times.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Write the repeated flight to this log [default for one CSV flight: logs/NAME-replay.mcap, for
    /// several: none].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let logs = recordings::find(&arguments.logs)?;
    let mut flights = Vec::with_capacity(logs.len());
    for log in &logs {
        let is_mcap = is_mcap(log)?;
        if is_mcap && !rows::is_recording(&LogReader::open(log)?) {
            if logs.len() > 1 {
                bail!("{} is a log of tello-ctl: it is repeated alone", log.display());
            }
            if arguments.against.is_some() {
                bail!("--against is for recordings of others: a log of tello-ctl has its settings");
            }
            let report = compare::run(log, arguments)?;
            say::report(&report, arguments.json)?;
            return Ok(if report.is_equal { Verdict::Good } else { Verdict::Bad });
        }
        flights.push(rows::read(log, is_mcap)?);
    }
    let report = recording::run(&logs, &flights, arguments)?;
    say::report(&report, arguments.json)?;
    Ok(if report.is_airborne() { Verdict::Good } else { Verdict::Bad })
}

fn is_mcap(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MCAP_MAGIC.len() as u64).read_to_end(&mut head))
        .with_context(|| format!("cannot read {}", path.display()))?;
    anyhow::ensure!(!head.is_empty(), "{} is empty: there is no flight in it", path.display());
    Ok(head == MCAP_MAGIC)
}
