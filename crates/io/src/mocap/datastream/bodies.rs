//! All subjects of a DataStream, by the poses of their root segments.

#![deny(clippy::indexing_slicing)]

use super::decode::{self, Segment};
use super::packet::{Packets, Values, objects};
use super::{Offer, Refusal, id, latency};
use crate::clock::SpanNs;
use crate::mocap::axes::Placement;
use crate::mocap::protocol::{BodyProtocol, Head, Name, OBJECTS_MAX, Taker};
use crate::mocap::source::Connection;
use crate::mocap::{MocapCounters, SourceError};

/// The packets of a server, read for every subject.
#[derive(Debug, Default)]
pub(in crate::mocap) struct DatastreamBodies {
    packets: Packets,
    requests: Vec<u8>,
    rate_hz: f64,
    subjects: Vec<(String, Segment)>,
}

impl BodyProtocol for DatastreamBodies {
    fn push(
        &mut self,
        bytes: &[u8],
        counters: &MocapCounters,
        taker: &mut dyn Taker,
    ) -> Result<(), SourceError> {
        let Self { packets, requests, rate_hz, subjects } = self;
        packets.push(bytes, |packet| {
            counters.messages.count();
            match read(packet, rate_hz, subjects, taker) {
                Ok(Some(offer)) => offer.accept(requests),
                Ok(None) => Ok(()),
                Err(Refusal::Connection(error)) => Err(error),
                Err(Refusal::Packet) => {
                    counters.malformed.count();
                    Ok(())
                }
            }
        })
    }
}

impl Connection for DatastreamBodies {
    fn restart(&mut self) {
        *self = Self::default();
    }

    fn take_requests(&mut self, to: &mut Vec<u8>) {
        to.append(&mut self.requests);
    }
}

/// Takes in a packet; what the server offers, if this is its greeting.
fn read(
    packet: &[u8],
    rate_hz: &mut f64,
    subjects: &mut Vec<(String, Segment)>,
    taker: &mut dyn Taker,
) -> Result<Option<Offer>, Refusal> {
    let (mut offer, mut number, mut age) = (None, None, SpanNs(0));
    let mut named = Vec::new();
    let mut has_subjects = false;
    for object in objects(packet) {
        let (id, body) = object?;
        match id {
            id::OBJECT_ENUMS => offer = Some(Offer::decode(body)?),
            id::FRAME_INFO => number = Some(decode::frame_number(body)?),
            id::STREAM_INFO => *rate_hz = decode::rate_hz(body)?,
            id::LATENCY_INFO => age = latency(decode::latency_s(body)?),
            id::APPLICATION_INFO if decode::is_y_up(body)? => {
                return Err(Refusal::Connection(SourceError::UpIsY));
            }
            id::SUBJECT_INFO if named.len() < OBJECTS_MAX => {
                has_subjects = true;
                let mut values = Values::new(body);
                values.u32()?;
                let name = values.bytes()?;
                if let Some(root) = decode::root_segment(body, name)? {
                    named.push((String::from_utf8_lossy(name).into_owned(), root));
                }
            }
            _ => {}
        }
    }
    if has_subjects {
        // As for one object: a subject that is missing was removed.
        *subjects = named;
    }
    let Some(number) = number else { return Ok(offer) };
    for (name, root) in subjects.iter() {
        let mut at = None;
        for object in objects(packet) {
            let (id, body) = object?;
            if id == id::GLOBAL_SEGMENTS {
                at = at.or(decode::global_segment(body, *root)?);
            }
        }
        let at = at.map(|at| Placement { pos_v: at.pos_w, matrix: at.matrix });
        taker.body(Name { text: Some(name), id: None }, at.as_ref());
    }
    let rate_hz = *rate_hz;
    let (number, stamp, latency) = (number.into(), None, age);
    taker.frame(Head { number, rate_hz, stamp, latency, is_whole: true });
    Ok(offer)
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
