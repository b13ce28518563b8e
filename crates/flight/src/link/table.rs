//! Settings of the link monitor.

use horizon_model::setting::{SettingError, in_range, positive};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{HeightTable, TurnTable};

/// How a lost link is recognized in flight, as written in a file.
///
/// The errors of the model are those that the identified parameter may have in this flight.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LinkTable {
    /// Standard deviation of a position that the filter accepts. It stands for all motion that is too
    /// quick to be the sticks', not only for the noise of the motion capture. m, > 0
    pub sd_position_m: f64,
    /// Standard deviation of the horizontal disturbance velocity. m/s, > 0
    pub sd_disturbance_mps: f64,
    /// Time in which that velocity decays. s, > 0
    pub decay_s: f64,
    /// Standard deviation of the relative error of the gain of each axis. 1, > 0
    pub sd_gain: f64,
    /// Standard deviation of the error of the direction of flight. rad, > 0
    pub sd_heading_rad: f64,
    /// Standard deviation of the error of the dead time of each axis. s, > 0
    pub sd_dead_time_s: f64,
    /// Standard deviation of the relative error of the horizontal lag. 1, > 0
    pub sd_rate: f64,
    /// Time in which the errors of the model may change. s, > 0
    pub adapt_s: f64,
    /// Time in which the error of the dead time may change. Missing: `adapt_s`. s, > 0
    #[serde(default)]
    pub dead_time_adapt_s: Option<f64>,
    /// Evidence from which on a command outage counts. Log likelihood ratio. 1, > 0
    #[serde(alias = "loss_evidence")]
    pub outage_evidence: f64,
    /// Evidence from which on its end counts. Log likelihood ratio. 1, > 0
    pub return_evidence: f64,
    /// Time after which an outage no longer counts if no motion shows it or the contrary. s, > 0
    pub forget_s: f64,
    /// Most by which a flight corrects each dead time: all alike by what it shows of the horizontal one, unless
    /// `height` is set. Missing: 0, they stay. s, 0..=0.5
    #[serde(default)]
    pub dead_time_change_s: f64,
    /// Fraction of its configured dead time that such a correction leaves each axis. An axis that is taken for faster
    /// than it is oscillates, and what pushes the vehicle on looks like an early answer. Missing: 0. 1, 0..=1
    #[serde(default)]
    pub dead_time_min_ratio: f64,
    /// Largest stick of the controller while commands do not act: what looks like an outage may be a hand that holds
    /// the vehicle, or a push. Missing: that of the gate. 1, 0.1..=1
    #[serde(default)]
    pub outage_stick_max: Option<f64>,
    /// The filter that the dead time is learnt from. Missing: those that the link is tested by
    #[serde(default)]
    pub dead_time: Option<DeadTimeTable>,
    /// Detection of outages by the heading. Missing: none
    #[serde(default)]
    pub turn: Option<TurnTable>,
    /// What the height shows of the throttle's dead time. With it throttle and yaw are corrected by their own errors,
    /// too. Missing: as roll and pitch
    #[serde(default)]
    pub height: Option<HeightTable>,
}

/// The filter of the dead time, as written in a file; what is not here is that of [`LinkTable`].
///
/// An outage is detected by a coarse and quick filter, which does not follow it; a dead time, which is constant, by a
/// fine and slow one.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DeadTimeTable {
    /// Standard deviation of a position that the filter accepts. m, > 0
    pub sd_position_m: f64,
    /// Time in which the dead time may change. s, > 0
    pub adapt_s: f64,
}

impl DeadTimeTable {
    /// The settings of the filter.
    pub(super) fn of_filter(self, link: &LinkTable) -> LinkTable {
        let Self { sd_position_m, adapt_s } = self;
        LinkTable { sd_position_m, dead_time_adapt_s: Some(adapt_s), ..link.clone() }
    }

    fn check(&self) -> Result<(), SettingError> {
        positive("dead_time.sd_position_m", self.sd_position_m)?;
        positive("dead_time.adapt_s", self.adapt_s)?;
        Ok(())
    }
}

/// Checked [`LinkTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct LinkSettings(pub(super) LinkTable);

impl TryFrom<&LinkTable> for LinkSettings {
    type Error = SettingError;

    fn try_from(table: &LinkTable) -> Result<Self, SettingError> {
        positive("sd_position_m", table.sd_position_m)?;
        positive("sd_disturbance_mps", table.sd_disturbance_mps)?;
        positive("decay_s", table.decay_s)?;
        positive("sd_gain", table.sd_gain)?;
        positive("sd_heading_rad", table.sd_heading_rad)?;
        positive("sd_dead_time_s", table.sd_dead_time_s)?;
        positive("sd_rate", table.sd_rate)?;
        positive("adapt_s", table.adapt_s)?;
        table.dead_time_adapt_s.map(|time_s| positive("dead_time_adapt_s", time_s)).transpose()?;
        positive("outage_evidence", table.outage_evidence)?;
        positive("return_evidence", table.return_evidence)?;
        positive("forget_s", table.forget_s)?;
        in_range("dead_time_change_s", table.dead_time_change_s, 0.0..=0.5)?;
        in_range("dead_time_min_ratio", table.dead_time_min_ratio, 0.0..=1.0)?;
        let stick_max = table.outage_stick_max;
        stick_max.map(|max| in_range("outage_stick_max", max, 0.1..=1.0)).transpose()?;
        table.dead_time.as_ref().map_or(Ok(()), DeadTimeTable::check)?;
        table.turn.as_ref().map_or(Ok(()), TurnTable::check)?;
        table.height.as_ref().map_or(Ok(()), HeightTable::check)?;
        Ok(Self(table.clone()))
    }
}

#[cfg(test)]
mod tests;
