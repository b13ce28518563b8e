//! The Tello's binary protocol: frames, checks and sticks.
//!
//! Pure bytes to values and back, and the only place that knows wire units and wire order. What the
//! host sends is `host`, what the drone sends is `drone`; both are read and written, since the emulator
//! speaks the drone's side. Layouts: `docs/protocol.md`.

#![deny(clippy::indexing_slicing)]

mod drone;
mod flight_log;
mod host;
mod query;

use crc::{Algorithm, Crc};
use horizon_model::rows::{Sticks, stick};
use tello_flight::drone::{M_PER_DM, Protocol};
use thiserror::Error;

pub use drone::{DronePacket, FlightStatus, MOTORS_ON};
pub use host::HostPacket;
pub use query::{Answer, Query, Version};

/// The drone's video is not used, but the handshake names a port for it.
pub const VIDEO_PORT: u16 = 6038;

/// First byte of every frame.
const START: u8 = 0xCC;

/// Bytes of a frame around its payload: 9 of header, 2 of check.
const OVERHEAD_BYTES: usize = 11;

/// Most bytes of a frame: its length field has 13 bits.
const FRAME_BYTES_MAX: usize = (1 << 13) - 1;

/// Largest datagram that either side sends, frame or greeting.
pub const DATAGRAM_BYTES_MAX: usize = FRAME_BYTES_MAX;

const CRC_8: Algorithm<u8> = Algorithm {
    width: 8,
    poly: 0x31,
    init: 0xEE,
    refin: true,
    refout: true,
    xorout: 0,
    check: 0xFB,
    residue: 0,
};

const CRC_16: Algorithm<u16> = Algorithm {
    width: 16,
    poly: 0x1021,
    init: 0x496C,
    refin: true,
    refout: true,
    xorout: 0,
    check: 0x7109,
    residue: 0,
};

const HEADER_CHECK: Crc<u8> = Crc::<u8>::new(&CRC_8);
const FRAME_CHECK: Crc<u16> = Crc::<u16>::new(&CRC_16);

/// Message ids.
mod id {
    pub(super) const WIFI_STRENGTH: u16 = 0x001A;
    pub(super) const VERSION: u16 = 0x0045;
    pub(super) const DATE_TIME: u16 = 0x0046;
    pub(super) const STICKS: u16 = 0x0050;
    pub(super) const TAKE_OFF: u16 = 0x0054;
    pub(super) const LAND: u16 = 0x0055;
    pub(super) const FLIGHT_STATUS: u16 = 0x0056;
    pub(super) const ALTITUDE_LIMIT: u16 = 0x0058;
    pub(super) const LOG_HEADER: u16 = 0x1050;
    pub(super) const LOG_DATA: u16 = 0x1051;
    pub(super) const ASK_ALTITUDE_LIMIT: u16 = 0x1056;
    pub(super) const ASK_BATTERY_THRESHOLD: u16 = 0x1057;
    pub(super) const ASK_TILT_LIMIT: u16 = 0x1059;
}

/// Command that changes the phase of a flight and is acknowledged.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// Start the motors and climb to about 1 m.
    TakeOff,
    /// Descend and stop the motors. Any later command cancels it.
    Land,
}

impl Action {
    fn id(self) -> u16 {
        match self {
            Self::TakeOff => id::TAKE_OFF,
            Self::Land => id::LAND,
        }
    }
}

/// Setting of the drone, which the drone confirms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Setting {
    /// Highest altitude.
    AltitudeLimit,
}

/// Why a datagram is not understood.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum PacketError {
    /// Neither a frame nor a greeting, a text reply for instance.
    #[error("a datagram of {length} bytes is no frame of the binary protocol")]
    NotAFrame {
        /// Length of the datagram.
        length: usize,
    },
    /// The header has another length than the frame.
    #[error("a frame of {length} bytes states {stated}")]
    Length {
        /// Length by the header. bytes
        stated: usize,
        /// Length of the datagram.
        length: usize,
    },
    /// A check byte is wrong.
    #[error("the {part} check is wrong")]
    Check {
        /// `header` or `frame`.
        part: &'static str,
    },
    /// A correct frame of a message that is not ours to read.
    #[error("message {id:#06x} is not read")]
    Unread {
        /// Message id.
        id: u16,
    },
    /// A message whose payload is too short or has impossible values.
    #[error("message {id:#06x} does not fit its payload of {length} bytes")]
    Payload {
        /// Message id.
        id: u16,
        /// Length of the payload.
        length: usize,
    },
}

/// One message without its envelope.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Frame<'a> {
    /// Direction and type bits.
    kind: u8,
    id: u16,
    sequence: u16,
    payload: &'a [u8],
}

impl<'a> Frame<'a> {
    /// The message in a datagram that is exactly one frame, both checks verified.
    fn parse(datagram: &'a [u8]) -> Result<Self, PacketError> {
        let length = datagram.len();
        let not_a_frame = PacketError::NotAFrame { length };
        let (body, check) = datagram.split_last_chunk::<2>().ok_or(not_a_frame)?;
        let &[
            START,
            size_low,
            size_high,
            header_check,
            kind,
            id_low,
            id_high,
            low,
            high,
            ref payload @ ..,
        ] = body
        else {
            return Err(not_a_frame);
        };
        if HEADER_CHECK.checksum(&[START, size_low, size_high]) != header_check {
            return Err(PacketError::Check { part: "header" });
        }
        let stated = usize::from(u16::from_le_bytes([size_low, size_high]) >> 3);
        if stated != length {
            return Err(PacketError::Length { stated, length });
        }
        if FRAME_CHECK.checksum(body) != u16::from_le_bytes(*check) {
            return Err(PacketError::Check { part: "frame" });
        }
        let id = u16::from_le_bytes([id_low, id_high]);
        Ok(Self { kind, id, sequence: u16::from_le_bytes([low, high]), payload })
    }

    /// The refusal of this frame's payload.
    fn misfit(&self) -> PacketError {
        PacketError::Payload { id: self.id, length: self.payload.len() }
    }
}

/// Metres, or m/s, of a whole number of tenths: heights and speeds on the wire of both protocols.
pub(super) fn from_tenths(tenths: i16) -> f64 {
    f64::from(tenths) * M_PER_DM
}

/// Writes one frame over the content of `to`.
fn write_frame<const N: usize>(
    kind: u8,
    id: u16,
    sequence: u16,
    payload: &[u8; N],
    to: &mut Vec<u8>,
) {
    const { assert!(N + OVERHEAD_BYTES <= FRAME_BYTES_MAX) };
    write_any_frame(kind, id, sequence, payload, to);
}

/// As [`write_frame`], for a payload of any length that is short enough.
fn write_any_frame(kind: u8, id: u16, sequence: u16, payload: &[u8], to: &mut Vec<u8>) {
    #[expect(clippy::cast_possible_truncation, reason = "callers keep to 13 bits")]
    let size = ((payload.len() + OVERHEAD_BYTES) as u16) << 3;
    let [size_low, size_high] = size.to_le_bytes();
    let header = [START, size_low, size_high];
    to.clear();
    to.extend_from_slice(&header);
    to.push(HEADER_CHECK.checksum(&header));
    to.push(kind);
    to.extend_from_slice(&id.to_le_bytes());
    to.extend_from_slice(&sequence.to_le_bytes());
    to.extend_from_slice(payload);
    to.extend_from_slice(&FRAME_CHECK.checksum(to).to_le_bytes());
}

/// Steps of the wire from neutral to full deflection.
const STEPS_FULL: i16 = Protocol::Binary.stick_steps();

/// Wire value of a stick at rest.
const NEUTRAL: i16 = 1024;

/// Bits of one axis, and where each begins in the 48-bit word.
const AXIS_MASK: u64 = (1 << 11) - 1;
const ROLL_BIT: u32 = 0;
const PITCH_BIT: u32 = 11;
const THROTTLE_BIT: u32 = 22;
const YAW_BIT: u32 = 33;
const FAST_BIT: u32 = 44;

/// Deflection in steps of the wire, limited before it becomes an integer.
fn steps(u: f64) -> i16 {
    #[expect(clippy::cast_possible_truncation, reason = "limited; NaN becomes 0")]
    let steps = (u.clamp(-1.0, 1.0) * f64::from(STEPS_FULL)).round() as i16;
    steps
}

/// The 48-bit word of four axes. The wire counts yaw clockwise, we count it counter-clockwise.
fn stick_word(u: &Sticks, is_fast: bool) -> [u8; 6] {
    let axis = |steps: i16| u64::from((NEUTRAL + steps).unsigned_abs());
    let word = axis(steps(u[stick::ROLL])) << ROLL_BIT
        | axis(steps(u[stick::PITCH])) << PITCH_BIT
        | axis(steps(u[stick::THROTTLE])) << THROTTLE_BIT
        | axis(-steps(u[stick::YAW])) << YAW_BIT
        | u64::from(is_fast) << FAST_BIT;
    let [b0, b1, b2, b3, b4, b5, ..] = word.to_le_bytes();
    [b0, b1, b2, b3, b4, b5]
}

/// Sticks and the fast bit of a 48-bit word; `None` if an axis is beyond its full deflection.
fn sticks_of_word([b0, b1, b2, b3, b4, b5]: [u8; 6]) -> Option<(Sticks, bool)> {
    let word = u64::from_le_bytes([b0, b1, b2, b3, b4, b5, 0, 0]);
    let axis = |bit: u32| {
        let steps = i16::try_from(word >> bit & AXIS_MASK).ok()? - NEUTRAL;
        (steps.abs() <= STEPS_FULL).then(|| f64::from(steps) / f64::from(STEPS_FULL))
    };
    let u = Sticks::new(axis(ROLL_BIT)?, axis(PITCH_BIT)?, -axis(YAW_BIT)?, axis(THROTTLE_BIT)?);
    Some((u, word >> FAST_BIT & 1 == 1))
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
