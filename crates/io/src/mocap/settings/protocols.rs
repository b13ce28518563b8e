//! Settings of the protocols whose axes are settings: NatNet, QTM, VRPN.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::axes::{Axes, FrameTable, Unit};
use super::super::protocol::OBJECT_NAME_BYTES_MAX;
use super::{MocapSettings, Protocol, Transport, name_error, named, server_address};

/// An OptiTrack system: Motive's NatNet stream.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct NatnetTable {
    /// Host and command port of the server, such as `192.168.1.5:1510`.
    pub address: String,
    /// Name of the rigid body, or `#` and its streaming identity.
    pub object: String,
    /// Frame rate, in place of what the server says. Hz, 1..=2000
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
    /// Frame rate of the mocap system, which the messages do not tell. Hz, 1..=2000
    pub rate_hz: f64,
    /// Axes, nose and unit. VRPN says metres; not every server does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frame: Option<FrameTable>,
}

/// Settings of a NatNet server.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_natnet(table: &NatnetTable) -> Result<MocapSettings, SettingError> {
    let NatnetTable { address, object, rate_hz, frame } = table;
    let rate_hz = rate_hz.map(|rate_hz| in_range("rate_hz", rate_hz, 1.0..=2000.0)).transpose()?;
    let (object, axes) = (checked(object)?, Axes::new(frame.as_ref(), Unit::Metre)?);
    let transport = Transport::Natnet(server_address(address)?);
    Ok(MocapSettings { transport, protocol: Protocol::Natnet { rate_hz }, object, axes })
}

/// The same for QTM.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_qtm(table: &QtmTable) -> Result<MocapSettings, SettingError> {
    let QtmTable { address, object, frame } = table;
    let up = frame.as_ref().and_then(|frame| frame.axes).map(|[_, _, up]| up);
    let (object, axes) = (checked(object)?, Axes::new(frame.as_ref(), Unit::Millimetre)?);
    let transport = Transport::Tcp(server_address(address)?);
    Ok(MocapSettings { transport, protocol: Protocol::Qtm { up }, object, axes })
}

/// The same for VRPN.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_vrpn(table: &VrpnTable) -> Result<MocapSettings, SettingError> {
    let VrpnTable { address, object, rate_hz, frame } = table;
    let rate_hz = in_range("rate_hz", *rate_hz, 1.0..=2000.0)?;
    let (object, axes) = (checked(object)?, Axes::new(frame.as_ref(), Unit::Metre)?);
    let transport = Transport::Tcp(server_address(address)?);
    Ok(MocapSettings { transport, protocol: Protocol::Vrpn { rate_hz }, object, axes })
}

/// `object` if it is a name that is remembered.
fn checked(object: &str) -> Result<String, SettingError> {
    if object.len() > OBJECT_NAME_BYTES_MAX {
        return Err(name_error(object, "at most 256 bytes"));
    }
    named(object)
}

#[cfg(test)]
mod tests;
