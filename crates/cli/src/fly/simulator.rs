//! The simulator in place of the hardware: on loopback sockets, with the settings pointed at it.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use anyhow::Result;
use tello_io::config::FlyTable;
use tello_io::mocap::{MocapTable, ServerTable, UdpTable};
use tello_sim::{Emulator, MocapAddresses, NatnetServer, SdkVersion, World};

use super::Arguments;
use crate::sim;

/// Starts the simulator on free loopback ports, with the mocap source of the settings, and points the
/// settings at them. In the text SDK its drone knows `port`, whatever its settings say.
pub(super) fn start_simulator(arguments: &Arguments, table: &mut FlyTable) -> Result<Emulator> {
    let mut sim = sim::resolve(arguments.sim_config.as_ref(), arguments.profile)?;
    // An older SDK sends its state line to port 8890 alone; here it shall come to any that is free.
    sim.drone.sdk = SdkVersion::V3_0;
    let world = World::new(&sim, arguments.seed)?;
    let any_port = ([127, 0, 0, 1], 0).into();
    let silent = MocapAddresses::default();
    let mocap = match &table.mocap {
        MocapTable::Relay(_) => MocapAddresses { relay: Some(any_port), ..silent },
        MocapTable::Datastream(_) => MocapAddresses { datastream: Some(any_port), ..silent },
        MocapTable::Udp(_) => MocapAddresses { udp_target: Some(free_port(any_port)?), ..silent },
        MocapTable::Natnet(_) => {
            MocapAddresses { natnet: Some(NatnetServer::unicast(any_port)), ..silent }
        }
        MocapTable::Qtm(_) => MocapAddresses { qtm: Some(any_port), ..silent },
        MocapTable::Vrpn(_) => MocapAddresses { vrpn: Some(any_port), ..silent },
    };
    let emulator = Emulator::start(world, any_port, mocap)?;
    table.tello.address = emulator.drone_address().to_string();
    table.tello.interface = None;
    table.tello.local_port = 0;
    table.tello.state_port = 0;
    point_at(&mut table.mocap, emulator.mocap(), sim.object, sim.mocap_rate_hz);
    Ok(emulator)
}

/// Points the settings of a mocap source at the emulated one.
fn point_at(table: &mut MocapTable, emulated: MocapAddresses, simulated: String, sent_hz: f64) {
    let to = |text: &mut String, address: Option<SocketAddr>| {
        if let Some(address) = address {
            *text = address.to_string();
        }
    };
    match table {
        MocapTable::Relay(ServerTable { address, object }) => {
            to(address, emulated.relay);
            *object = simulated;
        }
        MocapTable::Datastream(ServerTable { address, object }) => {
            to(address, emulated.datastream);
            *object = simulated;
        }
        MocapTable::Udp(UdpTable { listen, object, rate_hz }) => {
            to(listen, emulated.udp_target);
            *object = simulated;
            *rate_hz = sent_hz;
        }
        // The simulated room has our frame, whatever the real one has.
        MocapTable::Natnet(table) => {
            to(&mut table.address, emulated.natnet.map(|server| server.address));
            (table.object, table.rate_hz, table.frame) = (simulated, None, None);
        }
        MocapTable::Qtm(table) => {
            to(&mut table.address, emulated.qtm);
            (table.object, table.frame) = (simulated, None);
        }
        MocapTable::Vrpn(table) => {
            to(&mut table.address, emulated.vrpn);
            (table.object, table.frame) = (simulated, None);
            table.rate_hz = sent_hz;
        }
    }
}

/// A port on which nobody listens, for the client that will: an object stream is sent there before.
fn free_port(any_port: SocketAddr) -> io::Result<SocketAddr> {
    UdpSocket::bind(any_port)?.local_addr()
}
