//! The UDP object stream: a block per frame to one host, whether it listens or not.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use tello_io::mocap::Body;
use tello_io::mocap::object_stream::encode_block;

use crate::mocap::Shot;

/// The largest block that Tracker can be set to.
const BLOCK_BYTES: usize = 1024;

/// The sending socket.
#[derive(Debug)]
pub(super) struct ObjectStreamPort {
    socket: UdpSocket,
    target: SocketAddr,
    block: Vec<u8>,
}

impl ObjectStreamPort {
    /// A socket that sends to `target`.
    pub(super) fn open(target: SocketAddr) -> io::Result<Self> {
        let any = match target {
            SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
            SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
        };
        let socket = UdpSocket::bind(any)?;
        socket.set_nonblocking(true)?;
        Ok(Self { socket, target, block: Vec::new() })
    }

    /// Sends the block of `shot`, with a second object.
    pub(super) fn push(&mut self, shot: &Shot<'_>, other: Option<Body<'_>>) {
        self.block.clear();
        let bodies: Vec<Body<'_>> = shot.body.into_iter().chain(other).collect();
        encode_block(shot.frame, &bodies, BLOCK_BYTES, &mut self.block);
        // A datagram that the system does not take is lost, as on any network.
        self.socket.send_to(&self.block, self.target).ok();
    }
}
