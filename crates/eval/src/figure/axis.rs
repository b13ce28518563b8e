//! One axis: its range and its ticks.
//!
//! Owns which numbers an axis shows. Where they go on the figure is the panel's business.

/// Beyond this a number is treated as absent: differences of such numbers overflow.
const DRAWABLE_MAX: f64 = 1e100;

/// Smallest range, and the same relative to the values in it; below, ticks would need too many digits.
const RANGE_MIN: f64 = 1e-100;
const RELATIVE_RANGE_MIN: f64 = 1e-6;

/// Whether `value` has a place on an axis.
pub(super) fn is_drawable(value: f64) -> bool {
    value.abs() < DRAWABLE_MAX
}

/// The range of an axis: `low < high`, both finite, in the unit of its label.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Axis {
    /// Lower end. Unit of the label
    pub low: f64,
    /// Upper end. Unit of the label
    pub high: f64,
}

/// A number on an axis as it is printed.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tick {
    /// The number. Unit of the label
    pub value: f64,
    /// Its digits.
    pub label: String,
}

impl Axis {
    /// The axis over all `values` that can be drawn, `None` if there are none.
    ///
    /// Equal values get a range around them.
    pub(super) fn over(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let drawable = values.into_iter().filter(|&value| is_drawable(value));
        let (low, high) = drawable.fold(None, |range: Option<(f64, f64)>, value| match range {
            None => Some((value, value)),
            Some((low, high)) => Some((low.min(value), high.max(value))),
        })?;
        let largest = low.abs().max(high.abs());
        if high - low > RANGE_MIN.max(RELATIVE_RANGE_MIN * largest) {
            return Some(Self { low, high });
        }
        let pad = if largest > RANGE_MIN { 0.1 * largest } else { 1.0 };
        Some(Self { low: low - pad, high: high + pad })
    }

    /// The axis from or to 0, if it does not contain it.
    pub(super) fn with_zero(self) -> Self {
        Self { low: self.low.min(0.0), high: self.high.max(0.0) }
    }

    /// The axis wider by `fraction` of its range at both ends, so that no line touches the frame.
    pub(super) fn padded(self, fraction: f64) -> Self {
        let pad = fraction * (self.high - self.low);
        Self { low: self.low - pad, high: self.high + pad }
    }

    /// Where `value` lies: 0 at the low end, 1 at the high end.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Whether `value` lies on the axis; false for NaN.
    pub(super) fn contains(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// At most `count` + 1 round numbers on the axis, in steps of 1, 2 or 5 times a power of ten.
    pub(super) fn ticks(&self, count: f64) -> Vec<Tick> {
        let rough = (self.high - self.low) / count.max(1.0);
        let magnitude = 10_f64.powf(rough.log10().floor());
        let factors = [1.0, 2.0, 5.0].into_iter().find(|factor| factor * magnitude >= rough);
        let step = factors.unwrap_or(10.0) * magnitude;
        let slack = 1e-9 * step;
        let first = ((self.low - slack) / step).ceil();
        let values = (0..100_u32).map(|i| (first + f64::from(i)) * step);
        let largest = self.low.abs().max(self.high.abs());
        values
            .take_while(|value| *value <= self.high + slack)
            .map(|value| Tick { value, label: number(value, step, largest) })
            .collect()
    }
}

/// `value`, a multiple of `step`, with the digits that distinguish it from its neighbours.
fn number(value: f64, step: f64, largest: f64) -> String {
    // The step is not exactly a power of ten; a millionth more keeps its logarithm's floor.
    let exponent = (step * 1.000_001).log10().floor();
    if value.abs() < 0.5 * step {
        return "0".to_owned();
    }
    if largest >= 1e5 || exponent < -4.0 {
        return format!("{value:.*e}", digits(value.abs().log10().floor() - exponent));
    }
    format!("{value:.*}", digits(-exponent))
}

fn digits(count: f64) -> usize {
    horizon_model::whole(count.clamp(0.0, 12.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(low: f64, high: f64, count: f64) -> Vec<String> {
        Axis { low, high }.ticks(count).into_iter().map(|tick| tick.label).collect()
    }

    #[test]
    fn ticks_are_round_and_have_the_digits_they_need() {
        assert_eq!(labels(-0.21, 0.23, 5.0), ["-0.2", "-0.1", "0", "0.1", "0.2"]);
        assert_eq!(labels(0.0, 107.0, 6.0), ["0", "20", "40", "60", "80", "100"]);
        assert_eq!(labels(0.0301, 0.0389, 5.0), ["0.032", "0.034", "0.036", "0.038"]);
        assert_eq!(labels(0.0, 2.6e6, 3.0), ["0", "1e6", "2e6"]);
        assert_eq!(labels(-2e-7, 1e-7, 3.0), ["-2e-7", "-1e-7", "0", "1e-7"]);
    }

    #[test]
    fn an_axis_ignores_what_cannot_be_drawn() {
        let axis = Axis::over([f64::NAN, 2.0, f64::INFINITY, -1.0, 1e300]);
        assert_eq!(axis, Some(Axis { low: -1.0, high: 2.0 }));
        assert_eq!(Axis::over([f64::NAN]), None);
        assert_eq!(Axis::over([]), None);
    }

    #[test]
    fn equal_values_have_a_range_around_them() {
        assert_eq!(Axis::over([0.0]), Some(Axis { low: -1.0, high: 1.0 }));
        let axis = Axis::over([5.0, 5.0]).unwrap();
        assert!(axis.low < 5.0 && 5.0 < axis.high, "{axis:?}");
    }
}
