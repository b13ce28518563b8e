//! `tello-ctl replay`: a recorded flight through the same tick again.
//!
//! A log of ours is repeated and compared, channel by channel and bit by bit. A CSV flight of the
//! thesis, converted or not, has no inbox to repeat: its poses and sticks run through filter and
//! estimator, and a log of ours comes out.

mod compare;
mod recording;

use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clap::Args;
use tello_io::log::LogReader;

use crate::Verdict;
use crate::recordings::{MCAP_MAGIC, rows};

/// Run a recorded flight through the loop again and compare it, channel by channel.
///
/// LOG is a log of tello-ctl (MCAP) or a CSV flight of the thesis (tag,step,v1,v2,v3,v4), also one
/// that was converted to MCAP. A log is repeated with its own settings, or with those of --config and
/// --params, and must come out bit by bit equal; the first difference of every channel is shown. A CSV
/// flight runs through filter and estimator with its own sticks, and the result is written as a log.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 equal (or a CSV flight that flew), 1 different, torn or never \
airborne, 2 not readable."
)]
pub(crate) struct Arguments {
    /// The recorded flight.
    log: PathBuf,
    /// Settings of the controller, in place of the log's own.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Identified parameters (model kinematic), in place of the settings' prior and dead times.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Write the repeated flight to this log [default for a CSV flight: logs/NAME-replay.mcap].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let is_mcap = is_mcap(&arguments.log)?;
    if is_mcap && !rows::is_recording(&LogReader::open(&arguments.log)?) {
        let report = compare::run(arguments)?;
        print(arguments, &report, &serde_json::to_value(&report)?);
        Ok(if report.is_equal { Verdict::Good } else { Verdict::Bad })
    } else {
        let report = recording::run(arguments, is_mcap)?;
        print(arguments, &report, &serde_json::to_value(&report)?);
        Ok(if report.is_airborne() { Verdict::Good } else { Verdict::Bad })
    }
}

fn print(arguments: &Arguments, text: &impl std::fmt::Display, json: &serde_json::Value) {
    if arguments.json {
        println!("{json}");
    } else {
        print!("{text}");
    }
}

fn is_mcap(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MCAP_MAGIC.len() as u64).read_to_end(&mut head))
        .with_context(|| format!("cannot read {}", path.display()))?;
    anyhow::ensure!(!head.is_empty(), "{} is empty: there is no flight in it", path.display());
    Ok(head == MCAP_MAGIC)
}
