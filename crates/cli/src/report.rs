//! `tello-ctl report`: recorded flights as one page, figures and numbers.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use tello_eval::report;
use tello_io::atomic_file;

use crate::{Verdict, stdio};

/// Make a page of recorded flights: was it good, and why not; numbers and figures.
///
/// LOG is a log of tello-ctl (MCAP), a CSV flight of the thesis, or a folder of them. The page is one HTML
/// file with everything inside: it needs no network and opens from the disk, light or dark, and prints.
/// Numbers are those of section 5.2.3 of the thesis with the definitions that reproduce them, and are named
/// in the page. With --against a second group of flights stands beside the first, with the differences
/// flight by flight: of the same name, or else in their order.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl report logs/today.mcap                       one flight
  tello-ctl report flights --figures figures             a folder of flights, figures as SVG files too
  tello-ctl report new --against old --out compared.html
  tello-ctl report flights --json                        the numbers of the page

Exit codes: 0 done, 1 some files could not be used, 2 none could, or the page could not be written.")]
pub(crate) struct Arguments {
    /// Recordings or folders of recordings.
    #[arg(value_name = "LOG", required = true)]
    logs: Vec<PathBuf>,
    /// Where the page goes; an older page is replaced, any other file is not.
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
    /// Recordings or folders of recordings to compare with.
    #[arg(long, value_name = "LOG", num_args = 1..)]
    against: Vec<PathBuf>,
    /// Write every figure of the page as an SVG file to this folder, too, made if it does not exist.
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    report::replaces_a_page(&arguments.out)?;
    let page = report::page_of(&arguments.logs, &arguments.against, &arguments.out)?;
    atomic_file::write_contents(&arguments.out, true, &page.html)?;
    if let Some(dir) = &arguments.figures {
        page.save_figures(dir)?;
    }
    stdio::report(&page.report, arguments.json)?;
    Ok(if page.report.unusable.is_empty() { Verdict::Good } else { Verdict::Bad })
}
