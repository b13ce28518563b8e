//! A log's poses as ROS 2 messages, for programs that read no JSON: Rerun, `rosbags`, ROS itself.
//!
//! Owns the wire form (CDR, little-endian) and the message definitions. Poses and transforms are taken from the
//! channels that viewers get (`/scene/pose`, `/scene/transform`), numbers from the estimated state.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

use mcap::records::MessageHeader;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::writer::{chunked, write_error};
use super::{Ending, LogError, LogReader};

/// Channels that are read.
const POSE: &str = "/scene/pose";
const TRANSFORM: &str = "/scene/transform";
const STATE: &str = "/estim/state";

const RULE: &str =
    "================================================================================\n";
const TIME: &str = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const HEADER: &str = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n";
const QUATERNION: &str =
    "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

#[derive(Deserialize)]
struct Stamp {
    sec: u32,
    nsec: u32,
}

#[derive(Deserialize)]
struct Vector {
    x: f64,
    y: f64,
    z: f64,
}

#[derive(Deserialize)]
struct Quaternion {
    x: f64,
    y: f64,
    z: f64,
    w: f64,
}

#[derive(Deserialize)]
struct Pose {
    position: Vector,
    orientation: Quaternion,
}

#[derive(Deserialize)]
struct PoseInFrame {
    timestamp: Stamp,
    frame_id: String,
    pose: Pose,
}

#[derive(Deserialize)]
struct Transform {
    timestamp: Stamp,
    parent_frame_id: String,
    child_frame_id: String,
    translation: Vector,
    rotation: Quaternion,
}

/// What was written.
#[derive(Debug)]
pub struct Exported {
    /// Messages of each channel.
    pub messages: BTreeMap<&'static str, u64>,
    /// How the log ends.
    pub ending: Option<Ending>,
}

/// Writes the poses of the log `file` to the new MCAP file `to`.
///
/// # Errors
/// A log that cannot be read, a record of another shape, a file that cannot be written.
pub fn export_ros2(file: &Path, to: &Path) -> Result<Exported, LogError> {
    let mut log = LogReader::open(file)?.select(&[POSE, TRANSFORM, STATE]);
    let started_unix_ns = log.head().started_unix_ns;
    let create = |source| LogError::Create { path: to.to_owned(), source };
    let sink = BufWriter::new(File::create_new(to).map_err(create)?);
    let failed = |error| write_error(to, error);
    let mut out = chunked().profile("ros2").create(sink).map_err(failed)?;
    let mut ids: BTreeMap<&'static str, u16> = BTreeMap::new();
    let mut messages: BTreeMap<&'static str, u64> = BTreeMap::new();
    while let Some(message) = log.next_message()? {
        let log_time = started_unix_ns.saturating_add_signed(message.t.0);
        let encoded = match message.topic {
            POSE => ("/pose", Kind::Pose, pose(&message.decode()?)),
            TRANSFORM => ("/tf", Kind::Transform, transform(&message.decode()?)),
            _ => (STATE, Kind::Numbers, numbers(log_time, &message.decode()?)),
        };
        let (topic, kind, bytes) = encoded;
        let id = if let Some(id) = ids.get(topic) {
            *id
        } else {
            let (name, definition) = kind.definition();
            let qos = BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())]);
            let id = out
                .add_schema(name, "ros2msg", definition.as_bytes())
                .and_then(|schema| out.add_channel(schema, topic, "cdr", &qos))
                .map_err(failed)?;
            ids.insert(topic, id);
            id
        };
        let header =
            MessageHeader { channel_id: id, sequence: 0, log_time, publish_time: log_time };
        out.write_to_known_channel(&header, &bytes).map_err(failed)?;
        *messages.entry(topic).or_default() += 1;
    }
    out.finish().map_err(failed)?;
    Ok(Exported { messages, ending: log.ending().cloned() })
}

/// Kinds of messages.
#[derive(Clone, Copy)]
enum Kind {
    Pose,
    Transform,
    Numbers,
}

impl Kind {
    /// Name and definition, with those of all parts.
    fn definition(self) -> (&'static str, String) {
        let join = |parts: &[&str]| parts.join(RULE);
        match self {
            Self::Pose => (
                "geometry_msgs/msg/PoseStamped",
                join(&[
                    "std_msgs/Header header\ngeometry_msgs/Pose pose\n",
                    HEADER,
                    TIME,
                    "MSG: geometry_msgs/Pose\ngeometry_msgs/Point position\n\
                     geometry_msgs/Quaternion orientation\n",
                    "MSG: geometry_msgs/Point\nfloat64 x\nfloat64 y\nfloat64 z\n",
                    QUATERNION,
                ]),
            ),
            Self::Transform => (
                "tf2_msgs/msg/TFMessage",
                join(&[
                    "geometry_msgs/TransformStamped[] transforms\n",
                    "MSG: geometry_msgs/TransformStamped\nstd_msgs/Header header\n\
                     string child_frame_id\ngeometry_msgs/Transform transform\n",
                    HEADER,
                    TIME,
                    "MSG: geometry_msgs/Transform\ngeometry_msgs/Vector3 translation\n\
                     geometry_msgs/Quaternion rotation\n",
                    "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n",
                    QUATERNION,
                ]),
            ),
            Self::Numbers => (
                "sensor_msgs/msg/JointState",
                join(&[
                    "std_msgs/Header header\nstring[] name\nfloat64[] position\n\
                     float64[] velocity\nfloat64[] effort\n",
                    HEADER,
                    TIME,
                ]),
            ),
        }
    }
}

fn pose(PoseInFrame { timestamp, frame_id, pose }: &PoseInFrame) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.header(timestamp, frame_id);
    cdr.vector(&pose.position);
    cdr.quaternion(&pose.orientation);
    cdr.bytes
}

fn transform(transform: &Transform) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.uint(1);
    cdr.header(&transform.timestamp, &transform.parent_frame_id);
    cdr.text(&transform.child_frame_id);
    cdr.vector(&transform.translation);
    cdr.quaternion(&transform.rotation);
    cdr.bytes
}

/// The numbers of a record with their names: of all common messages, only this one has names, and viewers plot it.
fn numbers(log_time_ns: u64, record: &Map<String, Value>) -> Vec<u8> {
    let count = |length: usize| u32::try_from(length).unwrap_or(u32::MAX);
    let numbers: Vec<(&String, f64)> =
        record.iter().filter_map(|(name, value)| Some((name, value.as_f64()?))).collect();
    let mut cdr = Cdr::new();
    let (sec, nsec) = (log_time_ns / 1_000_000_000, log_time_ns % 1_000_000_000);
    let stamp = Stamp {
        sec: u32::try_from(sec).unwrap_or(u32::MAX),
        nsec: u32::try_from(nsec).unwrap_or(0),
    };
    cdr.header(&stamp, "");
    cdr.uint(count(numbers.len()));
    for (name, _) in &numbers {
        cdr.text(name);
    }
    cdr.uint(count(numbers.len()));
    for (_, value) in &numbers {
        cdr.float(*value);
    }
    cdr.uint(0);
    cdr.uint(0);
    cdr.bytes
}

/// Common Data Representation, little-endian: numbers are aligned to their size, counted behind the first 4 bytes.
struct Cdr {
    bytes: Vec<u8>,
}

impl Cdr {
    fn new() -> Self {
        Self { bytes: vec![0, 1, 0, 0] }
    }

    fn align(&mut self, size: usize) {
        let length = (self.bytes.len() - 4).next_multiple_of(size) + 4;
        self.bytes.resize(length, 0);
    }

    fn uint(&mut self, value: u32) {
        self.align(4);
        self.bytes.extend(value.to_le_bytes());
    }

    fn float(&mut self, value: f64) {
        self.align(8);
        self.bytes.extend(value.to_le_bytes());
    }

    /// Length with the zero at the end, text, zero.
    fn text(&mut self, text: &str) {
        self.uint(u32::try_from(text.len() + 1).unwrap_or(u32::MAX));
        self.bytes.extend(text.as_bytes());
        self.bytes.push(0);
    }

    fn header(&mut self, stamp: &Stamp, frame_id: &str) {
        self.uint(stamp.sec);
        self.uint(stamp.nsec);
        self.text(frame_id);
    }

    fn vector(&mut self, vector: &Vector) {
        for value in [vector.x, vector.y, vector.z] {
            self.float(value);
        }
    }

    fn quaternion(&mut self, turn: &Quaternion) {
        for value in [turn.x, turn.y, turn.z, turn.w] {
            self.float(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_and_texts_end_with_zero() {
        let record = serde_json::json!({ "x": 1.0, "name": "no number", "y": -2.5 });
        let bytes = numbers(3_000_000_004, record.as_object().unwrap());
        let mut expected = vec![0, 1, 0, 0, 3, 0, 0, 0, 4, 0, 0, 0];
        // An empty frame: one byte, its zero; three more up to the next number.
        expected.extend([1, 0, 0, 0, 0, 0, 0, 0]);
        expected.extend([2, 0, 0, 0, 2, 0, 0, 0, b'x', 0, 0, 0, 2, 0, 0, 0, b'y', 0, 0, 0]);
        // Two numbers of 8 bytes, behind their count and 4 bytes; two empty lists.
        expected.extend([2, 0, 0, 0]);
        expected.resize((expected.len() - 4).next_multiple_of(8) + 4, 0);
        expected.extend(1.0_f64.to_le_bytes());
        expected.extend((-2.5_f64).to_le_bytes());
        expected.extend([0; 8]);
        assert_eq!(bytes, expected);
    }
}
