//! A number in a JSON document that the search may turn.

use std::str::FromStr;

use anyhow::{Context, Result, anyhow, bail};
use serde_json::Value;

/// A number as written on the command line: `KEY=LO..HI`, or `KEY+KEY=LO..HI` for one value of both. Ends
/// in the unit of the key
#[derive(Debug, Clone, PartialEq)]
pub struct Range {
    name: String,
    lo: f64,
    hi: f64,
}

/// Scale of a range in the search.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    /// By its value.
    Linear,
    /// By its logarithm.
    Logarithmic,
}

/// A number, or several of one value, with its range.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    range: Range,
    scale: Scale,
    /// JSON pointers to the places of the number, at least one.
    pointers: Vec<String>,
}

impl FromStr for Range {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let shape = "KEY=LO..HI, e.g. cycle.mpc.C_u[0]=0.1..10";
        let (name, range) =
            text.split_once('=').with_context(|| format!("{text:?}: expected {shape}"))?;
        let (lo, hi) =
            range.split_once("..").with_context(|| format!("{text:?}: expected {shape}"))?;
        let number = |text: &str| -> Result<f64> {
            text.trim().parse().with_context(|| format!("{text:?} is no number"))
        };
        let (lo, hi) = (number(lo)?, number(hi)?);
        if !(lo.is_finite() && hi.is_finite() && lo < hi) {
            bail!("{name}: {lo}..{hi}: expected LO < HI");
        }
        Ok(Self { name: name.to_owned(), lo, hi })
    }
}

impl Variable {
    /// The number of `range`, searched on `scale`.
    ///
    /// # Errors
    /// A range that is not positive has no logarithm.
    pub fn new(range: &Range, scale: Scale) -> Result<Self> {
        if scale == Scale::Logarithmic && range.lo <= 0.0 {
            bail!("{}: {}..{}: expected 0 < LO for --over-log", range.name, range.lo, range.hi);
        }
        let pointers = range.name.split('+').map(pointer).collect();
        Ok(Self { range: range.clone(), scale, pointers })
    }

    /// The key as it was written.
    pub fn name(&self) -> &str {
        &self.range.name
    }

    /// JSON pointers to the places of the number.
    pub fn places(&self) -> &[String] {
        &self.pointers
    }

    /// The setting's value, in the unit of its key, at `fraction` of its range, on its linear or logarithmic scale.
    /// `fraction`: 1, 0..=1; another gives the nearer end.
    pub fn value_at(&self, fraction: f64) -> f64 {
        let Range { lo, hi, .. } = self.range;
        let value = match self.scale {
            Scale::Linear => lo + fraction * (hi - lo),
            Scale::Logarithmic => lo * (hi / lo).powf(fraction),
        };
        // The ends are met up to rounding only.
        value.clamp(lo, hi)
    }

    /// The fraction of the range at which the number in `document` lies: where the search begins, so that its first
    /// try is the configuration as it is.
    ///
    /// # Errors
    /// As [`Variable::value`]; a number that lies outside of the range.
    pub fn fraction(&self, document: &Value) -> Result<f64> {
        let Range { name, lo, hi } = &self.range;
        let value = self.value(document)?;
        if !(*lo..=*hi).contains(&value) {
            bail!(
                "{name} is {value}, outside of {lo}..{hi}: the search begins there, so the range has to hold it"
            );
        }
        Ok(match self.scale {
            Scale::Linear => (value - lo) / (hi - lo),
            Scale::Logarithmic => (value / lo).ln() / (hi / lo).ln(),
        })
    }

    /// The number in `document`, which is the same at all of its places.
    ///
    /// # Errors
    /// A place that is missing or holds no number; two that differ.
    pub fn value(&self, document: &Value) -> Result<f64> {
        let mut values = self.pointers.iter().map(|pointer| {
            document.pointer(pointer).and_then(Value::as_f64).ok_or_else(|| self.missing(pointer))
        });
        let first = values.next().unwrap_or_else(|| Err(self.missing("")))?;
        for value in values {
            let value = value?;
            if value.to_bits() != first.to_bits() {
                bail!(
                    "{}: {first} and {value} differ; numbers that are searched as one begin as one",
                    self.name()
                );
            }
        }
        Ok(first)
    }

    /// Sets the number in `document` to where `fraction` is; a whole number stays one.
    ///
    /// # Errors
    /// A place that is missing or holds no number.
    pub fn set(&self, document: &mut Value, fraction: f64) -> Result<()> {
        let value = self.value_at(fraction);
        for pointer in &self.pointers {
            let place = document.pointer_mut(pointer).ok_or_else(|| self.missing(pointer))?;
            *place = if place.is_f64() {
                value.into()
            } else if place.is_number() {
                #[expect(clippy::cast_possible_truncation, reason = "a range of small numbers")]
                let whole = value.round() as i64;
                whole.into()
            } else {
                return Err(self.missing(pointer));
            };
        }
        Ok(())
    }

    fn missing(&self, pointer: &str) -> anyhow::Error {
        anyhow!("{}: there is no number at {pointer} of the flight's settings", self.range.name)
    }
}

/// `cycle.mpc.C_u[0]` as a JSON pointer, `/cycle/mpc/C_u/0`; a pointer stays one.
fn pointer(key: &str) -> String {
    if key.starts_with('/') {
        return key.to_owned();
    }
    format!("/{}", key.replace(['.', '['], "/").replace(']', ""))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn variable(text: &str, scale: Scale) -> Variable {
        Variable::new(&text.parse().unwrap(), scale).unwrap()
    }

    #[test]
    fn a_number_goes_where_its_keys_say() {
        let mut document = json!({ "mpc": { "C_u": [1.0, 2.0, 1.0], "horizon_steps": 13 } });
        let both = variable("mpc.C_u[0]+/mpc/C_u/2=0.1..10", Scale::Logarithmic);
        assert_eq!(both.value(&document).unwrap().to_bits(), 1.0_f64.to_bits());
        both.set(&mut document, 1.0).unwrap();
        variable("mpc.horizon_steps=10..20", Scale::Linear).set(&mut document, 0.26).unwrap();
        let expected = json!({ "mpc": { "C_u": [10.0, 2.0, 10.0], "horizon_steps": 13 } });
        assert_eq!(document, expected);
    }

    #[test]
    fn fractions_and_numbers_are_each_others_inverse() {
        for (text, scale, middle) in
            [("a=-2..6", Scale::Linear, 2.0), ("a=0.1..10", Scale::Logarithmic, 1.0)]
        {
            let variable = variable(text, scale);
            assert!(
                (variable.value_at(0.5) - middle).abs() < 1e-12,
                "{text}: {}",
                variable.value_at(0.5)
            );
            for k in 0..=10 {
                let fraction = f64::from(k) / 10.0;
                let back = variable.fraction(&json!({ "a": variable.value_at(fraction) })).unwrap();
                assert!((back - fraction).abs() < 1e-12, "{text}: {back} instead of {fraction}");
            }
            for outside in [-2.1, 10.1] {
                let error = variable.fraction(&json!({ "a": outside })).unwrap_err().to_string();
                assert!(error.contains("outside of"), "{text}: {error}");
            }
        }
    }

    #[test]
    fn numbers_that_are_searched_as_one_begin_as_one() {
        let error = variable("a+b=0..1", Scale::Linear).value(&json!({ "a": 0.5, "b": 0.6 }));
        let error = error.unwrap_err().to_string();
        assert!(error.contains("a+b: 0.5 and 0.6 differ"), "{error}");
    }

    #[test]
    fn a_range_or_a_document_without_its_number_is_refused() {
        for (text, reason) in [
            ("a", "expected KEY=LO..HI"),
            ("a=1", "\"a=1\": expected KEY=LO..HI"),
            ("a=1..b", "is no number"),
            ("a=2..1", "LO < HI"),
            ("a=NaN..1", "LO < HI"),
        ] {
            let error = format!("{:#}", text.parse::<Range>().unwrap_err());
            assert!(error.contains(reason), "{text}: {error}");
        }
        let range: Range = "a=0..1".parse().unwrap();
        assert!(
            Variable::new(&range, Scale::Logarithmic).unwrap_err().to_string().contains("0 < LO")
        );
        let document = json!({ "a": "text", "b": [1.0] });
        for key in ["a", "c", "b[1]", "b"] {
            let variable = variable(&format!("{key}=0..1"), Scale::Linear);
            let error = variable.value(&document).unwrap_err().to_string();
            assert!(error.contains("no number at /"), "{error}");
            assert!(variable.set(&mut document.clone(), 0.5).is_err(), "{key}");
        }
    }
}
