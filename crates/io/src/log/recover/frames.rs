//! The records of a file that may be damaged, in order.
//!
//! Owns how reading goes on behind a broken frame: at the next chunk that is whole.

use std::fs::File;
use std::io::{self, ErrorKind};
use std::os::unix::fs::FileExt;

use mcap::records::{ChunkHeader, Record, op};
use mcap::sans_io::{LinearReadEvent, LinearReader};
use mcap::{MAGIC, McapResult};

use crate::log::framing::{HEAD_BYTES, unpacked_max};
use crate::log::reader::{RECORD_BYTES_MAX, is_attachment, options};

/// Searched at once for the next chunk. bytes
const WINDOW_BYTES: usize = 64 * 1024;

/// A file on the way from its beginning to the end of its footer.
#[derive(Debug)]
pub(super) struct Frames {
    file: File,
    /// Size of the file.
    bytes: u64,
    /// Where the next record begins. bytes
    at: u64,
    /// Unpacked size of all chunks so far. bytes
    unpacked: u64,
    /// Bytes so far that hold no record that can be read.
    pub(super) unread_bytes: u64,
    is_ended: bool,
}

/// A record with its frame.
#[derive(Debug)]
pub(super) struct Frame {
    pub(super) opcode: u8,
    pub(super) data: Vec<u8>,
}

impl Frames {
    /// The records of `file`, which begins with [`MAGIC`].
    pub(super) fn new(file: File) -> io::Result<Self> {
        let bytes = file.metadata()?.len();
        let at = MAGIC.len() as u64;
        Ok(Self { file, bytes, at, unpacked: 0, unread_bytes: 0, is_ended: false })
    }

    /// The next record that can be read; of a chunk, its head can.
    pub(super) fn next(&mut self) -> io::Result<Option<Frame>> {
        while !self.is_ended && self.at < self.bytes {
            let mut frame = self.frame(self.at)?;
            if let Some(torn) = &frame
                && self.reaches_another_log(torn)?
            {
                frame = None;
            }
            let behind = frame.as_ref().map(|frame| self.at + frame.bytes());
            if let (Some(frame), Some(behind)) = (frame, behind) {
                if self.check(&frame) {
                    self.at = behind;
                    if frame.opcode == op::FOOTER {
                        self.is_ended = true;
                        self.at += MAGIC.len() as u64;
                    }
                    return Ok(Some(frame));
                }
                if self.frame(behind)?.is_some() {
                    self.unread_bytes += frame.bytes();
                    self.at = behind;
                    continue;
                }
            }
            let resumed = self.resumption()?;
            self.unread_bytes += resumed - self.at;
            self.is_ended = self.frame(resumed)?.is_none();
            self.at = resumed;
            if self.is_ended && self.is_closed(resumed)? {
                self.at += MAGIC.len() as u64;
            }
        }
        Ok(None)
    }

    /// Whether the magic at byte `at` closes the log: the file ends behind it, or another one begins.
    fn is_closed(&self, at: u64) -> io::Result<bool> {
        let behind = at + MAGIC.len() as u64;
        let mut next = [0; MAGIC.len()];
        let left = self.bytes.saturating_sub(behind);
        if left < MAGIC.len() as u64 {
            return Ok(self.bytes >= behind);
        }
        self.file.read_exact_at(&mut next, behind)?;
        Ok(next == MAGIC)
    }

    /// Whether the length of `frame`, which begins the rest of the file, reaches into another log behind a tear: a log
    /// begins in it, and its checksum, if it has one, does not hold.
    fn reaches_another_log(&self, frame: &Frame) -> io::Result<bool> {
        let begins = |bytes: &[u8]| bytes.starts_with(MAGIC) && bytes.ends_with(&[op::HEADER]);
        let has_log = |bytes: &[u8]| bytes.windows(MAGIC.len() + 1).any(begins);
        // The first bytes of the other log may be the last ones of the frame.
        let last = frame.data.len().saturating_sub(MAGIC.len());
        let mut seam = frame.data.get(last..).unwrap_or_default().to_vec();
        let mut behind = [0; MAGIC.len()];
        self.file.read_at(&mut behind, self.at + frame.bytes())?;
        seam.extend(behind);
        let is_sound = || match frame.opcode {
            op::CHUNK => records(&frame.data).is_ok(),
            op::ATTACHMENT => is_attachment(&frame.data),
            _ => false,
        };
        Ok((has_log(&frame.data) || has_log(&seam)) && !is_sound())
    }

    /// Bytes behind the end of the log, now that it was met.
    pub(super) fn rest_bytes(&self) -> u64 {
        self.bytes.saturating_sub(self.at)
    }

    /// The record at byte `at`, if one can be there.
    fn frame(&self, at: u64) -> io::Result<Option<Frame>> {
        let mut head = [0; HEAD_BYTES];
        let left = self.bytes.saturating_sub(at);
        if left < HEAD_BYTES as u64 {
            return Ok(None);
        }
        self.file.read_exact_at(&mut head, at)?;
        let [opcode, length @ ..] = head;
        let length = u64::from_le_bytes(length).min(u64::MAX >> 1);
        let is_known = (op::HEADER..=op::DATA_END).contains(&opcode);
        let Ok(size) = usize::try_from(length) else { return Ok(None) };
        if !is_known || size > RECORD_BYTES_MAX || length > left - HEAD_BYTES as u64 {
            return Ok(None);
        }
        let mut data = vec![0; size];
        self.file.read_exact_at(&mut data, at + HEAD_BYTES as u64)?;
        Ok(Some(Frame { opcode, data }))
    }

    /// Counts what a chunk unpacks to. Returns whether the fields of `frame` fit into it, and its chunk may be
    /// unpacked.
    fn check(&mut self, frame: &Frame) -> bool {
        if frame.opcode == op::ATTACHMENT && !is_attachment(&frame.data) {
            return false;
        }
        match mcap::parse_record(frame.opcode, &frame.data) {
            Ok(Record::Chunk { header, .. }) => {
                let unpacked = self.unpacked.saturating_add(header.uncompressed_size);
                let is_sound =
                    is_chunk(&header, frame) && unpacked <= unpacked_max(self.at + frame.bytes());
                if is_sound {
                    self.unpacked = unpacked;
                }
                is_sound
            }
            Ok(_) => true,
            Err(_) => false,
        }
    }

    /// Where the next whole chunk begins behind the beginning of the broken frame; if none does, the end of the file or
    /// the beginning of another one in it, which may be where the frame should be.
    fn resumption(&self) -> io::Result<u64> {
        let mut window = vec![0; WINDOW_BYTES];
        let mut at = self.at;
        loop {
            let read = match self.file.read_at(&mut window, at) {
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                read => read?,
            };
            let found = window.get(..read).unwrap_or_default();
            for (place, bytes) in (at..).zip(found.windows(MAGIC.len())) {
                let is_chunk = place > self.at && bytes.starts_with(&[op::CHUNK]);
                if bytes == MAGIC || is_chunk && self.is_whole(place)? {
                    return Ok(place);
                }
            }
            if read < MAGIC.len() {
                return Ok(self.bytes);
            }
            // What the window's end cut is searched again.
            at += (read - (MAGIC.len() - 1)) as u64;
        }
    }

    /// Whether a chunk whose checksum holds is at byte `at`.
    fn is_whole(&self, at: u64) -> io::Result<bool> {
        let Some(frame) = self.frame(at)? else { return Ok(false) };
        let is_chunk = match mcap::parse_record(frame.opcode, &frame.data) {
            Ok(Record::Chunk { header, .. }) => is_chunk(&header, &frame),
            _ => false,
        };
        Ok(is_chunk && records(&frame.data).is_ok())
    }
}

impl Frame {
    fn bytes(&self) -> u64 {
        (HEAD_BYTES + self.data.len()) as u64
    }
}

/// Whether the sizes of a chunk fit its frame and what is accepted.
fn is_chunk(header: &ChunkHeader, frame: &Frame) -> bool {
    // Times, size, checksum, name of the compression, length of what follows.
    let head = 8 + 8 + 8 + 4 + (4 + header.compression.len() as u64) + 8;
    header.compressed_size.checked_add(head) == Some(frame.data.len() as u64)
        && header.uncompressed_size <= RECORD_BYTES_MAX as u64
}

/// The records of the chunk record `chunk`, if its checksum holds.
pub(super) fn records(mut chunk: &[u8]) -> McapResult<Vec<Record<'static>>> {
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

#[cfg(test)]
mod tests;
