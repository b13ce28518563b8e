//! Makes a complete log of a torn or damaged one.
//!
//! Owns the copy, record by record and unchanged, of every chunk that is whole. It knows nothing of what the
//! records mean, so that it also mends logs of other versions.

#![deny(clippy::indexing_slicing)]

mod frames;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::{Channel, ChunkHeader, Record, SchemaHeader, op};
use mcap::{Attachment, McapError, Writer};

use self::frames::{Frame, Frames, records};
use super::writer::{chunked, create_new, metadata, write_error};
use super::{Ending, LogError, LogReader, io_error};

/// Result of a recovery.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recovered {
    /// Messages in the new log.
    pub messages: u64,
    /// Whether the old log ended early or was damaged.
    pub was_torn: bool,
    /// Bytes behind the end of the old log, which are not read: another log, perhaps.
    pub rest_bytes: u64,
    /// Bytes that hold no record that can be read: of frames that are damaged, or behind the last of a log that ends
    /// early.
    pub unread_bytes: u64,
    /// First and last time of each chunk that was left out because its bytes are not those that were written. s since
    /// the start of the log
    pub damaged: Vec<(f64, f64)>,
}

/// Copies the log `from` to the new file `to`, which is complete and has its index. Damaged chunks are left out.
///
/// # Errors
/// As [`LogReader::open`], with [`LogError::NotALog`] for a log without its metadata or without a chunk that is whole;
/// [`LogError::Exists`] rather than overwriting, [`LogError::Io`].
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, LogError> {
    let (was_torn, refusal) = state(from)?;
    let index = Index::of(from)?;
    // A file that is no log is refused before anything is created.
    let started_unix_ns = match (index.started_unix_ns, refusal) {
        (Some(started), refusal) if refusal.is_none() || index.has_channel() => started,
        (_, Some(refusal)) => return Err(refusal),
        (_, None) => 0,
    };
    let file = create_new(to)?;
    let failed = |error| write_error(to, error);
    let mcap = chunked().create(BufWriter::new(file)).map_err(failed)?;
    let mut copy = Copy {
        mcap,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        messages: 0,
        of_index: index.records,
    };
    let mut is_index = false;
    let walked = walk(from, |record| {
        is_index |= matches!(record, Record::DataEnd(_));
        // The index of the old log is made anew.
        if is_index { Ok(()) } else { copy.take(record).map_err(failed) }
    })?;
    copy.mcap.finish().map_err(failed)?;
    let since_start_s = |t: u64| t.saturating_sub(started_unix_ns) as f64 * 1e-9;
    let damaged = walked.damaged.iter().map(|chunk| {
        (since_start_s(chunk.message_start_time), since_start_s(chunk.message_end_time))
    });
    Ok(Recovered {
        messages: copy.messages,
        was_torn,
        rest_bytes: walked.rest_bytes,
        unread_bytes: walked.unread_bytes,
        damaged: damaged.collect(),
    })
}

fn open(path: &Path) -> Result<File, LogError> {
    File::open(path).map_err(io_error("open", path))
}

/// Whether `from` is torn or damaged, and why it cannot be read at all, if so.
fn state(from: &Path) -> Result<(bool, Option<LogError>), LogError> {
    match LogReader::open(from) {
        Ok(mut log) => {
            while log.next_message()?.is_some() {}
            Ok((!log.ending().is_some_and(Ending::is_whole), None))
        }
        Err(refusal @ LogError::NotALog { .. }) => Ok((true, Some(refusal))),
        Err(error) => Err(error),
    }
}

/// Result of the first pass through the file.
struct Index {
    /// Schemas and channels of the whole file by opcode and number. The chunk that introduces a channel may be damaged;
    /// the file's own index has the channel again.
    records: BTreeMap<(u8, u16), Record<'static>>,
    /// From the metadata.
    started_unix_ns: Option<u64>,
}

impl Index {
    fn of(from: &Path) -> Result<Self, LogError> {
        let mut index = Self { records: BTreeMap::new(), started_unix_ns: None };
        walk(from, |record| {
            match &record {
                Record::Schema { header: SchemaHeader { id, .. }, .. }
                | Record::Channel(Channel { id, .. }) => {
                    index.records.insert((record.opcode(), *id), record.into_owned());
                }
                Record::Metadata(record) => {
                    index.started_unix_ns =
                        index.started_unix_ns.or_else(|| metadata::started(record));
                }
                _ => {}
            }
            Ok(())
        })?;
        Ok(index)
    }

    fn has_channel(&self) -> bool {
        self.records.keys().any(|(opcode, _)| *opcode == op::CHANNEL)
    }
}

/// Result of a pass through the file.
struct Walked {
    damaged: Vec<ChunkHeader>,
    /// As of [`Recovered`].
    rest_bytes: u64,
    unread_bytes: u64,
}

/// Shows `take` every record of `from` that can be read, those of whole chunks one by one.
fn walk(
    from: &Path,
    mut take: impl FnMut(Record<'_>) -> Result<(), LogError>,
) -> Result<Walked, LogError> {
    let mut frames = Frames::new(open(from)?).map_err(io_error("read", from))?;
    let mut damaged = Vec::new();
    while let Some(Frame { opcode, data }) = frames.next().map_err(io_error("read", from))? {
        match mcap::parse_record(opcode, &data) {
            Ok(Record::Chunk { header, .. }) => match records(&data) {
                Ok(records) => records.into_iter().try_for_each(&mut take)?,
                Err(_) => damaged.push(header),
            },
            Ok(record) => take(record)?,
            Err(_) => {}
        }
    }
    Ok(Walked { damaged, rest_bytes: frames.rest_bytes(), unread_bytes: frames.unread_bytes })
}

/// The new log, and its numbers for the old log's schemas and channels.
struct Copy {
    mcap: Writer<BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
    /// Those of [`Index`] that were not written yet.
    of_index: BTreeMap<(u8, u16), Record<'static>>,
}

impl Copy {
    /// Writes a schema or channel that was not met before what refers to it.
    fn find(&mut self, opcode: u8, id: u16) -> Result<(), McapError> {
        let met = if opcode == op::SCHEMA { &self.schemas } else { &self.channels };
        match self.of_index.remove(&(opcode, id)) {
            Some(record) if !met.contains_key(&id) => self.take(record),
            _ => Ok(()),
        }
    }

    /// Writes `record`, unless it is a message of a channel that is not known.
    fn take(&mut self, record: Record<'_>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => {
                let id = self.mcap.add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
                self.find(op::SCHEMA, channel.schema_id)?;
                let schema = self.schemas.get(&channel.schema_id).copied().unwrap_or(0);
                let id = self.mcap.add_channel(
                    schema,
                    &channel.topic,
                    &channel.message_encoding,
                    &channel.metadata,
                )?;
                self.channels.insert(channel.id, id);
            }
            Record::Message { mut header, data } => {
                self.find(op::CHANNEL, header.channel_id)?;
                if let Some(id) = self.channels.get(&header.channel_id) {
                    header.channel_id = *id;
                    self.mcap.write_to_known_channel(&header, &data)?;
                    self.messages += 1;
                }
            }
            Record::Metadata(metadata) => self.mcap.write_metadata(&metadata)?,
            Record::Attachment { header, data, .. } => self.mcap.attach(&Attachment {
                log_time: header.log_time,
                create_time: header.create_time,
                name: header.name,
                media_type: header.media_type,
                data: Cow::Borrowed(&data),
            })?,
            _ => {}
        }
        Ok(())
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
