//! Packets from the host to the drone.

#![deny(clippy::indexing_slicing)]

use horizon_model::rows::Sticks;

use super::{Action, Frame, PacketError, Query, id, stick_word, sticks_of_word, write_frame};
use crate::clock::{CivilTime, TimeOfDay};

const CONN_REQ: &[u8; 9] = b"conn_req:";
const EMERGENCY: &[u8] = b"emergency";

/// Type bytes: bit 6 towards the drone, then the type of the message.
const KIND_GET: u8 = 0x48;
const KIND_DATA: u8 = 0x50;
const KIND_STICKS: u8 = 0x60;
const KIND_SET: u8 = 0x68;

/// Payload byte of [`id::LAND`].
const LAND: u8 = 0;
const CANCEL_LANDING: u8 = 1;

/// A datagram from the host.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum HostPacket {
    /// Asks for a connection. The drone answers with [`super::DronePacket::ConnAck`].
    ConnReq {
        /// Where the host would take video.
        video_port: u16,
    },
    /// Stick positions; not answered.
    Sticks {
        /// Each row in [-1, 1], a multiple of 1/660 on the wire.
        u: Sticks,
        /// Faster flight for the same sticks.
        is_fast: bool,
        /// Time of day at the host in UTC, for the drone's log.
        time: TimeOfDay,
    },
    /// Take off or land; answered with the same sequence number.
    Action {
        /// Which.
        action: Action,
        /// Running number.
        sequence: u16,
    },
    /// Stops the motors, whatever the drone does. The text SDK's `emergency`: this protocol has no
    /// message of its own for it and takes this one; it is rarely answered.
    EmergencyStop,
    /// Takes a landing back.
    CancelLanding {
        /// Running number.
        sequence: u16,
    },
    /// Answer to [`super::DronePacket::DateTimeRequest`].
    DateTime {
        /// Running number.
        sequence: u16,
        /// Date and time at the host in UTC.
        time: CivilTime,
    },
    /// Answer to [`super::DronePacket::LogHeader`].
    LogHeaderAck {
        /// Running number.
        sequence: u16,
        /// The header that is acknowledged.
        header_id: u16,
    },
    /// Highest altitude that the drone may fly to.
    AltitudeLimit {
        /// Running number.
        sequence: u16,
        /// m
        limit_m: u16,
    },
    /// Asks for a fact; answered by [`super::DronePacket::Answer`].
    Query {
        /// Running number.
        sequence: u16,
        /// Which.
        query: Query,
    },
}

impl HostPacket {
    /// Writes the datagram over the content of `to`.
    pub fn encode(&self, to: &mut Vec<u8>) {
        match *self {
            Self::ConnReq { video_port } => {
                to.clear();
                to.extend_from_slice(CONN_REQ);
                to.extend_from_slice(&video_port.to_le_bytes());
            }
            Self::Sticks { ref u, is_fast, time } => {
                let [w0, w1, w2, w3, w4, w5] = stick_word(u, is_fast);
                let TimeOfDay { hour, minute, second, millisecond } = time;
                let [ms_low, ms_high] = millisecond.to_le_bytes();
                let payload = [w0, w1, w2, w3, w4, w5, hour, minute, second, ms_low, ms_high];
                write_frame(KIND_STICKS, id::STICKS, 0, &payload, to);
            }
            Self::Action { action: Action::TakeOff, sequence } => {
                write_frame(KIND_SET, id::TAKE_OFF, sequence, &[], to);
            }
            Self::Action { action: Action::Land, sequence } => {
                write_frame(KIND_SET, id::LAND, sequence, &[LAND], to);
            }
            Self::EmergencyStop => {
                to.clear();
                to.extend_from_slice(EMERGENCY);
            }
            Self::CancelLanding { sequence } => {
                write_frame(KIND_SET, id::LAND, sequence, &[CANCEL_LANDING], to);
            }
            Self::DateTime { sequence, time } => {
                write_frame(KIND_DATA, id::DATE_TIME, sequence, &date_time_payload(&time), to);
            }
            Self::LogHeaderAck { sequence, header_id } => {
                let [low, high] = header_id.to_le_bytes();
                write_frame(KIND_DATA, id::LOG_HEADER, sequence, &[0, low, high], to);
            }
            Self::AltitudeLimit { sequence, limit_m } => {
                let payload = limit_m.to_le_bytes();
                write_frame(KIND_SET, id::ALTITUDE_LIMIT, sequence, &payload, to);
            }
            Self::Query { sequence, query } => {
                write_frame(KIND_GET, query.id(), sequence, &[], to);
            }
        }
    }

    /// The packet in a datagram of a host, ours or another program's.
    ///
    /// # Errors
    /// The datagram is damaged, of another protocol, or a message that is not read.
    pub fn decode(datagram: &[u8]) -> Result<Self, PacketError> {
        if let Some(&[low, high]) = datagram.strip_prefix(CONN_REQ) {
            return Ok(Self::ConnReq { video_port: u16::from_le_bytes([low, high]) });
        }
        if datagram.trim_ascii_end() == EMERGENCY {
            return Ok(Self::EmergencyStop);
        }
        let frame = Frame::parse(datagram)?;
        let sequence = frame.sequence;
        match (frame.id, frame.payload) {
            (id::STICKS, payload) => read_sticks(payload).ok_or(frame.misfit()),
            (id::TAKE_OFF, _) => Ok(Self::Action { action: Action::TakeOff, sequence }),
            (id::LAND, &[LAND]) => Ok(Self::Action { action: Action::Land, sequence }),
            (id::LAND, &[CANCEL_LANDING]) => Ok(Self::CancelLanding { sequence }),
            (id::DATE_TIME, payload) => read_date_time(payload)
                .map(|time| Self::DateTime { sequence, time })
                .ok_or(frame.misfit()),
            (id::LOG_HEADER, &[0, low, high]) => {
                Ok(Self::LogHeaderAck { sequence, header_id: u16::from_le_bytes([low, high]) })
            }
            (id::ALTITUDE_LIMIT, &[low, high]) => {
                Ok(Self::AltitudeLimit { sequence, limit_m: u16::from_le_bytes([low, high]) })
            }
            (id::LAND | id::LOG_HEADER | id::ALTITUDE_LIMIT, _) => Err(frame.misfit()),
            (id, payload) => match Query::of_id(id) {
                Some(query) if payload.is_empty() => Ok(Self::Query { sequence, query }),
                Some(_) => Err(frame.misfit()),
                None => Err(PacketError::Unread { id }),
            },
        }
    }
}

/// Sticks with either form of the time: 5 bytes, or five 16-bit numbers with the milliseconds split.
fn read_sticks(payload: &[u8]) -> Option<HostPacket> {
    let (word, time) = payload.split_first_chunk::<6>()?;
    let (u, is_fast) = sticks_of_word(*word)?;
    let (hour, minute, second, ms) = match *time {
        [hour, minute, second, ms_low, ms_high]
        | [hour, 0, minute, 0, second, 0, ms_low, _, ms_high, _] => {
            (hour, minute, second, [ms_low, ms_high])
        }
        _ => return None,
    };
    let time = TimeOfDay { hour, minute, second, millisecond: u16::from_le_bytes(ms) };
    Some(HostPacket::Sticks { u, is_fast, time })
}

/// Zero, then seven 16-bit numbers from the year to the millisecond.
fn date_time_payload(time: &CivilTime) -> [u8; 15] {
    let CivilTime { year, month, day, time: TimeOfDay { hour, minute, second, millisecond } } =
        *time;
    let ([year_low, year_high], [ms_low, ms_high]) =
        (year.to_le_bytes(), millisecond.to_le_bytes());
    [0, year_low, year_high, month, 0, day, 0, hour, 0, minute, 0, second, 0, ms_low, ms_high]
}

fn read_date_time(payload: &[u8]) -> Option<CivilTime> {
    let &[0, year_low, year_high, month, 0, day, 0, hour, 0, minute, 0, second, 0, ms_low, ms_high] =
        payload
    else {
        return None;
    };
    let millisecond = u16::from_le_bytes([ms_low, ms_high]);
    let time = TimeOfDay { hour, minute, second, millisecond };
    Some(CivilTime { year: u16::from_le_bytes([year_low, year_high]), month, day, time })
}

#[cfg(test)]
mod tests;
