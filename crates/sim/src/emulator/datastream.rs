//! The DataStream server: speaks first, hears what each client wants, sends a packet per frame.
//!
//! Owns the server's part of the conversation. Whatever does not change is in every packet, so that no
//! client has to remember it. A client that asks for frames one by one gets the next one that there is.

use std::collections::BTreeSet;
use std::io;
use std::net::SocketAddr;

use tello_io::mocap::Body;
use tello_io::mocap::datastream::decode::{self, Request};
use tello_io::mocap::datastream::packet::{Packets, objects};
use tello_io::mocap::datastream::{encode, id};

use super::clients::Clients;
use super::mocap::Port;
use crate::mocap::MocapFrame;

/// Identifiers of the data that can be sent.
const OFFERED: [u32; 9] = [
    id::STREAM_INFO,
    id::SUBJECT_INFO,
    id::FRAME_INFO,
    id::LOCAL_SEGMENTS,
    id::GLOBAL_SEGMENTS,
    id::LATENCY_INFO,
    id::APPLICATION_INFO,
    id::PING,
    id::CONTENTS,
];

/// Identities of the object and of a second one.
const SUBJECT: u32 = 1;
const OTHER: u32 = 2;

/// Frames that a client may have asked for, and pings that may wait.
const WAITING_MAX: usize = 64;

/// The listening socket and its clients.
#[derive(Debug)]
pub(super) struct DatastreamPort {
    clients: Clients<DatastreamSession>,
}

/// Subscription of one client.
#[derive(Debug, Default)]
struct DatastreamSession {
    packets: Packets,
    wanted: BTreeSet<u32>,
    wants_every_frame: bool,
    frames_due: usize,
    pings: Vec<u64>,
}

impl DatastreamPort {
    /// Listens on `address`; returns where clients connect to.
    pub(super) fn open(address: SocketAddr) -> io::Result<(SocketAddr, Self)> {
        let mut greeting = Vec::new();
        encode::packet(&mut greeting, |packet| packet.object_enums(&OFFERED));
        let clients = Clients::bind(address, greeting)?;
        Ok((clients.address()?, Self { clients }))
    }
}

impl Port for DatastreamPort {
    /// Accepts new clients, and reads from all.
    fn receive(&mut self) {
        self.clients.listen(DatastreamSession::receive);
    }

    /// Sends `frame` to whom it is due, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>) {
        self.clients.send(|session, to| session.send(frame, other, to));
    }
}

impl DatastreamSession {
    /// Takes in what the client sends.
    ///
    /// # Errors
    /// Something that is no DataStream.
    fn receive(&mut self, bytes: &[u8]) -> io::Result<()> {
        let Self { packets, wanted, wants_every_frame, frames_due, pings } = self;
        let mut is_clear = true;
        let result = packets.push(bytes, |packet| {
            let mut read = || -> Option<()> {
                for object in objects(packet) {
                    let (id, body) = object?;
                    if id == id::OBJECT_ENUMS {
                        wanted.clear();
                        decode::object_enums(body, |id| {
                            if OFFERED.contains(&id) {
                                wanted.insert(id);
                            }
                        })?;
                    }
                    match decode::request(id, body)? {
                        Request::EveryFrame => *wants_every_frame = true,
                        Request::Frame => {
                            *wants_every_frame = false;
                            *frames_due = 1;
                        }
                        Request::NextFrames(count) => {
                            let count = usize::try_from(count).unwrap_or(WAITING_MAX);
                            *frames_due = frames_due.saturating_add(count).min(WAITING_MAX);
                        }
                        Request::Ping(number) if pings.len() < WAITING_MAX => pings.push(number),
                        Request::Ping(_) | Request::Other => {}
                    }
                }
                Some(())
            };
            is_clear &= read().is_some();
            Ok(())
        });
        if is_clear && result.is_ok() { Ok(()) } else { Err(io::ErrorKind::InvalidData.into()) }
    }

    /// Appends the packet of `frame`, if it is due.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>, to: &mut Vec<u8>) {
        if !self.wants_every_frame && self.frames_due == 0 {
            return;
        }
        self.frames_due = self.frames_due.saturating_sub(1);
        let Self { wanted, pings, .. } = self;
        let MocapFrame { number, rate_hz, object, body } = *frame;
        // Subjects from 1 on; a lost one is named, and has no segments.
        let seen: Vec<(u32, Body<'_>)> = [(SUBJECT, body), (OTHER, other)]
            .into_iter()
            .filter_map(|(k, body)| Some((k, body?)))
            .collect();
        encode::packet(to, |packet| {
            let mut counts = Vec::new();
            for id in wanted.iter().copied() {
                let mut count = 1;
                match id {
                    id::STREAM_INFO => packet.stream_info(rate_hz),
                    id::SUBJECT_INFO => {
                        packet.subject_info(SUBJECT, object.as_bytes());
                        if let Some(other) = &other {
                            packet.subject_info(OTHER, other.name);
                            count = 2;
                        }
                    }
                    id::FRAME_INFO => packet.frame_info(number),
                    // The simulated room sees without delay.
                    id::LATENCY_INFO => packet.latency_info(&[("Simulation", 0.0)]),
                    id::APPLICATION_INFO => packet.application_info(),
                    id::LOCAL_SEGMENTS | id::GLOBAL_SEGMENTS => {
                        count = 0;
                        for (subject, body) in &seen {
                            packet.segments(id, *subject, body);
                            count += 1;
                        }
                    }
                    _ => continue,
                }
                if count > 0 {
                    counts.push((id, count));
                }
            }
            for number in pings.drain(..) {
                packet.ping(number);
            }
            if wanted.contains(&id::CONTENTS) {
                packet.contents(&counts);
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [u32; 9] = OFFERED;

    fn request(fill: impl FnOnce(&mut encode::Packet<'_>)) -> Vec<u8> {
        let mut bytes = Vec::new();
        encode::packet(&mut bytes, fill);
        bytes
    }

    fn session(ids: &[u32]) -> DatastreamSession {
        let mut session = DatastreamSession::default();
        session.receive(&request(|packet| packet.object_enums(ids))).unwrap();
        session
    }

    /// The packet of a client that asks for the next `count` frames.
    fn request_next_frames(count: u32) -> Vec<u8> {
        let head = *b"\x01\x00\x2b\x1a\x0c\x00\x00\x00\xa8\x86\x01\x00\x04\x00\x00\x00";
        [&head[..], &count.to_le_bytes()].concat()
    }

    /// Identities in the packet that the session sends for one frame, seen or not.
    fn sent(session: &mut DatastreamSession, is_seen: bool) -> Vec<u32> {
        let body = Body { name: b"tello", pos_v: [1.0, 2.0, 3.0], angles: [0.0; 3] };
        let body = is_seen.then_some(body);
        let mut bytes = Vec::new();
        session.send(
            &MocapFrame { number: 1, rate_hz: 50.0, object: "tello", body },
            None,
            &mut bytes,
        );
        let objects = objects(bytes.get(8..).unwrap_or_default());
        objects.map(|object| object.unwrap().0).collect()
    }

    #[test]
    fn frames_come_one_by_one_prefetched_or_all() {
        let mut session = session(&[id::FRAME_INFO]);
        let is_sent = |session: &mut DatastreamSession| !sent(session, true).is_empty();
        assert!(!is_sent(&mut session), "not asked for");
        session.receive(&request(|packet| packet.request_frame(false))).unwrap();
        assert_eq!([(); 2].map(|()| is_sent(&mut session)), [true, false]);
        session.receive(&request_next_frames(2)).unwrap();
        assert_eq!([(); 3].map(|()| is_sent(&mut session)), [true, true, false]);
        session.receive(&request(|packet| packet.request_frame(true))).unwrap();
        assert_eq!([(); 3].map(|()| is_sent(&mut session)), [true; 3]);
        session.receive(&request(|packet| packet.request_frame(false))).unwrap();
        assert_eq!([(); 2].map(|()| is_sent(&mut session)), [true, false]);
        session.receive(&request_next_frames(u32::MAX)).unwrap();
        assert_eq!(session.frames_due, WAITING_MAX);
    }

    #[test]
    fn what_is_wanted_is_sent_and_a_lost_subject_is_left_out() {
        let mut session = session(&ALL);
        session.receive(&request(|packet| packet.request_frame(true))).unwrap();
        session.receive(&request(|packet| packet.ping(7))).unwrap();
        assert_eq!(sent(&mut session, true), [1, 2, 5, 8, 9, 26, 37, 42, 100_004]);
        assert_eq!(sent(&mut session, false), [1, 2, 5, 26, 37, 100_004]);
        session.receive(&request(|packet| packet.object_enums(&[5, 9, 999]))).unwrap();
        assert_eq!(sent(&mut session, true), [5, 9]);
    }

    #[test]
    fn what_is_no_datastream_ends_the_connection() {
        assert!(DatastreamSession::default().receive(b"GET / HTTP/1.1\r\n").is_err());
        let mut short = request(|packet| packet.request_frame(true));
        short.truncate(short.len() - 1);
        *short.get_mut(4).unwrap() -= 1;
        assert!(DatastreamSession::default().receive(&short).is_err());
    }
}
