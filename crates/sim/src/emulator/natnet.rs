//! The NatNet server: answers questions, and sends frames to a group or to the clients that asked.
//!
//! Owns the server's part of the conversation. Nothing here waits.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, SocketAddrV4, UdpSocket};

use socket2::SockRef;
use tello_io::mocap::natnet::encode;
use tello_io::mocap::natnet::packet::{FrameEnd, RigidBody, ServerInfo, Version, id, message};
use tello_io::mocap::{Body, matrix_of_angles, quaternion_of_matrix};

use super::mocap::{Port, names};
use crate::mocap::MocapFrame;

/// Where the server is, and what it speaks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NatnetServer {
    /// Where it listens for questions. UDP
    pub address: SocketAddr,
    /// Group that frames are sent to; `None`: to each client that asked within the last seconds.
    pub group: Option<SocketAddrV4>,
    /// Version of the protocol.
    pub version: Version,
}

impl NatnetServer {
    /// A server at `address` that sends to the clients that asked, as current ones do.
    pub fn unicast(address: SocketAddr) -> Self {
        Self { address, group: None, version: Version { major: 4, minor: 1 } }
    }
}

/// Streaming identities of the object and of a second one.
const OBJECT_ID: i32 = 1;
const OTHER_ID: i32 = 2;

const TICKS_PER_S: u64 = 10_000_000;

/// Clients beyond this are not served.
const CLIENTS_MAX: usize = 16;
/// A client that sends nothing more for so long is forgotten. s
const SILENT_MAX_S: f64 = 10.0;
/// Most datagrams that are heard at a time.
const HEARD_MAX: usize = 64;

/// The socket and who listens.
#[derive(Debug)]
pub(super) struct NatnetPort {
    socket: UdpSocket,
    /// Where it listens, and what it speaks.
    pub(super) server: NatnetServer,
    clients: Vec<Client>,
    /// Rate and objects of the newest frame.
    room: Option<(f64, Vec<String>)>,
    bytes: Vec<u8>,
}

#[derive(Debug)]
struct Client {
    address: SocketAddr,
    silent_frames: u32,
}

impl NatnetPort {
    /// Listens at the address of `server`.
    pub(super) fn bind(server: NatnetServer) -> io::Result<Self> {
        let socket = UdpSocket::bind(server.address)?;
        socket.set_nonblocking(true)?;
        if let (Some(_), IpAddr::V4(address)) = (server.group, server.address.ip()) {
            // Frames leave by the interface that questions come to.
            let any = Ipv4Addr::UNSPECIFIED;
            if address != any {
                SockRef::from(&socket).set_multicast_if_v4(&address)?;
            }
        }
        let server = NatnetServer { address: socket.local_addr()?, ..server };
        Ok(Self { socket, server, clients: Vec::new(), room: None, bytes: Vec::new() })
    }
}

impl Port for NatnetPort {
    /// Answers what was asked.
    fn receive(&mut self) {
        let mut chunk = [0; 2048];
        for _ in 0..HEARD_MAX {
            // Errors of earlier datagrams show up here; the next call hears the others.
            let Ok((count, from)) = self.socket.recv_from(&mut chunk) else { return };
            if let Some((kind, body)) = message(chunk.get(..count).unwrap_or_default()) {
                self.note(from);
                self.answer(kind, body, from);
            }
        }
    }

    /// Sends `frame` to whom it is due, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>) {
        let MocapFrame { number, rate_hz, object, body } = *frame;
        self.room = Some((rate_hz, names(object, other)));
        let mut bodies = vec![rigid(OBJECT_ID, body)];
        bodies.extend(other.map(|other| rigid(OTHER_ID, Some(other))));
        let timestamp_s = f64::from(number) / rate_hz;
        let now = horizon_model::whole(timestamp_s * TICKS_PER_S as f64) as u64 + 1;
        // The simulated room sees without delay.
        let end = FrameEnd {
            timestamp_s,
            exposed: now,
            received: now,
            transmitted: now,
            has_new_models: false,
        };
        self.bytes.clear();
        encode::frame(self.server.version, number.cast_signed(), &bodies, &end, &mut self.bytes);
        // A datagram that the system does not take is lost, as on any network.
        if let Some(group) = self.server.group {
            self.socket.send_to(&self.bytes, group).ok();
            return;
        }
        for client in &mut self.clients {
            client.silent_frames += 1;
            self.socket.send_to(&self.bytes, client.address).ok();
        }
        let is_there = |client: &Client| f64::from(client.silent_frames) < SILENT_MAX_S * rate_hz;
        self.clients.retain(is_there);
    }
}

impl NatnetPort {
    /// Notes that a client is there.
    fn note(&mut self, address: SocketAddr) {
        if let Some(client) = self.clients.iter_mut().find(|client| client.address == address) {
            client.silent_frames = 0;
        } else if self.clients.len() < CLIENTS_MAX {
            self.clients.push(Client { address, silent_frames: 0 });
        }
    }

    fn answer(&mut self, kind: u16, body: &[u8], to: SocketAddr) {
        let NatnetServer { group, version, .. } = self.server;
        self.bytes.clear();
        match (kind, &self.room) {
            (id::CONNECT, _) => {
                let server = ServerInfo { version, ticks_per_s: TICKS_PER_S, group };
                encode::server_info(&server, "tello-ctl sim", &mut self.bytes);
            }
            (id::REQUEST_MODELDEF, Some((_, names))) => {
                let names = names.iter().map(String::as_str);
                let bodies: Vec<_> = [OBJECT_ID, OTHER_ID].into_iter().zip(names).collect();
                encode::model_definitions(version, &bodies, &mut self.bytes);
            }
            (id::REQUEST, Some((rate_hz, _))) if body.starts_with(b"FrameRate") => {
                #[expect(
                    clippy::cast_possible_truncation,
                    reason = "the answer has single precision"
                )]
                encode::response(*rate_hz as f32, &mut self.bytes);
            }
            _ => return,
        }
        self.socket.send_to(&self.bytes, to).ok();
    }
}

/// `body` by its number; one that is not seen stays in the frame.
fn rigid(id: i32, body: Option<Body<'_>>) -> RigidBody {
    let (pos_v, quaternion) = body.map_or(([0.0; 3], [0.0, 0.0, 0.0, 1.0]), |body| {
        (body.pos_v, quaternion_of_matrix(&matrix_of_angles(body.angles)))
    });
    RigidBody { id, pos_v, quaternion, is_tracked: body.is_some() }
}

#[cfg(test)]
mod tests;
