//! The log of a flight: which records a tick leaves, and how a flight is found again.
//!
//! Bytes and files are `io::log`; channels and their schemas are [`Topic`]. Thread in flight: the log's, not the
//! tick's. Allocates.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use schemars::schema_for;
use serde::Serialize;
use serde_json::Value;
use tello_flight::cycle::{FlightTable, Inbox, Outcome, Sink, Timing, Topic};
use tello_io::clock::TimeNs;
use tello_io::config;
use tello_io::log::{CONFIG, Channel, Head, LogError, LogReader, LogWriter};
use tello_io::mocap::StreamReport;
use tello_io::tello::LinkReport;

use crate::{REVISION, scene};

/// State of the mocap stream: about the link, not of a tick, so that no replay repeats it.
pub const STREAM: &str = "/vicon/stream";

/// State of the link to the drone, and what was sent in place of the control thread: no replay repeats it.
pub const LINK: &str = "/tello/link";

/// Document of a log that repeats another one: its flight is counted there.
const REPLAY: &str = "replay.json";

/// Document of a log whose vehicle was simulated. Logs of older versions have none.
const SIMULATED: &str = "simulated.json";

/// Removed keys of earlier settings, each with the pointer to its parent.
const REMOVED_KEYS: [(&str, &str); 1] = [("/cycle/monitors", "unproven_stick_max")];

/// Record of one tick in the log.
#[derive(Debug, Clone)]
pub struct TickRecord {
    /// The inputs of the tick.
    pub inbox: Inbox,
    /// The output of the tick.
    pub out: Outcome,
    /// How long it took.
    pub timing: Timing,
}

impl TickRecord {
    /// A record with the buffers of `out`.
    pub fn with_buffers(out: &Outcome) -> Self {
        Self { inbox: Inbox::new(), out: out.clone(), timing: Timing::default() }
    }
}

/// Where the ticks of a log come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// A flight.
    Flown,
    /// A flight of a simulated vehicle.
    Simulated,
    /// Another log, repeated.
    Repeated,
}

/// Creates the log of a flight at `path`, with its settings at the head; arguments as [`create_of`].
///
/// # Errors
/// As [`LogWriter::create`].
pub fn create(
    path: &Path,
    flight: &FlightTable,
    started_unix_ns: u64,
    shape: &Outcome,
) -> Result<LogWriter> {
    create_of(Origin::Flown, path, flight, started_unix_ns, shape)
}

/// Creates the log at `path` of ticks from `origin`, marked as such, with the settings of the flight at its head.
///
/// `shape` is any outcome of the flight's cycle.
///
/// # Errors
/// As [`LogWriter::create`].
pub fn create_of(
    origin: Origin,
    path: &Path,
    flight: &FlightTable,
    started_unix_ns: u64,
    shape: &Outcome,
) -> Result<LogWriter> {
    let mark = match origin {
        Origin::Flown => None,
        Origin::Simulated => Some((SIMULATED, "{ \"is_simulated\": true }")),
        Origin::Repeated => Some((REPLAY, "{ \"is_replay\": true }")),
    };
    let settings = serde_json::to_string_pretty(flight)?;
    let documents = mark.map(|(name, text)| (name.to_owned(), text.to_owned()));
    let head = Head {
        started_unix_ns,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        revision: REVISION.to_owned(),
        documents: documents.into_iter().chain([(CONFIG.to_owned(), settings)]).collect(),
    };
    Ok(LogWriter::create(path, &head, &channels(shape))?)
}

/// Whether the log repeats another one.
pub(crate) fn is_replay(log: &LogReader) -> bool {
    log.head().documents.contains_key(REPLAY)
}

/// Whether the log is marked as one of a simulated vehicle.
pub fn is_simulated(log: &LogReader) -> bool {
    log.head().documents.contains_key(SIMULATED)
}

/// The channels of a flight's log; `shape` is any outcome of its cycle.
pub fn channels(shape: &Outcome) -> Vec<Channel> {
    let channel = |topic: &Topic| Channel {
        topic: topic.name(),
        schema_name: topic.schema_name(),
        schema: topic.schema(shape.state_rows, shape.parameter_rows).into(),
    };
    let mut channels: Vec<_> = Topic::ALL.iter().map(channel).collect();
    let schema = schema_for!(StreamReport).into();
    channels.push(Channel { topic: STREAM, schema_name: "Stream", schema });
    let schema = schema_for!(LinkReport).into();
    channels.push(Channel { topic: LINK, schema_name: "DroneLink", schema });
    channels.extend(scene::channels());
    channels
}

/// Appends all records of a tick, the inbox first.
///
/// # Errors
/// As [`LogWriter::write`].
pub fn write_tick(log: &mut LogWriter, tick: &TickRecord) -> Result<(), LogError> {
    let mut sink = LogSink { t: tick.inbox.now, log };
    sink.put(Topic::Inbox, &tick.inbox)?;
    tick.out.records(&mut sink)?;
    sink.put(Topic::Timing, &tick.timing)
}

/// A log that takes the records of one tick.
struct LogSink<'a> {
    log: &'a mut LogWriter,
    t: TimeNs,
}

impl Sink for LogSink<'_> {
    type Error = LogError;

    fn put<R: Serialize>(&mut self, topic: Topic, record: &R) -> Result<(), LogError> {
        self.log.write(topic.name(), self.t, record)
    }
}

/// The settings of the flight in a log.
///
/// # Errors
/// The log carries none, or its keys are those of another version.
pub fn settings(log: &LogReader, path: &Path) -> Result<FlightTable> {
    let Some(text) = log.head().documents.get(CONFIG) else {
        bail!("{} carries no settings: it is no log of a flight", path.display());
    };
    read_settings(text).with_context(|| {
        format!(
            "in the settings that {} carries, written by tello-ctl {} ({}); this is {} ({REVISION})",
            path.display(),
            log.head().version,
            log.head().revision,
            env!("CARGO_PKG_VERSION"),
        )
    })
}

/// The settings `text`; removed keys that were null changed nothing.
fn read_settings(text: &str) -> Result<FlightTable> {
    let mut table: Value = serde_json::from_str(text)?;
    for (parent, key) in REMOVED_KEYS {
        if let Some(Value::Object(parent)) = table.pointer_mut(parent)
            && parent.get(key) == Some(&Value::Null)
        {
            parent.remove(key);
        }
    }
    Ok(config::from_value(&table)?)
}

/// Makes the folder `dir` of logs, if it does not exist.
///
/// # Errors
/// It cannot be made.
pub fn make_folder(dir: &Path) -> Result<()> {
    std::fs::create_dir_all(dir)
        .with_context(|| format!("cannot make the log folder {}", dir.display()))
}

/// The first of `dir/stem.mcap`, `dir/stem-2.mcap`, .. that does not exist; makes `dir`.
///
/// # Errors
/// The folder cannot be made.
pub fn free_path(dir: &Path, stem: &str) -> Result<PathBuf> {
    make_folder(dir)?;
    let mut path = dir.join(format!("{stem}.mcap"));
    let mut number = 2_u32;
    while path.exists() {
        path = dir.join(format!("{stem}-{number}.mcap"));
        number += 1;
    }
    Ok(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_that_is_no_more_is_read_where_it_changed_nothing() {
        let (table, mission) = config::fly(None, None).unwrap();
        let flight = config::flight(&table, mission, tello_flight::Start::Grounded);
        let with = |limit: Value| {
            let mut text = serde_json::to_value(&flight).unwrap();
            text["cycle"]["monitors"]["unproven_stick_max"] = limit;
            read_settings(&text.to_string())
        };
        assert_eq!(with(Value::Null).unwrap(), flight);
        let error = format!("{:#}", with(Value::from(0.4)).unwrap_err());
        assert!(error.contains("unknown field `unproven_stick_max`"), "{error}");
    }

    #[test]
    fn a_log_never_takes_the_place_of_another() {
        let root = std::env::temp_dir().join(format!("tello-ctl-free-path-{}", std::process::id()));
        let dir = root.join("deep");
        for expected in ["flight.mcap", "flight-2.mcap", "flight-3.mcap"] {
            let path = free_path(&dir, "flight").unwrap();
            assert_eq!(path, dir.join(expected));
            std::fs::write(path, "").unwrap();
        }
        std::fs::remove_file(dir.join("flight-2.mcap")).unwrap();
        assert_eq!(free_path(&dir, "flight").unwrap(), dir.join("flight-2.mcap"));
        assert_eq!(free_path(&dir, "other").unwrap(), dir.join("other.mcap"));
        let error = free_path(&dir.join("flight.mcap"), "a").unwrap_err().to_string();
        assert!(error.contains("cannot make the log folder"), "{error}");
        std::fs::remove_dir_all(root).unwrap();
    }

    #[test]
    fn every_channel_has_a_name_of_its_own() {
        use horizon_model::{Kinematic, Model};
        let shape = Outcome::with_buffers(&Kinematic::STATE, &Kinematic::PARAMETER, 3);
        let mut topics: Vec<_> =
            channels(&shape).into_iter().map(|channel| channel.topic).collect();
        let count = topics.len();
        topics.sort_unstable();
        topics.dedup();
        assert_eq!(topics.len(), count);
        assert!(
            topics.contains(&STREAM) && topics.contains(&LINK) && topics.len() > Topic::ALL.len()
        );
    }
}
