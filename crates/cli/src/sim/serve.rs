//! `tello-ctl sim` without `--batch`: the emulators, for clients of any program.

use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};

use anyhow::Result;
use serde_json::{Value, json};
use tello_sim::{Emulator, MocapAddresses, NatnetServer, SimTable, World};

use super::Arguments;
use crate::{Verdict, interrupt, stdio};

/// Runs the emulators until Ctrl-C.
pub(super) fn run(sim: &SimTable, arguments: &Arguments) -> Result<Verdict> {
    let mut emulators = Vec::new();
    for index in 0..arguments.drones {
        let mut sim = sim.clone();
        if index > 0 {
            sim.object = format!("{}{}", sim.object, u32::from(index) + 1);
        }
        let world = World::new(&sim, arguments.seed.saturating_add(u64::from(index)))?;
        let drone = moved(arguments.drone_address, index);
        let emulator = Emulator::start(world, drone, mocap(arguments, index))?;
        let addresses = addresses(&emulator, &sim.object, arguments);
        if arguments.json {
            stdio::line(addresses)?;
        } else {
            print(&emulator, &sim.object)?;
        }
        emulators.push(emulator);
    }
    if !arguments.json {
        stdio::line("Ctrl-C stops")?;
    }
    let runtime = interrupt::runtime()?;
    runtime.block_on(tokio::signal::ctrl_c())?;
    for emulator in emulators {
        emulator.stop()?;
    }
    Ok(Verdict::Good)
}

/// `address` at the IP address that is `index` further; its port stays.
fn moved(address: SocketAddr, index: u8) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) => {
            IpAddr::V4(Ipv4Addr::from_bits(ip.to_bits().saturating_add(index.into())))
        }
        IpAddr::V6(ip) => {
            IpAddr::V6(Ipv6Addr::from_bits(ip.to_bits().saturating_add(index.into())))
        }
    };
    SocketAddr::new(ip, address.port())
}

fn mocap(arguments: &Arguments, index: u8) -> MocapAddresses {
    let at = |address| moved(address, index);
    MocapAddresses {
        relay: Some(at(arguments.relay_address)),
        datastream: Some(at(arguments.datastream_address)),
        udp_target: Some(at(arguments.udp_target)),
        natnet: Some(NatnetServer {
            group: arguments.natnet_group,
            ..NatnetServer::unicast(at(arguments.natnet_address))
        }),
        qtm: Some(at(arguments.qtm_address)),
        vrpn: Some(at(arguments.vrpn_address)),
    }
}

fn addresses(emulator: &Emulator, object: &str, arguments: &Arguments) -> Value {
    let MocapAddresses { relay, datastream, udp_target, natnet, qtm, vrpn } = emulator.mocap();
    json!({
        "drone": emulator.drone_address(),
        "relay": relay,
        "datastream": datastream,
        "udp_target": udp_target,
        "natnet": natnet.map(|server| server.address),
        "natnet_group": arguments.natnet_group,
        "qtm": qtm,
        "vrpn": vrpn,
        "object": object,
    })
}

fn print(emulator: &Emulator, object: &str) -> Result<()> {
    let MocapAddresses { relay, datastream, udp_target, natnet, qtm, vrpn } = emulator.mocap();
    stdio::line(format_args!("drone on UDP {}", emulator.drone_address()))?;
    stdio::line(format_args!("object {object:?} at {} Hz by", 1.0 / tello_sim::DT_S))?;
    for (what, address) in [
        ("relay on TCP", relay),
        ("DataStream on TCP", datastream),
        ("object stream to UDP", udp_target),
        ("NatNet (OptiTrack) on UDP", natnet.map(|server| server.address)),
        ("QTM (Qualisys) on TCP", qtm),
        ("VRPN on TCP", vrpn),
    ] {
        if let Some(address) = address {
            stdio::line(format_args!("  {what} {address}"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_further_emulator_has_the_next_ip_address_and_the_same_ports() {
        let at = |text: &str| text.parse::<SocketAddr>().unwrap();
        assert_eq!(moved(at("127.0.0.1:801"), 0), at("127.0.0.1:801"));
        assert_eq!(moved(at("127.0.0.255:801"), 2), at("127.0.1.1:801"));
        assert_eq!(moved(at("[::1]:801"), 2), at("[::3]:801"));
        assert_eq!(moved(at("255.255.255.255:801"), 1), at("255.255.255.255:801"), "the last one");
    }
}
