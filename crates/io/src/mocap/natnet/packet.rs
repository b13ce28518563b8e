//! Datagrams of NatNet to values in SI units.
//!
//! Each function reads one kind of datagram, or returns `None` where bytes are missing. Counts on the wire are
//! never trusted: each element has to be there before the next is read. Other parts of a frame are skipped,
//! from protocol 4.1 on by their announced size, before that element by element.

#![deny(clippy::indexing_slicing)]

use core::net::{Ipv4Addr, SocketAddrV4};

use crate::mocap::bytes::Bytes;

/// Kinds of datagrams.
pub mod id {
    /// The client asks who serves.
    pub const CONNECT: u16 = 0;
    /// Who serves.
    pub const SERVERINFO: u16 = 1;
    /// A command or question as text.
    pub const REQUEST: u16 = 2;
    /// The answer to it.
    pub const RESPONSE: u16 = 3;
    /// The client asks for the descriptions of what is streamed.
    pub const REQUEST_MODELDEF: u16 = 4;
    /// Descriptions.
    pub const MODELDEF: u16 = 5;
    /// A frame.
    pub const FRAMEOFDATA: u16 = 7;
    /// The client is still there.
    pub const KEEPALIVE: u16 = 10;
}

/// Kinds of descriptions.
pub(super) mod described {
    pub(in super::super) const MARKER_SET: i32 = 0;
    pub(in super::super) const RIGID_BODY: i32 = 1;
    pub(in super::super) const SKELETON: i32 = 2;
    pub(in super::super) const CAMERA: i32 = 5;
}

/// Length of a name of fixed size.
pub(super) const FIXED_NAME_BYTES: usize = 256;

const VECTOR_BYTES: usize = 12;
/// Identity of the parent, offset from it.
pub(super) const PARENT_BYTES: usize = 4 + VECTOR_BYTES;
/// Position and label of a marker in a description.
const DESCRIBED_MARKER_BYTES: usize = VECTOR_BYTES + 4;
/// Identity, position, quaternion, error, flags.
const RIGID_BODY_BYTES: usize = 4 + 12 + 16 + 4 + 2;
/// Identity, position, size, flags, residual.
const LABELED_MARKER_BYTES: usize = 4 + 12 + 4 + 2 + 4;
/// Time code and sub-frame; zero without a generator of time codes.
pub(super) const TIME_CODE_BYTES: usize = 4 + 4;
/// Precision time stamp, seconds and fraction, in versions with sizes.
pub(super) const PRECISION_TIME_BYTES: usize = 4 + 4;

/// The protocol's version.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// First number.
    pub major: u8,
    /// Second number.
    pub minor: u8,
}

impl Version {
    /// Whether lists are preceded by their size in bytes.
    pub(super) fn has_sizes(self) -> bool {
        self >= Self { major: 4, minor: 1 }
    }
}

/// Who serves, and how.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ServerInfo {
    /// Version of what it sends.
    pub version: Version,
    /// Ticks of its clock in a second; 0 if it does not report them. Hz
    pub ticks_per_s: u64,
    /// Group and port that frames are sent to; `None` if they come to the client that asked.
    pub group: Option<SocketAddrV4>,
}

/// A rigid body of a frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBody {
    /// Streaming identity.
    pub id: i32,
    /// x, y, z in the axes of the source. m
    pub pos_v: [f64; 3],
    /// x, y, z, w. 1
    pub quaternion: [f64; 4],
    /// Whether the server saw it in this frame.
    pub is_tracked: bool,
}

/// Fields at the end of a frame. Times are in ticks of the server's clock.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FrameEnd {
    /// Seconds since the server's start, or of a recording. s
    pub timestamp_s: f64,
    /// Middle of the exposure; 0 if it is not known.
    pub exposed: u64,
    /// When the cameras' data were there.
    pub received: u64,
    /// When the frame was sent.
    pub transmitted: u64,
    /// Whether rigid bodies were added, removed or renamed.
    pub has_new_models: bool,
}

/// Kind and body of a datagram. `None`: truncated.
pub fn message(datagram: &[u8]) -> Option<(u16, &[u8])> {
    let mut bytes = Bytes::new(datagram);
    let (kind, length) = (bytes.u16_le()?, bytes.u16_le()?);
    Some((kind, bytes.take(length.into())?))
}

/// Length of the datagram at the front of `bytes`, by its head.
pub(in crate::mocap) fn datagram_length(bytes: &[u8]) -> Option<usize> {
    let mut head = Bytes::new(bytes);
    let (_, length) = (head.u16_le()?, head.u16_le()?);
    Some(usize::from(length) + 4)
}

/// Who serves. What a server of protocol 3.0 may leave out is not known then. `None`: truncated.
pub fn server_info(body: &[u8]) -> Option<ServerInfo> {
    let mut bytes = Bytes::new(body);
    bytes.skip(1, FIXED_NAME_BYTES)?;
    bytes.array::<4>()?;
    let [major, minor, ..] = bytes.array::<4>()?;
    let version = Version { major, minor };
    let ticks_per_s = bytes.u64_le().unwrap_or(0);
    let mut group = || {
        let (port, is_multicast) = (bytes.u16_le()?, bytes.u8()? != 0);
        let address = Ipv4Addr::from(bytes.array::<4>()?);
        (is_multicast && address.is_multicast()).then_some(SocketAddrV4::new(address, port))
    };
    Some(ServerInfo { version, ticks_per_s, group: group() })
}

/// The number in an answer, a little-endian `f32` in the unit of what was asked for; `None` if the body is too short.
pub fn number(body: &[u8]) -> Option<f64> {
    Bytes::new(body).f32_le().map(f64::from)
}

/// Calls `on_body` with identity and name of each rigid body that is described. `None`: truncated or malformed.
pub(crate) fn rigid_body_names(
    body: &[u8],
    version: Version,
    mut on_body: impl FnMut(i32, &[u8]),
) -> Option<()> {
    let mut bytes = Bytes::new(body);
    for _ in 0..bytes.count_le()? {
        let kind = bytes.i32_le()?;
        if version.has_sizes() {
            let size = bytes.count_le()?;
            let mut one = Bytes::new(bytes.take(size)?);
            if kind == described::RIGID_BODY {
                let name = one.until_zero()?;
                on_body(one.i32_le()?, name);
            }
            continue;
        }
        match kind {
            described::MARKER_SET => {
                bytes.until_zero()?;
                for _ in 0..bytes.count_le()? {
                    bytes.until_zero()?;
                }
            }
            described::RIGID_BODY => {
                let (id, name) = rigid_body_description(&mut bytes, version)?;
                on_body(id, name);
            }
            described::SKELETON => {
                bytes.until_zero()?;
                bytes.i32_le()?;
                for _ in 0..bytes.count_le()? {
                    rigid_body_description(&mut bytes, version)?;
                }
            }
            described::CAMERA => {
                bytes.until_zero()?;
                bytes.skip(7, 4)?;
            }
            // Force plates and devices come after the rigid bodies, and their length is not sent.
            _ => return Some(()),
        }
    }
    Some(())
}

/// Identity and name at the front of `bytes`, in a version without sizes.
fn rigid_body_description<'a>(bytes: &mut Bytes<'a>, version: Version) -> Option<(i32, &'a [u8])> {
    let name = bytes.until_zero()?;
    let id = bytes.i32_le()?;
    bytes.skip(1, PARENT_BYTES)?;
    let markers = bytes.count_le()?;
    bytes.skip(markers, DESCRIBED_MARKER_BYTES)?;
    if version.major >= 4 {
        for _ in 0..markers {
            bytes.until_zero()?;
        }
    }
    Some((id, name))
}

/// Number and end of a frame, whose `body` is what follows the head of the message. Calls `on_body` with each rigid
/// body, in the order of the frame.
///
/// The end is `None` if the frame stops within it; all is `None` if the frame stops before, after `on_body` was called
/// for the bodies that were complete. No allocation.
pub fn frame(
    body: &[u8],
    version: Version,
    mut on_body: impl FnMut(RigidBody),
) -> Option<(i32, Option<FrameEnd>)> {
    let mut bytes = Bytes::new(body);
    let number = bytes.i32_le()?;
    section(&mut bytes, version, marker_set)?;
    section(&mut bytes, version, unlabeled_marker)?;
    let count = bytes.count_le()?;
    if version.has_sizes() {
        let size = bytes.count_le()?;
        let mut bodies = Bytes::new(bytes.take(size)?);
        (0..count).try_for_each(|_| rigid_body(&mut bodies).map(&mut on_body))?;
    } else {
        (0..count).try_for_each(|_| rigid_body(&mut bytes).map(&mut on_body))?;
    }
    // The poses are there: what is missing behind them is the times at most.
    Some((number, end(bytes, version)))
}

/// A list of things that are skipped one by one, or at once where the size is sent.
fn section<'a>(
    bytes: &mut Bytes<'a>,
    version: Version,
    mut skip_one: impl FnMut(&mut Bytes<'a>) -> Option<()>,
) -> Option<()> {
    let count = bytes.count_le()?;
    if version.has_sizes() {
        let size = bytes.count_le()?;
        return bytes.skip(1, size);
    }
    (0..count).try_for_each(|_| skip_one(bytes))
}

fn rigid_body(bytes: &mut Bytes<'_>) -> Option<RigidBody> {
    let (id, pos_v, quaternion) = (bytes.i32_le()?, bytes.f32s_le()?, bytes.f32s_le()?);
    bytes.f32_le()?;
    let is_tracked = bytes.u16_le()? & 1 != 0;
    Some(RigidBody { id, pos_v, quaternion, is_tracked })
}

/// The end of a frame, behind its rigid bodies.
fn end(mut bytes: Bytes<'_>, version: Version) -> Option<FrameEnd> {
    section(&mut bytes, version, skeleton)?;
    if version.has_sizes() {
        section(&mut bytes, version, asset)?;
    }
    section(&mut bytes, version, labeled_marker)?;
    section(&mut bytes, version, force_plate)?;
    section(&mut bytes, version, device)?;
    bytes.skip(1, TIME_CODE_BYTES)?;
    let timestamp_s = f64::from_bits(bytes.u64_le()?);
    let (exposed, received, transmitted) = (bytes.u64_le()?, bytes.u64_le()?, bytes.u64_le()?);
    if version.has_sizes() {
        bytes.skip(1, PRECISION_TIME_BYTES)?;
    }
    let has_new_models = bytes.u16_le()? & 2 != 0;
    Some(FrameEnd { timestamp_s, exposed, received, transmitted, has_new_models })
}

fn marker_set(bytes: &mut Bytes<'_>) -> Option<()> {
    bytes.until_zero()?;
    let markers = bytes.count_le()?;
    bytes.skip(markers, VECTOR_BYTES)
}

fn unlabeled_marker(bytes: &mut Bytes<'_>) -> Option<()> {
    bytes.skip(1, VECTOR_BYTES)
}

fn labeled_marker(bytes: &mut Bytes<'_>) -> Option<()> {
    bytes.skip(1, LABELED_MARKER_BYTES)
}

fn skeleton(bytes: &mut Bytes<'_>) -> Option<()> {
    bytes.i32_le()?;
    let bones = bytes.count_le()?;
    bytes.skip(bones, RIGID_BODY_BYTES)
}

/// Assets came with the sizes: none is skipped by its elements.
fn asset(_bytes: &mut Bytes<'_>) -> Option<()> {
    None
}

fn force_plate(bytes: &mut Bytes<'_>) -> Option<()> {
    channels(bytes)
}

fn device(bytes: &mut Bytes<'_>) -> Option<()> {
    channels(bytes)
}

/// Identity, and the analog values of each channel.
fn channels(bytes: &mut Bytes<'_>) -> Option<()> {
    bytes.i32_le()?;
    for _ in 0..bytes.count_le()? {
        let values = bytes.count_le()?;
        bytes.skip(values, 4)?;
    }
    Some(())
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
