//! A flight as ROS 2 messages: what each message of a log becomes.
//!
//! Owns names, kinds and contents of the topics. `log ros2` writes them to a file, `fly --ros2` publishes them. They
//! are made from the bytes of the log alone. Frames: `world`, and `tello` in it. Thread in flight: that of the
//! publisher, not the tick's. Allocates.

mod cdr;
mod kind;

use std::path::Path;

use anyhow::Result;
use foxglove::Decode as _;
use foxglove::messages::PosesInFrame;
use horizon_model::rows::pose;
use serde::Deserialize;
use serde_json::{Map, Value};
use strum::VariantArray;
use tello_flight::cycle::{PoseRecord, Topic};
use tello_flight::drone::DroneStatus;
use tello_io::log::{Channel, Ending, LogReader, LogWriter};

use crate::scene;
use cdr::{Cdr, PoseNumbers};
pub use kind::Kind;

/// Frames: the room, and the vehicle in it.
pub(crate) const WORLD: &str = "world";
pub(crate) const VEHICLE: &str = "tello";

/// Levels of a diagnosis.
const OK: u8 = 0;
const WARN: u8 = 1;

/// Of a battery: discharging, in good health, lithium polymer.
const BATTERY_KIND: [u8; 3] = [2, 1, 3];

/// A topic.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, VariantArray)]
pub enum RosTopic {
    /// Estimated pose.
    Pose,
    /// Estimated pose as the frame `tello` in the frame `world`.
    Transform,
    /// Estimated velocity along the axes of the world, of models that have one.
    Velocity,
    /// All numbers of the estimated state, by name.
    State,
    /// Where the mission wants the vehicle to be.
    Reference,
    /// Present target.
    Target,
    /// Predicted poses over the horizon, 10 a second.
    Plan,
    /// Phase and faults.
    Diagnostics,
    /// Charge by the drone's own report.
    Battery,
}

/// A message: its topic and its bytes, CDR with the four bytes that name it.
pub type RosMessage = (RosTopic, Vec<u8>);

impl RosTopic {
    /// Every message, in the order of the documentation.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// Name of the topic.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Pose => "/tello/pose",
            Self::Transform => "/tf",
            Self::Velocity => "/tello/velocity",
            Self::State => "/tello/state",
            Self::Reference => "/tello/reference",
            Self::Target => "/tello/target",
            Self::Plan => "/tello/plan",
            Self::Diagnostics => "/diagnostics",
            Self::Battery => "/tello/battery",
        }
    }

    /// Kind of its messages.
    pub const fn kind(self) -> Kind {
        match self {
            Self::Pose | Self::Reference | Self::Target => Kind::Pose,
            Self::Transform => Kind::Transform,
            Self::Velocity => Kind::Twist,
            Self::State => Kind::Numbers,
            Self::Plan => Kind::Path,
            Self::Diagnostics => Kind::Diagnostics,
            Self::Battery => Kind::Battery,
        }
    }

    /// The topic as a channel of a log.
    pub fn channel(self) -> Channel {
        Channel {
            topic: self.name(),
            schema_name: self.kind().name(),
            schema: self.kind().schema(),
        }
    }
}

/// Channels of a log that have messages.
pub fn sources() -> [&'static str; 7] {
    [
        Topic::State.name(),
        Topic::Reference.name(),
        Topic::Target.name(),
        Topic::Phase.name(),
        Topic::Fault.name(),
        Topic::Inbox.name(),
        scene::PLAN,
    ]
}

/// Phase and faults by their names, which may be those of another version.
#[derive(Deserialize)]
struct PhaseName {
    phase: String,
}

#[derive(Deserialize)]
struct FaultNames {
    faults: Vec<String>,
}

/// Field of an inbox that is published.
#[derive(Deserialize)]
struct DroneOnly {
    drone: Option<DroneStatus>,
}

/// The messages that the message `data` of the log's channel `topic` becomes, stamped `stamp_ns` after 1970.
///
/// # Errors
/// It is not of the channel's form.
pub fn messages(topic: &str, stamp_ns: u64, data: &[u8]) -> Result<Vec<RosMessage>> {
    if topic == scene::PLAN {
        return Ok(vec![(RosTopic::Plan, path(stamp_ns, &PosesInFrame::decode(data)?))]);
    }
    Ok(match Topic::named(topic) {
        Some(Topic::State) => of_state(stamp_ns, &serde_json::from_slice(data)?),
        Some(Topic::Reference) => {
            vec![(RosTopic::Reference, pose_stamped(stamp_ns, &record_place(data)?))]
        }
        Some(Topic::Target) => {
            vec![(RosTopic::Target, pose_stamped(stamp_ns, &record_place(data)?))]
        }
        Some(Topic::Phase) => {
            let PhaseName { phase } = serde_json::from_slice(data)?;
            vec![(RosTopic::Diagnostics, diagnosis(stamp_ns, OK, "phase", &phase))]
        }
        Some(Topic::Fault) => {
            let FaultNames { faults } = serde_json::from_slice(data)?;
            vec![(RosTopic::Diagnostics, diagnosis(stamp_ns, WARN, "faults", &faults.join(", ")))]
        }
        Some(Topic::Inbox) => match serde_json::from_slice(data)? {
            DroneOnly { drone: Some(status) } => {
                vec![(RosTopic::Battery, battery(stamp_ns, &status))]
            }
            DroneOnly { drone: None } => Vec::new(),
        },
        _ => Vec::new(),
    })
}

/// How a log ended that was written as ROS 2 messages, and how many messages each topic has.
#[derive(Debug)]
pub struct Exported {
    /// Topics that have messages.
    pub messages: Vec<(&'static str, u64)>,
    /// How the log ends.
    pub ending: Option<Ending>,
}

/// Writes the flight of the log `from` as ROS 2 messages to the new MCAP file `to`.
///
/// # Errors
/// A log that cannot be read, a record of another shape, a file that cannot be written.
pub fn export(from: &Path, to: &Path) -> Result<Exported> {
    let mut log = LogReader::open(from)?.select(&sources());
    let started_unix_ns = log.head().started_unix_ns;
    let channels: Vec<_> = RosTopic::ALL.iter().copied().map(RosTopic::channel).collect();
    let mut out = LogWriter::create_ros2(to, log.head(), &channels)?;
    let mut counts: Vec<_> = RosTopic::ALL.iter().map(|topic| (topic.name(), 0)).collect();
    while let Some(message) = log.next_message()? {
        let stamp_ns = started_unix_ns.saturating_add_signed(message.t.0);
        // The plan of older logs is not there, nor is their scene in this form.
        for (topic, bytes) in messages(message.topic, stamp_ns, message.data)? {
            out.write_bytes(topic.name(), message.t, &bytes)?;
            for (name, count) in &mut counts {
                *count += u64::from(*name == topic.name());
            }
        }
    }
    out.finish()?;
    let messages = counts.into_iter().filter(|(_, count)| *count > 0).collect();
    Ok(Exported { messages, ending: log.ending().cloned() })
}

/// Numbers with their names. A missing number is NaN.
pub(crate) fn numbers(stamp_ns: u64, names: &[impl AsRef<str>], values: &[f64]) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, "");
    cdr.count(names.len());
    for name in names {
        cdr.text(name.as_ref());
    }
    cdr.doubles(values);
    cdr.count(0);
    cdr.count(0);
    cdr.into_bytes()
}

/// Position, and the turn by theta about z.
pub(crate) fn place([x, y, z, theta]: [f64; 4]) -> PoseNumbers {
    let (sin, cos) = (0.5 * theta).sin_cos();
    ([x, y, z], [0.0, 0.0, sin, cos])
}

fn of_state(stamp_ns: u64, record: &Map<String, Value>) -> Vec<RosMessage> {
    let row = |name: &str| record.get(name).and_then(Value::as_f64);
    let mut messages = Vec::with_capacity(4);
    if let (Some(x), Some(y), Some(z), Some(theta)) = (row("x"), row("y"), row("z"), row("theta")) {
        let place = place([x, y, z, theta]);
        messages.push((RosTopic::Pose, pose_stamped(stamp_ns, &place)));
        messages.push((RosTopic::Transform, transform(stamp_ns, &place)));
    }
    let velocity = |axis: &str| Some(row(&format!("v_{axis}"))? + row(&format!("d_{axis}"))?);
    if let (Some(x), Some(y), Some(z)) = (velocity("x"), velocity("y"), velocity("z")) {
        let mut cdr = Cdr::with_header(stamp_ns, WORLD);
        for value in [x, y, z, 0.0, 0.0, row("omega").unwrap_or(f64::NAN)] {
            cdr.double(value);
        }
        messages.push((RosTopic::Velocity, cdr.into_bytes()));
    }
    let (names, values): (Vec<&str>, Vec<f64>) = record
        .iter()
        .filter(|(name, _)| *name != "step")
        .filter_map(|(name, value)| Some((name.as_str(), value.as_f64()?)))
        .unzip();
    messages.push((RosTopic::State, numbers(stamp_ns, &names, &values)));
    messages
}

fn record_place(data: &[u8]) -> Result<PoseNumbers, serde_json::Error> {
    let at = serde_json::from_slice::<PoseRecord>(data)?.pose();
    Ok(place([at[pose::X], at[pose::Y], at[pose::Z], at[pose::THETA]]))
}

fn pose_stamped(stamp_ns: u64, place: &PoseNumbers) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, WORLD);
    cdr.place(place);
    cdr.into_bytes()
}

fn transform(stamp_ns: u64, place: &PoseNumbers) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.count(1);
    cdr.header(stamp_ns, WORLD);
    cdr.text(VEHICLE);
    cdr.place(place);
    cdr.into_bytes()
}

fn path(stamp_ns: u64, plan: &PosesInFrame) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, WORLD);
    cdr.count(plan.poses.len());
    for pose in &plan.poses {
        cdr.header(stamp_ns, WORLD);
        let at = pose.position.unwrap_or_default();
        let turn = pose.orientation.unwrap_or_default();
        cdr.place(&([at.x, at.y, at.z], [turn.x, turn.y, turn.z, turn.w]));
    }
    cdr.into_bytes()
}

fn diagnosis(stamp_ns: u64, level: u8, name: &str, message: &str) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, "");
    cdr.count(1);
    cdr.byte(level);
    cdr.text(name);
    cdr.text(message);
    cdr.text(VEHICLE);
    cdr.count(0);
    cdr.into_bytes()
}

fn battery(stamp_ns: u64, status: &DroneStatus) -> Vec<u8> {
    let mut cdr = Cdr::with_header(stamp_ns, "");
    #[expect(clippy::cast_possible_truncation, reason = "the message has single precision")]
    cdr.single(status.battery_v.map_or(f32::NAN, |battery_v| battery_v as f32));
    // Temperature, current, charge and capacities are not known.
    for _ in 0..5 {
        cdr.single(f32::NAN);
    }
    cdr.single(f32::from(status.battery_pct) * 1e-2);
    for value in BATTERY_KIND {
        cdr.byte(value);
    }
    // `present` of sensor_msgs/BatteryState: an answer came from it.
    cdr.byte(1);
    cdr.count(0);
    cdr.count(0);
    cdr.text("");
    cdr.text("");
    cdr.into_bytes()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_and_texts_end_with_zero() {
        let bytes = numbers(3_000_000_004, &["x", "y"], &[1.0, -2.5]);
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

    #[test]
    fn half_a_turn_is_the_quaternion_about_z() {
        let (_, [x, y, z, w]) = place([0.0, 0.0, 0.0, std::f64::consts::PI]);
        assert!(x.abs() + y.abs() + w.abs() < 1e-12 && (z - 1.0).abs() < 1e-12, "{x} {y} {z} {w}");
    }

    #[test]
    fn the_voltage_of_an_older_log_is_that_of_this_one() {
        let single = |battery: &str| {
            let inbox = format!(
                r#"{{"drone":{{"received_at":5,"is_flying":true,"is_on_ground":false,"takes_sticks":true,"battery_pct":80,{battery}}}}}"#
            );
            let made = messages(Topic::Inbox.name(), 0, inbox.as_bytes()).unwrap();
            assert_eq!(made[0].0, RosTopic::Battery);
            // Behind the header of the bytes, a time and an empty frame.
            made[0].1[20..24].to_vec()
        };
        assert_eq!(single(r#""battery_v":3.95"#), 3.95_f32.to_le_bytes());
        assert_eq!(single(r#""battery_mv":3950"#), 3.95_f32.to_le_bytes());
    }

    #[test]
    fn phases_and_faults_of_another_version_keep_their_names() {
        for (topic, name, json) in [
            (Topic::Phase, "phase_to_come", r#"{"phase":"phase_to_come"}"#),
            (Topic::Fault, "fault_to_come", r#"{"faults":["fault_to_come"]}"#),
        ] {
            let made = messages(topic.name(), 0, json.as_bytes()).unwrap();
            assert_eq!(made[0].0, RosTopic::Diagnostics);
            let is_there = made[0].1.windows(name.len()).any(|part| part == name.as_bytes());
            assert!(is_there, "{name}");
        }
    }

    #[test]
    fn a_velocity_is_driven_and_disturbance_together() {
        let record = serde_json::json!({
            "step": 7, "x": 1.0, "y": 2.0, "z": 3.0, "theta": 0.0, "omega": 0.25,
            "v_x": 0.5, "v_y": 0.0, "v_z": 0.0, "d_x": -0.125, "d_y": 0.0, "d_z": 0.0
        });
        let made = messages(Topic::State.name(), 0, record.to_string().as_bytes()).unwrap();
        let topics: Vec<RosTopic> = made.iter().map(|(topic, _)| *topic).collect();
        let all = [RosTopic::Pose, RosTopic::Transform, RosTopic::Velocity, RosTopic::State];
        assert_eq!(topics, all);
        let twist = &made[2].1;
        let first = twist.len() - 6 * 8;
        assert_eq!(twist[first..first + 8], 0.375_f64.to_le_bytes());
        assert_eq!(twist[first + 40..], 0.25_f64.to_le_bytes());
    }
}
