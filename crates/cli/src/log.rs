//! `tello-ctl log`: what a log is, what of it can be saved, and its records as tables.
//!
//! Owns the command. Reading, writing and mending are `io::log`, tables `tello_eval::log_tables`.

use std::collections::BTreeMap;
use std::fmt::{self, Display, Formatter};
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, ensure};
use clap::{Args, Subcommand};
use schemars::JsonSchema;
use serde::Serialize;
use tello_eval::log_tables;
use tello_eval::ros2::{self, Exported};
use tello_io::atomic_file;
use tello_io::clock::CivilTime;
use tello_io::log::{Ending, LogReader, Recovered, recover};

use crate::{Verdict, interrupt, stdio};

/// Look into logs, mend torn ones, and turn them into tables.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl log info logs/today.mcap                     who wrote it, its channels, how it ends
  tello-ctl log recover torn.mcap -o mended.mcap         all chunks of it that are whole
  tello-ctl log csv logs/today.mcap --out-dir today      a table for each channel
  tello-ctl log ros2 logs/today.mcap -o poses.mcap       the flight as ROS 2 messages

Exit codes: 0 done, 1 info, csv and ros2: the log is torn or has gaps, or a record is
unreadable; recover: no message was saved, or bytes behind the end of the log were not read, 2 could not run.")]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Show who wrote a log and when, its channels with the number of their messages, and how it ends.
    Info {
        /// The log.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Print one JSON object.
        #[arg(long)]
        json: bool,
    },
    /// Write a complete log of a torn or damaged one: every chunk that is whole.
    Recover {
        /// The torn log; it is not touched.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// The new log.
        #[arg(short, long, value_name = "FILE")]
        out: PathBuf,
    },
    /// Write the flight as ROS 2 messages into a new MCAP file, for `rosbags` and ROS: pose, transform, velocity,
    /// state, reference, target, plan, diagnostics, battery.
    Ros2 {
        /// The log.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// The new file.
        #[arg(short, long, value_name = "FILE")]
        out: PathBuf,
        /// Replace a file that exists.
        #[arg(long)]
        force: bool,
    },
    /// Write a CSV table for each channel: the time in s since the start of the log, and a column for each
    /// number, text or flag of its records. Of a list within a record each place is a column.
    Csv {
        /// The log.
        #[arg(value_name = "FILE")]
        file: PathBuf,
        /// Folder of the tables, made if it does not exist: `estim_state.csv` for `/estim/state`.
        #[arg(long, value_name = "DIR")]
        out_dir: PathBuf,
        /// Only these channels.
        #[arg(long, value_name = "TOPIC", num_args = 1..)]
        topic: Vec<String>,
        /// Replace tables that exist.
        #[arg(long)]
        force: bool,
    },
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    interrupt::leave_no_unfinished_file()?;
    match &arguments.command {
        Command::Info { file, json } => {
            let info = Info::of(file)?;
            stdio::report(&info, *json)?;
            Ok(if info.is_complete { Verdict::Good } else { Verdict::Bad })
        }
        Command::Recover { file, out } => {
            refuse_unreadable(file)?;
            ensure!(
                !atomic_file::is_there(out),
                "{} exists already: choose another name",
                out.display()
            );
            let recovered = atomic_file::write(out, false, |part| Ok(recover(file, part)?))?;
            report_recovered(file, out, recovered)
        }
        Command::Ros2 { file, out, force } => {
            refuse_unreadable(file)?;
            atomic_file::keep_apart(file, out)?;
            let Exported { messages, ending } =
                atomic_file::write(out, *force, |part| ros2::export(file, part))?;
            if messages.is_empty() {
                stdio::note(format_args!(
                    "note: {} holds no tick: no message is written",
                    file.display()
                ));
            }
            for (topic, count) in messages {
                stdio::line(format_args!("{topic:<24} {count:>8}"))?;
            }
            Ok(whole(file, ending))
        }
        Command::Csv { file, out_dir, topic, force } => {
            let tables = log_tables::write(file, out_dir, topic, *force)?;
            for table in tables.lines {
                stdio::line(table)?;
            }
            let verdict = whole(file, tables.ending);
            if tables.unreadable == 0 {
                return Ok(verdict);
            }
            stdio::note(format_args!("{} records are no JSON: left out", tables.unreadable));
            Ok(Verdict::Bad)
        }
    }
}

/// Refuses a file that cannot be read, which is no failure of the file that is written.
fn refuse_unreadable(file: &Path) -> Result<()> {
    let read = || File::open(file)?.read(&mut [0]);
    read().map(drop).with_context(|| format!("cannot read {}", file.display()))
}

/// Prints what became of the log `file`; bad if not all of it was read.
fn report_recovered(file: &Path, out: &Path, recovered: Recovered) -> Result<Verdict> {
    let Recovered { messages, was_torn, rest_bytes, unread_bytes, damaged } = recovered;
    let state = match (was_torn, damaged.len()) {
        (false, _) => "complete already",
        (true, 0) => "torn",
        (true, _) => "damaged",
    };
    for (first_s, last_s) in damaged {
        stdio::note(format_args!("a damaged chunk is left out: {first_s:.2} s to {last_s:.2} s"));
    }
    if unread_bytes > 0 {
        stdio::note(format_args!("{unread_bytes} bytes hold no whole record: left out"));
    }
    let (file, out) = (file.display(), out.display());
    stdio::line(format_args!("{file} was {state}: {messages} messages are in {out}"))?;
    if rest_bytes == 0 {
        let is_saved = messages > 0 || !was_torn;
        return Ok(if is_saved { Verdict::Good } else { Verdict::Bad });
    }
    stdio::note(format_args!(
        "{rest_bytes} bytes behind its end are not read, perhaps another log: `tail -c {rest_bytes} {file} > REST.mcap` \
         makes it a file of its own"
    ));
    Ok(Verdict::Bad)
}

/// Whether the log that was written out is complete; a note if not.
fn whole(file: &Path, ending: Option<Ending>) -> Verdict {
    match ending {
        Some(ending) if !ending.is_complete() => {
            stdio::note(format_args!("{}: {ending}; what it holds was written", file.display()));
            Verdict::Bad
        }
        _ => Verdict::Good,
    }
}

/// What a log is.
#[derive(Debug, Serialize, JsonSchema)]
struct Info {
    file: PathBuf,
    /// Size of the file. bytes
    bytes: u64,
    /// Version and revision of the program that wrote it.
    version: String,
    revision: String,
    /// Wall-clock time of its zero. ns since 1970-01-01 UTC
    started_unix_ns: u64,
    /// Documents in its head.
    documents: Vec<String>,
    /// Time from its first message to its last. s
    lasts_s: f64,
    /// Messages of each channel that has one.
    channels: BTreeMap<String, u64>,
    messages: u64,
    is_complete: bool,
    /// How it ends, in words.
    ending: String,
    #[serde(skip)]
    is_torn: bool,
}

impl Info {
    fn of(file: &Path) -> Result<Self> {
        let mut log = LogReader::open(file)?;
        let mut channels: BTreeMap<String, u64> = BTreeMap::new();
        let mut span: Option<(f64, f64)> = None;
        while let Some(message) = log.next_message()? {
            let t_s = message.t.seconds();
            span = Some(span.map_or((t_s, t_s), |(first, last)| (first.min(t_s), last.max(t_s))));
            match channels.get_mut(message.topic) {
                Some(count) => *count += 1,
                None => drop(channels.insert(message.topic.to_owned(), 1)),
            }
        }
        let head = log.head();
        Ok(Self {
            file: file.to_owned(),
            bytes: std::fs::metadata(file)?.len(),
            version: head.version.clone(),
            revision: head.revision.clone(),
            started_unix_ns: head.started_unix_ns,
            documents: head.documents.keys().cloned().collect(),
            lasts_s: span.map_or(0.0, |(first, last)| last - first),
            messages: channels.values().sum(),
            channels,
            is_complete: log.ending().is_some_and(Ending::is_complete),
            ending: log.ending().map_or_else(String::new, ToString::to_string),
            is_torn: matches!(log.ending(), Some(Ending::Torn { .. })),
        })
    }
}

impl Display for Info {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "log        {}, {} bytes", self.file.display(), self.bytes)?;
        writeln!(f, "written by tello-ctl {} ({})", self.version, self.revision)?;
        let started = i64::try_from(self.started_unix_ns).unwrap_or(0);
        let started = CivilTime::from_unix_ns(started).date_and_time();
        writeln!(f, "started    {started}")?;
        writeln!(f, "documents  {}", self.documents.join(", "))?;
        writeln!(f, "lasts      {:.2} s, {} messages", self.lasts_s, self.messages)?;
        for (topic, count) in &self.channels {
            writeln!(f, "  {topic:<24} {count:>8}")?;
        }
        writeln!(f, "ending     {}", self.ending)?;
        if self.is_torn {
            writeln!(f, "           `tello-ctl log recover` saves what is whole")?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests;
