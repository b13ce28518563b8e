//! Which source poses come from, and what the vehicle is called there.

mod protocols;

use std::net::SocketAddr;

use horizon_model::setting::{SettingError, in_range};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::axes::{Axes, Axis};
use super::datastream::DatastreamProtocol;
use super::natnet::NatnetProtocol;
use super::object_stream::{NAME_BYTES_MAX, ObjectStreamProtocol};
use super::protocol::{BodyProtocol, Picked};
use super::qtm::QtmProtocol;
use super::relay::RelayProtocol;
use super::vrpn::VrpnProtocol;
pub use protocols::{NatnetTable, QtmTable, VrpnTable};
use protocols::{of_natnet, of_qtm, of_vrpn};

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
    /// OptiTrack's NatNet, multicast or unicast as the server says.
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
    /// Frame rate of the mocap system, which the datagrams do not tell. Hz, 1..=2000
    pub rate_hz: f64,
}

/// Checked [`MocapTable`].
#[derive(Debug, Clone, PartialEq)]
pub struct MocapSettings {
    transport: Transport,
    protocol: Protocol,
    object: String,
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

#[derive(Debug, Clone, Copy, PartialEq)]
enum Protocol {
    Relay,
    ObjectStream { rate_hz: f64 },
    Datastream,
    Natnet { rate_hz: Option<f64> },
    Qtm { up: Option<Axis> },
    Vrpn { rate_hz: f64 },
}

impl MocapTable {
    /// Key of each source with its usual port.
    pub const KINDS: [(&'static str, u16); 6] = [
        ("relay", 51602),
        ("udp", 51001),
        ("datastream", 801),
        ("natnet", 1510),
        ("qtm", 22223),
        ("vrpn", 3883),
    ];

    /// Key of the source.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Relay(_) => "relay",
            Self::Udp(_) => "udp",
            Self::Datastream(_) => "datastream",
            Self::Natnet(_) => "natnet",
            Self::Qtm(_) => "qtm",
            Self::Vrpn(_) => "vrpn",
        }
    }

    /// Whether axes and nose are settings (`frame`); else the mocap system has to send ours.
    pub fn has_frame(&self) -> bool {
        matches!(self, Self::Natnet(_) | Self::Qtm(_) | Self::Vrpn(_))
    }

    /// Name of the vehicle in the mocap system.
    pub fn object(&self) -> &str {
        match self {
            Self::Relay(table) | Self::Datastream(table) => &table.object,
            Self::Udp(table) => &table.object,
            Self::Natnet(table) => &table.object,
            Self::Qtm(table) => &table.object,
            Self::Vrpn(table) => &table.object,
        }
    }

    /// The same source for another object.
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
        match self {
            Self::Relay(table) => ("mocap.relay.address", &table.address),
            Self::Datastream(table) => ("mocap.datastream.address", &table.address),
            Self::Udp(table) => ("mocap.udp.listen", &table.listen),
            Self::Natnet(table) => ("mocap.natnet.address", &table.address),
            Self::Qtm(table) => ("mocap.qtm.address", &table.address),
            Self::Vrpn(table) => ("mocap.vrpn.address", &table.address),
        }
    }
}

impl TryFrom<&MocapTable> for MocapSettings {
    type Error = SettingError;

    fn try_from(table: &MocapTable) -> Result<Self, SettingError> {
        let checked = match table {
            MocapTable::Relay(table) => Self::of_server(Protocol::Relay, table),
            MocapTable::Udp(table) => Self::of_udp(table),
            MocapTable::Datastream(table) => Self::of_server(Protocol::Datastream, table),
            MocapTable::Natnet(table) => of_natnet(table),
            MocapTable::Qtm(table) => of_qtm(table),
            MocapTable::Vrpn(table) => of_vrpn(table),
        };
        checked.map_err(|error| error.under(table.kind()))
    }
}

impl MocapSettings {
    /// The relay's protocol for `object`, from bytes that arrive without a socket.
    ///
    /// # Errors
    /// A name with spaces, or none.
    pub fn relay(object: &str) -> Result<Self, SettingError> {
        let (address, object) = ("localhost:0".to_owned(), object.to_owned());
        Self::of_server(Protocol::Relay, &ServerTable { address, object })
    }

    pub(super) fn transport(&self) -> &Transport {
        &self.transport
    }

    /// The source at its beginning, read for the vehicle.
    pub(super) fn source(&self) -> Picked {
        Picked::new(self.protocol(), &self.object, self.axes.clone())
    }

    /// The source at its beginning.
    pub(super) fn protocol(&self) -> Box<dyn BodyProtocol> {
        match self.protocol {
            Protocol::Relay => Box::new(RelayProtocol::default()),
            Protocol::ObjectStream { rate_hz } => Box::new(ObjectStreamProtocol::new(rate_hz)),
            Protocol::Datastream => Box::new(DatastreamProtocol::default()),
            Protocol::Natnet { rate_hz } => Box::new(NatnetProtocol::new(rate_hz)),
            Protocol::Qtm { up } => Box::new(QtmProtocol::new(up)),
            Protocol::Vrpn { rate_hz } => Box::new(VrpnProtocol::new(rate_hz)),
        }
    }

    /// How a place of the source becomes one of ours.
    pub fn axes(&self) -> Axes {
        self.axes.clone()
    }

    /// Name of the vehicle in the mocap system.
    pub fn object(&self) -> &str {
        &self.object
    }

    fn of_server(protocol: Protocol, table: &ServerTable) -> Result<Self, SettingError> {
        let ServerTable { address, object } = table;
        let address = server_address(address)?;
        if protocol == Protocol::Relay && object.contains(char::is_whitespace) {
            return Err(name_error(object, "a name without spaces"));
        }
        let transport = Transport::Tcp(address);
        Ok(Self { transport, protocol, object: named(object)?, axes: Axes::ours() })
    }

    fn of_udp(table: &UdpTable) -> Result<Self, SettingError> {
        let UdpTable { listen, object, rate_hz } = table;
        let address = listen.parse().ok();
        let address = address.ok_or_else(|| SettingError::new("listen", listen, "address:port"))?;
        if object.len() > NAME_BYTES_MAX {
            return Err(name_error(object, "at most 24 bytes"));
        }
        let protocol =
            Protocol::ObjectStream { rate_hz: in_range("rate_hz", *rate_hz, 1.0..=2000.0)? };
        let transport = Transport::Udp(address);
        Ok(Self { transport, protocol, object: named(object)?, axes: Axes::ours() })
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

fn named(object: &str) -> Result<String, SettingError> {
    if object.is_empty() {
        return Err(name_error(object, "a name"));
    }
    Ok(object.to_owned())
}

fn name_error(object: &str, rule: &'static str) -> SettingError {
    SettingError::new("object", format!("{object:?}"), rule)
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
        let names = MocapTable::KINDS.map(|(name, _)| format!("`{name}`")).join(", ");
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
    fn nonsense_settings_are_refused_with_key_value_and_rule() {
        let relay = |address, object| MocapTable::Relay(server(address, object));
        assert!(MocapSettings::try_from(&relay("mocap:51602", "tello")).is_ok());
        assert_eq!(error(&relay("mocap", "t")), "relay.address = mocap violates host:port");
        assert!(MocapSettings::try_from(&relay(":51602", "tello")).is_err());
        assert!(MocapSettings::try_from(&relay("mocap:70000", "tello")).is_err());
        assert_eq!(
            error(&relay("mocap:51602", "my drone")),
            "relay.object = \"my drone\" violates a name without spaces"
        );
        assert!(MocapSettings::try_from(&relay("mocap:51602", "")).is_err());
        let datastream = |object| MocapTable::Datastream(server("vicon:801", object));
        assert!(MocapSettings::try_from(&datastream("my drone")).is_ok());
        assert_eq!(error(&datastream("")), "datastream.object = \"\" violates a name");
        assert!(MocapSettings::try_from(&udp("0.0.0.0:51001", "tello", 100.0)).is_ok());
        assert_eq!(
            error(&udp("51001", "tello", 100.0)),
            "udp.listen = 51001 violates address:port"
        );
        assert!(error(&udp("0.0.0.0:1", "tello", 0.0)).starts_with("udp.rate_hz = 0"));
        assert!(error(&udp("0.0.0.0:1", "tello", f64::NAN)).starts_with("udp.rate_hz = NaN"));
        assert!(error(&udp("0.0.0.0:1", "a_name_of_twenty_five_byt", 50.0)).ends_with("24 bytes"));
    }
}
