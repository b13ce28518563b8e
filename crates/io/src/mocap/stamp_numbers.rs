//! Frame numbers for a source that sends stamps alone.
//!
//! Owns their order: rounded, the stamps of two frames can have one number, and it would be taken for one frame.

/// Time within which two stamps are those of one frame, of another object or sensor. periods
const ONE_FRAME: f64 = 0.25;

/// Numbers that grow with time, one per period.
#[derive(Debug, Clone, Default)]
pub struct StampNumbers {
    /// Stamp of the newest frame, in periods, and its number.
    newest: Option<(f64, i64)>,
}

impl StampNumbers {
    /// The number of a message stamped `time_s` by a source of `rate_hz`: of a later frame a larger one, at most one
    /// ahead of the time.
    pub fn number(&mut self, time_s: f64, rate_hz: f64) -> i64 {
        let periods = time_s * rate_hz;
        #[expect(clippy::cast_possible_truncation, reason = "saturates")]
        let rounded = periods.round() as i64;
        let number = match self.newest {
            Some((newest, number)) if (0.0..ONE_FRAME).contains(&(periods - newest)) => {
                return number;
            }
            Some((newest, number)) if periods > newest => {
                let next = number.saturating_add(1).min(rounded.saturating_add(1));
                rounded.max(next)
            }
            // The clock was set back, or a message was overtaken.
            _ => rounded,
        };
        self.newest = Some((periods, number));
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_half_a_period_off_are_as_many_numbers() {
        for (rate_hz, repeated) in [(100.0, 0), (99.9, 2), (100.1, 0)] {
            let mut numbers = StampNumbers::default();
            let of = |k: i32| {
                let jitter_s = if k % 2 == 0 { 2e-4 } else { -2e-4 };
                numbers.number(1e9 + (f64::from(k) + 0.5) / 100.0 + jitter_s, rate_hz)
            };
            let found: Vec<i64> = (0..2000).map(of).collect();
            // A source that is faster than its rate has fewer numbers than frames.
            let same = found.windows(2).filter(|pair| pair[0] >= pair[1]).count();
            assert!(same <= repeated, "{rate_hz} Hz: {same}");
            let ahead = |k: usize| found[k] as f64 - (1e9 + (k as f64 + 0.5) / 100.0) * rate_hz;
            assert!((0..2000).all(|k| ahead(k).abs() < 1.6), "{rate_hz} Hz");
        }
    }

    #[test]
    fn one_frame_has_one_number_and_a_clock_set_back_begins_anew() {
        let mut numbers = StampNumbers::default();
        let found = [7.0, 7.0, 7.0001, 7.05, 7.02, 5.0].map(|time_s| numbers.number(time_s, 50.0));
        assert_eq!(found, [350, 350, 350, 353, 351, 250]);
    }
}
