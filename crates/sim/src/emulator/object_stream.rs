//! The UDP object stream: a block per frame to one host, whether it listens or not.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, UdpSocket};

use tello_io::mocap::Body;
use tello_io::mocap::object_stream::encode_block;

use super::mocap::Port;
use crate::mocap::MocapFrame;

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
    /// A socket that sends to `target`, and that address.
    pub(super) fn open(target: SocketAddr) -> io::Result<(SocketAddr, Self)> {
        let any = match target {
            SocketAddr::V4(_) => SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0)),
            SocketAddr::V6(_) => SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0)),
        };
        let socket = UdpSocket::bind(any)?;
        socket.set_nonblocking(true)?;
        Ok((target, Self { socket, target, block: Vec::new() }))
    }
}

impl Port for ObjectStreamPort {
    /// Sends the block of `frame`, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>) {
        self.block.clear();
        let bodies: Vec<Body<'_>> = frame.body.into_iter().chain(other).collect();
        encode_block(frame.number, &bodies, BLOCK_BYTES, &mut self.block);
        // A datagram that the system does not take is lost, as on any network.
        self.socket.send_to(&self.block, self.target).ok();
    }
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::object_stream::Block;

    use super::super::mocap::tests::{ANY, VEHICLE, WAND, frame};
    use super::*;

    #[test]
    fn each_frame_is_a_datagram_with_what_is_seen() {
        let listener = UdpSocket::bind(ANY).unwrap();
        let (_, mut port) = ObjectStreamPort::open(listener.local_addr().unwrap()).unwrap();
        let mut bytes = [0; 2 * BLOCK_BYTES];
        for (number, body, other, names) in [
            (1, Some(VEHICLE), None, &["tello"][..]),
            (2, Some(VEHICLE), Some(WAND), &["tello", "wand"]),
            (3, None, Some(WAND), &["wand"]),
            (4, None, None, &[]),
        ] {
            port.send(&frame(number, body), other);
            let count = listener.recv(&mut bytes).unwrap();
            let block = Block::parse(&bytes[..count]).unwrap();
            let found: Vec<_> = block.objects().map(|body| str::from_utf8(body.name)).collect();
            assert_eq!(found, names.iter().copied().map(Ok).collect::<Vec<_>>());
            assert_eq!(block.frame, number);
        }
    }

    #[test]
    fn a_host_that_does_not_listen_holds_up_nothing() {
        let gone = UdpSocket::bind(ANY).unwrap().local_addr().unwrap();
        let (_, mut port) = ObjectStreamPort::open(gone).unwrap();
        for number in 0..10 {
            port.send(&frame(number, Some(VEHICLE)), None);
        }
        let six = ObjectStreamPort::open((Ipv6Addr::LOCALHOST, 9).into());
        // A machine without IPv6 has none.
        assert!(six.is_err() || six.is_ok_and(|(target, _)| target.is_ipv6()));
    }
}
