//! Vicon's DataStream, as far as the poses of subjects need it; both sides of the conversation.
//!
//! The server speaks first and lists what it can send; the client answers with what it wants and asks
//! for a packet per frame. A packet is a sequence of objects, each with identity and length, so that
//! unknown ones are skipped. A subject that is not seen is left out of a frame's segments. Pure: bytes
//! to values and back. Packets are [`packet`]'s, the bodies of objects [`decode`]'s and [`encode`]'s;
//! this file owns the client's part of the conversation.

#![deny(clippy::indexing_slicing)]

pub mod decode;
pub mod encode;
pub mod packet;

use decode::Segment;
use packet::{Packets, objects};

use super::axes::Placement;
use super::body::is_all_zero;
use super::protocol::{
    Absence, BodyProtocol, FrameVisitor, Head, LATENCY_MAX_S, Name, OBJECTS_MAX,
};
use super::source::{Refusal, SourceError};
use crate::clock::SpanNs;

/// Identities of objects.
pub mod id {
    /// Frame period.
    pub const STREAM_INFO: u32 = 1;
    /// Name and skeleton of a subject.
    pub const SUBJECT_INFO: u32 = 2;
    /// Frame number.
    pub const FRAME_INFO: u32 = 5;
    /// Poses of a subject's segments, relative to their parents.
    pub const LOCAL_SEGMENTS: u32 = 8;
    /// Poses of a subject's segments in the world.
    pub const GLOBAL_SEGMENTS: u32 = 9;
    /// How old a frame is when it is sent, by stages.
    pub const LATENCY_INFO: u32 = 26;
    /// Which axis points up.
    pub const APPLICATION_INFO: u32 = 37;
    /// A number that the server sends back.
    pub const PING: u32 = 42;
    /// Which objects can be sent, or are wanted.
    pub const OBJECT_ENUMS: u32 = 100_001;
    /// Asks for one frame, or for all from now on.
    pub const REQUEST_FRAME: u32 = 100_002;
    /// How many objects of each kind are in a packet, and which did not change.
    pub const CONTENTS: u32 = 100_004;
    /// Asks for the next frames.
    pub const REQUEST_NEXT_FRAME: u32 = 100_008;
}

/// Messages without which there is no pose.
const NEEDED: [u32; 3] = [id::SUBJECT_INFO, id::FRAME_INFO, id::GLOBAL_SEGMENTS];

/// Messages that are requested if they are offered, beside [`NEEDED`].
const USEFUL: [u32; 3] = [id::STREAM_INFO, id::LATENCY_INFO, id::APPLICATION_INFO];

/// The packets of a server.
#[derive(Debug, Default)]
pub(super) struct DatastreamProtocol {
    packets: Packets,
    /// Bytes to send next.
    requests: Vec<u8>,
    reader: Reader,
}

/// Content of the packets so far.
#[derive(Debug, Default)]
struct Reader {
    rate_hz: f64,
    subjects: Vec<Subject>,
}

/// A subject, which is where its root segment is.
#[derive(Debug)]
struct Subject {
    name: Vec<u8>,
    root: Segment,
    /// Where it is in the newest frame. m
    at: Option<Placement>,
}

/// Content of one packet beside its subjects and segments.
#[derive(Default)]
struct Contents {
    /// Offer of the server, if this is its greeting.
    offer: Option<Offer>,
    is_y_up: bool,
    number: Option<u32>,
    latency: SpanNs,
}

/// Which of [`NEEDED`] and [`USEFUL`] a server offers.
#[derive(Debug, Clone, Copy)]
struct Offer {
    needed: [bool; NEEDED.len()],
    useful: [bool; USEFUL.len()],
}

impl BodyProtocol for DatastreamProtocol {
    fn push(&mut self, bytes: &[u8], visitor: &mut dyn FrameVisitor) -> Result<(), SourceError> {
        let Self { packets, requests, reader } = self;
        packets.push(bytes, |packet| {
            visitor.message();
            let Some(contents) = reader.read(packet) else {
                visitor.refuse(Refusal::Form);
                return Ok(());
            };
            let Contents { offer, is_y_up, number, latency } = contents;
            if is_y_up {
                return Err(SourceError::UpIsY);
            }
            if let Some(offer) = offer {
                offer.accept(requests)?;
            }
            if let Some(number) = number {
                reader.hand_over(number, latency, visitor);
            }
            Ok(())
        })
    }

    fn restart(&mut self) {
        self.packets.clear();
        self.requests.clear();
        self.reader = Reader::default();
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.requests);
    }
}

impl Reader {
    /// Takes in a packet; `None` if an object in it does not match its identity.
    fn read(&mut self, packet: &[u8]) -> Option<Contents> {
        let mut contents = Contents::default();
        let mut has_subjects = false;
        for object in objects(packet) {
            let (id, body) = object?;
            match id {
                id::OBJECT_ENUMS => contents.offer = Some(Offer::decode(body)?),
                id::FRAME_INFO => contents.number = Some(decode::frame_number(body)?),
                id::STREAM_INFO => self.rate_hz = decode::rate_hz(body)?,
                id::LATENCY_INFO => contents.latency = latency(decode::latency_s(body)?),
                id::APPLICATION_INFO => contents.is_y_up |= decode::is_y_up(body)?,
                id::SUBJECT_INFO => {
                    has_subjects = true;
                    decode::subject(body)?;
                }
                _ => {}
            }
        }
        // Segments are understood once the subjects of the same packet are.
        if has_subjects {
            self.learn(packet);
        }
        self.place(packet)?;
        Some(contents)
    }

    /// Takes in the subjects of a packet, which has all: one that is missing was removed. Allocates only if they
    /// changed.
    fn learn(&mut self, packet: &[u8]) {
        let infos = objects(packet).flatten().filter(|(id, _)| *id == id::SUBJECT_INFO);
        let named = infos.filter_map(|(_, body)| decode::subject(body));
        let named =
            || named.clone().filter_map(|(name, root)| Some((name, root?))).take(OBJECTS_MAX);
        if named().ne(self.subjects.iter().map(|known| (known.name.as_slice(), known.root))) {
            let subject =
                |(name, root): (&[u8], _)| Subject { name: name.to_vec(), root, at: None };
            self.subjects = named().map(subject).collect();
        }
    }

    /// Takes in where the subjects are; `None` if an object does not match its identity.
    fn place(&mut self, packet: &[u8]) -> Option<()> {
        self.subjects.iter_mut().for_each(|subject| subject.at = None);
        for (id, body) in objects(packet).flatten() {
            if id != id::GLOBAL_SEGMENTS {
                continue;
            }
            decode::global_segments(body, |segment, at| {
                let is_lost = is_all_zero(at.pos_v.into_iter().chain(at.matrix));
                for subject in self.subjects.iter_mut().filter(|known| known.root == segment) {
                    subject.at = (!is_lost).then_some(at);
                }
            })?;
        }
        Some(())
    }

    /// Hands over the frame of the newest packet.
    fn hand_over(&self, number: u32, latency: SpanNs, visitor: &mut dyn FrameVisitor) {
        for Subject { name, at, .. } in &self.subjects {
            visitor.body(Name { text: Some(name), id: None }, at.as_ref());
        }
        let (number, rate_hz, absence) = (number.into(), self.rate_hz, Absence::Lost);
        visitor.frame(Head { number, rate_hz, stamp: None, latency, absence });
    }
}

/// A latency as a span; zero if it cannot be one.
fn latency(latency_s: f64) -> SpanNs {
    if !(0.0..=LATENCY_MAX_S).contains(&latency_s) {
        return SpanNs(0);
    }
    SpanNs::from_seconds(latency_s)
}

impl Offer {
    fn decode(body: &[u8]) -> Option<Self> {
        let mut offer = Self { needed: [false; NEEDED.len()], useful: [false; USEFUL.len()] };
        decode::object_enums(body, |offered| {
            let is_needed = offer.needed.iter_mut().zip(NEEDED);
            for (is_offered, id) in is_needed.chain(offer.useful.iter_mut().zip(USEFUL)) {
                *is_offered |= id == offered;
            }
        })?;
        Some(offer)
    }

    /// Appends the answer: what is wanted of this, and a packet for every frame.
    fn accept(self, to: &mut Vec<u8>) -> Result<(), SourceError> {
        let wanted = |ids: &[u32], is_offered: &[bool]| -> Vec<u32> {
            ids.iter().zip(is_offered).filter_map(|(id, is)| is.then_some(*id)).collect()
        };
        if let Some((id, _)) = NEEDED.iter().zip(self.needed).find(|(_, is_offered)| !is_offered) {
            return Err(SourceError::NotOffered { id: *id });
        }
        let mut ids = wanted(&NEEDED, &self.needed);
        ids.extend(wanted(&USEFUL, &self.useful));
        ids.sort_unstable();
        ids.push(id::CONTENTS);
        encode::packet(to, |packet| packet.object_enums(&ids));
        encode::packet(to, |packet| packet.request_frame(true));
        Ok(())
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
