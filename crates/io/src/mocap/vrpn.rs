//! A VRPN tracker over TCP, as far as the poses of its sensors need it.
//!
//! Both sides send a cookie with their version. Then come messages: head with length, time, sender and type as
//! numbers, and a body. The other side describes which names its numbers stand for. A tracker sends one message per
//! sensor and measurement; one that is not seen sends none. Pure: bytes to values and back. Messages are
//! [`packet`]'s and [`encode`]'s.

#![deny(clippy::indexing_slicing)]

pub mod encode;
pub mod packet;

use std::collections::BTreeMap;

use packet::{Messages, VrpnMessage, kind};

use super::axes::{Placement, matrix_of_quaternion};
use super::protocol::{
    Absence, BodyProtocol, FrameVisitor, Head, Name, OBJECT_NAME_BYTES_MAX, OBJECTS_MAX,
};
use super::source::{Refusal, SourceError};
use super::stamp_numbers::StampNumbers;
use crate::clock::SpanNs;

/// The type of message that a pose comes by.
pub const POSE: &str = "vrpn_Tracker Pos_Quat";

/// The messages of a server.
#[derive(Debug)]
pub(super) struct VrpnProtocol {
    messages: Messages,
    reader: Reader,
}

/// Content of the messages so far.
#[derive(Debug, Default)]
struct Reader {
    rate_hz: f64,
    is_new: bool,
    /// Trackers by the server's number for them.
    senders: BTreeMap<i32, String>,
    /// The server's number for poses.
    pose: Option<i32>,
    requests: Vec<u8>,
    /// By tracker and sensor, each of which has stamps of its own.
    numbers: BTreeMap<(i32, i32), StampNumbers>,
}

impl VrpnProtocol {
    /// A client before its first message, of a system with frames at `rate_hz`.
    pub(super) fn new(rate_hz: f64) -> Self {
        let reader = Reader { rate_hz, is_new: true, ..Reader::default() };
        Self { messages: Messages::default(), reader }
    }
}

impl BodyProtocol for VrpnProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        let Self { messages, reader } = self;
        messages.push(bytes, |message| {
            visitor.message();
            if let Err(why) = reader.read(message, visitor) {
                visitor.refuse(why);
            }
            Ok(())
        })
    }

    fn restart(&mut self) {
        *self = Self::new(self.reader.rate_hz);
    }

    fn beat(&mut self) {
        if std::mem::take(&mut self.reader.is_new) {
            encode::cookie(&mut self.reader.requests);
        }
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.reader.requests);
    }
}

impl Reader {
    /// Takes in a message.
    ///
    /// # Errors
    /// Its body does not match its type, or has no pose of a sender with a name.
    fn read(
        &mut self,
        message: &VrpnMessage<'_>,
        visitor: &mut dyn FrameVisitor,
    ) -> Result<(), Refusal> {
        let description = || packet::description(message.body).ok_or(Refusal::Form);
        match message.kind {
            kind::SENDER => {
                let name = String::from_utf8_lossy(description()?);
                let is_kept =
                    name.len() <= OBJECT_NAME_BYTES_MAX && self.senders.len() < OBJECTS_MAX;
                if is_kept {
                    self.senders.insert(message.sender, name.into_owned());
                }
            }
            kind::TYPE if description()? == POSE.as_bytes() => {
                self.pose = Some(message.sender);
            }
            of if Some(of) == self.pose => self.read_pose(message, visitor)?,
            _ => {}
        }
        Ok(())
    }

    fn read_pose(
        &mut self,
        message: &VrpnMessage<'_>,
        visitor: &mut dyn FrameVisitor,
    ) -> Result<(), Refusal> {
        let (sensor, pos_v, quaternion) = packet::pose(message.body).ok_or(Refusal::Form)?;
        if !pos_v.iter().chain(&quaternion).all(|value| value.is_finite()) {
            return Err(Refusal::Number);
        }
        let matrix = matrix_of_quaternion(quaternion).ok_or(Refusal::Rotation)?;
        // A sender that was not described has no name.
        let sender = self.senders.get(&message.sender).ok_or(Refusal::Sender)?;
        let at = Placement { pos_v, matrix };
        if sensor == 0 {
            visitor.body(Name { text: Some(sender.as_bytes()), id: None }, Some(&at));
        } else {
            let name = format!("{sender}#{sensor}");
            visitor.body(Name { text: Some(name.as_bytes()), id: None }, Some(&at));
        }
        // There are no frame numbers. A server with more objects than are read numbers the rest by rounding.
        let source = (message.sender, sensor);
        let has_room = self.numbers.len() < OBJECTS_MAX || self.numbers.contains_key(&source);
        let mut rounding = StampNumbers::default();
        let numbers =
            if has_room { self.numbers.entry(source).or_default() } else { &mut rounding };
        let number = numbers.number(message.time_s, self.rate_hz);
        let (rate_hz, stamp) = (self.rate_hz, Some(SpanNs::from_seconds(message.time_s)));
        visitor.frame(Head {
            number,
            rate_hz,
            stamp,
            latency: SpanNs(0),
            absence: Absence::Unknown,
        });
        Ok(())
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
