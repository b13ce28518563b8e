//! OptiTrack's NatNet, protocol 3 and 4, as far as the poses of rigid bodies need it.
//!
//! The client asks on the command port who serves; the answer states the version, how frames come (multicast
//! group, or to the client that asked) and the ticks of its clock. Then it asks for the names of the rigid bodies and
//! for the frame rate. Frames are one datagram each. Pure: bytes to values and back. Datagrams are
//! [`packet`]'s and [`encode`]'s; this file owns the client's part of the conversation.

#![deny(clippy::indexing_slicing)]

pub mod encode;
pub mod packet;

use core::net::SocketAddrV4;
use std::collections::BTreeMap;
use std::time::Duration;

use packet::{FrameEnd, ServerInfo, Version, id};

use super::axes::{Placement, matrix_of_quaternion};
use super::protocol::{
    Absence, BodyProtocol, FrameVisitor, Head, LATENCY_MAX_S, Name, OBJECT_NAME_BYTES_MAX,
    OBJECTS_MAX, RATE_HZ,
};
use super::source::{Refusal, SourceError};
use crate::clock::SpanNs;

/// Time between two beats, and without a frame until it is asked who serves: a server that was started again has
/// forgotten its clients, and a flight lands 2 s (`lost_s`) after the last pose. The first question is sent within two
/// beats.
const BEAT_PERIOD: Duration = Duration::from_millis(250);
/// Beats until the client announces itself again, and asks for what changed: 1 s.
const BEATS_PER_SLOW: u32 = 4;

/// The datagrams of a server.
#[derive(Debug, Default)]
pub(super) struct NatnetProtocol {
    server: Option<ServerInfo>,
    /// Rigid bodies by their streaming identity.
    names: BTreeMap<i32, String>,
    /// Whether the names are those of now, as far as the server reported.
    has_names: bool,
    /// Whether any names came on this connection: before, it is unknown which bodies a frame lacks.
    knows_names: bool,
    /// Beats so far, and since the newest frame.
    beats: u32,
    beats_since_frame: u32,
    /// From the settings, else from the server; 0 while it is not known. Hz
    rate_hz: f64,
    set_rate_hz: Option<f64>,
    requests: Vec<u8>,
}

impl NatnetProtocol {
    /// A client before its first datagram; `rate_hz` of the settings comes before that of the server.
    pub(super) fn new(rate_hz: Option<f64>) -> Self {
        Self {
            beats_since_frame: 1,
            rate_hz: rate_hz.unwrap_or(0.0),
            set_rate_hz: rate_hz,
            ..Self::default()
        }
    }

    /// Takes in who serves, and asks for the rest.
    fn greet(&mut self, server: ServerInfo) -> Result<(), SourceError> {
        let Version { major, minor } = server.version;
        if !(3..=4).contains(&major) {
            return Err(SourceError::NatnetVersion { major, minor });
        }
        // It comes after a silence only: a server that was started again may name its bodies otherwise. After a short
        // one the old names count until the new ones come.
        let is_other = self.server.is_none_or(|known| known.version != server.version);
        self.server = Some(server);
        self.has_names = false;
        if is_other || self.beats_since_frame > BEATS_PER_SLOW {
            self.knows_names = false;
            self.names.clear();
        }
        self.ask();
        Ok(())
    }

    /// Requests for what is not known.
    fn ask(&mut self) {
        if !self.has_names {
            encode::request(id::REQUEST_MODELDEF, b"", &mut self.requests);
        }
        if self.rate_hz <= 0.0 {
            encode::request(id::REQUEST, b"FrameRate\0", &mut self.requests);
        }
    }

    /// Takes in names; `None` if the datagram ends before they do.
    fn learn_names(&mut self, version: Version, body: &[u8]) -> Option<()> {
        let mut names = BTreeMap::new();
        packet::rigid_body_names(body, version, |id, name| {
            if names.len() < OBJECTS_MAX && name.len() <= OBJECT_NAME_BYTES_MAX {
                names.insert(id, String::from_utf8_lossy(name).into_owned());
            }
        })?;
        self.names = names;
        (self.has_names, self.knows_names) = (true, true);
        Some(())
    }

    /// Takes in the bodies of a frame; `None` if the datagram ends before they do.
    fn read_frame(
        &mut self,
        server: ServerInfo,
        body: &[u8],
        visitor: &mut dyn FrameVisitor,
    ) -> Option<()> {
        let mut is_unnamed = false;
        let names = &self.names;
        let (number, end) = packet::frame(body, server.version, |rigid| {
            let text = names.get(&rigid.id).map(String::as_bytes);
            is_unnamed |= text.is_none();
            let mut numbers = rigid.pos_v.iter().chain(&rigid.quaternion);
            let is_seen = rigid.is_tracked && numbers.all(|value| value.is_finite());
            // Zeros are no rotation: refused with that reason.
            let matrix = matrix_of_quaternion(rigid.quaternion).unwrap_or_default();
            let at = is_seen.then_some(Placement { pos_v: rigid.pos_v, matrix });
            visitor.body(Name { text, id: Some(rigid.id) }, at.as_ref());
        })?;
        if is_unnamed || end.is_some_and(|end| end.has_new_models) {
            // Asked for at the next beat, not with each frame.
            self.has_names = false;
        }
        self.beats_since_frame = 0;
        let latency = end.map_or(SpanNs(0), |end| latency(&end, server.ticks_per_s));
        let number = number.into();
        let stamp = end.and_then(|end| stamp(&end, server.ticks_per_s));
        let absence = if self.knows_names { Absence::Lost } else { Absence::Unknown };
        let rate_hz = self.rate_hz;
        visitor.frame(Head { number, rate_hz, stamp, latency, absence });
        Some(())
    }
}

impl BodyProtocol for NatnetProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        visitor.message();
        let Some((message, body)) = packet::message(bytes) else {
            visitor.refuse(Refusal::Form);
            return Ok(());
        };
        let is_read = match (message, self.server) {
            (id::SERVERINFO, _) => match packet::server_info(body) {
                Some(server) => {
                    self.greet(server)?;
                    Some(())
                }
                None => None,
            },
            (id::MODELDEF, Some(server)) => self.learn_names(server.version, body),
            (id::RESPONSE, Some(_)) => {
                if let Some(rate_hz) = packet::number(body).filter(|rate| RATE_HZ.contains(rate))
                    && self.set_rate_hz.is_none()
                {
                    self.rate_hz = rate_hz;
                }
                Some(())
            }
            (id::FRAMEOFDATA, Some(server)) => self.read_frame(server, body, visitor),
            // Before the version is known nothing can be read; other messages are not for us.
            _ => Some(()),
        };
        if is_read.is_none() {
            visitor.refuse(Refusal::Form);
        }
        Ok(())
    }

    fn restart(&mut self) {
        *self = Self::new(self.set_rate_hz);
    }

    fn beat(&mut self) {
        // A server that fell silent may have started again, with another version or without us.
        let is_silent = self.beats_since_frame > 0;
        self.beats_since_frame = self.beats_since_frame.saturating_add(1);
        if is_silent {
            encode::request(id::CONNECT, b"Ping\0", &mut self.requests);
        }
        let is_slow = self.beats.is_multiple_of(BEATS_PER_SLOW);
        self.beats = self.beats.wrapping_add(1);
        if self.server.is_some() && is_slow {
            encode::request(id::KEEPALIVE, b"", &mut self.requests);
        }
        // Frames without any names have no body of ours. Names that changed can wait, and a silent server is asked for
        // its names when it answers.
        if self.server.is_some() && (is_slow || !(self.knows_names || is_silent)) {
            self.ask();
        }
    }

    fn beat_period(&self) -> Duration {
        BEAT_PERIOD
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.requests);
    }

    fn group(&self) -> Option<SocketAddrV4> {
        self.server.and_then(|server| server.group)
    }
}

/// The middle of the exposure by the server's clock; `None` if it is not reported.
fn stamp(end: &FrameEnd, ticks_per_s: u64) -> Option<SpanNs> {
    let ns = u128::from(end.exposed) * 1_000_000_000 / u128::from(ticks_per_s).max(1);
    let is_reported = end.exposed > 0 && ticks_per_s > 0;
    i64::try_from(ns).ok().filter(|_| is_reported).map(SpanNs)
}

/// Time from the middle of the exposure to the sending; zero if it cannot be one.
fn latency(end: &FrameEnd, ticks_per_s: u64) -> SpanNs {
    let ticks = end.transmitted.saturating_sub(end.exposed);
    let latency_s = ticks as f64 / ticks_per_s as f64;
    if end.exposed == 0 || !(0.0..=LATENCY_MAX_S).contains(&latency_s) {
        return SpanNs(0);
    }
    SpanNs::from_seconds(latency_s)
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
