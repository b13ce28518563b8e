//! Reads a log from front to back, complete or torn.
//!
//! Owns the MCAP reader. It streams: memory is bounded by the largest chunk. Damage is an [`Ending`],
//! so that everything before it can be used; only a file that never was a log, or a disk that fails,
//! is an error.

#![deny(clippy::indexing_slicing)]

use std::collections::BTreeMap;
use std::fmt::{Display, Formatter};
use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{MessageHeader, Metadata, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde::de::DeserializeOwned;

use super::framing::Framing;
use super::writer::metadata;
use super::{Head, JSON, LogError, io_error};
use crate::clock::TimeNs;

/// Read from the file at once. bytes
const READ_BYTES: usize = 64 * 1024;

/// Longest record that is accepted; ours are far smaller. A damaged length must not fill the memory.
pub(super) const RECORD_BYTES_MAX: usize = 64 * 1024 * 1024;

const BEHIND_THE_END: &str =
    "the log is whole, but more bytes follow its end (two logs in one file?); they are not read";

/// A log being read.
pub struct LogReader {
    path: PathBuf,
    source: Box<dyn Read + Send>,
    mcap: LinearReader,
    framing: Framing,
    head: Head,
    has_metadata: bool,
    /// Topics by their numbers in the file, and whether their messages are JSON.
    channels: BTreeMap<u16, (String, bool)>,
    /// Topics to hand out; all without a selection.
    selection: Option<Vec<String>>,
    /// Bytes of the latest message; kept for their memory.
    data: Vec<u8>,
    bytes: u64,
    messages: u64,
    /// Records that are missing, by the log's own account.
    dropped: u64,
    last: Option<TimeNs>,
    ending: Option<Ending>,
}

/// One record of the log.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Message<'a> {
    /// Name of the channel.
    pub topic: &'a str,
    /// Time of the record. ns since the start of the log
    pub t: TimeNs,
    /// The record: JSON, or what a viewer reads.
    pub data: &'a [u8],
    /// Whether it is JSON.
    pub is_json: bool,
}

/// How a log ends.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// It was closed by its writer.
    Complete,
    /// It was closed, but the disk was slower than the flight.
    Gaps {
        /// Number of records that are missing.
        records: u64,
    },
    /// It stops early or is damaged: the writer was killed, the disk full, the file cut or changed.
    /// Every message that was handed out is sound.
    Torn {
        /// Messages before the tear, on any channel.
        messages: u64,
        /// Time of the last of them.
        last: Option<TimeNs>,
        /// How far the file was read. bytes
        bytes: u64,
        /// Reason.
        why: String,
    },
}

impl LogReader {
    /// Opens a log and reads its head.
    ///
    /// # Errors
    /// [`LogError::Io`] or [`LogError::NotALog`] with what the file is instead.
    pub fn open(path: &Path) -> Result<Self, LogError> {
        let file = File::open(path).map_err(io_error("open", path))?;
        Self::from_source(path, Box::new(file))
    }

    /// Opens a log from any source; `path` is for messages.
    ///
    /// # Errors
    /// [`LogError::Io`] or [`LogError::NotALog`].
    pub fn from_source(path: &Path, source: Box<dyn Read + Send>) -> Result<Self, LogError> {
        let log = Self::begin(path, source)?;
        let is_torn = log.ending.as_ref().is_some_and(|ending| !ending.is_complete());
        if is_torn { Err(log.not_a_log()) } else { Ok(log) }
    }

    /// Opens a log whose first chunk may be damaged.
    pub(super) fn begin(path: &Path, source: Box<dyn Read + Send>) -> Result<Self, LogError> {
        let mut log = Self {
            path: path.to_owned(),
            source,
            mcap: LinearReader::new_with_options(options()),
            framing: Framing::new(),
            head: Head::default(),
            has_metadata: false,
            channels: BTreeMap::new(),
            selection: None,
            data: Vec::new(),
            bytes: 0,
            messages: 0,
            dropped: 0,
            last: None,
            ending: None,
        };
        // The first channel marks the end of the head.
        while log.channels.is_empty() && log.ending.is_none() {
            log.advance()?;
        }
        if log.has_metadata { Ok(log) } else { Err(log.not_a_log()) }
    }

    /// Head of the log: version, revision and settings.
    pub fn head(&self) -> &Head {
        &self.head
    }

    /// A reader that hands out the messages of `topics` only.
    #[must_use]
    pub fn select(mut self, topics: &[&str]) -> Self {
        self.selection = Some(topics.iter().map(|topic| (*topic).to_owned()).collect());
        self
    }

    /// The next message in file order; `None` at the end; [`LogReader::ending`] states its kind.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn next_message(&mut self) -> Result<Option<Message<'_>>, LogError> {
        while self.ending.is_none() {
            if let Some((channel, t)) = self.advance()? {
                let known = self.channels.get(&channel);
                return Ok(known.map(|(topic, is_json)| Message {
                    topic,
                    t,
                    data: &self.data,
                    is_json: *is_json,
                }));
            }
        }
        Ok(None)
    }

    /// Topics of the channels with JSON that were met so far; our logs begin with all of them.
    pub fn json_topics(&self) -> impl Iterator<Item = &str> {
        self.channels.values().filter_map(|(topic, is_json)| is_json.then_some(topic.as_str()))
    }

    /// How the log ends; `None` before its end was met.
    pub fn ending(&self) -> Option<&Ending> {
        self.ending.as_ref()
    }

    /// Takes one step: reads on, or digests one record. Channel and time if that was a message to
    /// hand out, whose bytes are in `self.data` then.
    fn advance(&mut self) -> Result<Option<(u16, TimeNs)>, LogError> {
        let record = match self.mcap.next_event() {
            None => return self.end().map(|()| None),
            Some(Ok(LinearReadEvent::ReadRequest(_))) => return self.read_on().map(|()| None),
            Some(Ok(LinearReadEvent::Record { opcode, data })) => parse(opcode, data),
            Some(Err(error)) => Err(error),
        };
        match record {
            Ok(Some(Record::Message { header, data })) => {
                let Some((topic, _)) = self.channels.get(&header.channel_id) else {
                    let unknown = McapError::UnknownChannel(header.sequence, header.channel_id);
                    self.tear(unknown.to_string());
                    return Ok(None);
                };
                let is_wanted = self.selection.as_ref().is_none_or(|s| s.contains(topic));
                if is_wanted {
                    self.data.clear();
                    self.data.extend_from_slice(&data);
                }
                let t = self.count(&header);
                return Ok(is_wanted.then_some((header.channel_id, t)));
            }
            Ok(Some(Record::Channel(channel))) => {
                let is_json = channel.message_encoding == JSON;
                self.channels.insert(channel.id, (channel.topic, is_json));
            }
            Ok(Some(Record::Metadata(record))) if record.name == metadata::NAME => {
                self.take_metadata(&record);
            }
            Ok(Some(Record::Metadata(record))) if record.name == metadata::GAPS => {
                let dropped = record.metadata.get(metadata::DROPPED);
                self.dropped = dropped.and_then(|count| count.parse().ok()).unwrap_or(1);
            }
            Ok(Some(Record::Attachment { header, data, .. })) => {
                let json = String::from_utf8_lossy(&data).into_owned();
                self.head.documents.insert(header.name, json);
            }
            Ok(_) => {}
            Err(error) => self.tear(error.to_string()),
        }
        Ok(None)
    }

    /// The log has no further record: it is complete, unless something follows.
    fn end(&mut self) -> Result<(), LogError> {
        let more = self.framing.has_rest(&mut *self.source);
        if more.map_err(io_error("read", &self.path))? {
            self.tear(BEHIND_THE_END.to_owned());
        } else {
            let records = self.dropped;
            self.ending =
                Some(if records == 0 { Ending::Complete } else { Ending::Gaps { records } });
        }
        Ok(())
    }

    /// Feeds the decoder with the next bytes.
    fn read_on(&mut self) -> Result<(), LogError> {
        if let Some(why) = self.framing.refusal() {
            self.tear(why.to_owned());
            return Ok(());
        }
        let buffer = self.mcap.insert(READ_BYTES);
        let read = read_some(&mut *self.source, buffer).map_err(io_error("read", &self.path))?;
        let admitted = self.framing.admit(buffer.get(..read).unwrap_or_default());
        if admitted > 0 || read == 0 {
            self.mcap.notify_read(admitted);
        }
        self.bytes += admitted as u64;
        Ok(())
    }

    fn take_metadata(&mut self, record: &Metadata) {
        let entry = |key| record.metadata.get(key).cloned().unwrap_or_default();
        self.head.version = entry(metadata::VERSION);
        self.head.revision = entry(metadata::REVISION);
        if let Some(started) = metadata::started(record) {
            self.head.started_unix_ns = started;
            self.has_metadata = true;
        }
    }

    fn count(&mut self, header: &MessageHeader) -> TimeNs {
        let t = header.log_time.wrapping_sub(self.head.started_unix_ns).cast_signed();
        self.messages += 1;
        self.last = Some(TimeNs(t));
        TimeNs(t)
    }

    fn tear(&mut self, why: String) {
        let (messages, last, bytes) = (self.messages, self.last, self.bytes);
        self.ending = Some(Ending::Torn { messages, last, bytes, why });
    }

    pub(super) fn not_a_log(self) -> LogError {
        let why = match self.ending {
            _ if self.bytes == 0 => "it is empty".to_owned(),
            Some(Ending::Torn { why, .. }) if why.contains("compression") => {
                format!("{why} (`mcap compress --compression zstd` makes a log of it)")
            }
            Some(Ending::Torn { why, .. }) => format!(
                "{why} (`tello-ctl convert` makes a log from a CSV flight log; `tello-ctl log recover` saves what is \
                 left of a damaged one)"
            ),
            _ => format!("it is MCAP, but without the metadata record `{}`", metadata::NAME),
        };
        LogError::NotALog { path: self.path, why }
    }
}

impl std::fmt::Debug for LogReader {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogReader")
            .field("path", &self.path)
            .field("messages", &self.messages)
            .field("ending", &self.ending)
            .finish_non_exhaustive()
    }
}

impl Message<'_> {
    /// The JSON record as a value.
    ///
    /// # Errors
    /// [`LogError::Decode`]: the record is of another type or no JSON, or holds a number that was not finite.
    pub fn decode<T: DeserializeOwned>(&self) -> Result<T, LogError> {
        serde_json::from_slice(self.data).map_err(|source| LogError::Decode {
            topic: self.topic.to_owned(),
            t: self.t,
            source,
        })
    }
}

impl Ending {
    /// Whether the log was closed by its writer, and no record is missing.
    pub fn is_complete(&self) -> bool {
        *self == Self::Complete
    }

    /// The same, whatever follows the log in its file.
    pub(super) fn is_whole(&self) -> bool {
        match self {
            Self::Complete | Self::Gaps { .. } => true,
            Self::Torn { why, .. } => why == BEHIND_THE_END,
        }
    }
}

impl Display for Ending {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Complete => write!(f, "complete"),
            Self::Gaps { records } => {
                write!(f, "closed, but {records} ticks are missing: the disk was too slow")
            }
            Self::Torn { messages, last, bytes, why } => {
                let last_s = last.map_or(0.0, |t| t.0 as f64 * 1e-9);
                write!(f, "torn {last_s:.2} s into the log, after {messages} messages ")?;
                write!(f, "and {bytes} bytes: {why}")
            }
        }
    }
}

/// How logs are read: a chunk is checked before any message of it is handed out; the sums over the whole
/// file notice a chunk that is gone.
pub(super) fn options() -> LinearReaderOptions {
    LinearReaderOptions::default()
        .with_prevalidate_chunk_crcs(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(RECORD_BYTES_MAX)
}

/// The record if it is of a kind that a log of ours is made of.
fn parse(opcode: u8, data: &[u8]) -> Result<Option<Record<'_>>, McapError> {
    match opcode {
        op::ATTACHMENT if !is_attachment(data) => Err(McapError::UnexpectedEoc),
        op::CHANNEL | op::MESSAGE | op::METADATA | op::ATTACHMENT => {
            mcap::parse_record(opcode, data).map(Some)
        }
        _ => Ok(None),
    }
}

/// Whether an attachment's fields fit into its record, which [`mcap::parse_record`] takes for granted:
/// two times, name, media type, length, checksum.
pub(super) fn is_attachment(data: &[u8]) -> bool {
    fn after_text(data: &[u8]) -> Option<&[u8]> {
        let (length, rest) = data.split_first_chunk()?;
        rest.get(usize::try_from(u32::from_le_bytes(*length)).ok()?..)
    }
    data.get(8 + 8..)
        .and_then(after_text)
        .and_then(after_text)
        .is_some_and(|rest| rest.len() >= 8 + 4)
}

pub(super) fn read_some(source: &mut dyn Read, buffer: &mut [u8]) -> io::Result<usize> {
    loop {
        match source.read(buffer) {
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            result => return result,
        }
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
