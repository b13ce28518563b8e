//! The drone on UDP: hears packets, answers, and reports to whom it heard last.
//!
//! Owns the socket and the rhythm of what is sent unasked. What a packet does is `wire`'s.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use tello_io::tello::protocol::{DATAGRAM_BYTES_MAX, DronePacket, HostPacket};

use crate::world::World;

/// Most packets that are heard in one step; a host that sends more waits for the next one.
const PACKETS_MAX: usize = 64;
/// Steps between two flight statuses: 10 Hz.
const STATUS_STEPS: u64 = 5;
/// Steps between two reports of the radio link.
const WIFI_STEPS: u64 = 50;
/// What the drone says about its radio link. %.
const WIFI_STRENGTH_PCT: u8 = 90;
/// Number of the only log that the drone offers.
const LOG_HEADER_ID: u16 = 1;

/// The drone's socket and its host.
#[derive(Debug)]
pub(super) struct DronePort {
    socket: UdpSocket,
    /// Who connected, at the address last heard.
    host: Option<SocketAddr>,
    sequence: u16,
    inbound: Vec<u8>,
    outbound: Vec<u8>,
}

impl DronePort {
    /// Listens on `address`.
    pub(super) fn bind(address: SocketAddr) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        let inbound = vec![0; DATAGRAM_BYTES_MAX];
        Ok(Self { socket, host: None, sequence: 0, inbound, outbound: Vec::new() })
    }

    /// Where the host sends to.
    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Passes on what has arrived and answers it. Before a request for a connection, and in what is
    /// not understood, nothing is heard.
    pub(super) fn hear(&mut self, world: &mut World) {
        for _ in 0..PACKETS_MAX {
            let (length, from) = match self.socket.recv_from(&mut self.inbound) {
                Ok(received) => received,
                // An earlier answer found nobody: the host is gone, the queue is not.
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => continue,
                Err(_) => return,
            };
            let Ok(packet) = HostPacket::decode(&self.inbound[..length]) else { continue };
            let is_request = matches!(packet, HostPacket::ConnReq { .. });
            if world.is_deaf() || (!is_request && self.host.is_none()) {
                continue;
            }
            self.host = Some(from);
            if let Some(answer) = world.hear(&packet) {
                self.send(&answer);
                if is_request {
                    self.greet();
                }
            }
        }
    }

    /// Reports what is due.
    pub(super) fn speak(&mut self, world: &World) {
        let Some(status) = world.flight_status() else { return };
        if world.step().is_multiple_of(STATUS_STEPS) {
            let sequence = self.count();
            self.send(&DronePacket::Status { sequence, status });
        }
        if world.step().is_multiple_of(WIFI_STEPS) {
            let sequence = self.count();
            let strength_pct = WIFI_STRENGTH_PCT;
            self.send(&DronePacket::WifiStrength { sequence, strength_pct, disturbance: 0 });
        }
    }

    /// What a drone asks of a new host.
    fn greet(&mut self) {
        let sequence = self.count();
        self.send(&DronePacket::DateTimeRequest { sequence });
        let sequence = self.count();
        self.send(&DronePacket::LogHeader { sequence, header_id: LOG_HEADER_ID });
    }

    /// Running number of what is sent unasked.
    fn count(&mut self) -> u16 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn send(&mut self, packet: &DronePacket) {
        let Some(host) = self.host else { return };
        packet.encode(&mut self.outbound);
        // A radio link: what cannot be sent is lost.
        self.socket.send_to(&self.outbound, host).ok();
    }
}
