//! Looks at the frames of an MCAP file before its reader does.
//!
//! Owns how much a chunk may unpack to. A few bytes can claim gigabytes: a chunk that declares too much is never
//! unpacked. It keeps the place in the file, the beginning of one record and the sum of what the chunks unpack to.

#![deny(clippy::indexing_slicing)]

use std::io::{self, Read};

use mcap::MAGIC;
use mcap::records::op;

use super::reader::{RECORD_BYTES_MAX, read_some};

/// Opcode and length of a record.
pub(super) const HEAD_BYTES: usize = 1 + 8;

/// Of a chunk: first and last time, unpacked size.
const CHUNK_BYTES: usize = 8 + 8 + 8;

/// How many times its size on the disk a log may unpack to, beyond [`RECORD_BYTES_MAX`]. Ours reach 30.
const RATIO_MAX: u64 = 200;

/// Largest unpacked size of the chunks in the first `packed` bytes of a file. bytes
pub(super) fn unpacked_max(packed: u64) -> u64 {
    packed.saturating_mul(RATIO_MAX).saturating_add(RECORD_BYTES_MAX as u64)
}

/// The frames of one file, fed in order.
#[derive(Debug)]
pub(super) struct Framing {
    /// Bytes seen.
    offset: u64,
    /// Bytes of the file to pass over before the next record.
    skip: u64,
    /// Beginning of a record that is not complete yet.
    begun: [u8; HEAD_BYTES + CHUNK_BYTES],
    begun_bytes: usize,
    /// Unpacked size of all chunks so far. bytes
    unpacked: u64,
    refusal: Option<String>,
    /// Whether the footer was met.
    is_ended: bool,
    /// Whether bytes were seen behind the end of the file.
    has_rest: bool,
}

impl Framing {
    pub(super) fn new() -> Self {
        Self {
            offset: 0,
            skip: MAGIC.len() as u64,
            begun: [0; HEAD_BYTES + CHUNK_BYTES],
            begun_bytes: 0,
            unpacked: 0,
            refusal: None,
            is_ended: false,
            has_rest: false,
        }
    }

    /// How many of the next `bytes` of the file may be read; fewer than all if the rest is refused.
    pub(super) fn admit(&mut self, bytes: &[u8]) -> usize {
        let mut at = 0;
        while self.refusal.is_none() {
            let Some(rest) = bytes.get(at..).filter(|rest| !rest.is_empty()) else { break };
            let passed = usize::try_from(self.skip).unwrap_or(usize::MAX).min(rest.len());
            if passed > 0 {
                self.skip -= passed as u64;
                at += passed;
                self.offset += passed as u64;
                continue;
            }
            if self.is_ended {
                self.has_rest = true;
                break;
            }
            let wanted = self.wanted();
            let Some(free) = self.begun.get_mut(self.begun_bytes..wanted) else { break };
            for (slot, byte) in free.iter_mut().zip(rest) {
                *slot = *byte;
                self.begun_bytes += 1;
                at += 1;
                self.offset += 1;
            }
            if self.begun_bytes == self.wanted() {
                self.judge();
            }
        }
        at
    }

    /// Why nothing more may be read, with the place of the chunk in the file.
    pub(super) fn refusal(&self) -> Option<&str> {
        self.refusal.as_deref()
    }

    /// Whether `source` has more than one file, as of logs that were put together, now that the end was met.
    pub(super) fn has_rest(&self, source: &mut dyn Read) -> io::Result<bool> {
        Ok(self.has_rest || read_some(source, &mut [0])? > 0)
    }

    fn is_chunk(&self) -> bool {
        matches!(self.begun.first(), Some(&op::CHUNK))
    }

    /// How much of the record that begins has to be known.
    fn wanted(&self) -> usize {
        if self.begun_bytes > 0 && self.is_chunk() { self.begun.len() } else { HEAD_BYTES }
    }

    fn number(&self, at: usize) -> u64 {
        let bytes = self.begun.get(at..).and_then(|bytes| bytes.first_chunk());
        bytes.map_or(u64::MAX, |bytes| u64::from_le_bytes(*bytes))
    }

    /// Passes over a record whose beginning is known, or refuses it.
    fn judge(&mut self) {
        let length = self.number(1);
        let known = (self.begun_bytes - HEAD_BYTES) as u64;
        if self.is_chunk() {
            let start = self.offset - self.begun_bytes as u64;
            let unpacked = self.number(HEAD_BYTES + CHUNK_BYTES - 8);
            self.unpacked = self.unpacked.saturating_add(unpacked);
            let packed = start.saturating_add(length);
            if unpacked > RECORD_BYTES_MAX as u64 {
                self.refusal = Some(format!(
                    "the chunk at byte {start} would unpack to {unpacked} bytes; {RECORD_BYTES_MAX} are \
                     accepted"
                ));
            } else if self.unpacked > unpacked_max(packed) {
                self.refusal = Some(format!(
                    "up to the chunk at byte {start} the file would unpack to {} bytes, more than \
                     {RATIO_MAX} times its size",
                    self.unpacked
                ));
            }
        }
        // A chunk that is shorter than its own head is the reader's to refuse.
        self.skip = length.saturating_sub(known);
        if matches!(self.begun.first(), Some(&op::FOOTER)) {
            self.is_ended = true;
            self.skip = self.skip.saturating_add(MAGIC.len() as u64);
        }
        self.begun_bytes = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A record with `length` bytes of zeros behind it, of which only the head is written.
    fn record(opcode: u8, length: u64, written: usize) -> Vec<u8> {
        let mut bytes = vec![opcode];
        bytes.extend(length.to_le_bytes());
        bytes.resize(bytes.len() + written, 0);
        bytes
    }

    fn chunk(unpacked: u64, packed: usize) -> Vec<u8> {
        let mut bytes = record(op::CHUNK, (40 + packed) as u64, 16);
        bytes.extend(unpacked.to_le_bytes());
        bytes.resize(bytes.len() + 16 + packed, 0);
        bytes
    }

    /// Bytes admitted of a file in pieces of `step` bytes, and the refusal.
    fn admit(file: &[u8], step: usize) -> (usize, Option<String>) {
        let mut framing = Framing::new();
        let mut admitted = 0;
        for piece in file.chunks(step) {
            let count = framing.admit(piece);
            admitted += count;
            if count < piece.len() {
                break;
            }
        }
        (admitted, framing.refusal().map(str::to_owned))
    }

    #[test]
    fn a_chunk_that_claims_too_much_is_refused_with_its_place_however_it_is_cut() {
        let mut file = MAGIC.to_vec();
        file.extend(record(op::HEADER, 20, 20));
        file.extend(chunk(100_000, 5_000));
        let start = file.len();
        file.extend(chunk(4 << 30, 500));
        for step in [1, 7, 33, 4096, usize::MAX] {
            let (admitted, refusal) = admit(&file, step.min(file.len()));
            assert!((start..=start + 33).contains(&admitted), "{admitted} by {step}");
            let expected = format!("the chunk at byte {start} would unpack to 4294967296 bytes");
            assert!(refusal.is_some_and(|why| why.contains(&expected)));
            assert_eq!(admit(file.get(..start).unwrap(), step.min(start)), (start, None));
        }
    }

    #[test]
    fn many_chunks_together_are_bounded_by_the_size_of_the_file() {
        let mut file = MAGIC.to_vec();
        for _ in 0..100 {
            file.extend(chunk(1 << 20, 100));
        }
        let (_, refusal) = admit(&file, 4096);
        assert!(refusal.is_some_and(|why| why.contains("times its size")));
        // The same as a log of ours packs it.
        let mut file = MAGIC.to_vec();
        for _ in 0..200 {
            file.extend(chunk(1 << 20, 1 << 15));
        }
        assert_eq!(admit(&file, 4096), (file.len(), None));
    }

    #[test]
    fn lengths_that_cannot_be_are_left_to_the_reader() {
        let mut file = MAGIC.to_vec();
        file.extend(record(op::MESSAGE, u64::MAX, 1000));
        assert_eq!(admit(&file, 64), (file.len(), None));
    }
}
