//! Bodies of objects, to values in SI units.
//!
//! Each function reads one kind of body whole, or says why not. Counts on the wire are never trusted:
//! each element has to be there before the next is read, and nothing is allocated.

#![deny(clippy::indexing_slicing)]

use super::packet::{PacketError, Values};
use crate::mocap::M_PER_MM;

/// Ticks of the frame period in a second.
pub(super) const TICKS_PER_S: f64 = 135e6;

/// Parent of a segment that has none.
pub(super) const NO_PARENT: u32 = 0;

const BOUNDS_BYTES: usize = 6 * size_of::<f32>();

/// A segment of a subject.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Segment {
    /// Identity of the subject.
    pub subject: u32,
    /// Identity of the segment within it.
    pub segment: u32,
}

/// Where a segment is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// x, y, z in the world. m
    pub pos_w: [f64; 3],
    /// Rotation, row by row. 1
    pub matrix: [f64; 9],
}

/// What a client asks of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Request {
    /// One frame.
    Frame,
    /// Every frame from now on.
    EveryFrame,
    /// The next frames, so many.
    NextFrames(u32),
    /// The number, back.
    Ping(u64),
}

/// Calls `on_id` for each identity in the body of an `OBJECT_ENUMS`.
///
/// # Errors
/// The body is shorter or longer than it says, as for every function here; what follows a single number is not read.
pub fn object_enums(body: &[u8], mut on_id: impl FnMut(u32)) -> Result<(), PacketError> {
    let mut values = Values::new(body);
    for _ in 0..values.u32()? {
        on_id(values.u32()?);
    }
    values.end()
}

/// Number of the frame.
///
/// # Errors
/// As [`object_enums`].
pub fn frame_number(body: &[u8]) -> Result<u32, PacketError> {
    let mut values = Values::new(body);
    let number = values.u32()?;
    values.end()?;
    Ok(number)
}

/// Frames per second of a `STREAM_INFO`. Hz, > 0
///
/// # Errors
/// As [`object_enums`]; a period that is not positive.
pub fn rate_hz(body: &[u8]) -> Result<f64, PacketError> {
    let ticks = Values::new(body).i64()?;
    if ticks <= 0 {
        return Err(PacketError::Period { ticks });
    }
    Ok(TICKS_PER_S / ticks as f64)
}

/// Sum of the latencies of a `LATENCY_INFO`; any number. s
///
/// # Errors
/// As [`object_enums`].
pub fn latency_s(body: &[u8]) -> Result<f64, PacketError> {
    let mut values = Values::new(body);
    let mut sum_s = 0.0;
    for _ in 0..values.u32()? {
        values.bytes()?;
        sum_s += values.f64()?;
    }
    values.end()?;
    Ok(sum_s)
}

/// Whether y points up, by an `APPLICATION_INFO`; else z does.
///
/// # Errors
/// As [`object_enums`].
pub fn is_y_up(body: &[u8]) -> Result<bool, PacketError> {
    Ok(Values::new(body).u8()? != 0)
}

/// The root segment of a `SUBJECT_INFO`, if the subject has this name; names are compared byte by byte.
///
/// # Errors
/// As [`object_enums`]. Markers and what else follows the segments are not looked at.
pub fn root_segment(body: &[u8], name: &[u8]) -> Result<Option<Segment>, PacketError> {
    let mut values = Values::new(body);
    let subject = values.u32()?;
    let is_named = values.bytes()? == name;
    let mut root = None;
    for _ in 0..values.u32()? {
        let (parent, segment) = (values.u32()?, values.u32()?);
        values.take(BOUNDS_BYTES)?;
        values.bytes()?;
        if parent == NO_PARENT && root.is_none() {
            root = Some(Segment { subject, segment });
        }
    }
    Ok(root.filter(|_| is_named))
}

/// Where `wanted` is by a `GLOBAL_SEGMENTS`, if it is there.
///
/// # Errors
/// As [`object_enums`].
pub fn global_segment(body: &[u8], wanted: Segment) -> Result<Option<Placement>, PacketError> {
    let mut values = Values::new(body);
    let subject = values.u32()?;
    let mut found = None;
    for _ in 0..values.u32()? {
        let segment = values.u32()?;
        let (position_mm, matrix) = (values.f64s::<3>()?, values.f64s::<9>()?);
        if (Segment { subject, segment }) == wanted {
            found = Some(Placement { pos_w: position_mm.map(|mm| mm * M_PER_MM), matrix });
        }
    }
    values.end()?;
    Ok(found)
}

/// The request in an object of a client; `None` if it is none that the stream's data depend on.
///
/// # Errors
/// As [`object_enums`].
pub fn request(id: u32, body: &[u8]) -> Result<Option<Request>, PacketError> {
    let mut values = Values::new(body);
    Ok(match id {
        super::id::REQUEST_FRAME if values.u8()? != 0 => Some(Request::EveryFrame),
        super::id::REQUEST_FRAME => Some(Request::Frame),
        super::id::REQUEST_NEXT_FRAME => Some(Request::NextFrames(values.u32()?)),
        super::id::PING => Some(Request::Ping(values.i64()?.cast_unsigned())),
        _ => None,
    })
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
