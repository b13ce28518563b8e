//! Angles on the circle: the only place that wraps.

use std::f64::consts::{PI, TAU};

use crate::Vector;
use crate::row::Row;

/// `angle` in `[-pi, pi)`. rad
///
/// NaN stays NaN.
///
/// Real time: no allocation, constant cost.
#[inline]
pub fn wrap(angle: f64) -> f64 {
    let wrapped = (angle + PI).rem_euclid(TAU) - PI;
    // rem_euclid may round up to the divisor itself for tiny negative arguments.
    if wrapped >= PI { wrapped - TAU } else { wrapped }
}

/// The value equal to `angle` on the circle that lies nearest to `reference`, thesis equation 4.9. rad
///
/// Real time: no allocation, constant cost.
#[inline]
pub fn unwrap_near(angle: f64, reference: f64) -> f64 {
    reference + wrap(angle - reference)
}

/// `v` with every angle row moved to the turn nearest to the same row of `reference`; N rows each, in the units of
/// `rows`.
///
/// A target of 0 rad for a system that has turned once is 2 pi: it must not spin back. Of two turns that are equally
/// near the lower one is taken. An angle that is not finite, here or in `reference`, gives NaN in its row.
///
/// Real time: no allocation, one pass over the rows.
pub fn nearest_turn<const N: usize>(
    v: &Vector<N>,
    reference: &Vector<N>,
    rows: &[Row; N],
) -> Vector<N> {
    Vector::from_fn(|i, _| if rows[i].is_angle { unwrap_near(v[i], reference[i]) } else { v[i] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Vector;

    #[test]
    fn wrap_keeps_the_half_open_interval() {
        for (angle, expected) in
            [(0.0, 0.0), (PI, -PI), (-PI, -PI), (3.0 * PI, -PI), (4.0, 4.0 - TAU)]
        {
            assert!((wrap(angle) - expected).abs() < 1e-12, "wrap({angle}) = {}", wrap(angle));
        }
        for k in -1000..1000 {
            let angle = f64::from(k) * 0.0371;
            let wrapped = wrap(angle);
            assert!((-PI..PI).contains(&wrapped), "wrap({angle}) = {wrapped}");
            assert!(((wrapped - angle) / TAU).round().mul_add(-TAU, wrapped - angle).abs() < 1e-9);
        }
        assert!(wrap(f64::NAN).is_nan());
    }

    #[test]
    fn wrap_turns_the_angle_just_below_the_interval_to_its_begin() {
        // Its remainder is rounded up to a whole turn, which would give pi: outside of the interval.
        let below = (-PI).next_down();
        assert_eq!((below + PI).rem_euclid(TAU).to_bits(), TAU.to_bits());
        assert_eq!(wrap(below).to_bits(), (-PI).to_bits(), "{}", wrap(below));
    }

    #[test]
    fn unwrap_takes_the_short_way() {
        assert!((unwrap_near(-3.1, 3.1) - (TAU - 3.1)).abs() < 1e-12);
        assert!((unwrap_near(0.1, 4.0 * PI) - (4.0 * PI + 0.1)).abs() < 1e-12);
    }

    #[test]
    fn only_angle_rows_turn() {
        let rows = [Row::linear("x", "m"), Row::angle("theta")];
        let v = nearest_turn(&Vector::from([0.0, 0.0]), &Vector::from([9.0, 6.0]), &rows);
        assert!((v - Vector::from([0.0, TAU])).norm() < 1e-12);
    }
}
