//! `tello-ctl convert`: recordings between the thesis' CSV and MCAP.

use std::collections::BTreeSet;
use std::fmt::{self, Display, Formatter};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use rayon::iter::{IntoParallelRefIterator, ParallelIterator};
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::flight_log;
use tello_eval::metrics::ReferencePath;
use tello_eval::recordings::rows::{self, RowFlight};
use tello_eval::recordings::{self, ticks};
use tello_io::atomic_file;
use tello_io::log::csv::{self, CsvRow};
use tello_io::log::{CONFIG, LogReader};

use crate::{Verdict, interrupt, stdio};

/// Most digits behind the point that mean something for a number.
const DECIMALS_MAX: u8 = 17;

/// Convert recorded flights between the thesis' CSV and MCAP.
///
/// IN is a CSV flight of the thesis (tag,step,v1,v2,v3,v4), a log of tello-ctl (MCAP), or a folder of
/// them. A CSV flight becomes an MCAP file with the channels /recording/pose, /tello/command,
/// /control/target and /estim/parameter, which replay and ident read like the CSV itself, and which
/// comes back as the same CSV to the digit. A log of a flight becomes the four tags of the thesis: pos
/// (see --pos), input (sticks sent), target and param. Lines that cannot be read are left out and named, and so are
/// the phases of a log in which commands alone do not move the vehicle; dry runs and replays are refused.
///
/// A file appears when it is complete, and never replaces another without --force.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl convert flight.log -o flight.mcap            one CSV flight
  tello-ctl convert logs/thesis --out-dir mcap           every recording of a folder
  tello-ctl convert logs/today.mcap -o today.csv         a log of ours for the thesis' tools
  tello-ctl convert logs --out-dir csv --to csv --pos filtered --decimals 6

Exit codes: 0 all converted, 1 some not, or a log is torn or has gaps, 2 none.")]
pub(crate) struct Arguments {
    /// Recordings or folders of recordings.
    #[arg(value_name = "IN", required = true)]
    inputs: Vec<PathBuf>,
    /// Write the one recording to this file.
    #[arg(short, long, value_name = "FILE", required_unless_present = "out_dir")]
    out: Option<PathBuf>,
    /// Write every recording to this folder, made if it does not exist, under its own name.
    #[arg(long, value_name = "DIR", conflicts_with = "out")]
    out_dir: Option<PathBuf>,
    /// Format to write [default: the one that IN does not have].
    #[arg(long, value_enum)]
    to: Option<Format>,
    /// What becomes `pos` of a log of ours. The thesis' closed-loop logs have the estimate.
    #[arg(long, value_enum, default_value_t = Pos::Estimate)]
    pos: Pos,
    /// Digits behind the point in CSV [default: those of the original, 4 for a log of ours].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=i64::from(DECIMALS_MAX)))]
    decimals: Option<u8>,
    /// Replace files that exist.
    #[arg(long)]
    force: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Format of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// Lines of the thesis.
    Csv,
    /// Channels of records.
    Mcap,
}

impl Format {
    fn name(self) -> &'static str {
        match self {
            Self::Csv => "csv",
            Self::Mcap => "mcap",
        }
    }

    fn of(path: &Path) -> Result<Self> {
        let is_mcap = recordings::begins_as_mcap(path).context("it cannot be read")?;
        Ok(if is_mcap.context("it is empty")? { Self::Mcap } else { Self::Csv })
    }

    fn other(self) -> Self {
        match self {
            Self::Csv => Self::Mcap,
            Self::Mcap => Self::Csv,
        }
    }
}

/// Which pose of a log of ours becomes `pos`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Pos {
    /// The estimated state.
    Estimate,
    /// The last pose that the filter accepted.
    Filtered,
    /// The newest raw pose of the tick.
    Raw,
}

/// What became of the recordings.
#[derive(Debug, Serialize, JsonSchema)]
struct ConvertReport {
    files: Vec<Converted>,
}

/// What became of one recording.
#[derive(Debug, Serialize, JsonSchema)]
struct Converted {
    /// The original.
    from: PathBuf,
    /// The file written; null if there is none.
    to: Option<PathBuf>,
    /// Steps written.
    steps: usize,
    /// What of the original is not in it.
    skipped: Vec<String>,
    /// Whether the original is a whole log, or no log.
    #[serde(skip)]
    is_complete: bool,
    /// Why there is no file.
    error: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    interrupt::leave_no_unfinished_file()?;
    let (inputs, unnamed) = recordings::find(&arguments.inputs)?;
    if let (Some(out), [_, _, ..]) = (&arguments.out, &inputs[..]) {
        bail!("{} recordings do not fit into {}: give --out-dir", inputs.len(), out.display());
    }
    check_names(&inputs)?;
    if let Some(dir) = &arguments.out_dir {
        std::fs::create_dir_all(dir)
            .with_context(|| format!("cannot make the folder {}", dir.display()))?;
    }
    let refused = |from, why| Converted {
        from,
        to: None,
        steps: 0,
        skipped: Vec::new(),
        is_complete: true,
        error: Some(why),
    };
    let mut files: Vec<Converted> = inputs
        .par_iter()
        .map(|from| {
            convert(from, arguments)
                .unwrap_or_else(|error| refused(from.clone(), stdio::chain(&error)))
        })
        .collect();
    files.extend(unnamed.into_iter().map(|file| refused(file.path, file.why)));
    let report = ConvertReport { files };
    stdio::report(&report, arguments.json)?;
    report.verdict()
}

impl ConvertReport {
    /// # Errors
    /// No file was converted.
    fn verdict(&self) -> Result<Verdict> {
        let is_done = |file: &Converted| file.error.is_none();
        ensure!(self.files.iter().any(is_done), "nothing was converted");
        let is_whole = self.files.iter().all(|file| is_done(file) && file.is_complete);
        Ok(if is_whole { Verdict::Good } else { Verdict::Bad })
    }
}

/// Two recordings of one name would end in one file.
fn check_names(inputs: &[PathBuf]) -> Result<()> {
    let mut names = BTreeSet::new();
    for path in inputs {
        if !names.insert(path.file_stem()) {
            bail!(
                "{} has the name of another recording: convert them to different folders",
                path.display()
            );
        }
    }
    Ok(())
}

fn convert(from: &Path, arguments: &Arguments) -> Result<Converted> {
    let format = Format::of(from)?;
    let target = arguments.to.unwrap_or(format.other());
    if target == format {
        bail!("it is {} already", format.name());
    }
    let to = match (&arguments.out, &arguments.out_dir) {
        (Some(out), _) => out.clone(),
        (None, dir) => {
            // Not `with_extension`: of `run.1.log` the name is `run.1`.
            let mut name = from.file_stem().unwrap_or_default().to_owned();
            name.push(".");
            name.push(target.name());
            dir.as_deref().unwrap_or(Path::new(".")).join(name)
        }
    };
    atomic_file::keep_apart(from, &to)?;
    let flight = match format {
        Format::Csv => RowFlight::from(csv::read(from)?),
        Format::Mcap => of_mcap(from, arguments.pos)?,
    };
    if flight.rows.is_empty() {
        bail!("there is no step in it");
    }
    let decimals = arguments.decimals.map_or(flight.decimals, usize::from);
    atomic_file::write(&to, arguments.force, |part| match target {
        Format::Mcap => {
            let source = from.file_name().unwrap_or_default().to_string_lossy().into_owned();
            rows::write_log(part, source, &flight)
        }
        Format::Csv => write_csv(part, &flight.rows, decimals),
    })?;
    let RowFlight { rows, notes: skipped, is_complete, .. } = flight;
    let (from, to, steps) = (from.into(), Some(to), rows.len());
    Ok(Converted { from, to, steps, skipped, is_complete, error: None })
}

/// The rows of a converted recording, or of a flight of ours.
fn of_mcap(path: &Path, pos: Pos) -> Result<RowFlight> {
    let mut log = LogReader::open(path)?;
    if rows::is_recording(&log) {
        return rows::of_log(&mut log);
    }
    if !log.head().documents.contains_key(CONFIG) {
        bail!("it is neither a flight nor a converted recording");
    }
    // A log of another version may have settings that are not read any more.
    let reference =
        flight_log::settings(&log, path).and_then(|flight| Ok(ReferencePath::of(&flight)?));
    let targets_count = reference.map_or(usize::MAX, |reference| reference.targets_count);
    let mut notes = Vec::new();
    if flight_log::is_simulated(&log) {
        notes.push("that its vehicle was simulated, which CSV cannot state".to_owned());
    }
    let ticks = ticks::commanded(&mut log, &mut notes)?;
    let row = |tick: &ticks::TickRow| CsvRow {
        step: tick.period,
        pos: match pos {
            Pos::Estimate => tick.estimate,
            Pos::Filtered => tick.filtered.map(|(o, _)| o),
            Pos::Raw => tick.raw,
        },
        input: tick.u_sent,
        // A recording whose last target is reached has none any more: what follows is no part of its mission.
        target: tick.target.filter(|_| targets_count < 2 || tick.targets_reached < targets_count),
        param: tick.param,
    };
    let is_complete = rows::is_complete(&log);
    Ok(RowFlight {
        rows: ticks.iter().map(row).collect(),
        decimals: csv::THESIS_DECIMALS,
        notes,
        is_complete,
    })
}

fn write_csv(path: &Path, rows: &[CsvRow], decimals: usize) -> Result<()> {
    let mut out = BufWriter::new(File::create_new(path)?);
    for row in rows {
        row.write(&mut out, decimals)?;
    }
    out.flush()?;
    out.get_ref().sync_data()?;
    Ok(())
}

impl Display for ConvertReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for file in &self.files {
            let from = file.from.display();
            match (&file.to, &file.error) {
                (Some(to), _) => writeln!(f, "{from} -> {}: {} steps", to.display(), file.steps)?,
                (None, error) => writeln!(f, "{from}: {}", error.as_deref().unwrap_or_default())?,
            }
            for note in &file.skipped {
                writeln!(f, "  skipped {note}")?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
