//! Packets of QTM's real-time protocol, little-endian, and the bodies in them.

#![deny(clippy::indexing_slicing)]

use std::borrow::Cow;

use crate::mocap::SourceError;
use crate::mocap::axes::Placement;
use crate::mocap::bytes::{Bytes, text_of};

/// Kinds of packets.
pub mod kind {
    /// A text: what went wrong.
    pub const ERROR: u32 = 0;
    /// A text: a command, or the answer to it.
    pub const COMMAND: u32 = 1;
    /// A document.
    pub const XML: u32 = 2;
    /// A frame.
    pub const DATA: u32 = 3;
    /// One byte: what changed.
    pub const EVENT: u32 = 6;
}

/// 6DOF bodies with matrices, among the components of a frame.
pub(super) const BODIES: u32 = 5;
/// Rates of dropped and of unsynchronized frames, before the bodies.
pub(super) const LOSSES_BYTES: usize = 2 + 2;

/// Longest packet that is read, without its head. bytes
pub(crate) const PACKET_BYTES_MAX: usize = 1 << 20;

const HEAD_BYTES: usize = 8;

/// Assembles packets from pieces that are cut anywhere. Holds what has arrived, whatever is announced.
#[derive(Debug, Default)]
pub struct Packets {
    bytes: Vec<u8>,
}

impl Packets {
    /// Calls `on_packet` with kind and body, without the head, of each packet that `piece` completes; the rest is kept
    /// for the next piece. Allocates only if more is kept than ever before: at most a packet of `PACKET_BYTES_MAX`
    /// and a piece.
    ///
    /// # Errors
    /// A length that none of this protocol has, or the first error of `on_packet`. What follows makes no
    /// sense then: the next connection takes new [`Packets`].
    pub fn push(
        &mut self,
        piece: &[u8],
        mut on_packet: impl FnMut(u32, &[u8]) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        self.bytes.extend_from_slice(piece);
        let mut rest = Bytes::new(&self.bytes);
        loop {
            let mut ahead = rest;
            let (Some(size), Some(kind)) = (ahead.u32_le(), ahead.u32_le()) else { break };
            let length = usize::try_from(size).ok().and_then(|size| size.checked_sub(HEAD_BYTES));
            let Some(length) = length.filter(|length| *length <= PACKET_BYTES_MAX) else {
                return Err(SourceError::NoQtm);
            };
            let Some(body) = ahead.take(length) else { break };
            on_packet(kind, body)?;
            rest = ahead;
        }
        let used = self.bytes.len() - rest.rest().len();
        self.bytes.drain(..used);
        Ok(())
    }
}

/// The text of a packet: its bytes up to the first zero, or all of them. What is no UTF-8 becomes U+FFFD, for which the
/// text is copied; else it is borrowed.
pub fn text(body: &[u8]) -> Cow<'_, str> {
    String::from_utf8_lossy(text_of(body))
}

/// Time stamp (us) and number of a frame. Calls `on_body` with index, number of bodies and place of each body, in
/// millimetres, `None` for one that is not seen. `None` if the packet ends before the frame does.
pub fn frame(
    body: &[u8],
    mut on_body: impl FnMut(usize, usize, Option<Placement>),
) -> Option<(u64, u32)> {
    let mut bytes = Bytes::new(body);
    let time_us = bytes.u64_le()?;
    let number = bytes.u32_le()?;
    for _ in 0..bytes.u32_le()? {
        let (size, component) = (bytes.u32_le()?, bytes.u32_le()?);
        let length = usize::try_from(size).ok()?.checked_sub(HEAD_BYTES)?;
        let mut values = Bytes::new(bytes.take(length)?);
        if component != BODIES {
            continue;
        }
        let count = values.count_le()?;
        values.array::<LOSSES_BYTES>()?;
        for index in 0..count {
            let (pos_v, columns) = (values.f32s_le()?, values.f32s_le()?);
            on_body(index, count, placement(pos_v, columns));
        }
    }
    Some((time_us, number))
}

/// A place from position and matrix, which comes column by column; `None` if there are no numbers.
fn placement(pos_v: [f64; 3], columns: [f64; 9]) -> Option<Placement> {
    let is_seen = pos_v.iter().chain(&columns).all(|value| value.is_finite());
    let [a, d, g, b, e, h, c, f, i] = columns;
    is_seen.then_some(Placement { pos_v, matrix: [a, b, c, d, e, f, g, h, i] })
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
