//! The motion capture system in its protocols, side by side.

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
use crate::mocap::Shot;

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
    datastream: Option<DatastreamPort>,
    object_stream: Option<ObjectStreamPort>,
    natnet: Option<NatnetPort>,
    qtm: Option<QtmPort>,
    vrpn: Option<VrpnPort>,
    line: Vec<u8>,
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
        let datastream = open("DataStream server", asked.datastream, DatastreamPort::open)?;
        let object_stream = open("object stream", asked.udp_target, ObjectStreamPort::open)?;
        let natnet = asked.natnet.map(|server| {
            let refused = |source| EmulatorError::Bind {
                what: "NatNet server",
                address: server.address,
                source,
            };
            NatnetPort::bind(server).map_err(refused)
        });
        let natnet = natnet.transpose()?;
        let qtm = open("QTM server", asked.qtm, QtmPort::open)?;
        let vrpn = open("VRPN server", asked.vrpn, VrpnPort::open)?;
        let (qtm_address, qtm) = qtm.unzip();
        let (vrpn_address, vrpn) = vrpn.unzip();
        let (relay_address, relay) = relay.unzip();
        let (datastream_address, datastream) = datastream.unzip();
        let addresses = MocapAddresses {
            relay: relay_address,
            datastream: datastream_address,
            udp_target: asked.udp_target,
            natnet: natnet.as_ref().map(NatnetPort::server),
            qtm: qtm_address,
            vrpn: vrpn_address,
        };
        let line = Vec::new();
        Ok(Self { addresses, relay, datastream, object_stream, natnet, qtm, vrpn, line })
    }

    /// Where clients find them.
    pub fn addresses(&self) -> MocapAddresses {
        self.addresses
    }

    /// Hears the clients and sends them `shots`; nothing but greetings if there are none.
    pub fn push<'a>(&mut self, shots: impl IntoIterator<Item = Shot<'a>>) {
        self.push_with(shots, None);
    }

    /// The same with a second object in each shot, but not by the relay, which has a line for each object.
    pub fn push_with<'a>(
        &mut self,
        shots: impl IntoIterator<Item = Shot<'a>>,
        other: Option<Body<'_>>,
    ) {
        if let Some(relay) = &mut self.relay {
            relay.accept();
        }
        if let Some(datastream) = &mut self.datastream {
            datastream.receive();
        }
        if let Some(natnet) = &mut self.natnet {
            natnet.receive();
        }
        if let Some(qtm) = &mut self.qtm {
            qtm.receive();
        }
        if let Some(vrpn) = &mut self.vrpn {
            vrpn.receive();
        }
        for shot in shots {
            self.send(&shot, other);
        }
        // What the sockets did not take before.
        if let Some(relay) = &mut self.relay {
            relay.send(|(), _| ());
        }
    }

    /// Sends a line of another object than the vehicle.
    pub(crate) fn push_to_relay(&mut self, shot: &Shot<'_>) {
        if let Some(relay) = &mut self.relay {
            self.line.clear();
            let Shot { frame, rate_hz, object, body } = shot;
            let frame = i64::from(*frame);
            format_line(frame, *rate_hz, object, body.as_ref(), &mut self.line);
            relay.send(|(), to| to.extend_from_slice(&self.line));
        }
    }

    fn send(&mut self, shot: &Shot<'_>, other: Option<Body<'_>>) {
        self.push_to_relay(shot);
        if let Some(datastream) = &mut self.datastream {
            datastream.send(shot, other);
        }
        if let Some(object_stream) = &mut self.object_stream {
            object_stream.push(shot, other);
        }
        if let Some(natnet) = &mut self.natnet {
            natnet.send(shot, other);
        }
        if let Some(qtm) = &mut self.qtm {
            qtm.send(shot, other);
        }
        if let Some(vrpn) = &mut self.vrpn {
            vrpn.send(shot, other);
        }
    }
}

/// What `bind` makes of the address, if there is one.
fn open<T>(
    what: &'static str,
    address: Option<SocketAddr>,
    bind: impl FnOnce(SocketAddr) -> io::Result<T>,
) -> Result<Option<T>, EmulatorError> {
    let refused = |address| move |source| EmulatorError::Bind { what, address, source };
    address.map(|address| bind(address).map_err(refused(address))).transpose()
}

/// Names of what a shot shows.
pub(super) fn names(object: &str, other: Option<Body<'_>>) -> Vec<String> {
    let other = other.map(|other| String::from_utf8_lossy(other.name).into_owned());
    std::iter::once(object.to_owned()).chain(other).collect()
}

#[cfg(test)]
pub(super) mod tests;
