//! Whole numbers of what is measured in `f64`.

/// `value` without its fraction, as an index or a count: 0 of a negative one and of NaN, the largest of infinity.
///
/// Real time: no allocation.
#[inline]
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a cast saturates")]
pub const fn whole(value: f64) -> usize {
    value as usize
}

/// The number of steps of `dt_s` (s, > 0) that is nearest to `time_s` (s); 0 of a negative time.
///
/// Real time: no allocation.
#[inline]
pub fn steps(time_s: f64, dt_s: f64) -> usize {
    whole((time_s / dt_s).round())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_saturate_and_times_go_to_the_nearest_step() {
        let cases = [(2.9, 2), (0.0, 0), (-3.0, 0), (f64::NAN, 0), (f64::INFINITY, usize::MAX)];
        for (value, expected) in cases {
            assert_eq!(whole(value), expected, "{value}");
        }
        for (time_s, expected) in [(0.0, 0), (0.009, 0), (0.011, 1), (1.0, 50), (-1.0, 0)] {
            assert_eq!(steps(time_s, 0.02), expected, "{time_s} s");
        }
    }
}
