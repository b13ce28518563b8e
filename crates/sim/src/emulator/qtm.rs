//! The server of Qualisys' real-time protocol: greets, answers commands, sends frames to the clients that asked.
//!
//! Owns the server's part of the conversation. What a measurement would change is refused.

use std::io;
use std::net::SocketAddr;

use tello_io::mocap::qtm::packet::{Packets, kind, text};
use tello_io::mocap::qtm::{GREETING, encode};
use tello_io::mocap::{Body, Placement, matrix_of_angles};

use super::clients::Clients;
use super::mocap::{Port, names};
use crate::mocap::MocapFrame;

const MM_PER_M: f64 = 1e3;

/// The event of a server that is connected to its cameras.
const EVENT_CONNECTED: u8 = 1;

/// The listening socket and its clients.
#[derive(Debug)]
pub(super) struct QtmPort {
    clients: Clients<QtmSession>,
    /// Rate and objects of the newest frame.
    room: Option<(f64, Vec<String>)>,
}

/// Subscription of one client.
#[derive(Debug, Default)]
struct QtmSession {
    packets: Packets,
    answers: Vec<u8>,
    wants_parameters: bool,
    wants_every_frame: bool,
    wants_frame: bool,
}

impl QtmPort {
    /// Listens on `address`, little-endian; returns where clients connect to.
    pub(super) fn open(address: SocketAddr) -> io::Result<(SocketAddr, Self)> {
        let mut greeting = Vec::new();
        encode::text(kind::COMMAND, GREETING, &mut greeting);
        let clients = Clients::bind(address, greeting)?;
        Ok((clients.address()?, Self { clients, room: None }))
    }
}

impl Port for QtmPort {
    /// Accepts new clients, reads and answers all.
    fn receive(&mut self) {
        self.clients.receive(QtmSession::receive);
        let room = &self.room;
        self.clients.send(|session, to| {
            to.append(&mut session.answers);
            // Before the first frame it is not known what is in the room.
            if let Some((rate_hz, names)) = room
                && std::mem::take(&mut session.wants_parameters)
            {
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                encode::parameters(*rate_hz, "+Z", &names, to);
            }
        });
    }

    /// Sends `frame` to whom it is due, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>) {
        let MocapFrame { number, rate_hz, object, body } = *frame;
        self.room = Some((rate_hz, names(object, other)));
        let place = |body: Body<'_>| Placement {
            pos_v: body.pos_v.map(|m| m * MM_PER_M),
            matrix: matrix_of_angles(body.angles),
        };
        let mut places = vec![body.map(place)];
        places.extend(other.map(|other| Some(place(other))));
        let time_us = horizon_model::whole(1e6 * f64::from(number) / rate_hz) as u64;
        self.clients.send(|session, to| {
            if std::mem::take(&mut session.wants_frame) || session.wants_every_frame {
                encode::frame(number, time_us, &places, to);
            }
        });
    }
}

impl QtmSession {
    /// Takes in what the client sends.
    ///
    /// # Errors
    /// Something that is no packet.
    fn receive(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut packets = std::mem::take(&mut self.packets);
        let result = packets.push(bytes, |kind, body| {
            if kind == kind::COMMAND {
                self.obey(&text(body).to_ascii_lowercase());
            }
            Ok(())
        });
        self.packets = packets;
        result.map_err(|error| io::Error::new(io::ErrorKind::InvalidData, error))
    }

    /// Executes a command, given in lower case.
    fn obey(&mut self, command: &str) {
        let (verb, rest) = command.split_once(' ').unwrap_or((command, ""));
        let answer = match verb {
            "version" if rest.is_empty() => "Version is 1.19".to_owned(),
            "version" => format!("Version set to {rest}"),
            "byteorder" => "Byte order is little endian".to_owned(),
            "qtmversion" => "QTM Version is 0.0 (tello-ctl sim)".to_owned(),
            "getstate" => return encode::event(EVENT_CONNECTED, &mut self.answers),
            "getparameters" => {
                self.wants_parameters = true;
                return;
            }
            "getcurrentframe" => {
                self.wants_frame = true;
                return;
            }
            "streamframes" => {
                self.wants_every_frame = rest != "stop";
                return;
            }
            _ => {
                encode::text(kind::ERROR, "Command not supported", &mut self.answers);
                return;
            }
        };
        encode::text(kind::COMMAND, &answer, &mut self.answers);
    }
}

#[cfg(test)]
mod tests;
