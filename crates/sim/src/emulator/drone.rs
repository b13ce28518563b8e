//! The drone on UDP: hears datagrams, answers, and reports to whom it heard last.
//!
//! Owns the socket, the air around it, which of the two protocols is spoken, and the rhythm of what is
//! sent unasked. What a packet does is `wire`'s, what a command does is `sdk`'s.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use horizon_model::rows::pose;
use tello_io::tello::protocol::{DATAGRAM_BYTES_MAX, DronePacket, HostPacket};
use tello_io::tello::text::Command;

use crate::DT_S;
use crate::datagram_channel::Air;
use crate::firmware::{DroneTable, ReplyTo};
use crate::random::Purpose;
use crate::sdk::Sdk;
use crate::world::World;

/// Most packets that are taken from the socket in one step; a host that sends more waits for the next.
const PACKETS_MAX: usize = 64;
/// Steps between two flight statuses, or two state lines: 10 Hz.
const STATUS_STEPS: u64 = 5;
/// Steps between two reports of the radio link.
const WIFI_STEPS: u64 = 50;
/// Strength of the radio link that the drone reports. %
const WIFI_STRENGTH_PCT: u8 = 90;
/// Number of the only log that the drone offers.
const LOG_HEADER_ID: u16 = 1;
/// The only port of the host that some drones answer to.
const HOST_PORT: u16 = 8889;

/// The drone's socket and its host.
#[derive(Debug)]
pub(super) struct DronePort {
    socket: UdpSocket,
    table: DroneTable,
    uplink: Air<(Vec<u8>, SocketAddr)>,
    downlink: Air<(Vec<u8>, SocketAddr)>,
    mode: Mode,
    /// At the address last heard.
    host: Option<SocketAddr>,
    sequence: u16,
    /// Whether the host asked for the flight log.
    sends_log: bool,
    /// Heading at power-up. rad
    theta_start: f64,
    inbound: Vec<u8>,
}

/// The drone speaks what it heard first, until it is switched off.
#[derive(Debug)]
enum Mode {
    Undecided,
    Binary,
    Text(Sdk),
}

impl DronePort {
    /// Listens on `address` for the drone of `world`.
    pub(super) fn bind(address: SocketAddr, world: &World) -> io::Result<Self> {
        let socket = UdpSocket::bind(address)?;
        socket.set_nonblocking(true)?;
        let (table, seed) = (world.firmware, world.seed);
        Ok(Self {
            socket,
            table,
            uplink: Air::new(table.air, seed, Purpose::Uplink),
            downlink: Air::new(table.air, seed, Purpose::Downlink),
            mode: Mode::Undecided,
            host: None,
            sequence: 0,
            sends_log: false,
            theta_start: world.truth().pose[pose::THETA],
            inbound: vec![0; DATAGRAM_BYTES_MAX],
        })
    }

    /// Where the host sends to.
    pub(super) fn address(&self) -> io::Result<SocketAddr> {
        self.socket.local_addr()
    }

    /// Passes on what has arrived and answers it.
    pub(super) fn receive(&mut self, world: &mut World) {
        let now_s = now_s(world);
        for _ in 0..PACKETS_MAX {
            let (length, from) = match self.socket.recv_from(&mut self.inbound) {
                Ok(received) => received,
                // An earlier answer met a closed port: the host is gone, the queue is not.
                Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => continue,
                Err(_) => break,
            };
            self.uplink.send((self.inbound[..length].to_vec(), from), now_s);
        }
        if !world.is_connected() {
            (self.mode, self.host, self.sends_log) = (Mode::Undecided, None, false);
            self.theta_start = world.truth().pose[pose::THETA];
        }
        while let Some((datagram, from)) = self.uplink.receive(now_s) {
            if !world.ignores_commands() {
                self.take(&datagram, from, world);
            }
        }
        self.deliver(now_s);
    }

    /// Reports what is due, and delivers what is.
    pub(super) fn report(&mut self, world: &mut World) {
        match &mut self.mode {
            Mode::Undecided => {}
            Mode::Binary => self.report_binary(world),
            Mode::Text(sdk) => {
                let mut replies = Vec::new();
                sdk.advance(world.drone_mut(), &mut replies);
                let line = world.step().is_multiple_of(STATUS_STEPS).then(|| {
                    let mut bytes = Vec::new();
                    sdk.state_line(&world.reported()).encode(&mut bytes);
                    (bytes, sdk.state_port)
                });
                self.reply(replies, world);
                if let (Some((bytes, port)), Some(mut host)) = (line, self.host) {
                    host.set_port(port);
                    self.send(bytes, host, world);
                }
            }
        }
        self.deliver(now_s(world));
    }

    /// Before a request for a connection or for SDK mode, nothing is heard. The request decides which.
    fn take(&mut self, datagram: &[u8], from: SocketAddr, world: &mut World) {
        if matches!(self.mode, Mode::Undecided) {
            if matches!(HostPacket::decode(datagram), Ok(HostPacket::ConnReq { .. })) {
                self.mode = Mode::Binary;
            } else if Command::decode(datagram) == Ok(Command::Enter) {
                self.mode = Mode::Text(Sdk::new(self.table.sdk, self.theta_start));
                self.host = Some(self.answer_to(from));
                if self.table.binary_first
                    && let Some(status) = world.flight_status()
                {
                    self.send_packet(&DronePacket::Status { sequence: 0, status }, world);
                }
            } else {
                return;
            }
            world.set_connected(true);
        }
        self.host = Some(self.answer_to(from));
        match &mut self.mode {
            Mode::Undecided => {}
            Mode::Binary => self.take_packet(datagram, world),
            // What is no text is not even refused.
            Mode::Text(_) if !datagram.is_ascii() => {}
            Mode::Text(sdk) => {
                let mut replies = Vec::new();
                sdk.receive(datagram, world.drone_mut(), &mut replies);
                self.reply(replies, world);
            }
        }
    }

    fn answer_to(&self, from: SocketAddr) -> SocketAddr {
        match self.table.reply_to {
            ReplyTo::Sender => from,
            ReplyTo::Port8889 => SocketAddr::new(from.ip(), HOST_PORT),
        }
    }

    /// Handles one packet of the binary protocol; an unknown one is not answered.
    fn take_packet(&mut self, datagram: &[u8], world: &mut World) {
        let Ok(packet) = HostPacket::decode(datagram) else { return };
        self.sends_log |= matches!(packet, HostPacket::LogHeaderAck { .. });
        if let Some(answer) = world.receive(&packet) {
            self.send_packet(&answer, world);
            if matches!(packet, HostPacket::ConnReq { .. }) {
                self.greet(world);
            }
        }
    }

    fn report_binary(&mut self, world: &World) {
        let Some(status) = world.flight_status() else { return };
        if world.step().is_multiple_of(STATUS_STEPS) {
            let sequence = self.count();
            self.send_packet(&DronePacket::Status { sequence, status }, world);
            if self.sends_log {
                self.log(world);
            }
        }
        if world.step().is_multiple_of(WIFI_STEPS) {
            let sequence = self.count();
            let strength_pct = WIFI_STRENGTH_PCT;
            self.send_packet(
                &DronePacket::WifiStrength { sequence, strength_pct, disturbance: 0 },
                world,
            );
        }
    }

    /// Sends a record of the flight log: of it, clients take the heading.
    fn log(&mut self, world: &World) {
        let sequence = self.count();
        if let Some(record) = world.log_record(sequence, self.theta_start) {
            self.send_packet(&record, world);
        }
    }

    /// Asks a new host for the date and time.
    fn greet(&mut self, world: &World) {
        let sequence = self.count();
        self.send_packet(&DronePacket::DateTimeRequest { sequence }, world);
        let sequence = self.count();
        self.send_packet(&DronePacket::LogHeader { sequence, header_id: LOG_HEADER_ID }, world);
    }

    /// Running number of what is sent unasked.
    fn count(&mut self) -> u16 {
        self.sequence = self.sequence.wrapping_add(1);
        self.sequence
    }

    fn send_packet(&mut self, packet: &DronePacket, world: &World) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        if let Some(host) = self.host {
            self.send(bytes, host, world);
        }
    }

    fn reply(&mut self, replies: Vec<String>, world: &World) {
        let Some(host) = self.host else { return };
        for reply in replies {
            self.send(reply.into_bytes(), host, world);
        }
    }

    fn send(&mut self, bytes: Vec<u8>, to: SocketAddr, world: &World) {
        if !world.is_mute() {
            self.downlink.send((bytes, to), now_s(world));
        }
    }

    fn deliver(&mut self, now_s: f64) {
        while let Some((bytes, to)) = self.downlink.receive(now_s) {
            // A radio link: what cannot be sent is lost.
            self.socket.send_to(&bytes, to).ok();
        }
    }
}

/// The time that the drone has lived. s
fn now_s(world: &World) -> f64 {
    world.step() as f64 * DT_S
}

#[cfg(test)]
mod tests;
