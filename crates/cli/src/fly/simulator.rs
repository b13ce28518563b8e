//! The simulator in place of the hardware: on loopback sockets, with the settings pointed at it.

use std::io;
use std::net::{SocketAddr, UdpSocket};

use anyhow::Result;
use tello_flight::RoomTable;
use tello_io::config::FlyTable;
use tello_io::mocap::MocapTable;
use tello_sim::{Emulator, MocapAddresses, NatnetServer, SdkVersion, SimStart, World};

use super::Arguments;
use crate::{sim, stdio};

/// Starts the simulator on free loopback ports, with the mocap source of the settings, and points the
/// settings at them. In the text SDK its drone knows `port`, whatever its settings are.
pub(super) fn start_simulator(arguments: &Arguments, table: &mut FlyTable) -> Result<Emulator> {
    let mut sim = sim::resolve(arguments.sim_config.as_ref(), arguments.profile)?;
    // An older SDK sends its state line to port 8890 alone; here it shall come to any that is free.
    sim.drone.sdk = SdkVersion::V3_0;
    if let Some(note) = start_note(sim.start, table.cycle.supervisor.room.as_ref()) {
        stdio::note(note);
    }
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
    point_at(&mut table.mocap, emulator.mocap(), &sim.object, sim.mocap_rate_hz);
    Ok(emulator)
}

/// A vehicle that starts nearer to a wall may leave the room in its take-off. m
const START_MARGIN_M: f64 = 0.3;

/// A note of a simulated vehicle that stands where the supervisor lets none fly: `--sim` has no pre-flight list.
fn start_note(start: SimStart, room: Option<&RoomTable>) -> Option<String> {
    let (SimStart::Ground { x, y, .. } | SimStart::Air { x, y, .. }) = start;
    let RoomTable { x_m, y_m, .. } = room?;
    let distances = [(x, x_m), (y, y_m)].map(|(at, [low, high])| (at - low).min(high - at));
    let margin_m = distances.into_iter().fold(f64::INFINITY, f64::min);
    (margin_m < START_MARGIN_M).then(|| {
        let place = if margin_m < 0.0 { "outside of" } else { "at a wall of" };
        format!(
            "note: the simulated vehicle starts at {x:.2}, {y:.2} m, {place} cycle.supervisor.room: give --sim-config \
             with another start"
        )
    })
}

/// Points the settings of a mocap source at the emulated one.
fn point_at(table: &mut MocapTable, emulated: MocapAddresses, object: &str, sent_hz: f64) {
    *table = table.of_object(object);
    table.set_rate_hz(sent_hz);
    let to = |text: &mut String, address: Option<SocketAddr>| {
        if let Some(address) = address {
            *text = address.to_string();
        }
    };
    match table {
        MocapTable::Relay(table) => to(&mut table.address, emulated.relay),
        MocapTable::Datastream(table) => to(&mut table.address, emulated.datastream),
        MocapTable::Udp(table) => to(&mut table.listen, emulated.udp_target),
        // The simulated room has our frame, whatever the real one has.
        MocapTable::Natnet(table) => {
            to(&mut table.address, emulated.natnet.map(|server| server.address));
            (table.rate_hz, table.frame) = (None, None);
        }
        MocapTable::Qtm(table) => {
            to(&mut table.address, emulated.qtm);
            table.frame = None;
        }
        MocapTable::Vrpn(table) => {
            to(&mut table.address, emulated.vrpn);
            table.frame = None;
        }
    }
}

/// A port without a listener, for the client that will be one: the object stream is sent there from the start.
fn free_port(any_port: SocketAddr) -> io::Result<SocketAddr> {
    UdpSocket::bind(any_port)?.local_addr()
}

#[cfg(test)]
mod tests {
    use tello_io::mocap::{FrameTable, NatnetTable, ServerTable, UdpTable, VrpnTable};

    use super::*;

    const SENT_HZ: f64 = 100.0;

    /// The settings `table` of a real room, pointed at a simulated one.
    fn pointed(mut table: MocapTable) -> MocapTable {
        let at = |port| Some(SocketAddr::from(([127, 0, 0, 1], port)));
        let emulated = MocapAddresses {
            relay: at(1),
            udp_target: at(2),
            natnet: at(3).map(NatnetServer::unicast),
            vrpn: at(4),
            ..MocapAddresses::default()
        };
        point_at(&mut table, emulated, "simulated", SENT_HZ);
        table
    }

    #[test]
    fn a_source_is_pointed_at_the_emulated_one_by_address_object_and_rate() {
        let (address, object) = ("room:801".to_owned(), "real".to_owned());
        let server = ServerTable { address, object: object.clone() };
        let (relay, simulated) = ("127.0.0.1:1".to_owned(), "simulated".to_owned());
        let expected = ServerTable { address: relay, object: simulated.clone() };
        assert_eq!(pointed(MocapTable::Relay(server)), MocapTable::Relay(expected));
        let udp = UdpTable { listen: "0.0.0.0:51001".into(), object, rate_hz: 240.0 };
        let expected =
            UdpTable { listen: "127.0.0.1:2".into(), object: simulated, rate_hz: SENT_HZ };
        assert_eq!(pointed(MocapTable::Udp(udp)), MocapTable::Udp(expected));
    }

    #[test]
    fn a_start_at_a_wall_or_outside_has_a_note() {
        let (x_m, y_m, z_m) = ([-2.0, 2.0], [-3.0, 1.0], [0.0, 2.5]);
        let room = RoomTable { x_m, y_m, z_m, stop_s: 1.0 };
        let at = |x, y| start_note(SimStart::Ground { x, y, theta: 0.0 }, Some(&room));
        assert!(at(-2.0, -3.0).unwrap().contains("-2.00, -3.00 m, at a wall of cycle"));
        assert!(at(0.0, 1.5).unwrap().contains("outside of"));
        assert_eq!(at(0.0, -1.0), None);
        assert_eq!(start_note(SimStart::Ground { x: 9.0, y: 9.0, theta: 0.0 }, None), None);
    }

    #[test]
    fn the_frame_of_the_real_room_is_not_that_of_the_simulated_one() {
        let frame = Some(FrameTable::default());
        let (address, object) = ("room:1".to_owned(), "real".to_owned());
        let natnet = NatnetTable {
            address: address.clone(),
            object: object.clone(),
            rate_hz: Some(240.0),
            frame: frame.clone(),
        };
        let expected = NatnetTable {
            address: "127.0.0.1:3".into(),
            object: "simulated".into(),
            rate_hz: None,
            frame: None,
        };
        assert_eq!(pointed(MocapTable::Natnet(natnet)), MocapTable::Natnet(expected));
        let vrpn = VrpnTable { address, object, rate_hz: 240.0, frame };
        let expected = VrpnTable {
            address: "127.0.0.1:4".into(),
            object: "simulated".into(),
            rate_hz: SENT_HZ,
            frame: None,
        };
        assert_eq!(pointed(MocapTable::Vrpn(vrpn)), MocapTable::Vrpn(expected));
    }
}
