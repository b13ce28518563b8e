//! Common Data Representation of ROS 2 messages, little-endian.
//!
//! Owns the bytes. Each message begins with four bytes that name the encoding; numbers are aligned to their size,
//! counted behind these.

#![deny(clippy::indexing_slicing)]

/// Bytes that name the encoding.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// Position and orientation: x, y, z in m; quaternion x, y, z, w.
pub(crate) type Place = ([f64; 3], [f64; 4]);

/// A message being written.
pub(super) struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    /// A message with the header of `stamp_ns` after 1970 and the frame `frame_id`.
    pub(super) fn with_header(stamp_ns: u64, frame_id: &str) -> Self {
        let mut cdr = Self::new();
        cdr.header(stamp_ns, frame_id);
        cdr
    }

    /// An empty message.
    pub(super) fn new() -> Self {
        Self { bytes: HEAD.to_vec() }
    }

    pub(super) fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn align(&mut self, size: usize) {
        let length = (self.bytes.len() - HEAD.len()).next_multiple_of(size) + HEAD.len();
        self.bytes.resize(length, 0);
    }

    pub(super) fn byte(&mut self, value: u8) {
        self.bytes.push(value);
    }

    pub(super) fn uint(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    /// A number of single precision.
    pub(super) fn single(&mut self, value: f32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    pub(super) fn double(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    /// How many elements follow.
    pub(super) fn count(&mut self, count: usize) {
        self.uint(u32::try_from(count).unwrap_or(u32::MAX));
    }

    /// Length with the zero at the end, text, zero.
    pub(super) fn text(&mut self, text: &str) {
        self.count(text.len() + 1);
        self.bytes.extend(text.as_bytes());
        self.byte(0);
    }

    pub(super) fn doubles(&mut self, values: &[f64]) {
        self.count(values.len());
        for value in values {
            self.double(*value);
        }
    }

    pub(super) fn header(&mut self, stamp_ns: u64, frame_id: &str) {
        self.uint(u32::try_from(stamp_ns / 1_000_000_000).unwrap_or(u32::MAX));
        self.uint(u32::try_from(stamp_ns % 1_000_000_000).unwrap_or(0));
        self.text(frame_id);
    }

    /// A point or vector, then a quaternion.
    pub(super) fn place(&mut self, (point, turn): &Place) {
        for value in point.iter().chain(turn) {
            self.double(*value);
        }
    }
}
