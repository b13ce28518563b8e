//! The UDP object stream of Vicon Tracker, to and from bodies.
//!
//! One datagram is a block of a frame: frame number (u32), number of items (u8), and per item an
//! identity (u8, 0 for objects), the size of what follows (u16), 24 bytes of name, three coordinates in
//! millimetres and three angles in rad (f64). Numbers are little-endian. An object that is lost is left
//! out. Pure: bytes to values and back.

#![deny(clippy::indexing_slicing)]

use super::M_PER_MM;
use super::axes::Placement;
use super::body::{Body, is_all_zero, matrix_of_angles};
use super::bytes::{Bytes, text_of};
use super::protocol::{Absence, BodyProtocol, FrameVisitor, Head, Name};
use super::source::{Refusal, SourceError};
use crate::clock::SpanNs;

/// Longest name of an object.
pub(crate) const NAME_BYTES_MAX: usize = 24;

/// Sizes of a block that Tracker can be set to. bytes
pub const BLOCK_BYTES: [usize; 3] = [256, 512, 1024];

const HEAD_BYTES: usize = 5;
const ITEM_HEAD_BYTES: usize = 3;
const OBJECT_BYTES: usize = NAME_BYTES_MAX + 6 * size_of::<f64>();
const OBJECT_ID: u8 = 0;

/// One datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Block<'a> {
    /// Frame number of the mocap system.
    pub frame: u32,
    /// Whether another object would not have fitted: the frame may go on in another datagram.
    pub is_full: bool,
    count: u8,
    items: &'a [u8],
}

impl<'a> Block<'a> {
    /// The block in one datagram; `None` if an item is not within it, or an object has another size than an object
    /// has: the datagram is lost, the stream goes on.
    pub fn parse(datagram: &'a [u8]) -> Option<Self> {
        let mut bytes = Bytes::new(datagram);
        let (frame, count) = (bytes.u32_le()?, bytes.u8()?);
        let items = bytes.rest();
        for _ in 0..count {
            let (id, body) = item(&mut bytes)?;
            if id == OBJECT_ID {
                object(body)?;
            }
        }
        let is_full = bytes.rest().len() < ITEM_HEAD_BYTES + OBJECT_BYTES;
        Some(Self { frame, is_full, count, items })
    }

    /// The objects of the block in the order of the wire; other items are left out.
    pub fn objects(&self) -> impl Iterator<Item = Body<'a>> + use<'a> {
        let mut bytes = Bytes::new(self.items);
        (0..self.count).filter_map(move |_| {
            let (id, body) = item(&mut bytes)?;
            if id == OBJECT_ID { object(body) } else { None }
        })
    }
}

/// Identity and bytes of the next item.
fn item<'a>(bytes: &mut Bytes<'a>) -> Option<(u8, &'a [u8])> {
    let (id, length) = (bytes.u8()?, bytes.u16_le()?);
    Some((id, bytes.take(length.into())?))
}

/// The object in the 72 bytes of an item.
fn object(bytes: &[u8]) -> Option<Body<'_>> {
    let mut bytes = Bytes::new(bytes);
    let name = text_of(bytes.take(NAME_BYTES_MAX)?);
    let (pos_mm, angles) = (bytes.f64s_le::<3>()?, bytes.f64s_le()?);
    bytes.end()?;
    Some(Body { name, pos_v: pos_mm.map(|mm| mm * M_PER_MM), angles })
}

/// Appends a block of `size` bytes with as many of `bodies` as fit, at most 255; none if `size` is below the head.
/// Returns their number.
///
/// A longer name is cut to `NAME_BYTES_MAX` bytes.
pub fn encode_block(frame: u32, bodies: &[Body<'_>], size: usize, to: &mut Vec<u8>) -> usize {
    let begin = to.len();
    let fitting = size.saturating_sub(HEAD_BYTES) / (ITEM_HEAD_BYTES + OBJECT_BYTES);
    let count = u8::try_from(bodies.len().min(fitting)).unwrap_or(u8::MAX);
    to.extend(frame.to_le_bytes());
    to.push(count);
    for body in bodies.iter().take(count.into()) {
        to.push(OBJECT_ID);
        to.extend(u16::try_from(OBJECT_BYTES).unwrap_or(u16::MAX).to_le_bytes());
        let padding = std::iter::repeat(&0);
        to.extend(body.name.iter().chain(padding).take(NAME_BYTES_MAX));
        let numbers = body.pos_v.map(|m| m / M_PER_MM).into_iter().chain(body.angles);
        to.extend(numbers.flat_map(f64::to_le_bytes));
    }
    to.resize(begin + size.max(HEAD_BYTES), 0);
    count.into()
}

/// The blocks of an object stream.
#[derive(Debug)]
pub(super) struct ObjectStreamProtocol {
    rate_hz: f64,
    /// The frame of a full block, which may go on in the next datagram.
    unfinished: Option<u32>,
}

impl ObjectStreamProtocol {
    /// A reader before its first block, of a system with frames at `rate_hz`.
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { rate_hz, unfinished: None }
    }

    fn head(&self, number: u32, absence: Absence) -> Head {
        let (number, rate_hz) = (number.into(), self.rate_hz);
        Head { number, rate_hz, stamp: None, latency: SpanNs(0), absence }
    }
}

impl BodyProtocol for ObjectStreamProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        visitor.message();
        let Some(block) = Block::parse(bytes) else {
            visitor.refuse(Refusal::Form);
            return Ok(());
        };
        if let Some(number) = self.unfinished.take_if(|number| *number != block.frame) {
            // The frame did not go on: what was in none of its blocks is lost.
            visitor.frame(self.head(number, Absence::LostUnlessBefore));
        }
        for Body { name, pos_v, angles } in block.objects() {
            let at = Placement { pos_v, matrix: matrix_of_angles(angles) };
            let is_lost = is_all_zero(pos_v.into_iter().chain(angles));
            visitor.body(Name { text: Some(name), id: None }, (!is_lost).then_some(&at));
        }
        // Handed over before the next block: a pose does not wait for it.
        self.unfinished = block.is_full.then_some(block.frame);
        let absence = if block.is_full { Absence::Unknown } else { Absence::LostUnlessBefore };
        visitor.frame(self.head(block.frame, absence));
        Ok(())
    }

    fn restart(&mut self) {
        self.unfinished = None;
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
