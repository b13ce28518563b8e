//! Kinds of ROS 2 messages that are written, with their published definitions.

use tello_io::log::Schema;

const RULE: &str =
    "================================================================================\n";
const TIME: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const POINT: &str = "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n";
const QUATERNION: &str =
    "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";
const VECTOR: &str = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";
const POSE: &str = "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\n\
                    geometry_msgs/Quaternion orientation\n";
const POSE_STAMPED: &str = "MSG: geometry_msgs/PoseStamped\nstd_msgs/Header header\n\
                            geometry_msgs/Pose pose\n";
const TRANSFORM: &str = "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\n\
                         geometry_msgs/Quaternion rotation\n";
const TRANSFORM_STAMPED: &str = "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\n\
                                 string child_frame_id\ngeometry_msgs/Transform transform\n";
const TWIST: &str = "MSG: geometry_msgs/Twist\ngeometry_msgs/Vector3 linear\n\
                     geometry_msgs/Vector3 angular\n";
const STATUS: &str = "MSG: diagnostic_msgs/DiagnosticStatus\nbyte OK=0\nbyte WARN=1\nbyte ERROR=2\n\
                      byte STALE=3\nbyte level\nstring name\nstring message\nstring hardware_id\n\
                      diagnostic_msgs/KeyValue[] values\n";
const KEY_VALUE: &str = "MSG: diagnostic_msgs/KeyValue\nstring key\nstring value\n";
const BATTERY: &str = "std_msgs/Header header\nfloat32 voltage\nfloat32 temperature\nfloat32 current\n\
                       float32 charge\nfloat32 capacity\nfloat32 design_capacity\nfloat32 percentage\n\
                       uint8 power_supply_status\nuint8 power_supply_health\n\
                       uint8 power_supply_technology\nbool present\nfloat32[] cell_voltage\n\
                       float32[] cell_temperature\nstring location\nstring serial_number\n";

/// A kind of message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// `geometry_msgs/PoseStamped`
    Pose,
    /// `geometry_msgs/TwistStamped`
    Twist,
    /// `tf2_msgs/TFMessage`
    Transform,
    /// `nav_msgs/Path`
    Path,
    /// `sensor_msgs/JointState`: of all common messages, only this one has names, and viewers plot it.
    Numbers,
    /// `diagnostic_msgs/DiagnosticArray`
    Diagnostics,
    /// `sensor_msgs/BatteryState`
    Battery,
}

impl Kind {
    /// Package, `msg` and name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pose => "geometry_msgs/msg/PoseStamped",
            Self::Twist => "geometry_msgs/msg/TwistStamped",
            Self::Transform => "tf2_msgs/msg/TFMessage",
            Self::Path => "nav_msgs/msg/Path",
            Self::Numbers => "sensor_msgs/msg/JointState",
            Self::Diagnostics => "diagnostic_msgs/msg/DiagnosticArray",
            Self::Battery => "sensor_msgs/msg/BatteryState",
        }
    }

    /// The definition, with those of all its parts.
    pub fn schema(self) -> Schema {
        let (own, parts): (&str, &[&str]) = match self {
            Self::Pose => {
                ("std_msgs/Header header\ngeometry_msgs/Pose pose\n", &[POSE, POINT, QUATERNION])
            }
            Self::Twist => {
                ("std_msgs/Header header\ngeometry_msgs/Twist twist\n", &[TWIST, VECTOR])
            }
            Self::Transform => (
                "geometry_msgs/TransformStamped[] transforms\n",
                &[TRANSFORM_STAMPED, TRANSFORM, VECTOR, QUATERNION],
            ),
            Self::Path => (
                "std_msgs/Header header\ngeometry_msgs/PoseStamped[] poses\n",
                &[POSE_STAMPED, POSE, POINT, QUATERNION],
            ),
            Self::Numbers => (
                "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n\
                 float64[] effort\n",
                &[],
            ),
            Self::Diagnostics => (
                "std_msgs/Header header\ndiagnostic_msgs/DiagnosticStatus[] status\n",
                &[STATUS, KEY_VALUE],
            ),
            Self::Battery => (BATTERY, &[]),
        };
        let mut definition = own.to_owned();
        for part in [HEADER, TIME].iter().chain(parts) {
            definition.push_str(RULE);
            definition.push_str(part);
        }
        Schema::Ros2(definition.into())
    }
}

#[cfg(test)]
mod tests;
