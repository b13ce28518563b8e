//! `tello-ctl report`: recorded flights as one page, figures and numbers.

use std::fs;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use clap::Args;
use tello_eval::report::{self, GENERATOR};
use tello_io::whole_file;

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
    replaces_a_page(&arguments.out)?;
    let page = report::of(&arguments.logs, &arguments.against, &arguments.out)?;
    whole_file::write(&arguments.out, true, |part| Ok(fs::write(part, &page.html)?))?;
    if let Some(dir) = &arguments.figures {
        page.save_figures(dir)?;
    }
    stdio::report(&page.report, arguments.json)?;
    Ok(if page.report.unusable.is_empty() { Verdict::Good } else { Verdict::Bad })
}

/// Refuses a page that could not be written, and one that would replace a file that is no page of this program: a log
/// may be the only one of its flight.
///
/// # Errors
/// The file is there and does not begin as our pages do, or cannot be read, or its folder cannot be written.
pub(crate) fn replaces_a_page(path: &Path) -> Result<()> {
    whole_file::probe(path)?;
    if !path.is_file() {
        return Ok(());
    }
    let mut start = Vec::new();
    let at = || format!("cannot replace {}", path.display());
    let file = fs::File::open(path).with_context(at)?;
    file.take(HEAD_BYTES).read_to_end(&mut start).with_context(at)?;
    let is_page = start.is_empty() || String::from_utf8_lossy(&start).contains(GENERATOR);
    ensure!(is_page, "{} exists and is no page of tello-ctl: choose another name", path.display());
    Ok(())
}

/// Within which a page says by which program it was made. bytes
const HEAD_BYTES: u64 = 1024;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_replaced_and_a_log_is_not() {
        let path = std::env::temp_dir().join(format!("tello-ctl-page-{}", std::process::id()));
        assert!(replaces_a_page(&path).is_ok(), "there is no file");
        let page = format!("<!DOCTYPE html>\n<html>\n<head>\n{GENERATOR}");
        for (text, is_fine) in
            [("", true), (&page, true), ("<!DOCTYPE html>", false), ("\u{89}MCAP0", false)]
        {
            fs::write(&path, text).unwrap();
            assert_eq!(replaces_a_page(&path).is_ok(), is_fine, "{text:?}");
        }
        fs::remove_file(path).unwrap();
    }
}
