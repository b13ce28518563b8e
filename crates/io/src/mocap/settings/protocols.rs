//! Settings of the protocols that send many bodies in a frame: NatNet, QTM, VRPN.

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::super::axes::{Axes, FrameTable, Unit};
use super::super::natnet::NatnetProtocol;
use super::super::protocol::{BodyProtocol, OBJECT_NAME_BYTES_MAX, Picked};
use super::super::qtm::QtmProtocol;
use super::super::source::Source;
use super::super::vrpn::VrpnProtocol;
use super::{Transport, name_error, named, server_address};

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

/// A checked table.
#[derive(Debug, Clone, PartialEq)]
pub(in super::super) struct Bodies {
    kind: Kind,
    /// Axes, nose and unit of the source.
    pub(in super::super) axes: Axes,
    pub(in super::super) object: String,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Natnet { rate_hz: Option<f64> },
    Qtm { up: Option<super::super::axes::Axis> },
    Vrpn { rate_hz: f64 },
}

impl Bodies {
    /// The protocol at its beginning.
    pub(in super::super) fn protocol(&self) -> Box<dyn BodyProtocol> {
        match self.kind {
            Kind::Natnet { rate_hz } => Box::new(NatnetProtocol::new(rate_hz)),
            Kind::Qtm { up } => Box::new(QtmProtocol::new(up)),
            Kind::Vrpn { rate_hz } => Box::new(VrpnProtocol::new(rate_hz)),
        }
    }

    /// The source at its beginning.
    pub(super) fn source(&self) -> Box<dyn Source> {
        Box::new(Picked::new(self.protocol(), &self.object, self.axes.clone()))
    }
}

/// How bytes arrive from a NatNet server, and what they mean.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_natnet(table: &NatnetTable) -> Result<(Transport, Bodies), SettingError> {
    let rate_hz = table.rate_hz.map(|rate_hz| in_range("rate_hz", rate_hz, 1.0..=2000.0));
    let kind = Kind::Natnet { rate_hz: rate_hz.transpose()? };
    let bodies = bodies(kind, &table.object, table.frame.as_ref(), Unit::Metre)?;
    Ok((Transport::Natnet(server_address(&table.address)?), bodies))
}

/// The same for QTM.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_qtm(table: &QtmTable) -> Result<(Transport, Bodies), SettingError> {
    let up = table.frame.as_ref().and_then(|frame| frame.axes).map(|[_, _, up]| up);
    let bodies = bodies(Kind::Qtm { up }, &table.object, table.frame.as_ref(), Unit::Millimetre)?;
    Ok((Transport::Tcp(server_address(&table.address)?), bodies))
}

/// The same for VRPN.
///
/// # Errors
/// The first value that breaks its rule, by its key in the table.
pub(super) fn of_vrpn(table: &VrpnTable) -> Result<(Transport, Bodies), SettingError> {
    let kind = Kind::Vrpn { rate_hz: in_range("rate_hz", table.rate_hz, 1.0..=2000.0)? };
    let bodies = bodies(kind, &table.object, table.frame.as_ref(), Unit::Metre)?;
    Ok((Transport::Tcp(server_address(&table.address)?), bodies))
}

fn bodies(
    kind: Kind,
    object: &str,
    frame: Option<&FrameTable>,
    usual: Unit,
) -> Result<Bodies, SettingError> {
    if object.len() > OBJECT_NAME_BYTES_MAX {
        return Err(name_error(object, "at most 256 bytes"));
    }
    Ok(Bodies { kind, axes: Axes::new(frame, usual)?, object: named(object)? })
}

#[cfg(test)]
mod tests;
