//! Bodies of objects, to values in SI units.
//!
//! Each function reads one kind of body whole. `None`: malformed, shorter or longer than its counts require; what
//! follows a single number is not read. Counts on the wire are never trusted: each element has to be there before the
//! next is read, and nothing is allocated.

#![deny(clippy::indexing_slicing)]

use crate::mocap::M_PER_MM;
use crate::mocap::axes::Placement;
use crate::mocap::bytes::Bytes;

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

/// Request of a client.
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
    /// Nothing that frames depend on.
    Other,
}

/// Calls `on_id` for each identity in the body of an `OBJECT_ENUMS`.
pub fn object_enums(body: &[u8], mut on_id: impl FnMut(u32)) -> Option<()> {
    let mut bytes = Bytes::new(body);
    for _ in 0..bytes.u32_le()? {
        on_id(bytes.u32_le()?);
    }
    bytes.end()
}

/// Number of the frame.
pub(crate) fn frame_number(body: &[u8]) -> Option<u32> {
    let mut bytes = Bytes::new(body);
    let number = bytes.u32_le()?;
    bytes.end()?;
    Some(number)
}

/// Frames per second of a `STREAM_INFO`. Hz, > 0
pub fn rate_hz(body: &[u8]) -> Option<f64> {
    let ticks = Bytes::new(body).i64_le()?;
    (ticks > 0).then(|| TICKS_PER_S / ticks as f64)
}

/// Sum of the latencies of a `LATENCY_INFO`; any number. s
pub(crate) fn latency_s(body: &[u8]) -> Option<f64> {
    let mut bytes = Bytes::new(body);
    let mut sum_s = 0.0;
    for _ in 0..bytes.u32_le()? {
        bytes.counted_le()?;
        sum_s += bytes.f64_le()?;
    }
    bytes.end()?;
    Some(sum_s)
}

/// Whether y points up, by an `APPLICATION_INFO`; else z does.
pub(crate) fn is_y_up(body: &[u8]) -> Option<bool> {
    Some(Bytes::new(body).u8()? != 0)
}

/// Name and root segment of a `SUBJECT_INFO`; a subject without segments has no root. Markers and what else follows the
/// segments are not looked at.
pub fn subject(body: &[u8]) -> Option<(&[u8], Option<Segment>)> {
    let mut bytes = Bytes::new(body);
    let subject = bytes.u32_le()?;
    let name = bytes.counted_le()?;
    let mut root = None;
    for _ in 0..bytes.u32_le()? {
        let (parent, segment) = (bytes.u32_le()?, bytes.u32_le()?);
        bytes.take(BOUNDS_BYTES)?;
        bytes.counted_le()?;
        if parent == NO_PARENT && root.is_none() {
            root = Some(Segment { subject, segment });
        }
    }
    Some((name, root))
}

/// Calls `on_segment` with each segment of a `GLOBAL_SEGMENTS` and its placement in the world, position in m. `None`:
/// the body is malformed; segments before the defect were reported.
pub(crate) fn global_segments(
    body: &[u8],
    mut on_segment: impl FnMut(Segment, Placement),
) -> Option<()> {
    let mut bytes = Bytes::new(body);
    let subject = bytes.u32_le()?;
    for _ in 0..bytes.u32_le()? {
        let segment = bytes.u32_le()?;
        let (position_mm, matrix) = (bytes.f64s_le::<3>()?, bytes.f64s_le()?);
        let pos_v = position_mm.map(|mm| mm * M_PER_MM);
        on_segment(Segment { subject, segment }, Placement { pos_v, matrix });
    }
    bytes.end()
}

/// The request in an object of a client.
pub fn request(id: u32, body: &[u8]) -> Option<Request> {
    let mut bytes = Bytes::new(body);
    Some(match id {
        super::id::REQUEST_FRAME if bytes.u8()? != 0 => Request::EveryFrame,
        super::id::REQUEST_FRAME => Request::Frame,
        super::id::REQUEST_NEXT_FRAME => Request::NextFrames(bytes.u32_le()?),
        super::id::PING => Request::Ping(bytes.u64_le()?),
        _ => Request::Other,
    })
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
