//! Cookie and messages of VRPN, for clients and for the emulator.

#![deny(clippy::indexing_slicing)]

use super::packet::{ALIGN, COOKIE_BEGIN, COOKIE_BYTES, HEAD_BYTES, VrpnMessage};

/// Appends the cookie: version 7.35, nothing to be logged.
pub fn cookie(to: &mut Vec<u8>) {
    let begin = to.len();
    to.extend(COOKIE_BEGIN);
    to.extend(b"35  0");
    to.resize(begin + COOKIE_BYTES, 0);
}

/// Appends a message, big-endian: its head of 24 bytes, its body, and zeros up to a multiple of 8 bytes.
pub fn message(message: &VrpnMessage<'_>, to: &mut Vec<u8>) {
    let VrpnMessage { time_s, sender, kind, body } = *message;
    let length = u32::try_from(HEAD_BYTES + body.len()).unwrap_or(u32::MAX);
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "u32 seconds until 2106"
    )]
    let (seconds, microseconds) = (time_s as u32, (time_s.fract() * 1e6) as u32);
    for value in [length, seconds, microseconds, sender.cast_unsigned(), kind.cast_unsigned(), 0] {
        to.extend(value.to_be_bytes());
    }
    to.extend(body);
    to.extend(std::iter::repeat_n(0, body.len().next_multiple_of(ALIGN) - body.len()));
}

/// The body of a description: length of the name with its zero as four bytes, then both.
pub fn description(name: &str) -> Vec<u8> {
    let length = u32::try_from(name.len() + 1).unwrap_or(u32::MAX);
    [&length.to_be_bytes(), name.as_bytes(), &[0]].concat()
}

/// The body of a pose: sensor, position in the unit of the server (m by default), quaternion x y z w.
pub fn pose(sensor: i32, pos_v: [f64; 3], quaternion: [f64; 4]) -> Vec<u8> {
    let mut body = Vec::new();
    body.extend(sensor.to_be_bytes());
    body.extend([0; 4]);
    body.extend(pos_v.into_iter().chain(quaternion).flat_map(f64::to_be_bytes));
    body
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
