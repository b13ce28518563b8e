//! Which source poses come from, and what the vehicle is called there.

mod kind;
mod protocols;

use std::net::SocketAddr;

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::axes::{Axes, FrameTable, Unit};
use super::datastream::DatastreamProtocol;
use super::natnet::NatnetProtocol;
use super::object_stream::{NAME_BYTES_MAX, ObjectStreamProtocol};
use super::protocol::{BodyProtocol, OBJECT_NAME_BYTES_MAX, SelectedProtocol};
use super::qtm::QtmProtocol;
use super::relay::RelayProtocol;
use super::vrpn::VrpnProtocol;
pub use kind::MocapKind;
pub use protocols::{NatnetTable, QtmTable, VrpnTable};

/// Where poses come from, as written in JSON: the source by its key.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum MocapTable {
    /// The thesis' relay: lines of text over TCP.
    Relay(ServerTable),
    /// The UDP object stream of Vicon Tracker.
    Udp(UdpTable),
    /// Vicon's DataStream server (TCP), which Tracker, Nexus and Shogun are.
    Datastream(ServerTable),
    /// OptiTrack's NatNet, multicast or unicast as the server announces.
    Natnet(NatnetTable),
    /// Qualisys' real-time protocol (TCP).
    Qtm(QtmTable),
    /// A VRPN tracker (TCP).
    Vrpn(VrpnTable),
}

/// A server that poses are fetched from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ServerTable {
    /// Host and port of the server, such as `192.168.1.5:51602` or `vicon:801`.
    pub address: String,
    /// Name of the vehicle in the mocap system; in the relay's lines it cannot have spaces.
    pub object: String,
}

/// Where the UDP object stream arrives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct UdpTable {
    /// Local address and port that Tracker sends to, such as `0.0.0.0:51001`.
    pub listen: String,
    /// Name of the vehicle in the mocap system. At most 24 bytes.
    pub object: String,
    /// Frame rate of the mocap system, which the datagrams do not state. Hz, 1..=2000
    pub rate_hz: f64,
}

/// Checked [`MocapTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct MocapSettings {
    table: MocapTable,
    pub(super) transport: Transport,
    axes: Axes,
}

/// How bytes arrive.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Transport {
    /// From a server, host and port.
    Tcp(String),
    /// On a port of ours.
    Udp(SocketAddr),
    /// From a NatNet server, host and command port.
    Natnet(String),
}

/// Content of a table, whatever its source.
struct Parts<'a> {
    kind: MocapKind,
    /// Key of the address.
    key: &'static str,
    address: &'a str,
    object: &'a str,
    /// Hz
    rate_hz: Option<f64>,
    frame: Option<&'a FrameTable>,
}

impl MocapTable {
    fn parts(&self) -> Parts<'_> {
        let (kind, key, [address, object], rate_hz, frame) = match self {
            Self::Relay(ServerTable { address, object }) => {
                (MocapKind::Relay, "mocap.relay.address", [address, object], None, None)
            }
            Self::Udp(UdpTable { listen, object, rate_hz }) => {
                (MocapKind::Udp, "mocap.udp.listen", [listen, object], Some(*rate_hz), None)
            }
            Self::Datastream(ServerTable { address, object }) => {
                (MocapKind::Datastream, "mocap.datastream.address", [address, object], None, None)
            }
            Self::Natnet(NatnetTable { address, object, rate_hz, frame }) => (
                MocapKind::Natnet,
                "mocap.natnet.address",
                [address, object],
                *rate_hz,
                frame.as_ref(),
            ),
            Self::Qtm(QtmTable { address, object, frame }) => {
                (MocapKind::Qtm, "mocap.qtm.address", [address, object], None, frame.as_ref())
            }
            Self::Vrpn(VrpnTable { address, object, rate_hz, frame }) => (
                MocapKind::Vrpn,
                "mocap.vrpn.address",
                [address, object],
                Some(*rate_hz),
                frame.as_ref(),
            ),
        };
        Parts { kind, key, address, object, rate_hz, frame }
    }

    /// Kind of the source.
    pub fn kind(&self) -> MocapKind {
        self.parts().kind
    }

    /// Whether axes and nose are settings (`frame`); else the mocap system has to send ours.
    pub fn has_frame(&self) -> bool {
        matches!(self, Self::Natnet(_) | Self::Qtm(_) | Self::Vrpn(_))
    }

    /// Name of the vehicle in the mocap system.
    pub fn object(&self) -> &str {
        self.parts().object
    }

    /// Settings of this source for another object.
    #[must_use]
    pub fn of_object(&self, name: &str) -> Self {
        let mut other = self.clone();
        let object = match &mut other {
            Self::Relay(table) | Self::Datastream(table) => &mut table.object,
            Self::Udp(table) => &mut table.object,
            Self::Natnet(table) => &mut table.object,
            Self::Qtm(table) => &mut table.object,
            Self::Vrpn(table) => &mut table.object,
        };
        name.clone_into(object);
        other
    }

    /// Sets the rate of a source that does not announce its own; the others keep theirs.
    pub fn set_rate_hz(&mut self, rate_hz: f64) {
        match self {
            Self::Udp(table) => table.rate_hz = rate_hz,
            Self::Vrpn(table) => table.rate_hz = rate_hz,
            Self::Relay(_) | Self::Datastream(_) | Self::Natnet(_) | Self::Qtm(_) => {}
        }
    }

    /// The address to connect to or to listen on, with its key.
    pub fn address(&self) -> (&'static str, &str) {
        let Parts { key, address, .. } = self.parts();
        (key, address)
    }
}

impl TryFrom<&MocapTable> for MocapSettings {
    type Error = SettingError;

    fn try_from(table: &MocapTable) -> Result<Self, SettingError> {
        Self::of(table).map_err(|error| error.under(table.kind().name()))
    }
}

impl MocapSettings {
    /// The relay's protocol for `object`, from bytes that arrive without a socket.
    ///
    /// # Errors
    /// A name with spaces, or none.
    pub fn relay(object: &str) -> Result<Self, SettingError> {
        let (address, object) = ("localhost:0".to_owned(), object.to_owned());
        Self::of(&MocapTable::Relay(ServerTable { address, object }))
    }

    /// The source at its beginning, read for the vehicle.
    pub(super) fn source(&self) -> SelectedProtocol {
        SelectedProtocol::new(self.protocol(), self.object(), self.axes.clone())
    }

    /// The source at its beginning.
    pub(super) fn protocol(&self) -> Box<dyn BodyProtocol> {
        match &self.table {
            MocapTable::Relay(_) => Box::new(RelayProtocol::default()),
            MocapTable::Udp(table) => Box::new(ObjectStreamProtocol::new(table.rate_hz)),
            MocapTable::Datastream(_) => Box::new(DatastreamProtocol::default()),
            MocapTable::Natnet(table) => Box::new(NatnetProtocol::new(table.rate_hz)),
            MocapTable::Qtm(QtmTable { frame, .. }) => {
                let axes = frame.as_ref().and_then(|frame| frame.axes);
                Box::new(QtmProtocol::new(axes.map(|[_, _, up]| up)))
            }
            MocapTable::Vrpn(table) => Box::new(VrpnProtocol::new(table.rate_hz)),
        }
    }

    /// The mapping from axes and unit of the source to the world frame.
    pub fn axes(&self) -> Axes {
        self.axes.clone()
    }

    /// Name of the vehicle in the mocap system.
    pub fn object(&self) -> &str {
        self.table.object()
    }

    fn of(table: &MocapTable) -> Result<Self, SettingError> {
        let Parts { address, object, rate_hz, frame, .. } = table.parts();
        let transport = match table {
            MocapTable::Udp(_) => {
                let listen = address.parse().ok();
                let refused = || SettingError::new("listen", address, "address:port");
                Transport::Udp(listen.ok_or_else(refused)?)
            }
            MocapTable::Natnet(_) => Transport::Natnet(server_address(address)?),
            _ => Transport::Tcp(server_address(address)?),
        };
        rate_hz.map(|rate_hz| in_range("rate_hz", rate_hz, 1.0..=2000.0)).transpose()?;
        let bytes = object.len();
        let broken = match table {
            _ if bytes == 0 => Some("a name"),
            MocapTable::Relay(_) if object.contains(char::is_whitespace) => {
                Some("a name without spaces")
            }
            MocapTable::Udp(_) if bytes > NAME_BYTES_MAX => Some("at most 24 bytes"),
            _ if table.has_frame() && bytes > OBJECT_NAME_BYTES_MAX => Some("at most 256 bytes"),
            _ => None,
        };
        if let Some(rule) = broken {
            return Err(SettingError::new("object", format!("{object:?}"), rule));
        }
        let axes = match table {
            MocapTable::Qtm(_) => Axes::new(frame, Unit::Millimetre)?,
            _ if table.has_frame() => Axes::new(frame, Unit::Metre)?,
            _ => Axes::ours(),
        };
        Ok(Self { table: table.clone(), transport, axes })
    }
}

/// `address` if it is a host and a port.
fn server_address(address: &str) -> Result<String, SettingError> {
    let is_address = address
        .rsplit_once(':')
        .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
    if is_address {
        Ok(address.to_owned())
    } else {
        Err(SettingError::new("address", address, "host:port"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn server(address: &str, object: &str) -> ServerTable {
        ServerTable { address: address.into(), object: object.into() }
    }

    fn error(table: &MocapTable) -> String {
        MocapSettings::try_from(table).unwrap_err().to_string()
    }

    fn udp(listen: &str, object: &str, rate_hz: f64) -> MocapTable {
        MocapTable::Udp(UdpTable { listen: listen.into(), object: object.into(), rate_hz })
    }

    #[test]
    fn the_source_is_chosen_by_its_key() {
        let text =
            r#"{ "udp": { "listen": "0.0.0.0:51001", "object": "tello", "rate_hz": 100.0 } }"#;
        let table: MocapTable = serde_json::from_str(text).unwrap();
        assert_eq!(table, udp("0.0.0.0:51001", "tello", 100.0));
        let text = r#"{ "relay": { "address": "mocap:51602", "object": "tello" } }"#;
        let table: MocapTable = serde_json::from_str(text).unwrap();
        assert_eq!(table, MocapTable::Relay(server("mocap:51602", "tello")));
        assert_eq!(
            serde_json::to_value(&table).unwrap(),
            serde_json::from_str::<serde_json::Value>(text).unwrap()
        );
        for text in ["{}", r#"{ "optitrack": {} }"#, r#"{ "relay": { "address": "a:1" } }"#] {
            assert!(serde_json::from_str::<MocapTable>(text).is_err(), "{text}");
        }
    }

    #[test]
    fn the_names_are_those_that_settings_may_have() {
        let error = serde_json::from_str::<MocapTable>(r#"{ "": {} }"#).unwrap_err().to_string();
        let names = MocapKind::ALL.map(|kind| format!("`{}`", kind.name())).join(", ");
        assert!(error.contains(&format!("expected one of {names} at")), "{error}");
    }

    #[test]
    fn only_a_source_without_a_rate_of_its_own_takes_one() {
        let mut table = udp("0.0.0.0:51001", "tello", 100.0);
        table.set_rate_hz(240.0);
        assert_eq!(table, udp("0.0.0.0:51001", "tello", 240.0));
        let mut relay = MocapTable::Relay(server("mocap:51602", "tello"));
        relay.set_rate_hz(240.0);
        assert_eq!(relay, MocapTable::Relay(server("mocap:51602", "tello")));
        let (address, object) = ("a:1510".into(), "tello".into());
        let natnet = NatnetTable { address, object, rate_hz: Some(50.0), frame: None };
        let mut table = MocapTable::Natnet(natnet.clone());
        table.set_rate_hz(240.0);
        assert_eq!(table, MocapTable::Natnet(natnet), "in place of the server's: it stays");
    }

    #[test]
    fn mocap_settings_that_break_a_rule_are_refused_with_key_value_and_rule() {
        let relay = |address, object| MocapTable::Relay(server(address, object));
        assert!(MocapSettings::try_from(&relay("mocap:51602", "tello")).is_ok());
        assert_eq!(error(&relay("mocap", "t")), "relay.address = mocap: expected host:port");
        assert!(MocapSettings::try_from(&relay(":51602", "tello")).is_err());
        assert!(MocapSettings::try_from(&relay("mocap:70000", "tello")).is_err());
        assert_eq!(
            error(&relay("mocap:51602", "my drone")),
            "relay.object = \"my drone\": expected a name without spaces"
        );
        assert!(MocapSettings::try_from(&relay("mocap:51602", "")).is_err());
        let datastream = |object| MocapTable::Datastream(server("vicon:801", object));
        assert!(MocapSettings::try_from(&datastream("my drone")).is_ok());
        assert_eq!(error(&datastream("")), "datastream.object = \"\": expected a name");
        assert!(MocapSettings::try_from(&udp("0.0.0.0:51001", "tello", 100.0)).is_ok());
        assert_eq!(
            error(&udp("51001", "tello", 100.0)),
            "udp.listen = 51001: expected address:port"
        );
        assert!(error(&udp("0.0.0.0:1", "tello", 0.0)).starts_with("udp.rate_hz = 0"));
        assert!(error(&udp("0.0.0.0:1", "tello", f64::NAN)).starts_with("udp.rate_hz = NaN"));
        assert!(error(&udp("0.0.0.0:1", "a_name_of_twenty_five_byt", 50.0)).ends_with("24 bytes"));
    }
}
