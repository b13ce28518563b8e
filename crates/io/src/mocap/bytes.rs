//! Values from the front of received bytes, little-endian or big-endian.
//!
//! Owns the bounds: every read returns `None` where bytes are missing, and nothing is allocated.

#![deny(clippy::indexing_slicing)]

/// Bytes left to read. Cheap to copy, so that a caller can look ahead.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bytes<'a>(&'a [u8]);

/// Methods that read one number in a byte order.
macro_rules! numbers {
    ($($name:ident: $type:ty = $from:ident;)*) => {
        $(pub(super) fn $name(&mut self) -> Option<$type> {
            self.array().map(<$type>::$from)
        })*
    };
}

impl<'a> Bytes<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self(bytes)
    }

    numbers! {
        u8: u8 = from_le_bytes;
        u16_le: u16 = from_le_bytes;
        u32_le: u32 = from_le_bytes;
        i32_le: i32 = from_le_bytes;
        u64_le: u64 = from_le_bytes;
        i64_le: i64 = from_le_bytes;
        f32_le: f32 = from_le_bytes;
        f64_le: f64 = from_le_bytes;
        u32_be: u32 = from_be_bytes;
        i32_be: i32 = from_be_bytes;
        f64_be: f64 = from_be_bytes;
    }

    /// The next `N` numbers of four bytes, little-endian.
    pub(super) fn f32s_le<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f32_le()?.into();
        }
        Some(values)
    }

    /// The next `N` numbers of eight bytes, little-endian.
    pub(super) fn f64s_le<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64_le()?;
        }
        Some(values)
    }

    /// The next `N` numbers of eight bytes, big-endian.
    pub(super) fn f64s_be<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for value in &mut values {
            *value = self.f64_be()?;
        }
        Some(values)
    }

    /// A count of things to come: a number of four bytes, little-endian, that is not negative.
    pub(super) fn count_le(&mut self) -> Option<usize> {
        usize::try_from(self.i32_le()?).ok()
    }

    pub(super) fn take(&mut self, count: usize) -> Option<&'a [u8]> {
        let (bytes, rest) = self.0.split_at_checked(count)?;
        self.0 = rest;
        Some(bytes)
    }

    /// Bytes behind their number, which has four bytes, little-endian.
    pub(super) fn counted_le(&mut self) -> Option<&'a [u8]> {
        let count = usize::try_from(self.u32_le()?).ok()?;
        self.take(count)
    }

    /// Skips `count` things of `size` bytes each.
    pub(super) fn skip(&mut self, count: usize, size: usize) -> Option<()> {
        self.take(count.checked_mul(size)?).map(|_| ())
    }

    /// Bytes up to a zero, which is skipped.
    pub(super) fn until_zero(&mut self) -> Option<&'a [u8]> {
        let at = self.0.iter().position(|byte| *byte == 0)?;
        let text = self.take(at)?;
        self.take(1)?;
        Some(text)
    }

    pub(super) fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (array, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*array)
    }

    /// Bytes that were not read.
    pub(super) fn rest(self) -> &'a [u8] {
        self.0
    }

    /// `None` if something was not read.
    pub(super) fn end(self) -> Option<()> {
        self.0.is_empty().then_some(())
    }
}

/// The text before the first zero in a field of fixed size.
pub(super) fn text_of(field: &[u8]) -> &[u8] {
    field.split(|byte| *byte == 0).next().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_in_their_order_and_only_whole() {
        let received = [0xfe, 0xff, 0xff, 0xff, 0x00, 0x00, 0x00, 0x02, 0x40, 0x09];
        let mut bytes = Bytes::new(&received);
        assert_eq!(bytes.i32_le(), Some(-2));
        assert_eq!(bytes.u32_be(), Some(2));
        assert_eq!(bytes.u32_le(), None);
        assert_eq!(bytes.rest(), [0x40, 0x09], "what is too short stays");
        assert_eq!(bytes.u16_le(), Some(0x0940));
        assert_eq!((bytes.u8(), bytes.f64_be()), (None, None));
    }

    #[test]
    fn several_numbers_are_all_there_or_none() {
        let received = [1.5_f32.to_le_bytes(), (-2.0_f32).to_le_bytes()].concat();
        assert_eq!(Bytes::new(&received).f32s_le(), Some([1.5, -2.0]));
        assert_eq!(Bytes::new(&received).f32s_le::<3>(), None);
        let received = [0.1_f64.to_be_bytes(), f64::MAX.to_be_bytes()].concat();
        assert_eq!(Bytes::new(&received).f64s_be(), Some([0.1, f64::MAX]));
        assert_eq!(Bytes::new(&received).f64s_be::<3>(), None);
        let received = [0.1_f64.to_le_bytes(), f64::MAX.to_le_bytes()].concat();
        assert_eq!(Bytes::new(&received).f64s_le(), Some([0.1, f64::MAX]));
        assert_eq!(Bytes::new(&received).f64s_le::<3>(), None);
    }

    #[test]
    fn counts_that_no_message_can_have_are_refused() {
        assert_eq!(Bytes::new(&7_i32.to_le_bytes()).count_le(), Some(7));
        assert_eq!(Bytes::new(&(-1_i32).to_le_bytes()).count_le(), None);
        let mut bytes = Bytes::new(&[0; 8]);
        assert_eq!(bytes.skip(usize::MAX, 2), None, "the product has no number");
        assert_eq!(bytes.skip(3, 3), None);
        assert_eq!((bytes.skip(2, 4), bytes.rest()), (Some(()), &[][..]));
    }

    #[test]
    fn counted_bytes_are_all_there_or_none() {
        let received = b"\x02\0\0\0ab\x02\0\0\0c";
        let mut bytes = Bytes::new(received);
        assert_eq!((bytes.counted_le(), bytes.end()), (Some(&b"ab"[..]), None));
        assert_eq!(bytes.counted_le(), None);
        assert_eq!(Bytes::new(&u32::MAX.to_le_bytes()).counted_le(), None);
        assert_eq!(Bytes::new(b"").end(), Some(()));
    }

    #[test]
    fn text_ends_at_its_zero() {
        let mut bytes = Bytes::new(b"tello\0rest");
        assert_eq!(bytes.until_zero(), Some(&b"tello"[..]));
        assert_eq!((bytes.until_zero(), bytes.rest()), (None, &b"rest"[..]));
        assert_eq!(text_of(b"ab\0cd\0"), b"ab");
        assert_eq!((text_of(b"ab"), text_of(b"")), (&b"ab"[..], &b""[..]));
    }
}
