//! Settings of a delay search.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Search for dead times, as written in a file.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DelayTable {
    /// Longest dead time that is tried. s, 0.1..=2
    pub dead_time_max_s: f64,
    /// Distance of the first candidates, from the start outward; the best one is refined by its gradient. s, 0.01..=0.2
    pub grid_s: f64,
    /// How exact a dead time has to be. s, 0.0005..=0.02
    pub tolerance_s: f64,
    /// Most steps of refinement; it ends earlier when every dead time is exact enough. 1..=50
    pub rounds: u32,
}

/// Checked [`DelayTable`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DelaySettings {
    pub(super) dead_time_max_s: f64,
    pub(super) grid_s: f64,
    pub(super) tolerance_s: f64,
    pub(super) rounds: u32,
}

impl TryFrom<&DelayTable> for DelaySettings {
    type Error = SettingError;

    fn try_from(table: &DelayTable) -> Result<Self, SettingError> {
        Ok(Self {
            dead_time_max_s: in_range("dead_time_max_s", table.dead_time_max_s, 0.1..=2.0)?,
            grid_s: in_range("grid_s", table.grid_s, 0.01..=0.2)?,
            tolerance_s: in_range("tolerance_s", table.tolerance_s, 0.0005..=0.02)?,
            rounds: in_range("rounds", table.rounds, 1..=50)?,
        })
    }
}

impl DelaySettings {
    /// Candidates of a search of one group after the other: equidistant from 0 on. s
    pub(super) fn grid(&self) -> impl Iterator<Item = f64> + use<> {
        let Self { dead_time_max_s, grid_s, .. } = *self;
        (0..).map(move |i: u32| f64::from(i) * grid_s).take_while(move |at| *at <= dead_time_max_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TABLE: DelayTable =
        DelayTable { dead_time_max_s: 0.6, grid_s: 0.06, tolerance_s: 0.005, rounds: 20 };

    #[test]
    fn a_setting_out_of_range_is_refused() {
        for (table, refusal) in [
            (
                DelayTable { dead_time_max_s: 2.1, ..TABLE },
                "dead_time_max_s = 2.1: expected 0.1..=2.0",
            ),
            (DelayTable { grid_s: 0.0, ..TABLE }, "grid_s = 0: expected 0.01..=0.2"),
            (DelayTable { grid_s: f64::NAN, ..TABLE }, "grid_s = NaN: expected 0.01..=0.2"),
            (DelayTable { tolerance_s: 0.1, ..TABLE }, "tolerance_s = 0.1: expected 0.0005..=0.02"),
            (DelayTable { rounds: 0, ..TABLE }, "rounds = 0: expected 1..=50"),
        ] {
            assert_eq!(DelaySettings::try_from(&table).unwrap_err().to_string(), refusal);
        }
    }

    #[test]
    fn the_candidates_fill_the_range_from_zero_on() {
        let settings = DelaySettings::try_from(&TABLE).unwrap();
        let grid: Vec<f64> = DelaySettings { dead_time_max_s: 0.2, ..settings }.grid().collect();
        assert_eq!(grid.len(), 4);
        for (i, at_s) in (0..).zip(grid) {
            assert!((at_s - 0.06 * f64::from(i)).abs() < 1e-15, "candidate {i}: {at_s} s");
        }
        // The end of the range is a candidate.
        let whole = DelaySettings { dead_time_max_s: 0.25, grid_s: 0.125, ..settings };
        assert_eq!(whole.grid().count(), 3);
    }
}
