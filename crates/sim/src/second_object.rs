//! A second object that moves through the room.
//!
//! Owns its script: to and fro between two places at one speed. What sees it is not known here.

use horizon_model::setting::{SettingError, finite, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::DT_S;

/// Fractions of the golden ratio are spread evenly over the seeds. 1
const GOLDEN: f64 = 0.618_033_988_749_895;

/// To and fro between two places.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PasserTable {
    /// World x, y, z of one end. m
    #[serde(rename = "from_m")]
    pub from_w_m: [f64; 3],
    /// Of the other. m
    #[serde(rename = "to_m")]
    pub to_w_m: [f64; 3],
    /// Speed. m/s, 0..=5
    pub speed_mps: f64,
    /// From when to when nothing sees it; null: always seen. s, >= 0, not decreasing
    pub hidden_s: Option<[f64; 2]>,
}

impl PasserTable {
    /// Checks the values.
    ///
    /// # Errors
    /// The first value that breaks its rule.
    pub fn check(&self) -> Result<(), SettingError> {
        for (key, ends) in [("from_m", self.from_w_m), ("to_m", self.to_w_m)] {
            for (k, value) in ends.into_iter().enumerate() {
                finite(&format!("{key}[{k}]"), value)?;
            }
        }
        if let Some([from_s, until_s]) = self.hidden_s {
            finite("hidden_s[1]", until_s)?;
            in_range("hidden_s[0]", from_s, 0.0..=until_s)?;
        }
        in_range("speed_mps", self.speed_mps, 0.0..=5.0).map(drop)
    }

    /// Its position at `step`; the seed chooses where on the path it begins. World frame. m
    pub fn place(&self, step: u64, seed: u64) -> [f64; 3] {
        let phase = self.traversals(step, seed) % 2.0;
        let fraction = if phase > 1.0 { 2.0 - phase } else { phase };
        std::array::from_fn(|i| self.from_w_m[i] + fraction * (self.to_w_m[i] - self.from_w_m[i]))
    }

    /// Its place as it is seen, as by [`Self::place`]; `None` while nothing sees it. m
    pub fn seen(&self, step: u64, seed: u64) -> Option<[f64; 3]> {
        let now_s = DT_S * step as f64;
        let is_hidden =
            self.hidden_s.is_some_and(|[from_s, until_s]| from_s <= now_s && now_s < until_s);
        (!is_hidden).then(|| self.place(step, seed))
    }

    /// Whether it turns round between `step` and the next one.
    pub fn turns_after(&self, step: u64, seed: u64) -> bool {
        self.traversals(step, seed).floor() < self.traversals(step + 1, seed).floor()
    }

    /// Traversals of the path by `step`. 1
    fn traversals(&self, step: u64, seed: u64) -> f64 {
        let squares = self.from_w_m.iter().zip(&self.to_w_m).map(|(from, to)| (to - from).powi(2));
        let length_m = squares.sum::<f64>().sqrt();
        let begun = 2.0 * (seed as f64 * GOLDEN).fract();
        let gone =
            if length_m > 0.0 { self.speed_mps * DT_S * step as f64 / length_m } else { 0.0 };
        begun + gone
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PASSER: PasserTable = PasserTable {
        from_w_m: [0.0, 0.0, 1.0],
        to_w_m: [2.0, 0.0, 1.0],
        speed_mps: 1.0,
        hidden_s: None,
    };

    #[test]
    fn it_goes_to_and_fro_at_its_speed() {
        for (seconds, x_m) in [(0, 0.0), (1, 1.0), (2, 2.0), (3, 1.0), (5, 1.0), (8, 0.0)] {
            let [x, y, z] = PASSER.place(50 * seconds, 0);
            assert!((x - x_m).abs() < 1e-9, "{x} m after {seconds} s");
            assert_eq!((y, z), (0.0, 1.0));
        }
        assert!(
            (0..200).filter(|step| PASSER.turns_after(*step, 0)).eq([99, 199]),
            "it turns twice"
        );
        let [one, other] = [1, 2].map(|seed| PASSER.place(0, seed)[0]);
        assert!((one - other).abs() > 0.1, "seeds begin elsewhere");
        let still = PasserTable { to_w_m: PASSER.from_w_m, ..PASSER };
        assert!(still.place(70, 3)[0].abs() < 1e-12);
    }

    #[test]
    fn an_object_with_a_value_outside_of_its_range_is_refused() {
        let refused = |passer: PasserTable| passer.check().unwrap_err().to_string();
        let nan = PasserTable { to_w_m: [0.0, f64::NAN, 0.0], ..PASSER };
        assert!(refused(nan).starts_with("to_m[1] = NaN"), "{}", refused(nan));
        let fast = PasserTable { speed_mps: 5.5, ..PASSER };
        assert_eq!(refused(fast), "speed_mps = 5.5: expected 0.0..=5.0");
        let backwards = PasserTable { hidden_s: Some([2.0, 1.0]), ..PASSER };
        assert_eq!(refused(backwards), "hidden_s[0] = 2: expected 0.0..=1.0");
        assert!(PASSER.check().is_ok());
    }

    #[test]
    fn hidden_it_goes_on_unseen() {
        let hidden = PasserTable { hidden_s: Some([1.0, 3.0]), ..PASSER };
        assert!(hidden.check().is_ok());
        for step in [49, 50, 149, 150] {
            let seen = [49, 150].contains(&step).then(|| PASSER.place(step, 0));
            assert_eq!(hidden.seen(step, 0), seen, "step {step}");
        }
    }
}
