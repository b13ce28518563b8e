//! Packets from the drone to the host.

#![deny(clippy::indexing_slicing)]

use tello_flight::drone::V_PER_MV;

use super::{
    Action, Answer, Frame, PacketError, Query, Setting, flight_log, from_tenths, id,
    write_any_frame, write_frame,
};

const CONN_ACK: &[u8; 9] = b"conn_ack:";

/// Type bytes: bit 7 from the drone, then the type of the message.
const KIND_STATUS: u8 = 0x88;
const KIND_REQUEST: u8 = 0x90;
const KIND_REPLY: u8 = 0xB0;

/// Bits of [`FlightStatus::flags`].
const FLYING: u8 = 1 << 0;
const ON_GROUND: u8 = 1 << 1;
/// Bit of [`FlightStatus::flags`]: the motors run.
pub const MOTORS_ON: u8 = 1 << 2;
const HOVERING: u8 = 1 << 3;
const BATTERY_LOW: u8 = 1 << 5;
const BATTERY_CRITICAL: u8 = 1 << 6;

/// A datagram from the drone.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DronePacket {
    /// Answer to a request for a connection.
    ConnAck {
        /// The video port that was asked for.
        video_port: u16,
    },
    /// About 10 per second.
    Status {
        /// Running number.
        sequence: u16,
        /// Its content.
        status: FlightStatus,
    },
    /// Answer to an action, with the action's sequence number.
    Ack {
        /// The action that was accepted.
        action: Action,
        /// Its number.
        sequence: u16,
    },
    /// Answer to a setting, with its sequence number.
    SettingAck {
        /// Setting that was set.
        setting: Setting,
        /// Its number.
        sequence: u16,
    },
    /// Answer to a query, with its sequence number.
    Answer {
        /// Its number.
        sequence: u16,
        /// Its content.
        answer: Answer,
    },
    /// Asks for the host's date and time.
    DateTimeRequest {
        /// Running number.
        sequence: u16,
    },
    /// Start of the drone's log, to be acknowledged.
    LogHeader {
        /// Running number.
        sequence: u16,
        /// Number of the header.
        header_id: u16,
    },
    /// The inertial measurement unit in the drone's log. The layout is that of other clients, not verified.
    LogData {
        /// Running number.
        sequence: u16,
        /// Counter of the drone's clock, about 2.344 MHz.
        tick: u32,
        /// Heading since power-up, clockwise from above; -pi..=pi if it was read. rad
        yaw_rad: f64,
    },
    /// Quality of the radio link.
    WifiStrength {
        /// Running number.
        sequence: u16,
        /// %, 0..=100
        strength_pct: u8,
        /// Disturbance, unit unknown.
        disturbance: u8,
    },
}

impl DronePacket {
    /// Writes the datagram over the content of `to`.
    pub fn encode(&self, to: &mut Vec<u8>) {
        match *self {
            Self::ConnAck { video_port } => {
                to.clear();
                to.extend_from_slice(CONN_ACK);
                to.extend_from_slice(&video_port.to_le_bytes());
            }
            Self::Status { sequence, ref status } => {
                write_frame(KIND_STATUS, id::FLIGHT_STATUS, sequence, &status.to_bytes(), to);
            }
            Self::Ack { action, sequence } => {
                write_frame(KIND_REPLY, action.id(), sequence, &[0], to);
            }
            Self::SettingAck { setting: Setting::AltitudeLimit, sequence } => {
                write_frame(KIND_REPLY, id::ALTITUDE_LIMIT, sequence, &[0], to);
            }
            Self::Answer { sequence, ref answer } => {
                let id = answer.query().id();
                write_any_frame(KIND_REPLY, id, sequence, &answer.payload(), to);
            }
            Self::DateTimeRequest { sequence } => {
                write_frame(KIND_REQUEST, id::DATE_TIME, sequence, &[0, 0], to);
            }
            Self::LogHeader { sequence, header_id } => {
                let [low, high] = header_id.to_le_bytes();
                write_frame(KIND_STATUS, id::LOG_HEADER, sequence, &[low, high, 0, 0, 0, 0], to);
            }
            Self::LogData { sequence, tick, yaw_rad } => {
                let payload = flight_log::imu_payload(tick, yaw_rad);
                write_frame(KIND_STATUS, id::LOG_DATA, sequence, &payload, to);
            }
            Self::WifiStrength { sequence, strength_pct, disturbance } => {
                let payload = [strength_pct, disturbance];
                write_frame(KIND_STATUS, id::WIFI_STRENGTH, sequence, &payload, to);
            }
        }
    }

    /// The packet in a datagram of a drone.
    ///
    /// # Errors
    /// The datagram is damaged, of another protocol, or a message that is not read.
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        if let Some(&[low, high]) = datagram.strip_prefix(CONN_ACK) {
            return Ok(Self::ConnAck { video_port: u16::from_le_bytes([low, high]) });
        }
        let frame = Frame::parse(datagram)?;
        let sequence = frame.sequence;
        match (frame.id, frame.payload) {
            (id::FLIGHT_STATUS, payload) => FlightStatus::from_bytes(payload)
                .map(|status| Self::Status { sequence, status })
                .ok_or(frame.misfit()),
            (id::TAKE_OFF, _) => Ok(Self::Ack { action: Action::TakeOff, sequence }),
            (id::LAND, _) => Ok(Self::Ack { action: Action::Land, sequence }),
            (id::ALTITUDE_LIMIT, _) => {
                Ok(Self::SettingAck { setting: Setting::AltitudeLimit, sequence })
            }
            (id::DATE_TIME, _) => Ok(Self::DateTimeRequest { sequence }),
            (id::LOG_HEADER, &[low, high, ..]) => {
                Ok(Self::LogHeader { sequence, header_id: u16::from_le_bytes([low, high]) })
            }
            (id::WIFI_STRENGTH, &[strength_pct, disturbance]) => {
                Ok(Self::WifiStrength { sequence, strength_pct, disturbance })
            }
            // A log has records of many kinds: one without heading is no damage.
            (id::LOG_DATA, payload) => flight_log::imu_heading(payload)
                .map(|(tick, yaw_rad)| Self::LogData { sequence, tick, yaw_rad })
                .ok_or(PacketError::Unread { id: frame.id }),
            (id::LOG_HEADER | id::WIFI_STRENGTH, _) => Err(frame.misfit()),
            // An answer of another firmware may be laid out otherwise: it is no damage.
            (id, payload) => Query::of_id(id)
                .and_then(|query| query.answer(payload))
                .map(|answer| Self::Answer { sequence, answer })
                .ok_or(PacketError::Unread { id }),
        }
    }
}

/// Flight status as sent, in the units of the wire; faults, calibration, camera, motors and sensors are not read and
/// sent as 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct FlightStatus {
    /// Height. dm; low by an offset that differs from flight to flight
    pub height_dm: i16,
    /// Speed that the drone calls north. dm/s
    pub vel_north_dm_s: i16,
    /// Speed that the drone calls east. dm/s
    pub vel_east_dm_s: i16,
    /// Speed downwards. dm/s
    pub vel_down_dm_s: i16,
    /// Time in the air. 0.1 s
    pub fly_time_ds: i16,
    /// Charge. %
    pub battery_pct: u8,
    /// Flight time left. 0.1 s
    pub time_left_ds: i16,
    /// Battery voltage. mV
    pub battery_mv: i16,
    /// Bits that the methods of this type read.
    pub flags: u8,
    /// 1 landed, 6 flying; others are undocumented.
    pub flight_mode: u8,
}

impl FlightStatus {
    const BYTES: usize = 24;

    /// A status whose flags report that the drone flies, or that it stands on the ground.
    pub fn new(is_flying: bool) -> Self {
        let (flags, flight_mode) =
            if is_flying { (FLYING | MOTORS_ON | HOVERING, 6) } else { (ON_GROUND, 1) };
        Self { flags, flight_mode, ..Self::default() }
    }

    /// Whether the drone reports that it is in the air.
    pub fn is_flying(&self) -> bool {
        self.flags & FLYING != 0
    }

    /// Whether the drone reports that it stands on the ground.
    pub fn is_on_ground(&self) -> bool {
        self.flags & ON_GROUND != 0
    }

    /// Height, low by an offset that differs from flight to flight. m
    pub fn height_m(&self) -> f64 {
        from_tenths(self.height_dm)
    }

    /// Velocity: north, east, down by their names. m/s
    pub fn velocity_d_mps(&self) -> [f64; 3] {
        [self.vel_north_dm_s, self.vel_east_dm_s, self.vel_down_dm_s].map(from_tenths)
    }

    /// Battery voltage. V
    pub fn battery_v(&self) -> f64 {
        f64::from(self.battery_mv) * V_PER_MV
    }

    /// This status with these judgements of the drone on its charge.
    #[must_use]
    pub fn with_battery(mut self, is_low: bool, is_critical: bool) -> Self {
        for (bit, is_set) in [(BATTERY_LOW, is_low), (BATTERY_CRITICAL, is_critical)] {
            self.flags = if is_set { self.flags | bit } else { self.flags & !bit };
        }
        self
    }

    /// Low or critical charge, by the drone's own thresholds.
    pub fn is_battery_low(&self) -> bool {
        self.flags & (BATTERY_LOW | BATTERY_CRITICAL) != 0
    }

    /// Critical charge, by the drone's own threshold.
    pub fn is_battery_critical(&self) -> bool {
        self.flags & BATTERY_CRITICAL != 0
    }

    fn from_bytes(payload: &[u8]) -> Option<Self> {
        let b: &[u8; Self::BYTES] = payload.try_into().ok()?;
        Some(Self {
            height_dm: i16::from_le_bytes([b[0], b[1]]),
            vel_north_dm_s: i16::from_le_bytes([b[2], b[3]]),
            vel_east_dm_s: i16::from_le_bytes([b[4], b[5]]),
            vel_down_dm_s: i16::from_le_bytes([b[6], b[7]]),
            fly_time_ds: i16::from_le_bytes([b[8], b[9]]),
            battery_pct: b[12],
            time_left_ds: i16::from_le_bytes([b[13], b[14]]),
            battery_mv: i16::from_le_bytes([b[15], b[16]]),
            flags: b[17],
            flight_mode: b[18],
        })
    }

    fn to_bytes(self) -> [u8; Self::BYTES] {
        let mut b = [0; Self::BYTES];
        b[0..2].copy_from_slice(&self.height_dm.to_le_bytes());
        b[2..4].copy_from_slice(&self.vel_north_dm_s.to_le_bytes());
        b[4..6].copy_from_slice(&self.vel_east_dm_s.to_le_bytes());
        b[6..8].copy_from_slice(&self.vel_down_dm_s.to_le_bytes());
        b[8..10].copy_from_slice(&self.fly_time_ds.to_le_bytes());
        b[12] = self.battery_pct;
        b[13..15].copy_from_slice(&self.time_left_ds.to_le_bytes());
        b[15..17].copy_from_slice(&self.battery_mv.to_le_bytes());
        b[17] = self.flags;
        b[18] = self.flight_mode;
        b
    }
}

#[cfg(test)]
mod tests;
