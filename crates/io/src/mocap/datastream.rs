//! Vicon's DataStream, as far as the pose of one subject needs it; both sides of the conversation.
//!
//! The server speaks first and says what it can send; the client answers with what it wants and asks
//! for a packet per frame. A packet is a sequence of objects, each with identity and length, so that
//! unknown ones are skipped. A subject that is not seen is left out of a frame's segments. Pure: bytes
//! to values and back. Packets are [`packet`]'s, the bodies of objects [`decode`]'s and [`encode`]'s;
//! this file owns the client's part of the conversation.

#![deny(clippy::indexing_slicing)]

mod bodies;
pub mod decode;
pub mod encode;
pub mod packet;

pub(super) use bodies::DatastreamBodies;
use decode::Segment;
use horizon_model::rows::Pose;
use packet::{PacketError, Packets, objects};

use super::MocapCounters;
use super::body::{heading_of_matrix, is_all_zero, pose};
use super::protocol::LATENCY_MAX_S;
use super::source::{Connection, Frame, Source, SourceError};
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

/// What a pose cannot do without.
const NEEDED: [u32; 3] = [id::SUBJECT_INFO, id::FRAME_INFO, id::GLOBAL_SEGMENTS];

/// What is asked for if it is offered, beside [`NEEDED`].
const USEFUL: [u32; 3] = [id::STREAM_INFO, id::LATENCY_INFO, id::APPLICATION_INFO];

/// The packets of a server, read for the root segment of one subject.
#[derive(Debug)]
pub(super) struct DatastreamSource {
    packets: Packets,
    /// What to send next.
    requests: Vec<u8>,
    reader: Reader,
}

/// What the packets so far say.
#[derive(Debug)]
struct Reader {
    subject: String,
    /// Identities of the subject and of its root segment.
    root: Option<Segment>,
    /// Whether two subjects have its name.
    is_doubled: bool,
    rate_hz: f64,
}

/// What one packet says.
struct News {
    /// What the server offers, if this is its greeting.
    offer: Option<Offer>,
    frame: Option<Frame>,
}

/// Everything but the segments of a packet.
#[derive(Default)]
struct Head {
    offer: Option<Offer>,
    number: Option<u32>,
    latency: SpanNs,
}

/// Why a packet says nothing.
enum Refusal {
    /// An object in it is not what its identity says; the next packet is read.
    Packet,
    /// No packet will say anything.
    Connection(SourceError),
}

impl From<PacketError> for Refusal {
    fn from(_: PacketError) -> Self {
        Self::Packet
    }
}

/// Which of [`NEEDED`] and [`USEFUL`] a server offers.
#[derive(Debug, Clone, Copy)]
struct Offer {
    needed: [bool; NEEDED.len()],
    useful: [bool; USEFUL.len()],
}

impl DatastreamSource {
    pub(super) fn new(subject: &str) -> Self {
        let subject = subject.to_owned();
        Self {
            packets: Packets::default(),
            requests: Vec::new(),
            reader: Reader { subject, root: None, is_doubled: false, rate_hz: 0.0 },
        }
    }
}

impl Source for DatastreamSource {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<(), SourceError> {
        let Self { packets, requests, reader } = self;
        packets.push(bytes, |packet| {
            counters.messages.count();
            let news = match reader.read(packet) {
                Ok(news) => news,
                Err(Refusal::Connection(error)) => return Err(error),
                Err(Refusal::Packet) => {
                    counters.malformed.count();
                    return Ok(());
                }
            };
            if let Some(offer) = news.offer {
                offer.accept(requests)?;
            }
            if let Some(frame) = news.frame {
                if reader.is_doubled {
                    counters.doubled.count();
                } else if reader.root.is_none() {
                    counters.other_object.count();
                }
                on_frame(frame);
            }
            Ok(())
        })
    }
}

impl Connection for DatastreamSource {
    fn restart(&mut self) {
        self.packets.clear();
        self.requests.clear();
        self.reader.root = None;
        self.reader.is_doubled = false;
        self.reader.rate_hz = 0.0;
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.requests);
    }
}

impl Reader {
    fn read(&mut self, packet: &[u8]) -> Result<News, Refusal> {
        // Segments are understood once the subjects of the same packet are.
        let Head { offer, number, latency } = self.read_head(packet)?;
        let Some(number) = number else { return Ok(News { offer, frame: None }) };
        let pose = self.read_pose(packet)?;
        let frame =
            Frame { number: number.into(), rate_hz: self.rate_hz, stamp: None, latency, pose };
        Ok(News { offer, frame: Some(frame) })
    }

    fn read_head(&mut self, packet: &[u8]) -> Result<Head, Refusal> {
        let mut head = Head::default();
        let (mut has_subjects, mut root, mut is_doubled) = (false, None, false);
        for object in objects(packet) {
            let (id, body) = object?;
            match id {
                id::OBJECT_ENUMS => head.offer = Some(Offer::decode(body)?),
                id::FRAME_INFO => head.number = Some(decode::frame_number(body)?),
                id::STREAM_INFO => self.rate_hz = decode::rate_hz(body)?,
                id::LATENCY_INFO => head.latency = latency(decode::latency_s(body)?),
                id::APPLICATION_INFO if decode::is_y_up(body)? => {
                    return Err(Refusal::Connection(SourceError::UpIsY));
                }
                id::SUBJECT_INFO => {
                    has_subjects = true;
                    let named = decode::root_segment(body, self.subject.as_bytes())?;
                    is_doubled |= root.is_some() && named.is_some();
                    root = root.or(named);
                }
                _ => {}
            }
        }
        if has_subjects {
            // A packet with subjects has all of them: one that is missing was removed.
            // Of two it is not known which is which.
            self.root = root.filter(|_| !is_doubled);
            self.is_doubled = is_doubled;
        }
        Ok(head)
    }

    /// Pose of the root segment; `None` if it is not there or all zero.
    fn read_pose(&self, packet: &[u8]) -> Result<Option<Pose>, Refusal> {
        let Some(root) = self.root else { return Ok(None) };
        for object in objects(packet) {
            let (id, body) = object?;
            if id != id::GLOBAL_SEGMENTS {
                continue;
            }
            let Some(at) = decode::global_segment(body, root)? else { continue };
            if is_all_zero(at.pos_w.into_iter().chain(at.matrix)) {
                return Ok(None);
            }
            let pose = heading_of_matrix(&at.matrix).and_then(|theta| pose(at.pos_w, theta));
            return pose.map(Some).ok_or(Refusal::Packet);
        }
        Ok(None)
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
    fn decode(body: &[u8]) -> Result<Self, PacketError> {
        let mut offer = Self { needed: [false; NEEDED.len()], useful: [false; USEFUL.len()] };
        decode::object_enums(body, |offered| {
            let is_needed = offer.needed.iter_mut().zip(NEEDED);
            for (is_offered, id) in is_needed.chain(offer.useful.iter_mut().zip(USEFUL)) {
                *is_offered |= id == offered;
            }
        })?;
        Ok(offer)
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
