//! How a person steers: which device, how far, and how long something acts without news of it.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::panel::Timers;
use crate::clock::SpanNs;

/// How a person steers, as written in JSON.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The key of an `Option` counts as optional unless stated otherwise, here and in `present`.
#[schemars(extend("required" = ["device", "deflection", "smoothing_s", "pulse_s", "hold_s", "press_max_s",
    "axis_silent_s", "dead_zone"]))]
pub struct ManualTable {
    /// Keyboard or gamepad beside the terminal: a file such as `/dev/input/event5`, `gamepad` for the
    /// first one that is found, `null` for none.
    #[serde(deserialize_with = "tello_flight::present")]
    pub device: Option<String>,
    /// Stick of a key that is held, and of a gamepad's stick at its stop. 1, 0..=1
    pub deflection: f64,
    /// Time constant with which the sticks follow. s, 0.01..=5
    pub smoothing_s: f64,
    /// How long a key acts that cannot report its release, from each press or repetition. s, 0.05..=1
    pub pulse_s: f64,
    /// How long a key acts that can, from its press and from each repetition: longer than a keyboard takes to
    /// begin to repeat. s, 0.3..=2
    pub hold_s: f64,
    /// Longest time that any key acts from its press. s, `hold_s`..=10
    pub press_max_s: f64,
    /// How long a pushed gamepad stick acts without an event of the gamepad. s, 0.5..=5
    pub axis_silent_s: f64,
    /// Fraction of a gamepad stick's travel around its middle that gives no input. 1, 0.02..=0.5
    pub dead_zone: f64,
}

/// Checked [`ManualTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct ManualSettings {
    /// The input device beside the terminal: a path, `gamepad` or none.
    pub(super) device: Option<String>,
    /// Largest deflection that a person's sticks have. 1, 0..=1
    pub(crate) deflection: f64,
    /// Time constant of the sticks. s
    pub(super) smoothing_s: f64,
    /// How long something acts without news of it.
    pub(super) timers: Timers,
    /// Fraction of a gamepad stick's travel around its middle that gives no input. 1, 0.02..=0.5
    dead_zone: f64,
}

impl TryFrom<&ManualTable> for ManualSettings {
    type Error = SettingError;

    fn try_from(table: &ManualTable) -> Result<Self, SettingError> {
        let ManualTable { device, deflection, smoothing_s, dead_zone, .. } = table;
        let is_named = |device: &String| device == "gamepad" || device.starts_with('/');
        if let Some(device) = device.as_ref().filter(|device| !is_named(device)) {
            let rule = "a path from the root, gamepad or null";
            return Err(SettingError::new("device", device, rule));
        }
        let span = |key, seconds, range| in_range(key, seconds, range).map(SpanNs::from_seconds);
        let hold_s = in_range("hold_s", table.hold_s, 0.3..=2.0)?;
        let timers = Timers {
            pulse: span("pulse_s", table.pulse_s, 0.05..=1.0)?,
            hold: SpanNs::from_seconds(hold_s),
            press_max: span("press_max_s", table.press_max_s, hold_s..=10.0)?,
            axis_silent: span("axis_silent_s", table.axis_silent_s, 0.5..=5.0)?,
        };
        Ok(Self {
            device: device.clone(),
            deflection: in_range("deflection", *deflection, 0.0..=1.0)?,
            smoothing_s: in_range("smoothing_s", *smoothing_s, 0.01..=5.0)?,
            timers,
            dead_zone: in_range("dead_zone", *dead_zone, 0.02..=0.5)?,
        })
    }
}

impl ManualSettings {
    /// The place of a gamepad's stick, -1..=1, with its dead zone cut out and the rest stretched to the
    /// full travel.
    pub(crate) fn excess_over_dead_zone(&self, place: f64) -> f64 {
        let excess = (place.abs() - self.dead_zone).max(0.0) / (1.0 - self.dead_zone);
        excess.min(1.0).copysign(place)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in crate::manual) fn table() -> ManualTable {
        ManualTable {
            device: None,
            deflection: 0.5,
            smoothing_s: 0.2,
            pulse_s: 0.15,
            hold_s: 0.9,
            press_max_s: 3.0,
            axis_silent_s: 2.0,
            dead_zone: 0.1,
        }
    }

    #[test]
    fn manual_settings_that_break_a_rule_are_refused_with_key_value_and_rule() {
        let check =
            |table: ManualTable| ManualSettings::try_from(&table).map_err(|e| e.to_string());
        assert!(check(table()).is_ok());
        assert!(check(ManualTable { device: Some("gamepad".into()), ..table() }).is_ok());
        let error = check(ManualTable { device: Some("event5".into()), ..table() }).unwrap_err();
        assert_eq!(error, "device = event5: expected a path from the root, gamepad or null");
        let error = check(ManualTable { deflection: 1.5, ..table() }).unwrap_err();
        assert_eq!(error, "deflection = 1.5: expected 0.0..=1.0");
        assert!(check(ManualTable { smoothing_s: 0.0, ..table() }).is_err());
        assert!(check(ManualTable { pulse_s: f64::NAN, ..table() }).is_err());
        for hold_s in [f64::NAN, 0.1, 5.0] {
            assert!(check(ManualTable { hold_s, ..table() }).is_err(), "{hold_s}");
        }
        let error = check(ManualTable { press_max_s: 0.5, ..table() }).unwrap_err();
        assert_eq!(
            error, "press_max_s = 0.5: expected 0.9..=10.0",
            "shorter than a repetition takes"
        );
        for axis_silent_s in [0.1, 60.0, f64::INFINITY] {
            assert!(check(ManualTable { axis_silent_s, ..table() }).is_err(), "{axis_silent_s}");
        }
        assert!(check(ManualTable { dead_zone: 1.0, ..table() }).is_err());
    }
}
