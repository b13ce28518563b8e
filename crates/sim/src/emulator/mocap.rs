//! The motion capture system in its protocols, side by side.

use std::fmt::Debug;
use std::io;
use std::net::SocketAddr;

use tello_io::mocap::{Body, format_line};

use super::EmulatorError;
use super::clients::Clients;
use super::datastream::DatastreamPort;
use super::natnet::{NatnetPort, NatnetServer};
use super::object_stream::ObjectStreamPort;
use super::qtm::QtmPort;
use super::vrpn::VrpnPort;
use crate::mocap::MocapFrame;

/// Where the emulated motion capture speaks; what is `None` is silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MocapAddresses {
    /// Where the text relay listens. TCP
    pub relay: Option<SocketAddr>,
    /// Where the DataStream server listens. TCP
    pub datastream: Option<SocketAddr>,
    /// Where the object stream is sent to. UDP
    pub udp_target: Option<SocketAddr>,
    /// Where the NatNet server listens, and how it sends. UDP
    pub natnet: Option<NatnetServer>,
    /// Where the server of Qualisys' protocol listens, little-endian. TCP
    pub qtm: Option<SocketAddr>,
    /// Where the VRPN server listens. TCP
    pub vrpn: Option<SocketAddr>,
}

/// The sockets of an emulated motion capture system. Nothing here waits.
#[derive(Debug)]
pub struct MocapServers {
    addresses: MocapAddresses,
    relay: Option<Clients<()>>,
    ports: Vec<Box<dyn Port>>,
    line: Vec<u8>,
}

/// The sockets of one protocol. Nothing in it waits.
pub(super) trait Port: Debug + Send {
    /// Hears the clients and answers them.
    fn receive(&mut self) {}

    /// Sends `frame` to whom it is due, with a second object.
    fn send(&mut self, frame: &MocapFrame<'_>, other: Option<Body<'_>>);
}

impl MocapServers {
    /// Opens the sockets that `asked` names; port 0 takes a free port.
    ///
    /// # Errors
    /// An address that cannot be bound.
    pub fn bind(asked: MocapAddresses) -> Result<Self, EmulatorError> {
        let relay = open("relay", asked.relay, |address| {
            let clients = Clients::bind(address, Vec::new())?;
            Ok((clients.address()?, clients))
        })?;
        let (relay_address, relay) = relay.unzip();
        let mut addresses = MocapAddresses { relay: relay_address, ..asked };
        let mut ports: Vec<Box<dyn Port>> = Vec::new();
        add(&mut ports, "DataStream server", &mut addresses.datastream, DatastreamPort::open)?;
        add(&mut ports, "object stream", &mut addresses.udp_target, ObjectStreamPort::open)?;
        if let Some(server) = asked.natnet {
            let (what, address) = ("NatNet server", server.address);
            let refused = |source| EmulatorError::Bind { what, address, source };
            let port = NatnetPort::bind(server).map_err(refused)?;
            addresses.natnet = Some(port.server);
            ports.push(Box::new(port));
        }
        add(&mut ports, "QTM server", &mut addresses.qtm, QtmPort::open)?;
        add(&mut ports, "VRPN server", &mut addresses.vrpn, VrpnPort::open)?;
        Ok(Self { addresses, relay, ports, line: Vec::new() })
    }

    /// Where clients find them.
    pub fn addresses(&self) -> MocapAddresses {
        self.addresses
    }

    /// Hears the clients and sends them `frames`; nothing but greetings if there are none.
    pub fn push<'a>(&mut self, frames: impl IntoIterator<Item = MocapFrame<'a>>) {
        self.push_with(frames, None);
    }

    /// Hears the clients and sends them `frames`, with a second object in each frame; not by the relay, which has a
    /// line for each object.
    pub fn push_with<'a>(
        &mut self,
        frames: impl IntoIterator<Item = MocapFrame<'a>>,
        other: Option<Body<'_>>,
    ) {
        if let Some(relay) = &mut self.relay {
            relay.accept();
        }
        for port in &mut self.ports {
            port.receive();
        }
        for frame in frames {
            self.push_to_relay(&frame);
            for port in &mut self.ports {
                port.send(&frame, other);
            }
        }
        // What the sockets did not take before.
        if let Some(relay) = &mut self.relay {
            relay.send(|(), _| ());
        }
    }

    /// Sends a line of another object than the vehicle.
    pub(crate) fn push_to_relay(&mut self, frame: &MocapFrame<'_>) {
        if let Some(relay) = &mut self.relay {
            self.line.clear();
            let MocapFrame { number, rate_hz, object, body } = frame;
            format_line(i64::from(*number), *rate_hz, object, body.as_ref(), &mut self.line);
            relay.send(|(), to| to.extend_from_slice(&self.line));
        }
    }
}

/// Result of `bind` for the address, if there is one.
fn open<T>(
    what: &'static str,
    address: Option<SocketAddr>,
    bind: impl FnOnce(SocketAddr) -> io::Result<T>,
) -> Result<Option<T>, EmulatorError> {
    let refused = |address| move |source| EmulatorError::Bind { what, address, source };
    address.map(|address| bind(address).map_err(refused(address))).transpose()
}

/// Opens the port at `address`, if there is one, and notes where it is then.
fn add<P: Port + 'static>(
    ports: &mut Vec<Box<dyn Port>>,
    what: &'static str,
    address: &mut Option<SocketAddr>,
    bind: fn(SocketAddr) -> io::Result<(SocketAddr, P)>,
) -> Result<(), EmulatorError> {
    if let Some((bound, port)) = open(what, *address, bind)? {
        *address = Some(bound);
        ports.push(Box::new(port));
    }
    Ok(())
}

/// Names of what a frame shows.
pub(super) fn names(object: &str, other: Option<Body<'_>>) -> Vec<String> {
    let other = other.map(|other| String::from_utf8_lossy(other.name).into_owned());
    std::iter::once(object.to_owned()).chain(other).collect()
}

#[cfg(test)]
pub(super) mod tests;
