//! Packets and objects: the framing of the DataStream.

#![deny(clippy::indexing_slicing)]

use crate::mocap::SourceError;
use crate::mocap::bytes::Bytes;

/// First bytes of every packet.
pub(crate) const MAGIC: u32 = 0x1A2B_0001;

/// Longest packet that is read, with its head: a hundred subjects of a hundred segments fit. bytes
pub(crate) const PACKET_BYTES_MAX: usize = 1 << 20;

const HEAD_BYTES: usize = 8;

/// Assembles packets from pieces that are cut anywhere. Holds what has arrived, whatever is announced.
#[derive(Debug, Default)]
pub struct Packets {
    bytes: Vec<u8>,
}

impl Packets {
    /// Calls `on_packet` with the objects of each packet that `piece` completes.
    ///
    /// # Errors
    /// Bytes that are no packet, one that is too long, or the first error of `on_packet`. What
    /// follows makes no sense then.
    pub fn push(
        &mut self,
        piece: &[u8],
        mut on_packet: impl FnMut(&[u8]) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        self.bytes.extend_from_slice(piece);
        let mut rest = self.bytes.as_slice();
        while let Some((packet, after)) = split_packet(rest)? {
            on_packet(packet)?;
            rest = after;
        }
        let used = self.bytes.len() - rest.len();
        self.bytes.drain(..used);
        Ok(())
    }

    /// Room that is held. bytes
    pub fn capacity(&self) -> usize {
        self.bytes.capacity()
    }

    /// Forgets the packet that has not ended: its connection is gone.
    pub fn clear(&mut self) {
        self.bytes.clear();
    }
}

/// A packet, and what follows it.
type Split<'a> = (&'a [u8], &'a [u8]);

/// The first packet in `bytes`, if it is whole.
fn split_packet(bytes: &[u8]) -> Result<Option<Split<'_>>, SourceError> {
    let Some((magic, rest)) = bytes.split_first_chunk() else { return Ok(None) };
    let found = u32::from_le_bytes(*magic);
    if found != MAGIC {
        return Err(SourceError::Magic { found });
    }
    let Some((length, rest)) = rest.split_first_chunk() else { return Ok(None) };
    let length = u32::from_le_bytes(*length);
    let max = PACKET_BYTES_MAX - HEAD_BYTES;
    match usize::try_from(length) {
        Ok(length) if length <= max => Ok(rest.split_at_checked(length)),
        _ => Err(SourceError::TooLong { length, max }),
    }
}

/// The objects of a packet: identity and body; `None`, which is the last item, where the packet ends within one.
pub fn objects(packet: &[u8]) -> impl Iterator<Item = Option<(u32, &[u8])>> + Clone {
    let mut bytes = Bytes::new(packet);
    std::iter::from_fn(move || {
        if bytes.end().is_some() {
            return None;
        }
        let mut next = || Some((bytes.u32_le()?, bytes.counted_le()?));
        let object = next();
        if object.is_none() {
            bytes = Bytes::new(&[]);
        }
        Some(object)
    })
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
