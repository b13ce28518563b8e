//! The Tello, through its binary protocol.
//!
//! Owns the settings of the link, its counters and what the control thread learns of the drone.
//! Bytes are `tello::protocol`, limits are `tello::gate`, what is sent when is `tello::session`, the
//! socket is `tello::client`.

mod client;
mod gate;
pub mod protocol;
mod session;

use std::net::SocketAddr;
use std::sync::atomic::{AtomicBool, Ordering};

use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};
use tello_model::setting::SettingError;

pub use client::{DroneClient, DroneLink, LinkError, OrderError};
pub use gate::{Approved, Gate, GateTable};
pub use session::{Order, Session};

use crate::Counter;
use crate::clock::TimeNs;
use protocol::FlightStatus;

/// What the drone last said of itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DroneStatus {
    /// When the packet arrived.
    pub received_at: TimeNs,
    /// In the air, by the drone's own judgement.
    pub is_flying: bool,
    /// Standing, by the drone's own judgement.
    pub is_on_ground: bool,
    /// Charge is low by the drone's own thresholds.
    pub is_battery_low: bool,
    /// Charge. %, 0..=100
    pub battery_pct: u8,
    /// Battery voltage. mV
    pub battery_mv: i16,
    /// Height. dm; low by an offset that differs from flight to flight
    pub height_dm: i16,
    /// 1 landed, 6 flying; others are undocumented.
    pub flight_mode: u8,
}

impl DroneStatus {
    fn new(status: &FlightStatus, received_at: TimeNs) -> Self {
        Self {
            received_at,
            is_flying: status.is_flying(),
            is_on_ground: status.is_on_ground(),
            is_battery_low: status.is_battery_low(),
            battery_pct: status.battery_pct,
            battery_mv: status.battery_mv,
            height_dm: status.height_dm,
            flight_mode: status.flight_mode,
        }
    }
}

/// Where the drone is, as written in JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The key of an `Option` counts as optional unless said otherwise, here and in `present`.
#[schemars(extend("required" = ["address", "local_port", "interface"]))]
pub struct TelloTable {
    /// IP address and port of the drone: `192.168.10.1:8889` for every Tello.
    pub address: String,
    /// UDP port of the host; 0 takes any that is free.
    pub local_port: u16,
    /// Network interface with the drone's Wi-Fi, such as `wlan1`; `null` lets the system route.
    #[serde(deserialize_with = "present")]
    pub interface: Option<String>,
}

/// An optional value whose key is required: serde lets the key of an `Option` be missing.
fn present<'de, D: Deserializer<'de>>(from: D) -> Result<Option<String>, D::Error> {
    Option::deserialize(from)
}

/// Checked [`TelloTable`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TelloSettings {
    address: SocketAddr,
    local_port: u16,
    interface: Option<String>,
}

impl TryFrom<&TelloTable> for TelloSettings {
    type Error = SettingError;

    fn try_from(table: &TelloTable) -> Result<Self, SettingError> {
        let TelloTable { address, local_port, interface } = table.clone();
        let Ok(parsed @ SocketAddr::V4(_)) = address.parse() else {
            return Err(SettingError::new("address", address, "IPv4 address:port"));
        };
        if interface.as_ref().is_some_and(String::is_empty) {
            return Err(SettingError::new("interface", "\"\"", "a name or null"));
        }
        Ok(Self { address: parsed, local_port, interface })
    }
}

/// How the link to the drone does.
#[derive(Debug, Default)]
pub struct LinkCounters {
    is_connected: AtomicBool,
    /// Requests for a connection.
    pub conn_requests: Counter,
    /// Correct packets of the drone.
    pub packets: Counter,
    /// Datagrams that are damaged, of another protocol or of another sender.
    pub malformed: Counter,
    /// Status packets lost because the queue was full.
    pub overflow: Counter,
    /// Stick packets sent, neutral ones of the watchdog included.
    pub sticks: Counter,
    /// Stick packets made neutral because the control thread was silent.
    pub neutralised: Counter,
    /// Landings begun because the control thread was silent.
    pub watchdog_landings: Counter,
    /// Orders sent, repeated landings included.
    pub orders: Counter,
    /// Acknowledgements of the newest order.
    pub acks: Counter,
    /// Datagrams that the socket did not take or could not read.
    pub socket_errors: Counter,
}

impl LinkCounters {
    /// Whether the drone acknowledged the connection and was heard in the last 2 s.
    ///
    /// It says nothing of the way to the drone: that can be dead while status packets arrive.
    pub fn is_connected(&self) -> bool {
        self.is_connected.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(table: &TelloTable) -> Result<TelloSettings, SettingError> {
        TelloSettings::try_from(table)
    }

    fn table() -> TelloTable {
        TelloTable { address: "192.168.10.1:8889".into(), local_port: 0, interface: None }
    }

    #[test]
    fn nonsense_settings_are_refused_with_key_value_and_rule() {
        assert!(check(&table()).is_ok());
        let error = check(&TelloTable { address: "tello:8889".into(), ..table() }).unwrap_err();
        assert_eq!(error.to_string(), "address = tello:8889 violates IPv4 address:port");
        assert!(check(&TelloTable { address: "[::1]:8889".into(), ..table() }).is_err());
        let error = check(&TelloTable { interface: Some(String::new()), ..table() }).unwrap_err();
        assert_eq!(error.to_string(), "interface = \"\" violates a name or null");
    }

    #[test]
    fn the_interface_may_be_null_but_not_missing() {
        let read = |text: &str| serde_json::from_str::<TelloTable>(text);
        let json = r#"{"address": "192.168.10.1:8889", "local_port": 0, "interface": null}"#;
        assert_eq!(read(json).unwrap(), table());
        let error = read(r#"{"address": "192.168.10.1:8889", "local_port": 0}"#).unwrap_err();
        assert!(error.to_string().contains("missing field `interface`"), "{error}");
        let schema = serde_json::to_value(schemars::schema_for!(TelloTable)).unwrap();
        let required = schema["required"].as_array().unwrap();
        assert!(required.contains(&"interface".into()), "{schema}");
    }
}
