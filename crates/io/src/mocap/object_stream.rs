//! The UDP object stream of Vicon Tracker, to and from bodies.
//!
//! One datagram is a block of a frame: frame number (u32), number of items (u8), and per item an
//! identity (u8, 0 for objects), the size of what follows (u16), 24 bytes of name, three coordinates in
//! millimetres and three angles in rad (f64). Numbers are little-endian. An object that is lost is left
//! out. Pure: bytes to values and back.

#![deny(clippy::indexing_slicing)]

use thiserror::Error;

use super::axes::Placement;
use super::body::{Body, heading_of_angles, is_all_zero, matrix_of_angles, pose};
use super::protocol::{BodyProtocol, Head, Name, OBJECTS_MAX, Taker};
use super::source::{Connection, Frame, Source, SourceError};
use super::{M_PER_MM, MocapCounters};
use crate::clock::SpanNs;

/// Longest name of an object.
pub const NAME_BYTES_MAX: usize = 24;

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

/// Why a datagram is not a block.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum BlockError {
    /// Less than a frame number and a count.
    #[error("{length} bytes are no block")]
    NoHead {
        /// Bytes received.
        length: usize,
    },
    /// The datagram ends inside an item.
    #[error("the block ends inside item {item} of {count}")]
    Truncated {
        /// Index of the item.
        item: u8,
        /// Announced number of items.
        count: u8,
    },
    /// An object with another size than an object has.
    #[error("object {item} has {length} bytes instead of 72")]
    Length {
        /// Index of the item.
        item: u8,
        /// Its announced size.
        length: usize,
    },
}

impl<'a> Block<'a> {
    /// The block in one datagram, every item within it.
    ///
    /// # Errors
    /// The first item that is not within the datagram; the datagram is lost, the stream goes on.
    pub fn parse(datagram: &'a [u8]) -> Result<Self, BlockError> {
        let (frame, rest) =
            datagram.split_first_chunk().ok_or(BlockError::NoHead { length: datagram.len() })?;
        let (&count, mut rest) =
            rest.split_first().ok_or(BlockError::NoHead { length: datagram.len() })?;
        let items = rest;
        for item in 0..count {
            let (_, length, body) = item_head(rest).ok_or(BlockError::Truncated { item, count })?;
            let (_, after) =
                body.split_at_checked(length).ok_or(BlockError::Truncated { item, count })?;
            rest = after;
        }
        let is_full = rest.len() < ITEM_HEAD_BYTES + OBJECT_BYTES;
        Ok(Self { frame: u32::from_le_bytes(*frame), is_full, count, items })
    }

    /// The objects of the block in the order of the wire; other items are left out. An error where an object has a
    /// wrong length; the next ones are read.
    pub fn objects(&self) -> impl Iterator<Item = Result<Body<'a>, BlockError>> + use<'a> {
        let mut rest = self.items;
        (0..self.count).filter_map(move |item| {
            let (id, length, body) = item_head(rest)?;
            let (body, after) = body.split_at_checked(length)?;
            rest = after;
            let is_object = id == OBJECT_ID;
            is_object.then(|| object(body).ok_or(BlockError::Length { item, length }))
        })
    }
}

/// Identity and size of the item at the front of `bytes`, and what follows them.
fn item_head(bytes: &[u8]) -> Option<(u8, usize, &[u8])> {
    let (&id, rest) = bytes.split_first()?;
    let (length, rest) = rest.split_first_chunk()?;
    Some((id, u16::from_le_bytes(*length).into(), rest))
}

/// The object in the 72 bytes of an item.
fn object(bytes: &[u8]) -> Option<Body<'_>> {
    let (name, mut numbers) = bytes.split_at_checked(NAME_BYTES_MAX)?;
    let mut next = || {
        let (number, rest) = numbers.split_first_chunk()?;
        numbers = rest;
        Some(f64::from_le_bytes(*number))
    };
    let pos_w = [next()? * M_PER_MM, next()? * M_PER_MM, next()? * M_PER_MM];
    let angles = [next()?, next()?, next()?];
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    numbers.is_empty().then_some(Body { name, pos_w, angles })
}

/// Appends a block of `size` bytes with as many of `bodies` as fit; the number of those that did.
///
/// A longer name is cut to [`NAME_BYTES_MAX`] bytes.
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
        let numbers = body.pos_w.map(|m| m / M_PER_MM).into_iter().chain(body.angles);
        to.extend(numbers.flat_map(f64::to_le_bytes));
    }
    to.resize(begin + size.max(HEAD_BYTES), 0);
    count.into()
}

/// The object stream, read for one object.
#[derive(Debug)]
pub(super) struct ObjectStreamSource {
    object: String,
    rate_hz: f64,
    /// The frame of a full block without the object, which may go on in the next datagram.
    unfinished: Option<u32>,
    /// The last frame that had the object.
    seen: Option<u32>,
}

impl ObjectStreamSource {
    pub(super) fn new(object: &str, rate_hz: f64) -> Self {
        Self { object: object.to_owned(), rate_hz, unfinished: None, seen: None }
    }

    fn frame(&self, number: u32, pose: Option<horizon_model::rows::Pose>) -> Frame {
        let (number, rate_hz) = (number.into(), self.rate_hz);
        Frame { number, rate_hz, stamp: None, latency: SpanNs(0), pose }
    }

    /// The object was in a block of the frame `number`.
    fn see(
        &mut self,
        number: u32,
        pose: Option<horizon_model::rows::Pose>,
        on_frame: &mut dyn FnMut(Frame),
    ) {
        self.seen = Some(number);
        self.unfinished = None;
        on_frame(self.frame(number, pose));
    }

    /// What one block says, or why it says nothing.
    fn read(&mut self, block: &Block<'_>, on_frame: &mut dyn FnMut(Frame)) -> Option<Reading> {
        let (mut others, mut found) = (0, None);
        for body in block.objects() {
            let body = match body {
                Ok(body) => body,
                // Behind our object nothing else matters.
                Err(_) if found.is_some() => continue,
                Err(_) => return None,
            };
            if body.name != self.object.as_bytes() {
                others += 1;
            } else if found.replace(body).is_some() {
                // Of two it is not known which is which.
                self.see(block.frame, None, on_frame);
                return Some(Reading::Doubled);
            }
        }
        if let Some(body) = found {
            let pose = if is_all_zero(body.pos_w.into_iter().chain(body.angles)) {
                None
            } else {
                Some(pose(body.pos_w, heading_of_angles(body.angles)?)?)
            };
            self.see(block.frame, pose, on_frame);
            return Some(Reading::Object);
        }
        if self.seen != Some(block.frame) {
            if block.is_full {
                self.unfinished = Some(block.frame);
            } else {
                self.unfinished = None;
                on_frame(self.frame(block.frame, None));
            }
        }
        Some(if others > 0 { Reading::Others } else { Reading::Nothing })
    }
}

/// What a block was about.
enum Reading {
    Object,
    /// More than one object has the name.
    Doubled,
    Others,
    Nothing,
}

impl Source for ObjectStreamSource {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<(), SourceError> {
        counters.messages.count();
        let Ok(block) = Block::parse(bytes) else {
            counters.malformed.count();
            return Ok(());
        };
        if let Some(number) = self.unfinished.take_if(|number| *number != block.frame) {
            // The frame did not go on: the object was in none of its blocks.
            on_frame(self.frame(number, None));
        }
        match self.read(&block, on_frame) {
            Some(Reading::Object | Reading::Nothing) => {}
            Some(Reading::Doubled) => counters.doubled.count(),
            Some(Reading::Others) => counters.other_object.count(),
            None => counters.malformed.count(),
        }
        Ok(())
    }
}

impl Connection for ObjectStreamSource {
    fn restart(&mut self) {
        self.unfinished = None;
        self.seen = None;
    }
}

/// The blocks of an object stream, read for every object that it has.
#[derive(Debug)]
pub(super) struct BlockBodies {
    rate_hz: f64,
    /// The frame of full blocks, which may go on in the next datagram, and its bodies so far.
    unfinished: Option<u32>,
    bodies: Vec<(String, Placement)>,
}

impl BlockBodies {
    pub(super) fn new(rate_hz: f64) -> Self {
        Self { rate_hz, unfinished: None, bodies: Vec::new() }
    }

    /// Hands over the frame `number`, which is complete.
    fn end(&mut self, number: u32, taker: &mut dyn Taker) {
        for (name, at) in self.bodies.drain(..) {
            taker.body(Name { text: Some(&name), id: None }, Some(&at));
        }
        let (number, rate_hz) = (number.into(), self.rate_hz);
        let (stamp, latency) = (None, SpanNs(0));
        taker.frame(Head { number, rate_hz, stamp, latency, is_whole: true });
    }
}

impl BodyProtocol for BlockBodies {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        taker: &mut dyn Taker,
    ) -> Result<(), SourceError> {
        counters.messages.count();
        let Ok(block) = Block::parse(bytes) else {
            counters.malformed.count();
            return Ok(());
        };
        if let Some(number) = self.unfinished.take_if(|number| *number != block.frame) {
            self.end(number, taker);
        }
        for body in block.objects() {
            let Ok(body) = body else {
                counters.malformed.count();
                continue;
            };
            if self.bodies.len() < OBJECTS_MAX {
                let at = Placement { pos_v: body.pos_w, matrix: matrix_of_angles(body.angles) };
                self.bodies.push((String::from_utf8_lossy(body.name).into_owned(), at));
            }
        }
        if block.is_full {
            self.unfinished = Some(block.frame);
        } else {
            self.unfinished = None;
            self.end(block.frame, taker);
        }
        Ok(())
    }
}

impl Connection for BlockBodies {
    fn restart(&mut self) {
        self.unfinished = None;
        self.bodies.clear();
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
