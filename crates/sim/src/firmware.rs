//! Settings of the simulated drone: what differs between real ones, and the air around them.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_model::setting::{SettingError, in_range};

use crate::air::AirTable;

/// What the simulated drone is like beside the way it flies.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DroneTable {
    /// Charge that running motors take: 0.125 empties a full battery to a tenth in 12 minutes. %/s,
    /// 0..=100
    pub drain_pct_per_s: f64,
    /// The text SDK that it knows.
    pub sdk: SdkVersion,
    /// Whether its first answer in the text SDK is a status packet of the binary protocol, as real ones
    /// often do.
    pub binary_first: bool,
    /// Where its answers go.
    pub reply_to: ReplyTo,
    /// Datagrams on their way, in either direction.
    pub air: AirTable,
}

/// Version of the text SDK.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Serialize, Deserialize, JsonSchema)]
pub enum SdkVersion {
    /// The plain Tello: neither `sdk?` nor `sn?`.
    #[serde(rename = "1.3")]
    V1_3,
    /// The Tello EDU.
    #[serde(rename = "2.0")]
    V2_0,
    /// The Robomaster TT: knows `port`.
    #[serde(rename = "3.0")]
    V3_0,
}

/// Where answers go.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ReplyTo {
    /// To the address and port that was heard.
    Sender,
    /// To port 8889 of the host, whichever port it sends from.
    Port8889,
}

/// A drone on a good day, and a perfect radio.
#[cfg(test)]
pub(crate) const PLAIN: DroneTable = DroneTable {
    drain_pct_per_s: 0.125,
    sdk: SdkVersion::V1_3,
    binary_first: true,
    reply_to: ReplyTo::Sender,
    air: crate::air::PERFECT,
};

impl DroneTable {
    /// These settings, each within its range.
    ///
    /// # Errors
    /// The first value that breaks its rule.
    pub(crate) fn checked(self) -> Result<Self, SettingError> {
        in_range("drain_pct_per_s", self.drain_pct_per_s, 0.0..=100.0)?;
        self.air.check().map_err(|error| error.under("air"))?;
        Ok(self)
    }
}
