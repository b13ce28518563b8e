//! `tello-ctl merge`: the parts of a batch, a campaign or a bootstrap become what one process prints.

mod watch;

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use tello_eval::ident::ResampleFile;
use tello_eval::part_file::{self, Kind};
use tello_sim::batch;
use tello_sim::campaign::Campaign;

use crate::{Verdict, sim, stdio};

/// Merge the part files of `sim --shard` and `ident --shard`.
///
/// Prints bit for bit what one process prints for all seeds. Of a bootstrap it prints a table, and with --json the file
/// bootstrap.json that one process writes, for `ident --resume`. Refuses parts that are missing, there twice, torn,
/// or of other settings, logs, seeds or another revision of the program; nothing is printed then.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  tello-ctl sim --batch 1000 --campaign --shard 1/2 --part a.part
  tello-ctl sim --batch 1000 --campaign --shard 2/2 --part b.part
  tello-ctl merge a.part b.part
  tello-ctl merge --watch run1                        as soon as all parts are there

Exit codes: 0 done, 1 a campaign found something or Ctrl-C came first, 2 the parts are not a whole.")]
pub(crate) struct Arguments {
    /// Part files, in any order.
    #[arg(required_unless_present = "watch", conflicts_with = "watch")]
    parts: Vec<PathBuf>,
    /// Wait until all parts are in this folder (`*.part`), with their progress, rate and remaining time on the standard
    /// error. Ctrl-C ends it.
    #[arg(long, value_name = "DIR")]
    watch: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    match &arguments.watch {
        None => merge(&arguments.parts, arguments.json),
        Some(folder) => match watch::wait(folder)? {
            Some(parts) => merge(&parts, arguments.json),
            None => Ok(Verdict::Bad),
        },
    }
}

fn merge(parts: &[PathBuf], is_json: bool) -> Result<Verdict> {
    let first = parts.first().context("no part to merge")?;
    match part_file::kind(first)? {
        Kind::Batch => {
            let (header, rows) = part_file::merge(parts)?;
            let flown = batch::by_contender(rows);
            sim::print_batches(&flown, header.names, header.seed, is_json)?;
            Ok(Verdict::Good)
        }
        Kind::Campaign => {
            let (_, rows) = part_file::merge(parts)?;
            sim::print_campaign(&Campaign::of(rows), is_json)
        }
        Kind::Bootstrap => {
            let merged = ResampleFile::merge(parts)?;
            if is_json { stdio::line(merged.json()?) } else { stdio::report(&merged, false) }?;
            Ok(Verdict::Good)
        }
    }
}
