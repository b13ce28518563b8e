//! Makes a complete log of a torn one.
//!
//! Owns the copy, record by record and unchanged, of everything before the tear: up to the last chunk that
//! is whole. It knows nothing of what the records mean, so that it also mends logs of other versions.

#![deny(clippy::indexing_slicing)]

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions};
use std::io::BufWriter;
use std::path::Path;

use mcap::records::{Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader};
use mcap::{Attachment, McapError, Writer};

use super::framing::Framing;
use super::reader::{RECORD_BYTES_MAX, is_attachment, options, read_some};
use super::writer::{chunked, write_error};
use super::{LogError, LogReader};

/// What was saved.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Recovered {
    /// Messages in the new log.
    pub messages: u64,
    /// Whether the old log was torn at all.
    pub was_torn: bool,
}

/// Copies the log `from` to the new file `to`, which is complete and has its index.
///
/// # Errors
/// As [`LogReader::open`]; [`LogError::Exists`] rather than overwriting, [`LogError::Create`],
/// [`LogError::Write`], [`LogError::Read`].
pub fn recover(from: &Path, to: &Path) -> Result<Recovered, LogError> {
    // A file that is no log is refused before anything is created.
    drop(LogReader::open(from)?);
    let mut source =
        File::open(from).map_err(|source| LogError::Open { path: from.to_owned(), source })?;
    let file = OpenOptions::new().write(true).create_new(true).open(to).map_err(|source| {
        let path = to.to_owned();
        if source.kind() == std::io::ErrorKind::AlreadyExists {
            LogError::Exists { path }
        } else {
            LogError::Create { path, source }
        }
    })?;
    let failed = |error| write_error(to, error);
    let mcap = chunked().create(BufWriter::new(file)).map_err(failed)?;
    let mut copy = Copy { mcap, schemas: BTreeMap::new(), channels: BTreeMap::new(), messages: 0 };
    let mut reader = LinearReader::new_with_options(options());
    let mut framing = Framing::new();
    let mut is_index = false;
    let was_torn = loop {
        match reader.next_event() {
            None => break false,
            // The index of the old log is made anew; only whether it is whole counts.
            Some(Ok(LinearReadEvent::Record { opcode: op::DATA_END, .. })) => is_index = true,
            Some(Ok(LinearReadEvent::Record { .. })) if is_index => {}
            Some(Ok(LinearReadEvent::ReadRequest(_))) if framing.refusal().is_some() => break true,
            Some(Ok(LinearReadEvent::ReadRequest(bytes))) => {
                let buffer = reader.insert(bytes.min(RECORD_BYTES_MAX));
                let read = read_some(&mut source, buffer)
                    .map_err(|source| LogError::Read { path: from.to_owned(), source })?;
                let admitted = framing.admit(buffer.get(..read).unwrap_or_default());
                if admitted > 0 || read == 0 {
                    reader.notify_read(admitted);
                }
            }
            Some(Ok(LinearReadEvent::Record { opcode, data })) => {
                let is_damaged = opcode == op::ATTACHMENT && !is_attachment(data);
                match mcap::parse_record(opcode, data) {
                    Ok(record) if !is_damaged && copy.knows(&record) => {
                        copy.take(record).map_err(failed)?;
                    }
                    _ => break true,
                }
            }
            Some(Err(_)) => break true,
        }
    };
    copy.mcap.finish().map_err(failed)?;
    Ok(Recovered { messages: copy.messages, was_torn })
}

/// The new log, and its numbers for the old log's schemas and channels.
struct Copy {
    mcap: Writer<BufWriter<File>>,
    schemas: BTreeMap<u16, u16>,
    channels: BTreeMap<u16, u16>,
    messages: u64,
}

impl Copy {
    /// Whether what `record` refers to was there before.
    fn knows(&self, record: &Record<'_>) -> bool {
        match record {
            Record::Channel(channel) => {
                channel.schema_id == 0 || self.schemas.contains_key(&channel.schema_id)
            }
            Record::Message { header, .. } => self.channels.contains_key(&header.channel_id),
            _ => true,
        }
    }

    fn take(&mut self, record: Record<'_>) -> Result<(), McapError> {
        match record {
            Record::Schema { header, data } => {
                let id = self.mcap.add_schema(&header.name, &header.encoding, &data)?;
                self.schemas.insert(header.id, id);
            }
            Record::Channel(channel) => {
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
