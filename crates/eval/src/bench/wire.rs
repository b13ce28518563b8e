//! The bytes of the bench: packets to the drone in either protocol, and its reports.
//!
//! Pure. The session of a flight sends packets in its own order alone; the bench needs others.

use horizon_model::rows::Sticks;
use serde::{Serialize, Serializer};
use tello_flight::drone::MOTORS_REST;
use tello_io::clock::{TimeNs, TimeOfDay};
use tello_io::tello::protocol::{
    self, Action, Answer, DronePacket, FlightStatus, HostPacket, MOTORS_ON, Query,
};
use tello_io::tello::text::{self, Command, Field, StateLine};
use tello_io::tello::{Protocol, TOF_FLYING_M};

use crate::display_rounding::to_thousandths;

/// A centimetre of the record. m
const M_PER_CM: f64 = 0.01;

/// A report of the drone.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Status {
    /// Whether the drone reports that it flies.
    pub is_flying: bool,
    /// Flying, or the bit "motors on"; in the text SDK the motors' time grows.
    pub is_running: bool,
    /// Height. m
    pub height_m: Option<f64>,
    /// Velocity, in the axes of the report. m/s
    #[serde(rename = "velocity_mps")]
    pub velocity_d_mps: Option<[f64; 3]>,
    /// Charge. %
    pub battery_pct: Option<f64>,
    /// Heading of the state line, clockwise. rad; in the binary protocol it is in [`BenchEventKind::Heading`]
    #[serde(rename = "yaw_deg")]
    pub yaw: Option<Radians>,
    /// Bits and mode of the binary status.
    flags: Option<(u8, u8)>,
    /// Distance to the floor of the state line.
    #[serde(rename = "tof_cm")]
    tof: Option<Metres>,
    /// Time with motors on of the state line. s
    motor_s: Option<f64>,
}

/// An angle. rad; degrees in the record
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radians(
    /// The angle. rad
    pub f64,
);

/// A distance. m; centimetres in the record
#[derive(Debug, Clone, Copy, PartialEq)]
struct Metres(f64);

impl Serialize for Radians {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        to_thousandths(self.0.to_degrees()).serialize(serializer)
    }
}

impl Serialize for Metres {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        to_thousandths(self.0 / M_PER_CM).serialize(serializer)
    }
}

/// A line of the record.
#[derive(Debug, Clone, Serialize)]
pub struct Event {
    /// Since the beginning of the check. s
    pub t_s: f64,
    /// What happened.
    #[serde(flatten)]
    pub what: BenchEventKind,
}

/// An event of the bench.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BenchEventKind {
    /// A step of the check begins.
    Step(String),
    /// We sent a packet.
    Sent {
        /// Its name.
        packet: &'static str,
        /// Its sequence number, if it has one.
        sequence: Option<u16>,
        /// Its bytes, two digits each.
        bytes: String,
        /// Why it was not sent.
        error: Option<String>,
    },
    /// The drone reported its state.
    Status(Status),
    /// A record of the drone's log: heading, clockwise. rad
    Heading(Radians),
    /// The drone offers its log.
    LogHeader {
        /// Its sequence number.
        sequence: u16,
        /// Number of the header.
        header_id: u16,
    },
    /// The drone acknowledges an order.
    Ack {
        /// Name of the order.
        packet: &'static str,
        /// Sequence number of the order.
        sequence: u16,
    },
    /// The drone answers with the version of its firmware.
    Version {
        /// Sequence number of the question.
        sequence: u16,
        /// The version.
        version: String,
    },
    /// A text of the text SDK.
    Reply(String),
    /// The drone's answer or status at the second socket.
    AtSecond(String),
    /// Bytes of no known meaning, two digits each.
    Other(String),
}

/// A packet to the drone.
#[derive(Debug, Clone, Copy)]
pub enum Packet {
    /// Asks for a connection, or for SDK mode.
    Hello,
    /// Names our port for state lines.
    Ports(u16),
    /// The four channels. 1
    Sticks(Sticks),
    /// Orders a take-off, with this sequence number.
    TakeOff(u16),
    /// Orders a landing, with this sequence number.
    Land(u16),
    /// Stops the motors.
    Emergency,
    /// Asks for the firmware's version, with this sequence number.
    Version(u16),
    /// Asks for the drone's log: sequence and number of its header.
    LogHeaderAck(u16, u16),
}

impl Packet {
    /// Its name and its sequence number in the record.
    pub fn name(self) -> (&'static str, Option<u16>) {
        match self {
            Self::Hello => ("hello", None),
            Self::Ports(_) => ("port", None),
            Self::Sticks(_) => ("sticks", None),
            Self::TakeOff(sequence) => ("take_off", Some(sequence)),
            Self::Land(sequence) => ("land", Some(sequence)),
            Self::Emergency => ("emergency", None),
            Self::Version(sequence) => ("version", Some(sequence)),
            Self::LogHeaderAck(..) => ("log_header", None),
        }
    }

    /// Its bytes in `protocol`; `time` is that of the day, which sticks carry.
    pub fn encode(self, protocol: Protocol, time: TimeOfDay) -> Vec<u8> {
        let mut bytes = Vec::new();
        match protocol {
            Protocol::Binary => match self {
                Self::Hello | Self::Ports(_) => {
                    HostPacket::ConnReq { video_port: protocol::VIDEO_PORT }
                }
                Self::Sticks(u) => HostPacket::Sticks { u, is_fast: false, time },
                Self::TakeOff(sequence) => HostPacket::Action { action: Action::TakeOff, sequence },
                Self::Land(sequence) => HostPacket::Action { action: Action::Land, sequence },
                Self::Emergency => HostPacket::EmergencyStop,
                Self::Version(sequence) => HostPacket::Query { sequence, query: Query::Version },
                Self::LogHeaderAck(sequence, header_id) => {
                    HostPacket::LogHeaderAck { sequence, header_id }
                }
            }
            .encode(&mut bytes),
            Protocol::Text => match self {
                Self::Hello | Self::Version(_) | Self::LogHeaderAck(..) => Command::Enter,
                Self::Ports(state) => Command::Ports { state, video: text::VIDEO_PORT },
                Self::Sticks(u) => Command::Sticks(u),
                Self::TakeOff(_) => Command::TakeOff,
                Self::Land(_) => Command::Land,
                Self::Emergency => Command::EmergencyStop,
            }
            .encode(&mut bytes),
        }
        bytes
    }
}

/// Time with motors on, which only the text SDK reports.
#[derive(Debug, Default)]
pub struct Motor {
    newest_s: Option<f64>,
    grew_at: Option<TimeNs>,
}

impl Motor {
    /// Takes the newest value. Whether the time grew within [`MOTORS_REST`].
    fn grows(&mut self, motor_s: Option<f64>, now: TimeNs) -> bool {
        if let (Some(before_s), Some(motor_s)) = (self.newest_s, motor_s)
            && motor_s > before_s
        {
            self.grew_at = Some(now);
        }
        self.newest_s = motor_s.or(self.newest_s);
        self.grew_at.is_some_and(|at| now.since(at) < MOTORS_REST)
    }
}

/// Meaning of a datagram at the command socket.
pub fn read(bytes: &[u8], protocol: Protocol) -> BenchEventKind {
    match DronePacket::decode(bytes) {
        Ok(DronePacket::Status { status, .. }) => {
            let FlightStatus { flags, flight_mode, .. } = status;
            BenchEventKind::Status(Status {
                is_flying: status.is_flying(),
                is_running: status.is_flying() || flags & MOTORS_ON != 0,
                height_m: Some(status.height_m()),
                velocity_d_mps: Some(status.velocity_d_mps()),
                battery_pct: Some(status.battery_pct.into()),
                yaw: None,
                flags: Some((flags, flight_mode)),
                tof: None,
                motor_s: None,
            })
        }
        Ok(DronePacket::Ack { action, sequence }) => {
            let packet = if action == Action::Land { "land" } else { "take_off" };
            BenchEventKind::Ack { packet, sequence }
        }
        Ok(DronePacket::LogHeader { sequence, header_id }) => {
            BenchEventKind::LogHeader { sequence, header_id }
        }
        Ok(DronePacket::LogData { yaw_rad, .. }) => BenchEventKind::Heading(Radians(yaw_rad)),
        Ok(DronePacket::Answer { sequence, answer: Answer::Version(version) }) => {
            let version = version.to_string();
            BenchEventKind::Version { sequence, version }
        }
        _ => match protocol {
            Protocol::Text if bytes.is_ascii() => {
                BenchEventKind::Reply(String::from_utf8_lossy(bytes).trim().into())
            }
            Protocol::Binary | Protocol::Text => BenchEventKind::Other(hex(bytes)),
        },
    }
}

/// Meaning of a datagram at the state socket: the drone flies high above the floor, and its motors run then, or while
/// their time grows.
pub fn read_state(bytes: &[u8], motor: &mut Motor, now: TimeNs) -> BenchEventKind {
    let Some(line) = StateLine::decode(bytes) else {
        return BenchEventKind::Other(hex(bytes));
    };
    let (tof_m, motor_s) = (line.tof_m(), line.get(Field::Time));
    let is_growing = motor.grows(motor_s, now);
    let is_high = tof_m.is_some_and(|tof_m| TOF_FLYING_M.contains(&tof_m));
    BenchEventKind::Status(Status {
        is_flying: is_high,
        is_running: is_high || is_growing,
        height_m: line.height_m(),
        velocity_d_mps: line.velocity_d_mps(),
        battery_pct: line.get(Field::Bat),
        yaw: line.heading_rad().map(|heading_rad| Radians(-heading_rad)),
        flags: None,
        tof: tof_m.map(Metres),
        motor_s,
    })
}

/// Bytes as two digits each.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |hex, byte| hex + &format!("{byte:02x}"))
}

#[cfg(test)]
mod tests;
