//! How a vehicle differs from the model of its controller, beside the spread over flights.
//!
//! Owns what a test of robustness changes, after a seed has drawn its vehicle.

use horizon_model::setting::{SettingError, finite, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::PlantParams;

/// Changes to the vehicle of every seed.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VariationTable {
    /// Factor of the horizontal gain. 1, 0.01..=100
    pub gain: f64,
    /// Added to the dead time of every stick, which stays at 0 or above. s
    pub dead_time_s: f64,
    /// Factor of the time constant of the horizontal velocity. 1, 0.01..=100
    pub lag: f64,
    /// Added to the direction of flight minus measured yaw. rad, -3.2..=3.2
    pub theta_0: f64,
}

/// The vehicle as it was drawn.
pub const UNVARIED: VariationTable =
    VariationTable { gain: 1.0, dead_time_s: 0.0, lag: 1.0, theta_0: 0.0 };

impl PlantParams {
    /// This vehicle with the changes of `variation`.
    ///
    /// # Errors
    /// A change that breaks its rule, or makes a vehicle that breaks one.
    pub fn varied(&self, variation: &VariationTable) -> Result<Self, SettingError> {
        let Self(mut table) = *self;
        let longer_s = finite("dead_time_s", variation.dead_time_s)?;
        for axis in [&mut table.horizontal, &mut table.vertical, &mut table.yaw] {
            axis.dead_time_s = (axis.dead_time_s + longer_s).max(0.0);
        }
        table.horizontal.gain *= in_range("gain", variation.gain, 0.01..=100.0)?;
        table.horizontal.tau_s *= in_range("lag", variation.lag, 0.01..=100.0)?;
        table.theta_0 += in_range("theta_0", variation.theta_0, -3.2..=3.2)?;
        Self::try_from(table)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plant::NOMINAL;

    fn varied(variation: VariationTable) -> Result<PlantParams, String> {
        let nominal = PlantParams::try_from(NOMINAL).unwrap();
        nominal.varied(&variation).map_err(|error| error.to_string())
    }

    #[test]
    fn each_change_moves_what_it_names_and_nothing_else() {
        assert_eq!(varied(UNVARIED).unwrap().table(), &NOMINAL);
        let mut expected = NOMINAL;
        expected.horizontal.gain *= 0.7;
        assert_eq!(varied(VariationTable { gain: 0.7, ..UNVARIED }).unwrap().table(), &expected);
        let mut expected = NOMINAL;
        expected.horizontal.tau_s *= 1.4;
        assert_eq!(varied(VariationTable { lag: 1.4, ..UNVARIED }).unwrap().table(), &expected);
        let mut expected = NOMINAL;
        expected.theta_0 += 0.3;
        assert_eq!(varied(VariationTable { theta_0: 0.3, ..UNVARIED }).unwrap().table(), &expected);
        let mut expected = NOMINAL;
        expected.horizontal.dead_time_s -= 0.1;
        expected.vertical.dead_time_s -= 0.1;
        // Yaw acts after 0.04 s already.
        expected.yaw.dead_time_s = 0.0;
        let sooner = VariationTable { dead_time_s: -0.1, ..UNVARIED };
        assert_eq!(varied(sooner).unwrap().table(), &expected);
    }

    #[test]
    fn a_variation_outside_of_its_range_is_refused_with_key_value_and_rule() {
        for (variation, refusal) in [
            (VariationTable { gain: 0.0, ..UNVARIED }, "gain = 0: expected 0.01..=100.0"),
            (VariationTable { lag: -1.0, ..UNVARIED }, "lag = -1: expected 0.01..=100.0"),
            (VariationTable { theta_0: f64::NAN, ..UNVARIED }, "theta_0 = NaN: expected"),
            (VariationTable { theta_0: 180.0, ..UNVARIED }, "theta_0 = 180: expected -3.2..=3.2"),
            (
                VariationTable { dead_time_s: 2.0, ..UNVARIED },
                "horizontal.dead_time_s = 2.32: expected 0.0..=2.0",
            ),
        ] {
            assert!(varied(variation).unwrap_err().contains(refusal), "{variation:?}");
        }
    }
}
