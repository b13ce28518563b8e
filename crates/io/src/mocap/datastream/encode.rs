//! Packets to send: a client's requests, a server's frames.

use super::decode::{NO_PARENT, TICKS_PER_S};
use super::id;
use super::packet::MAGIC;
use crate::mocap::{Body, M_PER_MM, matrix_of_angles};

/// Identity of a subject's one segment.
const SEGMENT: u32 = 1;
/// Markers of a segment: none is sent.
const MARKERS: usize = 0;
/// Segments that the markers are attached to: there are no markers.
const ATTACHMENTS: usize = 0;

/// A packet under construction.
#[derive(Debug)]
pub struct Packet<'a>(&'a mut Vec<u8>);

/// Appends a packet with the objects that `fill` puts into it.
pub fn packet(to: &mut Vec<u8>, fill: impl FnOnce(&mut Packet<'_>)) {
    to.extend(MAGIC.to_le_bytes());
    let mut rest = Vec::new();
    fill(&mut Packet(&mut rest));
    put_bytes(to, &rest);
}

impl Packet<'_> {
    /// Which objects can be sent, or are wanted.
    pub fn object_enums(&mut self, ids: &[u32]) {
        self.object(id::OBJECT_ENUMS, |body| {
            put_count(body, ids.len());
            body.extend(ids.iter().flat_map(|id| id.to_le_bytes()));
        });
    }

    /// Appends `REQUEST_FRAME`: asks for one frame, or for all from now on if `is_every`.
    pub fn request_frame(&mut self, is_every: bool) {
        self.object(id::REQUEST_FRAME, |body| body.push(is_every.into()));
    }

    /// Appends `PING`: a number for the other side to send back, or the number that is sent back.
    pub fn ping(&mut self, number: u64) {
        self.object(id::PING, |body| body.extend(number.to_le_bytes()));
    }

    /// Appends `FRAME_INFO`: the number of the frame.
    pub fn frame_info(&mut self, frame: u32) {
        self.object(id::FRAME_INFO, |body| body.extend(frame.to_le_bytes()));
    }

    /// Appends `STREAM_INFO`: the frame period of `rate_hz`, Hz, in ticks of 1 / 135 MHz.
    pub fn stream_info(&mut self, rate_hz: f64) {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "ticks of a period, far below i64::MAX"
        )]
        let ticks = (TICKS_PER_S / rate_hz).round() as i64;
        self.object(id::STREAM_INFO, |body| body.extend(ticks.to_le_bytes()));
    }

    /// Appends `APPLICATION_INFO`: z points up.
    pub fn application_info(&mut self) {
        self.object(id::APPLICATION_INFO, |body| body.push(0));
    }

    /// Latencies by the names of their stages. s
    pub fn latency_info(&mut self, stages: &[(&str, f64)]) {
        self.object(id::LATENCY_INFO, |body| {
            put_count(body, stages.len());
            for (name, latency_s) in stages {
                put_bytes(body, name.as_bytes());
                body.extend(latency_s.to_le_bytes());
            }
        });
    }

    /// A subject, whose root segment has its name, as Tracker does it.
    pub fn subject_info(&mut self, subject: u32, name: &[u8]) {
        self.object(id::SUBJECT_INFO, |body| {
            body.extend(subject.to_le_bytes());
            put_bytes(body, name);
            put_count(body, 1);
            body.extend(NO_PARENT.to_le_bytes());
            body.extend(SEGMENT.to_le_bytes());
            body.extend([0.0_f32; 6].into_iter().flat_map(f32::to_le_bytes));
            put_bytes(body, name);
            put_count(body, MARKERS);
            put_count(body, ATTACHMENTS);
        });
    }

    /// The pose of a subject's root segment, as `GLOBAL_SEGMENTS` or `LOCAL_SEGMENTS`: for a root
    /// they are equal.
    pub fn segments(&mut self, id: u32, subject: u32, seen: &Body<'_>) {
        self.object(id, |body| {
            body.extend(subject.to_le_bytes());
            put_count(body, 1);
            body.extend(SEGMENT.to_le_bytes());
            let numbers = seen.pos_v.map(|m| m / M_PER_MM);
            let numbers = numbers.into_iter().chain(matrix_of_angles(seen.angles));
            // A product of zero and a negative number is -0.0, which Vicon does not send.
            body.extend(numbers.flat_map(|number| (number + 0.0).to_le_bytes()));
        });
    }

    /// How many objects of each kind the packet has; none is left out because it did not change.
    pub fn contents(&mut self, counts: &[(u32, u32)]) {
        self.object(id::CONTENTS, |body| {
            put_count(body, counts.len());
            body.extend(
                counts.iter().flat_map(|(id, count)| [*id, *count]).flat_map(u32::to_le_bytes),
            );
            put_count(body, 0);
        });
    }

    fn object(&mut self, id: u32, fill: impl FnOnce(&mut Vec<u8>)) {
        let mut body = Vec::new();
        fill(&mut body);
        self.0.extend(id.to_le_bytes());
        put_bytes(self.0, &body);
    }
}

fn put_count(to: &mut Vec<u8>, count: usize) {
    to.extend(u32::try_from(count).unwrap_or(u32::MAX).to_le_bytes());
}

fn put_bytes(to: &mut Vec<u8>, bytes: &[u8]) {
    put_count(to, bytes.len());
    to.extend_from_slice(bytes);
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "a test may panic")]
mod tests;
