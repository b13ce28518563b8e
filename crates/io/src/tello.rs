//! The Tello, through its binary protocol or its text SDK.
//!
//! Owns the settings of the link, its counters and what the control thread receives from the drone.
//! Bytes are `tello::protocol` and `tello::text`, limits are the gate of `tello-flight`, what is sent when is
//! `tello::session`, the socket is `tello::client`, and `tello::guardian` lands a drone that the client
//! has left alone.

mod bind;
mod client;
mod guardian;
pub mod protocol;
mod report;
mod session;
pub mod text;

use std::net::{SocketAddr, SocketAddrV4, UdpSocket};
use std::sync::atomic::{AtomicBool, AtomicI64, Ordering};

use horizon_model::setting::{SettingError, in_range};
use parking_lot::Mutex;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use bind::LinkError;
pub use client::{DroneClient, DroneLink, OrderError};
pub use guardian::{Guardian, GuardianReport, GuardianSockets, Heartbeat, SenderState, WatchEnd};
use protocol::{Answer, FlightStatus, Version};
pub use report::LinkReport;
pub use session::{Message, STATE_PORT, Session, TOF_FLYING_M};
pub use tello_flight::drone::{DroneOrder, DroneStatus, Protocol};
pub use tello_flight::gate::Approved;

use crate::Counter;
use crate::clock::{SpanNs, TimeNs};

/// Content of a status packet of the binary protocol; the heading is in other packets.
fn status_from_binary(status: &FlightStatus, received_at: TimeNs) -> DroneStatus {
    DroneStatus {
        received_at,
        is_flying: status.is_flying(),
        is_on_ground: status.is_on_ground(),
        takes_sticks: true,
        is_battery_low: Some(status.is_battery_low()),
        is_battery_critical: Some(status.is_battery_critical()),
        battery_pct: status.battery_pct,
        battery_v: Some(status.battery_v()),
        height_m: Some(status.height_m()),
        velocity_d_mps: Some(status.velocity_d_mps()),
        heading_rad: None,
        flight_mode: Some(status.flight_mode),
    }
}

/// Where the drone is, as written in JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
// The key of an `Option` counts as optional unless stated otherwise, here and in `present`.
#[schemars(extend("required" = [
    "protocol", "address", "local_port", "state_port", "altitude_limit_m", "interface"
]))]
pub struct TelloTable {
    /// How to talk to it.
    pub protocol: Protocol,
    /// IP address and port of the drone: `192.168.10.1:8889` for every Tello.
    pub address: String,
    /// UDP port of the host; 0 takes any that is free. In the text SDK some drones answer to 8889 only.
    pub local_port: u16,
    /// UDP port of the host for the text SDK's state line: 8890, unless the drone knows the command
    /// `port` (SDK 3.0), which it is then sent; 0 takes any that is free.
    pub state_port: u16,
    /// Highest altitude that the drone is ordered to keep, in the binary protocol; `null` leaves it as it
    /// is. m, 1..=100
    #[serde(deserialize_with = "tello_flight::present")]
    pub altitude_limit_m: Option<u16>,
    /// Network interface with the drone's Wi-Fi, such as `wlan1`; `null` lets the system route.
    #[serde(deserialize_with = "tello_flight::present")]
    pub interface: Option<String>,
}

/// Checked [`TelloTable`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TelloSettings {
    protocol: Protocol,
    address: SocketAddr,
    local_port: u16,
    state_port: u16,
    altitude_limit_m: Option<u16>,
    interface: Option<String>,
}

impl TryFrom<&TelloTable> for TelloSettings {
    type Error = SettingError;

    fn try_from(table: &TelloTable) -> Result<Self, SettingError> {
        let TelloTable { protocol, address, local_port, state_port, altitude_limit_m, interface } =
            table.clone();
        let of_one_host = |at: &SocketAddrV4| {
            let ip = at.ip();
            !ip.is_unspecified() && !ip.is_broadcast() && !ip.is_multicast()
        };
        let Some(parsed) = address.parse().ok().filter(of_one_host) else {
            return Err(SettingError::new("address", address, "IPv4 address:port of one host"));
        };
        let parsed = SocketAddr::V4(parsed);
        if interface.as_ref().is_some_and(String::is_empty) {
            return Err(SettingError::new("interface", "\"\"", "a name or null"));
        }
        if let Some(limit_m) = altitude_limit_m {
            in_range("altitude_limit_m", f64::from(limit_m), 1.0..=100.0)?;
        }
        if local_port != 0 && local_port == state_port && protocol.has_state_port() {
            let rule = "another port than local_port";
            return Err(SettingError::new("state_port", state_port, rule));
        }
        Ok(Self { protocol, address: parsed, local_port, state_port, altitude_limit_m, interface })
    }
}

impl TelloSettings {
    /// How to talk to the drone.
    pub fn protocol(&self) -> Protocol {
        self.protocol
    }

    /// Address and port at which the drone takes commands.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Non-blocking sockets as the link uses them: for commands and, in the text SDK, for the state line.
    ///
    /// # Errors
    /// As [`DroneClient::bind`].
    pub fn bind(&self) -> Result<(UdpSocket, Option<UdpSocket>), LinkError> {
        let commands = bind::bind_socket(self, "local_port", self.local_port)?;
        let state = self
            .protocol
            .has_state_port()
            .then(|| bind::bind_socket(self, "state_port", self.state_port));
        Ok((commands, state.transpose()?))
    }
}

/// How the link to the drone does.
#[derive(Debug, Default)]
pub struct LinkCounters {
    is_connected: AtomicBool,
    /// Correct packets of the drone.
    pub packets: Counter,
    /// Datagrams that are damaged, of another protocol or from another address.
    pub malformed: Counter,
    /// Status packets lost because the queue was full.
    pub overflow: Counter,
    /// Stick packets sent while the sender steers, neutral ones of its watchdog included; not those directly before
    /// LAND and before the first emergency stop.
    pub sticks: Counter,
    /// Stick packets made neutral because the control thread was silent.
    pub neutralised: Counter,
    /// Landings begun because the control thread was silent.
    pub watchdog_landings: Counter,
    /// Landings that the guardian began, or may have begun, because this program stood still.
    pub guardian_landings: Counter,
    /// Guardians that ended before this program, or did not answer; the drone is landed then.
    pub guardians_lost: Counter,
    /// Orders sent, repeated landings included.
    pub orders: Counter,
    /// Acknowledgements of the newest order.
    pub acks: Counter,
    /// Commands that the drone refused in words; text SDK only.
    pub refusals: Counter,
    /// Datagrams that the socket did not take or could not read.
    pub socket_errors: Counter,
    /// Time from the control thread to the socket of the newest sticks. ns
    sticks_latency_ns: AtomicI64,
    /// Longest time between two turns of the sender while the drone may have been in the air. ns
    pause_ns: AtomicI64,
    facts: Mutex<DroneFacts>,
    refusal: Mutex<Option<String>>,
}

/// Answers of a drone to queries; binary protocol only.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct DroneFacts {
    /// Version of the firmware.
    pub version: Option<Version>,
    /// Highest altitude that it flies to. m
    pub altitude_limit_m: Option<u16>,
    /// Charge below which it calls its battery low. %
    pub battery_threshold_pct: Option<u8>,
    /// Largest tilt. rad
    pub tilt_limit_rad: Option<f64>,
}

/// More of the words of a refusal is not kept.
const REFUSAL_CHARS: usize = 80;

impl LinkCounters {
    /// Whether the drone has answered or reported, and was heard in the last 2 s.
    ///
    /// It shows nothing about the direction to the drone: packets may be lost there while status packets arrive.
    pub fn is_connected(&self) -> bool {
        self.is_connected.load(Ordering::Relaxed)
    }

    /// Time from the control thread to the socket of the newest sticks; zero before the first.
    pub fn sticks_latency(&self) -> SpanNs {
        SpanNs(self.sticks_latency_ns.load(Ordering::Relaxed))
    }

    fn note_sticks_latency(&self, latency: SpanNs) {
        self.sticks_latency_ns.store(latency.0, Ordering::Relaxed);
    }

    /// The longest time for which the sender stood still while the drone may have been in the air, 40 ms
    /// of rest between two turns included.
    pub fn longest_pause(&self) -> SpanNs {
        SpanNs(self.pause_ns.load(Ordering::Relaxed))
    }

    fn note_pause(&self, pause: Option<SpanNs>) {
        self.pause_ns.fetch_max(pause.map_or(0, |pause| pause.0), Ordering::Relaxed);
    }

    /// Whether the drone was landed without the control thread: because that was silent, or because this
    /// program stood still.
    pub fn has_landed_unasked(&self) -> bool {
        self.watchdog_landings.get() > 0 || self.guardian_landings.get() > 0
    }

    /// Whether the guardian has ended or does not answer: the drone is landed then, too.
    pub fn has_lost_guardian(&self) -> bool {
        self.guardians_lost.get() > 0
    }

    /// The answers that have arrived so far.
    pub fn facts(&self) -> DroneFacts {
        *self.facts.lock()
    }

    /// Text of the newest refusal, at most 80 characters; text SDK only; `None` before the first.
    pub fn refusal(&self) -> Option<String> {
        self.refusal.lock().clone()
    }

    fn note_refusal(&self, text: &[u8]) {
        let text = String::from_utf8_lossy(text).trim().chars().take(REFUSAL_CHARS).collect();
        self.refusals.count();
        *self.refusal.lock() = Some(text);
    }

    fn note(&self, answer: Answer) {
        let mut facts = self.facts.lock();
        match answer {
            Answer::Version(version) => facts.version = Some(version),
            Answer::AltitudeLimit(limit_m) => facts.altitude_limit_m = Some(limit_m),
            Answer::BatteryThreshold(pct) => facts.battery_threshold_pct = Some(pct),
            Answer::TiltLimit(tilt_rad) => facts.tilt_limit_rad = Some(tilt_rad),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(table: &TelloTable) -> Result<TelloSettings, SettingError> {
        TelloSettings::try_from(table)
    }

    pub(super) fn table() -> TelloTable {
        TelloTable {
            protocol: Protocol::Binary,
            address: "192.168.10.1:8889".into(),
            local_port: 0,
            state_port: 8890,
            altitude_limit_m: None,
            interface: None,
        }
    }

    #[test]
    fn link_settings_that_break_a_rule_are_refused_with_key_value_and_rule() {
        assert!(check(&table()).is_ok());
        let error = check(&TelloTable { address: "tello:8889".into(), ..table() }).unwrap_err();
        assert_eq!(
            error.to_string(),
            "address = tello:8889: expected IPv4 address:port of one host"
        );
        for address in ["[::1]:8889", "255.255.255.255:8889", "0.0.0.0:8889", "224.0.0.1:8889"] {
            assert!(
                check(&TelloTable { address: address.into(), ..table() }).is_err(),
                "{address}"
            );
        }
        let error = check(&TelloTable { interface: Some(String::new()), ..table() }).unwrap_err();
        assert_eq!(error.to_string(), "interface = \"\": expected a name or null");
        assert!(check(&TelloTable { altitude_limit_m: Some(0), ..table() }).is_err());
        let text = TelloTable { protocol: Protocol::Text, local_port: 8890, ..table() };
        let error = check(&text).unwrap_err();
        assert_eq!(error.to_string(), "state_port = 8890: expected another port than local_port");
    }

    #[test]
    fn what_may_be_null_may_not_be_missing() {
        let read = |text: &str| serde_json::from_str::<TelloTable>(text);
        let head = r#"{"protocol": "binary", "address": "192.168.10.1:8889", "local_port": 0,
            "state_port": 8890"#;
        let all = format!(r#"{head}, "altitude_limit_m": null, "interface": null}}"#);
        assert_eq!(read(&all).unwrap(), table());
        let error = read(&format!(r#"{head}, "altitude_limit_m": null}}"#)).unwrap_err();
        assert!(error.to_string().contains("missing field `interface`"), "{error}");
        let error = read(&format!(r#"{head}, "interface": null}}"#)).unwrap_err();
        assert!(error.to_string().contains("missing field `altitude_limit_m`"), "{error}");
        let schema = serde_json::to_value(schemars::schema_for!(TelloTable)).unwrap();
        let required = schema["required"].as_array().unwrap();
        assert_eq!(required.len(), schema["properties"].as_object().unwrap().len(), "{schema}");
    }
}
