//! Settings of the protocols whose axes are settings: NatNet, QTM, VRPN.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::axes::FrameTable;

/// An OptiTrack system: Motive's NatNet stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NatnetTable {
    /// Host and command port of the server, such as `192.168.1.5:1510`.
    pub address: String,
    /// Name of the rigid body, or `#` and its streaming identity.
    pub object: String,
    /// Frame rate, in place of the announced one. Hz, 1..=2000
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rate_hz: Option<f64>,
    /// Axes and nose. Motive has y up unless it is set to z.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameTable>,
}

/// A Qualisys system: QTM's real-time server.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct QtmTable {
    /// Host and little-endian port of the server, such as `192.168.1.5:22223`.
    pub address: String,
    /// Name of the 6DOF body.
    pub object: String,
    /// Axes and nose.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameTable>,
}

/// A VRPN server, which many mocap systems can be.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct VrpnTable {
    /// Host and port of the server, such as `192.168.1.5:3883`.
    pub address: String,
    /// Name of the tracker; `name#2` for its third sensor.
    pub object: String,
    /// Frame rate of the mocap system, which the messages do not state. Hz, 1..=2000
    pub rate_hz: f64,
    /// Axes, nose and unit. VRPN specifies metres; not every server does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameTable>,
}

#[cfg(test)]
mod tests;
