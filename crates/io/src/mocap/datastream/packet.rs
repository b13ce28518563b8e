//! Packets and objects: the framing of the DataStream.

#![deny(clippy::indexing_slicing)]

use thiserror::Error;

use crate::mocap::SourceError;

/// What every packet begins with.
pub const MAGIC: u32 = 0x1A2B_0001;

/// Longest packet that is read, with its head: a hundred subjects of a hundred segments fit. bytes
pub const PACKET_BYTES_MAX: usize = 1 << 20;

const HEAD_BYTES: usize = 8;

/// Why a packet is refused; the next one is read.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum PacketError {
    /// A value is announced and not there.
    #[error("{left} bytes are left where {wanted} are announced")]
    Short {
        /// Bytes that are announced.
        wanted: usize,
        /// Bytes that there are.
        left: usize,
    },
    /// Bytes are left behind the last value.
    #[error("{left} bytes are left over")]
    Long {
        /// How many.
        left: usize,
    },
    /// A frame period of zero or less.
    #[error("a frame period of {ticks} ticks")]
    Period {
        /// Ticks of 135 MHz.
        ticks: i64,
    },
}

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

/// The objects of a packet: identity and body; an error, which is the last item, where the packet ends within one.
pub fn objects(packet: &[u8]) -> impl Iterator<Item = Result<(u32, &[u8]), PacketError>> {
    let mut values = Values::new(packet);
    std::iter::from_fn(move || {
        if values.is_empty() {
            return None;
        }
        let object = values.u32().and_then(|id| Ok((id, values.bytes()?)));
        if object.is_err() {
            values = Values::new(&[]);
        }
        Some(object)
    })
}

/// Takes values from the front of an object's body. A single value that is cut off is an error and takes nothing.
#[derive(Debug, Clone, Copy)]
pub struct Values<'a>(&'a [u8]);

impl<'a> Values<'a> {
    /// The values in `body`, little-endian; the first is taken next.
    pub fn new(body: &'a [u8]) -> Self {
        Self(body)
    }

    fn is_empty(self) -> bool {
        self.0.is_empty()
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], PacketError> {
        let left = self.0.len();
        let (array, rest) =
            self.0.split_first_chunk().ok_or(PacketError::Short { wanted: N, left })?;
        self.0 = rest;
        Ok(*array)
    }

    /// The next value, one byte.
    ///
    /// # Errors
    /// As for all of these, [`PacketError::Short`].
    pub fn u8(&mut self) -> Result<u8, PacketError> {
        Ok(u8::from_le_bytes(self.array()?))
    }

    /// The next value.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn u32(&mut self) -> Result<u32, PacketError> {
        Ok(u32::from_le_bytes(self.array()?))
    }

    /// The next value.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn i64(&mut self) -> Result<i64, PacketError> {
        Ok(i64::from_le_bytes(self.array()?))
    }

    /// The next value.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn f64(&mut self) -> Result<f64, PacketError> {
        Ok(f64::from_le_bytes(self.array()?))
    }

    /// The next `N` values.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn f64s<const N: usize>(&mut self) -> Result<[f64; N], PacketError> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64()?;
        }
        Ok(values)
    }

    /// Bytes behind their number: a string, or the body of an object.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn bytes(&mut self) -> Result<&'a [u8], PacketError> {
        let wanted = usize::try_from(self.u32()?).unwrap_or(usize::MAX);
        self.take(wanted)
    }

    /// The next `wanted` bytes.
    ///
    /// # Errors
    /// [`PacketError::Short`].
    pub fn take(&mut self, wanted: usize) -> Result<&'a [u8], PacketError> {
        let left = self.0.len();
        let (bytes, rest) =
            self.0.split_at_checked(wanted).ok_or(PacketError::Short { wanted, left })?;
        self.0 = rest;
        Ok(bytes)
    }

    /// Whether nothing is left.
    ///
    /// # Errors
    /// [`PacketError::Long`] if something is.
    pub fn end(self) -> Result<(), PacketError> {
        let left = self.0.len();
        if left == 0 { Ok(()) } else { Err(PacketError::Long { left }) }
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
