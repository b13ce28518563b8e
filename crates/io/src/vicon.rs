//! The Vicon system, through the thesis' text relay.
//!
//! Owns what a mocap sample is, the settings of the connection and its counters. Bytes are
//! `vicon::relay`, the socket is `vicon::client`. Whether a sample is believed is decided by the
//! filter in `tello-estim`, not here.

mod client;
mod frame_clock;
mod lines;
mod relay;
mod stream;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tello_model::rows::Pose;
use tello_model::setting::SettingError;

pub use client::{ViconClient, ViconFeed};
pub use lines::{LINE_BYTES_MAX, Lines};
pub use relay::{LineError, RelayPose, format_line, parse_line};
pub use stream::RelayStream;

use crate::Counter;
use crate::clock::TimeNs;

/// One mocap sample of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sighting {
    /// Frame number of the mocap system.
    pub frame: i64,
    /// When it was measured, as far as frame number and rate tell: [`Sighting::received_at`] less what
    /// this frame was slower than the fastest of its connection. Its age counts from here.
    pub measured_at: TimeNs,
    /// When its bytes arrived.
    pub received_at: TimeNs,
    /// Pose in the world frame, heading in [-pi, pi]; `None` if the system does not see the vehicle.
    #[serde(with = "pose_fields")]
    #[schemars(with = "Option<pose_fields::Fields>")]
    pub pose: Option<Pose>,
}

/// Where the relay is and what the vehicle is called there, as written in JSON.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ViconTable {
    /// Host and port of the relay, such as `192.168.1.5:51602` or `mocap:51602`.
    pub address: String,
    /// Name of the vehicle in the mocap system. No spaces.
    pub object: String,
}

/// Checked [`ViconTable`].
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ViconSettings {
    address: String,
    object: String,
}

impl TryFrom<&ViconTable> for ViconSettings {
    type Error = SettingError;

    fn try_from(table: &ViconTable) -> Result<Self, SettingError> {
        let ViconTable { address, object } = table;
        let is_address = address
            .rsplit_once(':')
            .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
        if !is_address {
            return Err(SettingError::new("address", address, "host:port"));
        }
        if object.is_empty() || object.contains(char::is_whitespace) {
            return Err(SettingError::new(
                "object",
                format!("{object:?}"),
                "a name without spaces",
            ));
        }
        Ok(Self { address: address.clone(), object: object.clone() })
    }
}

/// What became of the bytes of the relay.
#[derive(Debug, Default)]
pub struct ViconCounters {
    /// Connections made.
    pub connects: Counter,
    /// Complete lines received.
    pub lines: Counter,
    /// Lines that [`parse_line`] refused, and lines longer than [`LINE_BYTES_MAX`].
    pub malformed: Counter,
    /// Lines of another object.
    pub other_object: Counter,
    /// Lines with the frame number of the line before.
    pub repeated: Counter,
    /// Sightings lost because the queue was full.
    pub overflow: Counter,
}

/// A pose with its rows by name, for logs.
mod pose_fields {
    use schemars::JsonSchema;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};
    use tello_model::rows::{Pose, pose};

    #[derive(Serialize, Deserialize, JsonSchema)]
    #[serde(deny_unknown_fields)]
    pub(super) struct Fields {
        /// m
        x: f64,
        /// m
        y: f64,
        /// m
        z: f64,
        /// rad
        theta: f64,
    }

    #[expect(clippy::ref_option, reason = "the signature that serde calls")]
    pub(super) fn serialize<S: Serializer>(o: &Option<Pose>, to: S) -> Result<S::Ok, S::Error> {
        o.map(|o| Fields { x: o[pose::X], y: o[pose::Y], z: o[pose::Z], theta: o[pose::THETA] })
            .serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(
        from: D,
    ) -> Result<Option<Pose>, D::Error> {
        let fields = Option::<Fields>::deserialize(from)?;
        Ok(fields.map(|Fields { x, y, z, theta }| Pose::new(x, y, z, theta)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(address: &str, object: &str) -> Result<ViconSettings, SettingError> {
        ViconSettings::try_from(&ViconTable { address: address.into(), object: object.into() })
    }

    #[test]
    fn a_sighting_survives_json_bit_for_bit() {
        let pose = Some(Pose::new(0.1 + 0.2, -1.0 / 3.0, 1.3, std::f64::consts::PI));
        for pose in [pose, None] {
            let sighting =
                Sighting { frame: -3, measured_at: TimeNs(5), received_at: TimeNs(7), pose };
            let json = serde_json::to_string(&sighting).unwrap();
            assert_eq!(serde_json::from_str::<Sighting>(&json).unwrap(), sighting, "{json}");
        }
    }

    #[test]
    fn a_logged_pose_names_its_rows() {
        let pose = Some(Pose::new(1.0, 2.0, 3.0, 0.5));
        let sighting = Sighting { frame: 1, measured_at: TimeNs(2), received_at: TimeNs(3), pose };
        let expected = serde_json::json!({
            "frame": 1,
            "measured_at": 2,
            "received_at": 3,
            "pose": {"x": 1.0, "y": 2.0, "z": 3.0, "theta": 0.5}
        });
        assert_eq!(serde_json::to_value(sighting).unwrap(), expected);
    }

    #[test]
    fn nonsense_settings_are_refused_with_key_value_and_rule() {
        assert!(check("mocap:51602", "tello").is_ok());
        let error = check("mocap", "tello").unwrap_err();
        assert_eq!(error.to_string(), "address = mocap violates host:port");
        assert!(check(":51602", "tello").is_err());
        assert!(check("mocap:70000", "tello").is_err());
        let error = check("mocap:51602", "my drone").unwrap_err();
        assert_eq!(error.to_string(), "object = \"my drone\" violates a name without spaces");
        assert!(check("mocap:51602", "").is_err());
    }
}
