//! Values from the front of received bytes, little-endian or big-endian.
//!
//! Owns the bounds: every read says `None` where bytes are missing, and nothing is allocated.

#![deny(clippy::indexing_slicing)]

/// What is left to read. Cheap to copy, so that a caller can look ahead.
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
        f32_le: f32 = from_le_bytes;
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

    /// What was not read.
    pub(super) fn rest(self) -> &'a [u8] {
        self.0
    }
}

/// The text before the first zero in a field of fixed size.
pub(super) fn text_of(field: &[u8]) -> &[u8] {
    field.split(|byte| *byte == 0).next().unwrap_or_default()
}
