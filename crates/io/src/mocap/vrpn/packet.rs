//! Cookie and messages of VRPN, big-endian, and their bodies.

#![deny(clippy::indexing_slicing)]

use crate::mocap::SourceError;
use crate::mocap::bytes::{Bytes, text_of};

/// Types that every side knows.
pub mod kind {
    /// The name that a sender's number stands for.
    pub const SENDER: i32 = -1;
    /// The name that a type's number stands for.
    pub const TYPE: i32 = -2;
}

/// Begin of a cookie, up to the second part of the version.
pub(super) const COOKIE_BEGIN: &[u8] = b"vrpn: ver. 07.";
pub(super) const COOKIE_BYTES: usize = 24;
pub(super) const HEAD_BYTES: usize = 24;
/// Number in the sequence of messages: a stream of TCP keeps its order without it.
const SEQUENCE_BYTES: usize = 4;
/// Bodies are filled up to a multiple of this.
pub(super) const ALIGN: usize = 8;

/// Longest message that is read: VRPN's own buffer.
const MESSAGE_BYTES_MAX: usize = 64_000;

/// A message of the VRPN protocol, its body not yet parsed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VrpnMessage<'a> {
    /// Measurement time, by the clock of the sender. s
    pub time_s: f64,
    /// Number of the sender, or what is described.
    pub sender: i32,
    /// Number of the message type; negative for the protocol's own.
    pub kind: i32,
    /// Bytes behind the header, without padding.
    pub body: &'a [u8],
}

/// Assembles messages from pieces that are cut anywhere. Holds what has arrived, whatever is announced.
#[derive(Debug, Default)]
pub struct Messages {
    bytes: Vec<u8>,
    has_cookie: bool,
}

impl Messages {
    /// Calls `on_message` with each message that `piece` completes; the cookie comes first.
    ///
    /// # Errors
    /// Another cookie, a length that no message has, or the first error of `on_message`. What follows makes no
    /// sense then.
    pub fn push(
        &mut self,
        piece: &[u8],
        mut on_message: impl FnMut(&VrpnMessage<'_>) -> Result<(), SourceError>,
    ) -> Result<(), SourceError> {
        self.bytes.extend_from_slice(piece);
        let mut rest = Bytes::new(&self.bytes);
        if !self.has_cookie {
            let begin = self.bytes.iter().zip(COOKIE_BEGIN);
            if !begin.into_iter().all(|(byte, expected)| byte == expected) {
                return Err(SourceError::NoVrpn);
            }
            if rest.take(COOKIE_BYTES).is_none() {
                return Ok(());
            }
            self.has_cookie = true;
        }
        while let Some((message, after)) = split(rest)? {
            on_message(&message)?;
            rest = after;
        }
        let used = self.bytes.len() - rest.rest().len();
        self.bytes.drain(..used);
        Ok(())
    }
}

/// The first message, if it is whole, and what follows it.
fn split(mut bytes: Bytes<'_>) -> Result<Option<(VrpnMessage<'_>, Bytes<'_>)>, SourceError> {
    let Some(length) = bytes.u32_be() else { return Ok(None) };
    let length = usize::try_from(length).unwrap_or(usize::MAX);
    if !(HEAD_BYTES..=MESSAGE_BYTES_MAX).contains(&length) {
        return Err(SourceError::NoVrpn);
    }
    let body_length = length - HEAD_BYTES;
    let mut read = || {
        let (seconds, microseconds) = (bytes.u32_be()?, bytes.u32_be()?);
        let (sender, kind) = (bytes.i32_be()?, bytes.i32_be()?);
        bytes.array::<SEQUENCE_BYTES>()?;
        let body = bytes.take(body_length.next_multiple_of(ALIGN))?.get(..body_length)?;
        let time_s = f64::from(seconds) + 1e-6 * f64::from(microseconds);
        Some(VrpnMessage { time_s, sender, kind, body })
    };
    Ok(read().map(|message| (message, bytes)))
}

/// The name in the body of a description of a sender or kind; `None` if the body is shorter than its length
/// field states.
pub fn description(body: &[u8]) -> Option<&[u8]> {
    let mut bytes = Bytes::new(body);
    let length = usize::try_from(bytes.u32_be()?).ok()?;
    bytes.take(length).map(text_of)
}

/// Sensor, position (m, as VRPN defines it) and quaternion x y z w of a pose. `None`: the body is too short.
pub fn pose(body: &[u8]) -> Option<(i32, [f64; 3], [f64; 4])> {
    let mut bytes = Bytes::new(body);
    let sensor = bytes.i32_be()?;
    bytes.i32_be()?;
    Some((sensor, bytes.f64s_be()?, bytes.f64s_be()?))
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
