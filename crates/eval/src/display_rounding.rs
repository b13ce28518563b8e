//! Numbers for viewers: fewer points, and no more digits than can be seen.
//!
//! Thread in flight: the log's, not the tick's. Allocates.

use horizon_model::rows::{Pose, pose};

/// A position in the world frame: x, y, z. m
pub type PosW = [f64; 3];

/// At most `most` of `points`, evenly, and the last one.
pub fn every<T: Copy>(points: &[T], most: usize) -> Vec<T> {
    let stride = points.len().div_ceil(most).max(1);
    let last = points.len().saturating_sub(1);
    let kept = points.iter().enumerate().filter(|(i, _)| i % stride == 0 || *i == last);
    kept.map(|(_, point)| *point).collect()
}

/// Ticks of `dt_s` between two drawings that are `span_s` apart, one at least.
pub fn ticks(span_s: f64, dt_s: f64) -> u64 {
    horizon_model::steps(span_s, dt_s).max(1) as u64
}

/// Position of the pose `at` in the world frame, rounded to a millimetre. m
pub(crate) fn pos_w_of(at: &Pose) -> PosW {
    [at[pose::X], at[pose::Y], at[pose::Z]].map(to_thousandths)
}

/// A number in any unit, rounded to a thousandth of it.
pub(crate) fn to_thousandths(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thinning_keeps_both_ends() {
        let points: Vec<usize> = (0..1000).collect();
        let kept = every(&points, 60);
        assert!(kept.len() <= 61, "{} points", kept.len());
        assert_eq!((kept.first(), kept.last()), (Some(&0), Some(&999)));
        assert_eq!(every(&[7, 8], 60), [7, 8]);
        assert!(every::<u8>(&[], 60).is_empty());
    }
}
