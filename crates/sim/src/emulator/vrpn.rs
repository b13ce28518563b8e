//! The VRPN server: a tracker with one sensor for each object, over TCP.
//!
//! Owns the server's part of the conversation. A body that is not seen is not reported, as by others.

use std::collections::BTreeSet;
use std::io;
use std::net::SocketAddr;

use tello_io::mocap::vrpn::packet::{Messages, VrpnMessage, description, kind};
use tello_io::mocap::vrpn::{POSE, encode};
use tello_io::mocap::{Body, matrix_of_angles, quaternion_of_matrix};

use super::clients::Clients;
use super::mocap::{Port, names};
use crate::mocap::MocapFrame;

/// Our numbers for the tracker, for a second one and for the types.
const TRACKER: i32 = 0;
const OTHER: i32 = 1;
const POSES: i32 = 0;
const PONGS: i32 = 1;

const PING: &[u8] = b"vrpn_Base ping_message";
const PONG: &str = "vrpn_Base pong_message";

/// Types of a client that are remembered.
const TYPES_MAX: usize = 64;

/// The listening socket and its clients.
#[derive(Debug)]
pub(super) struct VrpnPort {
    clients: Clients<VrpnSession>,
}

/// State and messages of one client.
#[derive(Debug, Default)]
struct VrpnSession {
    messages: Messages,
    knows_tracker: bool,
    /// The client's numbers for a ping.
    pings: BTreeSet<i32>,
    wants_pong: bool,
}

impl VrpnPort {
    /// Listens on `address`; returns where clients connect to.
    pub(super) fn open(address: SocketAddr) -> io::Result<(SocketAddr, Self)> {
        let mut greeting = Vec::new();
        encode::cookie(&mut greeting);
        for (number, name) in [(POSES, POSE), (PONGS, PONG)] {
            describe(kind::TYPE, number, name, &mut greeting);
        }
        let clients = Clients::bind(address, greeting)?;
        Ok((clients.address()?, Self { clients }))
    }
}

impl Port for VrpnPort {
    /// Accepts new clients, and reads from all.
    fn receive(&mut self) {
        self.clients.listen(VrpnSession::receive);
    }

    /// Sends `frame` to all, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>) {
        let MocapFrame { number, rate_hz, object, body } = *frame;
        let time_s = f64::from(number) / rate_hz;
        let pose = |body: Body<'_>| {
            let quaternion = quaternion_of_matrix(&matrix_of_angles(body.angles));
            encode::pose(0, body.pos_v, quaternion)
        };
        let poses = [(TRACKER, body.map(pose)), (OTHER, other.map(pose))];
        let senders = [TRACKER, OTHER].into_iter().zip(names(object, other));
        let append = |sender, kind, body: &[u8], to: &mut Vec<u8>| {
            encode::message(&VrpnMessage { time_s, sender, kind, body }, to);
        };
        self.clients.send(|session, to| {
            if !std::mem::replace(&mut session.knows_tracker, true) {
                for (sender, name) in senders.clone() {
                    describe(kind::SENDER, sender, &name, to);
                }
            }
            if std::mem::take(&mut session.wants_pong) {
                append(TRACKER, PONGS, &[], to);
            }
            for (sender, pose) in &poses {
                if let Some(pose) = pose {
                    append(*sender, POSES, pose, to);
                }
            }
        });
    }
}

impl VrpnSession {
    /// Takes in what the client sends.
    ///
    /// # Errors
    /// Something that is no VRPN.
    fn receive(&mut self, bytes: &[u8]) -> io::Result<()> {
        let Self { messages, pings, wants_pong, .. } = self;
        let result = messages.push(bytes, |message| {
            if message.kind == kind::TYPE
                && pings.len() < TYPES_MAX
                && description(message.body) == Some(PING)
            {
                pings.insert(message.sender);
            }
            *wants_pong |= message.kind >= 0 && pings.contains(&message.kind);
            Ok(())
        });
        result.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
    }
}

/// Appends which name a number stands for.
fn describe(kind: i32, number: i32, name: &str, to: &mut Vec<u8>) {
    let body = encode::description(name);
    encode::message(&VrpnMessage { time_s: 0.0, sender: number, kind, body: &body }, to);
}

#[cfg(test)]
mod tests;
