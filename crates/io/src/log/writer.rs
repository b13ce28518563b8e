//! Writes a log: head first, then chunks of messages, appended only.
//!
//! Owns the MCAP writer and the way to the disk. When to flush is the caller's decision; in flight
//! that is [`super::Recorder`], since closing a chunk can take longer than a tick.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};

use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, McapError, WriteOptions};
use serde::Serialize;

use super::{Channel, Head, LogError, io_error};
use crate::clock::TimeNs;

/// Uncompressed size at which a chunk is closed: about a second of flight. bytes
const CHUNK_BYTES: u64 = 64 * 1024;

/// Names of the metadata record and its entries.
pub(super) mod metadata {
    use mcap::records::Metadata;

    /// The record.
    pub(in crate::log) const NAME: &str = "tello-ctl";
    /// Wall-clock time of the log's zero.
    pub(in crate::log) const STARTED: &str = "started_unix_ns";
    /// Version of the program.
    pub(in crate::log) const VERSION: &str = "version";
    /// Git revision of the program.
    pub(in crate::log) const REVISION: &str = "revision";

    /// The record of a log with gaps. Not that of the head, which takes the place of an earlier one.
    pub(in crate::log) const GAPS: &str = "tello-ctl gaps";
    /// Number of records that are missing.
    pub(in crate::log) const DROPPED: &str = "records_dropped";

    /// The log's zero, if `record` is ours. ns since 1970-01-01 UTC
    pub(in crate::log) fn started(record: &Metadata) -> Option<u64> {
        let started = record.metadata.get(STARTED).filter(|_| record.name == NAME)?;
        started.parse().ok()
    }
}

/// Appends, never seeks: what is on the disk is not written again.
type Sink = NoSeek<BufWriter<Box<dyn Write + Send>>>;

/// A log being written.
///
/// Dropping it closes the file as [`LogWriter::finish`] does, but an error is lost then.
pub struct LogWriter {
    path: PathBuf,
    started_unix_ns: u64,
    mcap: mcap::Writer<Sink>,
    /// Topics with their numbers in the file.
    channels: Vec<(&'static str, u16)>,
    /// JSON of the latest record; kept for its memory.
    json: Vec<u8>,
    messages: u64,
    taps: Vec<Box<dyn Tap>>,
}

/// Receiver of every message beside the file.
pub trait Tap: Send {
    /// Receives a message on `topic`, as the file has it, at `log_time_ns` since 1970-01-01 UTC.
    /// The thread that writes the log waits for it: it must not block.
    fn receive(&mut self, topic: &str, log_time_ns: u64, bytes: &[u8]);
}

/// Size and place of a finished log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Summary {
    /// Path of the file.
    pub path: PathBuf,
    /// Size of the file. bytes
    pub bytes: u64,
    /// Number of messages in it.
    pub messages: u64,
}

impl LogWriter {
    /// Creates the file with its head and channels, and brings these to the disk.
    ///
    /// # Errors
    /// [`LogError::Exists`] rather than overwriting, [`LogError::Io`].
    pub fn create(path: &Path, head: &Head, channels: &[Channel]) -> Result<Self, LogError> {
        Self::create_of_profile("", path, head, channels)
    }

    /// Creates a log with channels of ROS 2 messages alone: programs of ROS read no file with others.
    ///
    /// # Errors
    /// As [`LogWriter::create`].
    pub fn create_ros2(path: &Path, head: &Head, channels: &[Channel]) -> Result<Self, LogError> {
        Self::create_of_profile("ros2", path, head, channels)
    }

    fn create_of_profile(
        profile: &str,
        path: &Path,
        head: &Head,
        channels: &[Channel],
    ) -> Result<Self, LogError> {
        let file = create_new(path)?;
        Self::into_sink(path, Box::new(Disk(file)), chunked().profile(profile), head, channels)
    }

    /// Creates a log in any sink; `path` is for messages.
    pub(super) fn into_sink(
        path: &Path,
        sink: Box<dyn Write + Send>,
        options: WriteOptions,
        head: &Head,
        channels: &[Channel],
    ) -> Result<Self, LogError> {
        let failed = |error| write_error(path, error);
        let mcap = options
            .library(format!("tello-ctl {}", head.version))
            .disable_seeking(true)
            .create(NoSeek::new(BufWriter::new(sink)))
            .map_err(failed)?;
        let mut log = Self {
            path: path.to_owned(),
            started_unix_ns: head.started_unix_ns,
            mcap,
            channels: Vec::with_capacity(channels.len()),
            json: Vec::new(),
            messages: 0,
            taps: Vec::new(),
        };
        log.write_head(head).map_err(failed)?;
        for channel in channels {
            let id = log.add(channel)?;
            log.channels.push((channel.topic, id));
        }
        log.flush()?;
        Ok(log)
    }

    /// Appends `record` to `topic` at `t`. May close a chunk, which is compressed and written: never
    /// call it from the control thread.
    ///
    /// # Errors
    /// [`LogError::NoChannel`] and [`LogError::Encode`] leave the log as it was; after
    /// [`LogError::Io`] it is to be given up.
    pub fn write<R: Serialize + ?Sized>(
        &mut self,
        topic: &str,
        t: TimeNs,
        record: &R,
    ) -> Result<(), LogError> {
        let channel_id = self.channel(topic)?;
        self.json.clear();
        serde_json::to_writer(&mut self.json, record)
            .map_err(|error| LogError::Encode { topic: topic.to_owned(), source: error.into() })?;
        let json = std::mem::take(&mut self.json);
        let written = self.append(topic, channel_id, t, &json);
        self.json = json;
        written
    }

    /// Appends a message that is bytes already, in the form of its channel.
    ///
    /// # Errors
    /// As [`LogWriter::write`].
    pub fn write_bytes(&mut self, topic: &str, t: TimeNs, bytes: &[u8]) -> Result<(), LogError> {
        let channel_id = self.channel(topic)?;
        self.append(topic, channel_id, t, bytes)
    }

    fn channel(&self, topic: &str) -> Result<u16, LogError> {
        let known = self.channels.iter().find(|(known, _)| *known == topic);
        known
            .map(|(_, id)| *id)
            .ok_or_else(|| LogError::NoChannel { topic: topic.to_owned(), path: self.path.clone() })
    }

    fn append(
        &mut self,
        topic: &str,
        channel_id: u16,
        t: TimeNs,
        bytes: &[u8],
    ) -> Result<(), LogError> {
        let log_time = self.started_unix_ns.saturating_add_signed(t.0);
        #[expect(clippy::cast_possible_truncation, reason = "the format counts modulo 2^32")]
        let sequence = self.messages as u32;
        let header = MessageHeader { channel_id, sequence, log_time, publish_time: log_time };
        self.mcap
            .write_to_known_channel(&header, bytes)
            .map_err(|error| write_error(&self.path, error))?;
        self.messages += 1;
        for tap in &mut self.taps {
            tap.receive(topic, log_time, bytes);
        }
        Ok(())
    }

    /// Closes the chunk and waits until the disk has it: a killed program loses nothing before.
    ///
    /// # Errors
    /// [`LogError::Io`]: the log is to be given up; it has what was flushed before.
    pub fn flush(&mut self) -> Result<(), LogError> {
        self.mcap.flush().map_err(|error| write_error(&self.path, error))
    }

    /// Notes at the end of the log that `records` are missing in it, if any are.
    ///
    /// # Errors
    /// [`LogError::Io`]: the log is to be given up.
    pub(super) fn note_dropped(&mut self, records: u64) -> Result<(), LogError> {
        if records == 0 {
            return Ok(());
        }
        let metadata = BTreeMap::from([(metadata::DROPPED.into(), records.to_string())]);
        self.mcap
            .write_metadata(&Metadata { name: metadata::GAPS.into(), metadata })
            .map_err(|error| write_error(&self.path, error))
    }

    /// Closes the log with its index.
    ///
    /// # Errors
    /// [`LogError::Io`]: the log ends at its last flush and reads as torn.
    pub fn finish(mut self) -> Result<Summary, LogError> {
        self.mcap.finish().map_err(|error| write_error(&self.path, error))?;
        let written = self.mcap.into_inner().stream_position();
        let bytes = written.map_err(|error| write_error(&self.path, error.into()))?;
        Ok(Summary { path: self.path, bytes, messages: self.messages })
    }

    /// Passes every message to `tap` from now on, until the log is closed.
    pub fn add_tap(&mut self, tap: Box<dyn Tap>) {
        self.taps.push(tap);
    }

    /// The file that the log is written to.
    pub fn path(&self) -> &Path {
        &self.path
    }

    fn write_head(&mut self, head: &Head) -> Result<(), McapError> {
        let started = head.started_unix_ns;
        let entries = [
            (metadata::STARTED, started.to_string()),
            (metadata::VERSION, head.version.clone()),
            (metadata::REVISION, head.revision.clone()),
        ];
        self.mcap.write_metadata(&Metadata {
            name: metadata::NAME.into(),
            metadata: entries.map(|(key, value)| (key.into(), value)).into(),
        })?;
        for (name, json) in &head.documents {
            self.mcap.attach(&Attachment {
                log_time: started,
                create_time: started,
                name: name.clone(),
                media_type: "application/json".into(),
                data: Cow::Borrowed(json.as_bytes()),
            })?;
        }
        Ok(())
    }

    fn add(&mut self, channel: &Channel) -> Result<u16, LogError> {
        let Channel { topic, schema_name, schema: form } = channel;
        let encoding = form.message_encoding();
        self.mcap
            .add_schema(schema_name, form.schema_encoding(), &form.data())
            .and_then(|schema| self.mcap.add_channel(schema, topic, encoding, &BTreeMap::new()))
            .map_err(|error| write_error(&self.path, error))
    }
}

impl std::fmt::Debug for LogWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogWriter")
            .field("path", &self.path)
            .field("messages", &self.messages)
            .finish_non_exhaustive()
    }
}

/// A file whose flush reaches the disk and not only the system's cache.
struct Disk(File);

impl Write for Disk {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.sync_data()
    }
}

/// Chunks as all our logs have them.
pub(super) fn chunked() -> WriteOptions {
    WriteOptions::new().chunk_size(Some(CHUNK_BYTES)).compression_threads(0)
}

/// Creates the file of a log.
///
/// # Errors
/// [`LogError::Exists`] rather than overwriting, [`LogError::Io`].
pub(super) fn create_new(path: &Path) -> Result<File, LogError> {
    let created = OpenOptions::new().write(true).create_new(true).open(path);
    created.map_err(|source| match source.kind() {
        io::ErrorKind::AlreadyExists => LogError::Exists { path: path.to_owned() },
        _ => io_error("create", path)(source),
    })
}

pub(super) fn write_error(path: &Path, error: McapError) -> LogError {
    let source = match error {
        McapError::Io(source) => source,
        other => io::Error::other(other),
    };
    io_error("write to", path)(source)
}

#[cfg(test)]
mod tests;
