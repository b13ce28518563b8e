//! Numbers of a CSV log: a fast way for those of few digits, and the standard library's for the others.

use std::slice::Iter;
use std::str::FromStr;

/// Exact as doubles.
const POWERS_OF_TEN: [f64; 10] = [1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9];

/// A finite number with how many digits it has behind its point.
pub(super) fn number(field: &[u8]) -> Option<(f64, usize)> {
    let plain = Plain::read(&mut field.iter(), None).and_then(Plain::number);
    plain.or_else(|| {
        let number = parsed(field).filter(|number: &f64| number.is_finite())?;
        let behind_point = field.iter().rev().position(|byte| *byte == b'.');
        Some((number, behind_point.unwrap_or(0)))
    })
}

/// A number of few digits, as all of a log are.
pub(super) struct Plain {
    is_negative: bool,
    /// Without the point.
    digits: u32,
    /// How many digits are behind the point, if there is one.
    behind_point: Option<usize>,
}

impl Plain {
    /// Reads up to `end`, which is read too, or all there is.
    pub(super) fn read(bytes: &mut Iter<'_, u8>, end: Option<u8>) -> Option<Self> {
        let is_negative = bytes.as_slice().first() == Some(&b'-');
        if is_negative {
            bytes.next();
        }
        let (mut digits, mut before_point, mut count) = (0_u32, None, 0);
        loop {
            match bytes.next().copied() {
                Some(byte @ b'0'..=b'9') => {
                    count += 1;
                    digits = digits.checked_mul(10)?.checked_add(u32::from(byte - b'0'))?;
                }
                Some(b'.') if before_point.is_none() => before_point = Some(count),
                other if other == end => break,
                _ => return None,
            }
        }
        let behind_point = before_point.map(|before_point| count - before_point);
        (count > 0).then_some(Self { is_negative, digits, behind_point })
    }

    /// It as a step, if it is one.
    pub(super) fn step(self) -> Option<u64> {
        let is_step = !self.is_negative && self.behind_point.is_none();
        is_step.then_some(u64::from(self.digits))
    }

    /// It with how many digits it has behind its point. Its digits and its power of ten are exact, so
    /// that their quotient is the nearest double.
    pub(super) fn number(self) -> Option<(f64, usize)> {
        let behind_point = self.behind_point.unwrap_or(0);
        let number = f64::from(self.digits) / POWERS_OF_TEN.get(behind_point)?;
        Some((if self.is_negative { -number } else { number }, behind_point))
    }
}

pub(super) fn parsed<T: FromStr>(field: &[u8]) -> Option<T> {
    std::str::from_utf8(field).ok()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain(field: &str) -> Option<Plain> {
        Plain::read(&mut field.as_bytes().iter(), None)
    }

    #[test]
    fn numbers_are_those_of_the_standard_library_to_the_last_bit() {
        let mut digits = 1_u64;
        for length in 1..=12_u32 {
            for behind_point in 0..=length as usize {
                // A linear congruential generator: any digits will do.
                digits = digits.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                let width = length as usize;
                let text = format!("{:0>width$}", digits % 10_u64.pow(length));
                let (before, behind) = text.split_at(width - behind_point);
                for field in [format!("{before}.{behind}"), format!("-{before}.{behind}")] {
                    let (found, found_behind) = number(field.as_bytes()).unwrap();
                    let expected: f64 = field.parse().unwrap();
                    assert_eq!(found.to_bits(), expected.to_bits(), "{field}");
                    assert_eq!(found_behind, behind_point, "{field}");
                }
            }
        }
        for (field, expected) in [("-0", -0.0_f64), ("1e-3", 1e-3), ("+7", 7.0), (".5", 0.5)] {
            let (found, _) = number(field.as_bytes()).unwrap();
            assert_eq!(found.to_bits(), expected.to_bits(), "{field}");
        }
    }

    #[test]
    fn a_field_without_a_finite_number_has_no_value() {
        for field in ["", "-", ".", "-.", "1.2.3", "1-2", "nan", "inf", "1e999", "1 ", "0x1", "é"]
        {
            assert_eq!(number(field.as_bytes()), None, "{field:?}");
        }
        assert_eq!(number(&[b'1', 0xFF]), None, "no UTF-8");
    }

    #[test]
    fn a_step_with_a_sign_a_point_or_too_many_digits_is_refused() {
        assert_eq!(plain("4294967295").and_then(Plain::step), Some(4_294_967_295));
        for field in ["-1", "1.0", "1.", "4294967296", ""] {
            assert_eq!(plain(field).and_then(Plain::step), None, "{field:?}");
        }
    }

    #[test]
    fn reading_stops_behind_the_end_of_a_field() {
        let mut bytes = b"12,34".iter();
        assert_eq!(Plain::read(&mut bytes, Some(b',')).and_then(Plain::step), Some(12));
        assert_eq!(bytes.as_slice(), b"34");
        assert!(Plain::read(&mut b"12".iter(), Some(b',')).is_none(), "its end is missing");
    }
}
