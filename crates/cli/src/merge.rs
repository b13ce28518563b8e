//! `tello-ctl merge`: the parts of a batch or a campaign become what one process prints.

use std::path::PathBuf;

use anyhow::{Context, Result};
use clap::Args;
use tello_sim::batch;
use tello_sim::campaign::Campaign;
use tello_sim::part::{self, Kind};

use crate::{Verdict, sim};

/// Merge the part files of `sim --shard`.
///
/// Prints bit for bit what one process prints for all seeds. Refuses parts that are missing, there twice, torn,
/// or of other settings, seeds or another revision of the program; nothing is printed then.
#[derive(Debug, Args)]
#[command(after_help = "Example:
  tello-ctl sim --batch 1000 --campaign --shard 1/2 --part a.part
  tello-ctl sim --batch 1000 --campaign --shard 2/2 --part b.part
  tello-ctl merge a.part b.part

Exit codes: 0 done, 1 a campaign found something, 2 the parts are not a whole.")]
pub(crate) struct Arguments {
    /// Part files, in any order.
    #[arg(required = true)]
    parts: Vec<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let first = arguments.parts.first().context("no part to merge")?;
    match part::kind(first)? {
        Kind::Batch => {
            let (head, rows) = part::merge(&arguments.parts)?;
            let flown = batch::by_contender(rows);
            sim::print_batches(&flown, head.names, head.seed, arguments.json)?;
            Ok(Verdict::Good)
        }
        Kind::Campaign => {
            let (_, rows) = part::merge(&arguments.parts)?;
            sim::print_campaign(&Campaign::of(rows), arguments.json)
        }
    }
}
