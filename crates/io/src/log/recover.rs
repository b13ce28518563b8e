//! Makes a complete log of a torn or damaged one.
//!
//! Owns the copy, record by record and unchanged, of every chunk that is whole. It knows nothing of what the
//! records mean, so that it also mends logs of other versions.

#![deny(clippy::indexing_slicing)]

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, ErrorKind};
use std::path::Path;

use mcap::records::{Channel, ChunkHeader, Record, SchemaHeader, op};
use mcap::sans_io::{LinearReadEvent, LinearReader};
use mcap::{Attachment, MAGIC, McapError, McapResult, Writer};

use super::framing::{Framing, HEAD_BYTES};
use super::reader::{RECORD_BYTES_MAX, is_attachment, options, read_error, read_some};
use super::writer::{chunked, write_error};
use super::{LogError, LogReader};

/// What was saved.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Recovered {
    /// Messages in the new log.
    pub messages: u64,
    /// Whether the old log ended early or was damaged.
    pub was_torn: bool,
    /// Bytes behind the end of the old log, which are not read: another log, perhaps.
    pub rest_bytes: u64,
    /// Bytes behind the last record that could be read, of a log that ends early or whose frames are damaged there.
    pub unread_bytes: u64,
    /// First and last time of each chunk that was left out because its bytes are not those that were written. s since
    /// the start of the log
    pub damaged: Vec<(f64, f64)>,
}

/// Copies the log `from` to the new file `to`, which is complete and has its index. Damaged chunks are left out.
///
/// # Errors
/// As [`LogReader::open`], with [`LogError::NotALog`] for a log without a chunk that is whole; [`LogError::Exists`]
/// rather than overwriting, [`LogError::Create`], [`LogError::Write`], [`LogError::Read`].
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, LogError> {
    // A file that is no log is refused before anything is created.
    let log = LogReader::begin(from, Box::new(open(from)?))?;
    let file = OpenOptions::new().write(true).create_new(true).open(to).map_err(|source| {
        let path = to.to_owned();
        if source.kind() == ErrorKind::AlreadyExists {
            LogError::Exists { path }
        } else {
            LogError::Create { path, source }
        }
    })?;
    let failed = |error| write_error(to, error);
    let mcap = chunked().create(BufWriter::new(file)).map_err(failed)?;
    let mut copy = Copy {
        mcap,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        messages: 0,
        of_index: BTreeMap::new(),
    };
    walk(from, false, |record| {
        if let Record::Schema { header: SchemaHeader { id, .. }, .. }
        | Record::Channel(Channel { id, .. }) = &record
        {
            copy.of_index.insert((record.opcode(), *id), record.into_owned());
        }
        Ok(())
    })?;
    let mut is_index = false;
    let walked = walk(from, true, |record| {
        is_index |= matches!(record, Record::DataEnd(_));
        // The index of the old log is made anew.
        if is_index { Ok(()) } else { copy.take(record).map_err(failed) }
    })?;
    copy.mcap.finish().map_err(failed)?;
    if copy.channels.is_empty() && walked.is_torn {
        fs::remove_file(to).map_err(|source| LogError::Create { path: to.to_owned(), source })?;
        return Err(log.not_a_log());
    }
    let started_unix_ns = log.head().started_unix_ns;
    let since_start_s = |t: u64| t.saturating_sub(started_unix_ns) as f64 * 1e-9;
    let damaged = walked.damaged.iter().map(|chunk| {
        (since_start_s(chunk.message_start_time), since_start_s(chunk.message_end_time))
    });
    Ok(Recovered {
        messages: copy.messages,
        was_torn: walked.is_torn || !walked.damaged.is_empty(),
        rest_bytes: walked.rest_bytes,
        unread_bytes: walked.unread_bytes,
        damaged: damaged.collect(),
    })
}

fn open(path: &Path) -> Result<File, LogError> {
    File::open(path).map_err(|source| LogError::Open { path: path.to_owned(), source })
}

/// What was met on the way through a file.
struct Walked {
    /// Whether it ends before its index does.
    is_torn: bool,
    damaged: Vec<ChunkHeader>,
    /// Bytes behind its end.
    rest_bytes: u64,
    /// Bytes behind the last record, if it is torn.
    unread_bytes: u64,
}

/// Shows `take` every record of `from`, those of whole chunks one by one. If it `is_summed`, it ends where the sum over
/// all bytes shows that some are not those that were written.
fn walk(
    from: &Path,
    is_summed: bool,
    mut take: impl FnMut(Record<'_>) -> Result<(), LogError>,
) -> Result<Walked, LogError> {
    let mut source = open(from)?;
    let options = options().with_emit_chunks(true).with_validate_data_section_crc(is_summed);
    let mut reader = LinearReader::new_with_options(options);
    let mut framing = Framing::new();
    let mut damaged = Vec::new();
    let mut rest_bytes = 0;
    let mut read_bytes = MAGIC.len() as u64;
    let is_torn = loop {
        match reader.next_event() {
            None => {
                if framing.has_rest(&mut source).map_err(read_error(from))? {
                    let bytes = source.metadata().map_err(read_error(from))?.len();
                    rest_bytes = bytes.saturating_sub(framing.offset());
                }
                break false;
            }
            Some(Ok(LinearReadEvent::ReadRequest(_))) if framing.refusal().is_some() => break true,
            Some(Ok(LinearReadEvent::ReadRequest(bytes))) => {
                let buffer = reader.insert(bytes.min(RECORD_BYTES_MAX));
                let read = read_some(&mut source, buffer).map_err(read_error(from))?;
                let admitted = framing.admit(buffer.get(..read).unwrap_or_default());
                if admitted > 0 || read == 0 {
                    reader.notify_read(admitted);
                }
            }
            Some(Ok(LinearReadEvent::Record { opcode: op::ATTACHMENT, data }))
                if !is_attachment(data) =>
            {
                break true;
            }
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                read_bytes += (HEAD_BYTES + data.len()) as u64;
                match mcap::parse_record(opcode, data) {
                    Ok(Record::Chunk { header, .. }) => match records(data) {
                        Ok(records) => records.into_iter().try_for_each(&mut take)?,
                        Err(_) => damaged.push(header),
                    },
                    Ok(record) => take(record)?,
                    Err(_) => break true,
                }
            }
            Some(Err(_)) => break true,
        }
    };
    let bytes = source.metadata().map_err(read_error(from))?.len();
    let unread_bytes = if is_torn { bytes.saturating_sub(read_bytes) } else { 0 };
    Ok(Walked { is_torn, damaged, rest_bytes, unread_bytes })
}

/// The records of the chunk record `chunk`, if its checksum holds.
fn records(mut chunk: &[u8]) -> McapResult<Vec<Record<'static>>> {
    let options = options().with_skip_start_magic(true).with_skip_end_magic(true);
    let mut reader = LinearReader::new_with_options(options);
    let mut head = Some([&[op::CHUNK][..], &(chunk.len() as u64).to_le_bytes()].concat());
    let mut records = Vec::new();
    while let Some(event) = reader.next_event() {
        match event? {
            LinearReadEvent::ReadRequest(_) => {
                let head = head.take();
                let bytes = head.as_deref().unwrap_or_else(|| std::mem::take(&mut chunk));
                reader.insert(bytes.len()).copy_from_slice(bytes);
                reader.notify_read(bytes.len());
            }
            LinearReadEvent::Record { opcode, data } => {
                records.push(mcap::parse_record(opcode, data)?.into_owned());
            }
        }
    }
    Ok(records)
}

/// The new log, and its numbers for the old log's schemas and channels.
struct Copy {
    mcap: Writer<BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
    /// Schemas and channels of the whole file by opcode and number. The chunk that tells of a channel may be damaged;
    /// the index tells of it again.
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
