//! Report of the motion capture on the vehicle, from any system.

use horizon_model::rows::Pose;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::time::TimeNs;

/// One mocap sample of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sighting {
    /// Frame number of the mocap system.
    pub frame: i64,
    /// When it was measured, as the frame number shows by the source's clock, which is learned on the
    /// ground: [`Sighting::received_at`] less what this frame was slower than the fastest. If its number
    /// does not show it, a time that is too old to be used. Its age counts from here.
    pub measured_at: TimeNs,
    /// When its bytes arrived.
    pub received_at: TimeNs,
    /// Pose in the world frame, heading in [-pi, pi]; `None` if the system does not see the vehicle. m, rad
    #[serde(with = "pose_fields")]
    #[schemars(with = "Option<pose_fields::Fields>")]
    pub pose: Option<Pose>,
}

/// A pose with its rows by name, for logs.
mod pose_fields {
    use horizon_model::rows::{Pose, pose};
    use schemars::JsonSchema;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

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
}
