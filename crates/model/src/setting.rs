//! Checks of settings values, and the refusal of a value.
//!
//! Tables are read from JSON unchecked and turned into settings by `TryFrom`; a settings value is
//! the proof that the table was valid. Every refusal names key, value and rule.

use std::fmt::{Debug, Display};
use std::ops::RangeInclusive;

use thiserror::Error;

use crate::Vector;
use crate::row::{Domain, Row};

/// Range of weights. 1 / unit of the row
const WEIGHTS: RangeInclusive<f64> = 1e-6..=1e6;

/// A setting that breaks its rule, e.g. `mhe.window_steps = 1: expected 2..=200`.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{key} = {value}: expected {rule}")]
pub struct SettingError {
    /// Path of the key inside the file.
    pub key: String,
    /// The value as written.
    pub value: String,
    /// What would have been valid.
    pub rule: String,
}

impl SettingError {
    /// A refusal of `key = value` because of `rule`.
    pub fn new(key: impl Into<String>, value: impl Display, rule: impl Into<String>) -> Self {
        Self { key: key.into(), value: value.to_string(), rule: rule.into() }
    }

    /// The refusal with the key of the section in front: `window_steps` under `mhe` becomes
    /// `mhe.window_steps`.
    #[must_use]
    pub fn under(self, section: &str) -> Self {
        Self { key: format!("{section}.{}", self.key), ..self }
    }
}

/// `value` if it lies in `range`.
///
/// # Errors
/// The value is outside or NaN.
pub fn in_range<T: PartialOrd + Display + Copy + Debug>(
    key: &str,
    value: T,
    range: RangeInclusive<T>,
) -> Result<T, SettingError> {
    if range.contains(&value) {
        Ok(value)
    } else {
        Err(SettingError::new(key, value, format!("{range:?}")))
    }
}

/// `value` if it is finite.
///
/// # Errors
/// The value is infinite or NaN.
pub fn finite(key: &str, value: f64) -> Result<f64, SettingError> {
    if value.is_finite() { Ok(value) } else { Err(SettingError::new(key, value, "finite")) }
}

/// `value` if it is finite and positive.
///
/// # Errors
/// The value is zero, negative, infinite or NaN.
pub fn positive(key: &str, value: f64) -> Result<f64, SettingError> {
    if value.is_finite() && value > 0.0 {
        Ok(value)
    } else {
        Err(SettingError::new(key, value, "finite and > 0"))
    }
}

/// `value` if it is finite and not negative.
///
/// # Errors
/// The value is negative, infinite or NaN.
pub fn not_negative(key: &str, value: f64) -> Result<f64, SettingError> {
    if value.is_finite() && value >= 0.0 {
        Ok(value)
    } else {
        Err(SettingError::new(key, value, "finite and >= 0"))
    }
}

/// `value` if it can weigh a residual beside others: 1e-6 to 1e6.
///
/// Squares of weights further apart leave normal equations nothing of the lighter residual in double precision.
///
/// # Errors
/// The value is outside or NaN.
pub fn weight(key: &str, value: f64) -> Result<f64, SettingError> {
    if WEIGHTS.contains(&value) {
        Ok(value)
    } else {
        Err(SettingError::new(key, value, "1e-6..=1e6"))
    }
}

/// `value` if it is zero, for a residual that does not count, or a [`weight`].
///
/// # Errors
/// The value is neither.
pub fn weight_or_zero(key: &str, value: f64) -> Result<f64, SettingError> {
    if value == 0.0 || WEIGHTS.contains(&value) {
        Ok(value)
    } else {
        Err(SettingError::new(key, value, "0 or 1e-6..=1e6"))
    }
}

/// `values` as a vector whose rows are `rows`, each entry accepted by `check`.
///
/// `check` is one of this module's functions, or a closure with a range; it sees the key of the
/// entry, e.g. `C_o[2]`.
///
/// # Errors
/// A wrong number of entries (the message lists the rows) or a refused entry.
pub fn vector<const N: usize>(
    key: &str,
    values: &[f64],
    rows: &[Row; N],
    check: impl Fn(&str, f64) -> Result<f64, SettingError>,
) -> Result<Vector<N>, SettingError> {
    if values.len() != N {
        let names = rows.map(|row| row.name).join(", ");
        return Err(SettingError::new(
            key,
            format!("{values:?}"),
            format!("{N} entries ({names})"),
        ));
    }
    let mut v = Vector::zeros();
    for (i, value) in values.iter().enumerate() {
        v[i] = check(&format!("{key}[{i}]"), *value)?;
    }
    Ok(v)
}

/// Bounds as two vectors with `lo <= hi` in every row, both in the domain of the row.
///
/// # Errors
/// A wrong number of entries, an entry that is not finite, a lower bound above its upper bound, or
/// bounds that let a row leave its domain.
pub fn bounds<const N: usize>(
    (key_lo, lo): (&str, &[f64]),
    (key_hi, hi): (&str, &[f64]),
    rows: &[Row; N],
) -> Result<(Vector<N>, Vector<N>), SettingError> {
    let lo = vector(key_lo, lo, rows, finite)?;
    let hi = vector(key_hi, hi, rows, finite)?;
    for (i, Row { name, domain, .. }) in rows.iter().enumerate() {
        let refuse =
            |key: &str, value, rule| Err(SettingError::new(format!("{key}[{i}]"), value, rule));
        if lo[i] > hi[i] {
            return refuse(key_lo, lo[i], format!("at most {key_hi}[{i}] = {}", hi[i]));
        }
        match domain {
            Domain::Positive if lo[i] <= 0.0 => {
                return refuse(key_lo, lo[i], format!("> 0: {name} is positive"));
            }
            Domain::Fraction if lo[i] < 0.0 => {
                return refuse(key_lo, lo[i], format!(">= 0: {name} is not negative"));
            }
            Domain::Fraction if hi[i] >= 1.0 => {
                return refuse(key_hi, hi[i], format!("< 1: {name} is below 1"));
            }
            Domain::Real | Domain::Positive | Domain::Fraction => {}
        }
    }
    Ok((lo, hi))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROWS: [Row; 2] = [Row::linear("x", "m"), Row::linear("y", "m")];

    #[test]
    fn a_refusal_names_key_value_and_rule() {
        let error = in_range("window_steps", 1, 2..=200).unwrap_err().under("mhe");
        assert_eq!(error.to_string(), "mhe.window_steps = 1: expected 2..=200");
        let error = vector("C_o", &[1.0], &ROWS, positive).unwrap_err();
        assert_eq!(error.to_string(), "C_o = [1.0]: expected 2 entries (x, y)");
        let error = vector("C_o", &[1.0, -2.0], &ROWS, positive).unwrap_err();
        assert_eq!(error.to_string(), "C_o[1] = -2: expected finite and > 0");
    }

    #[test]
    fn nan_violates_every_rule() {
        assert!(in_range("a", f64::NAN, 0.0..=1.0).is_err());
        assert!(positive("a", f64::NAN).is_err());
        assert!(not_negative("a", f64::NAN).is_err());
        assert!(finite("a", f64::NAN).is_err());
        assert!(positive("a", f64::INFINITY).is_err());
    }

    #[test]
    fn crossed_bounds_are_refused() {
        let error = bounds(("lo", &[0.0, 2.0]), ("hi", &[1.0, 1.0]), &ROWS).unwrap_err();
        assert_eq!(error.to_string(), "lo[1] = 2: expected at most hi[1] = 1");
        assert!(bounds(("lo", &[0.0, 1.0]), ("hi", &[1.0, 1.0]), &ROWS).is_ok());
    }

    #[test]
    fn bounds_keep_a_row_in_its_domain() {
        let rows = [Row::positive("tau", "s"), Row::fraction("dead")];
        let check = |lo: [f64; 2], hi: [f64; 2]| bounds(("lo", &lo), ("hi", &hi), &rows);
        assert!(check([1e-9, 0.0], [5.0, 0.999]).is_ok());
        for (lo, hi, message) in [
            ([0.0, 0.0], [1.0, 0.5], "lo[0] = 0: expected > 0: tau is positive"),
            ([0.1, -0.1], [1.0, 0.5], "lo[1] = -0.1: expected >= 0: dead is not negative"),
            ([0.1, 0.0], [1.0, 1.0], "hi[1] = 1: expected < 1: dead is below 1"),
        ] {
            assert_eq!(check(lo, hi).unwrap_err().to_string(), message);
        }
    }
}
