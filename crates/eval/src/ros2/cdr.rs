//! Common Data Representation of ROS 2 messages, little-endian.
//!
//! Owns the bytes. Each message begins with four bytes that name the encoding; numbers are aligned to their size,
//! counted behind these.

#![deny(clippy::indexing_slicing)]

/// Bytes that name the encoding.
const HEAD: [u8; 4] = [0, 1, 0, 0];

/// Position and orientation: x, y, z in m; quaternion x, y, z, w.
pub(crate) type PoseNumbers = ([f64; 3], [f64; 4]);

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
    pub(super) fn place(&mut self, (point, turn): &PoseNumbers) {
        for value in point.iter().chain(turn) {
            self.double(*value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bytes that `write` appends after the head and a first byte.
    fn after_a_byte(write: impl FnOnce(&mut Cdr)) -> Vec<u8> {
        let mut cdr = Cdr::new();
        cdr.byte(9);
        write(&mut cdr);
        let bytes = cdr.into_bytes();
        let (head, rest) = bytes.split_at(HEAD.len());
        assert_eq!(head, HEAD);
        rest.to_vec()
    }

    #[test]
    fn numbers_begin_at_multiples_of_their_size() {
        assert_eq!(after_a_byte(|cdr| cdr.byte(1)), [9, 1]);
        assert_eq!(after_a_byte(|cdr| cdr.uint(0x0403_0201)), [9, 0, 0, 0, 1, 2, 3, 4]);
        let single = after_a_byte(|cdr| cdr.single(-0.5));
        assert_eq!(single, [9, 0, 0, 0, 0, 0, 0, 0xBF]);
        let double = after_a_byte(|cdr| cdr.double(2.0));
        assert_eq!(double, [9, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0x40]);
        // Aligned already: nothing between.
        let pair = after_a_byte(|cdr| {
            cdr.uint(1);
            cdr.double(0.0);
        });
        assert_eq!(pair.len(), 16);
    }

    #[test]
    fn a_text_counts_its_zero() {
        assert_eq!(after_a_byte(|cdr| cdr.text("ab")), [9, 0, 0, 0, 3, 0, 0, 0, b'a', b'b', 0]);
        assert_eq!(after_a_byte(|cdr| cdr.text("")), [9, 0, 0, 0, 1, 0, 0, 0, 0]);
    }

    #[test]
    fn a_header_has_seconds_nanoseconds_and_frame() {
        let mut cdr = Cdr::with_header(7_000_000_005, "w");
        cdr.byte(1);
        let expected = [0, 1, 0, 0, 7, 0, 0, 0, 5, 0, 0, 0, 2, 0, 0, 0, b'w', 0, 1];
        assert_eq!(cdr.into_bytes(), expected);
        // Beyond the seconds of its kind it stays at the last one.
        let late = Cdr::with_header(u64::MAX, "").into_bytes();
        assert_eq!(late.get(4..8), Some(&[0xFF; 4][..]));
    }

    #[test]
    fn a_place_is_its_point_and_its_quaternion() {
        let mut cdr = Cdr::new();
        cdr.place(&([1.0, 2.0, 3.0], [4.0, 5.0, 6.0, 7.0]));
        let bytes = cdr.into_bytes();
        let numbers = bytes.get(HEAD.len()..).unwrap().chunks(8);
        let numbers: Vec<f64> =
            numbers.map(|eight| f64::from_le_bytes(eight.try_into().unwrap())).collect();
        assert_eq!(numbers, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]);
        let mut list = Cdr::new();
        list.doubles(&[1.5]);
        assert_eq!(list.into_bytes().len(), HEAD.len() + 4 + 4 + 8);
    }
}
