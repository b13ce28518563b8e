use std::net::Ipv4Addr;

use tello_io::tello::protocol::{Action, FlightStatus};

use super::*;
use crate::drone::DronePhase;
use crate::fault::{InjectedFault, ScriptedFault};
use crate::world::tests::table;
use crate::{Profile, SimStart, SimTable};

const ANY: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);
const CONNECT: HostPacket = HostPacket::ConnReq { video_port: 6038 };
const TAKE_OFF: HostPacket = HostPacket::Action { action: Action::TakeOff, sequence: 7 };

/// A drone on the floor and a host, stepped by hand: datagrams on the loopback are there at once.
struct Fixture {
    world: World,
    port: DronePort,
    host: UdpSocket,
}

impl Fixture {
    fn new(faults: Vec<ScriptedFault>) -> Self {
        let start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.4 };
        let table = SimTable { profile: Profile::Clean, start, faults, ..table() };
        let world = World::new(&table, 1).unwrap();
        let port = DronePort::bind(ANY, &world).unwrap();
        let host = UdpSocket::bind(ANY).unwrap();
        host.connect(port.address().unwrap()).unwrap();
        host.set_nonblocking(true).unwrap();
        Self { world, port, host }
    }

    fn send(&self, packet: &HostPacket) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        self.host.send(&bytes).unwrap();
    }

    /// Datagrams that arrive in `steps` steps.
    fn step(&mut self, steps: u32) -> Vec<Vec<u8>> {
        let mut received = Vec::new();
        for _ in 0..steps {
            self.port.receive(&mut self.world);
            self.world.advance();
            self.port.report(&mut self.world);
            let mut bytes = [0; 2048];
            while let Ok(length) = self.host.recv(&mut bytes) {
                received.push(bytes[..length].to_vec());
            }
        }
        received
    }

    /// Packets that arrive in `steps` steps.
    fn packets(&mut self, steps: u32) -> Vec<DronePacket> {
        self.step(steps).iter().map(|bytes| DronePacket::decode(bytes).unwrap()).collect()
    }
}

fn statuses(packets: &[DronePacket]) -> Vec<&FlightStatus> {
    let statuses = packets.iter().filter_map(|packet| match packet {
        DronePacket::Status { status, .. } => Some(status),
        _ => None,
    });
    statuses.collect()
}

#[test]
fn nothing_is_heard_or_sent_before_a_request_for_a_connection() {
    let mut fixture = Fixture::new(Vec::new());
    fixture.send(&TAKE_OFF);
    fixture.host.send(b"takeoff").unwrap();
    assert!(fixture.step(60).is_empty() && fixture.port.host.is_none());
    assert_eq!(fixture.world.truth().phase, DronePhase::Grounded);
    fixture.send(&CONNECT);
    let packets = fixture.packets(1);
    assert_eq!(packets[0], DronePacket::ConnAck { video_port: 6038 });
    assert!(matches!(packets[1], DronePacket::DateTimeRequest { .. }), "{packets:?}");
    fixture.send(&TAKE_OFF);
    let ack = DronePacket::Ack { action: Action::TakeOff, sequence: 7 };
    assert!(fixture.packets(1).contains(&ack));
}

#[test]
fn a_status_goes_out_ten_times_per_second_and_the_link_once() {
    let mut fixture = Fixture::new(Vec::new());
    fixture.send(&CONNECT);
    fixture.packets(1);
    let packets = fixture.packets(100);
    let wifi = packets.iter().filter(|packet| matches!(packet, DronePacket::WifiStrength { .. }));
    assert_eq!((statuses(&packets).len(), wifi.count()), (20, 2));
    // No host asked for the log. Its records are none of the packets that are decoded.
    let is_log = |datagram: &&Vec<u8>| datagram.get(5..7) == Some(&[0x51, 0x10][..]);
    assert_eq!(fixture.step(50).iter().filter(is_log).count(), 0);
    fixture.send(&HostPacket::LogHeaderAck { sequence: 1, header_id: LOG_HEADER_ID });
    assert_eq!(fixture.step(50).iter().filter(is_log).count(), 10);
}

#[test]
fn a_deaf_drone_obeys_nothing_and_a_mute_one_reports_nothing() {
    let fault = |fault, from_s| ScriptedFault { fault, from_s, for_s: 1.0 };
    let mut fixture = Fixture::new(vec![
        fault(InjectedFault::DroneDeaf, 0.2),
        fault(InjectedFault::DroneMute, 1.2),
    ]);
    fixture.send(&CONNECT);
    fixture.packets(12);
    fixture.send(&TAKE_OFF);
    assert!(!statuses(&fixture.packets(30)).is_empty());
    assert_eq!(fixture.world.truth().phase, DronePhase::Grounded);
    fixture.packets(20);
    fixture.send(&TAKE_OFF);
    assert!(fixture.packets(20).is_empty());
    assert_eq!(fixture.world.truth().phase, DronePhase::TakingOff);
    let mut fixture = Fixture::new(vec![fault(InjectedFault::DroneDeaf, 0.0)]);
    fixture.send(&CONNECT);
    assert!(fixture.packets(100).is_empty(), "a request for a connection is not heard either");
}

#[test]
fn a_text_host_is_no_host_of_packets_until_the_drone_starts_anew() {
    let mut fixture = Fixture::new(Vec::new());
    fixture.host.send(b"command").unwrap();
    let first = fixture.step(1);
    assert!(first.iter().any(|reply| reply == b"ok"), "{first:?}");
    fixture.send(&CONNECT);
    fixture.host.send(b"\xcc\x60 no text").unwrap();
    assert!(fixture.step(20).is_empty());
    fixture.world.set_connected(false);
    fixture.send(&CONNECT);
    let ack = DronePacket::ConnAck { video_port: 6038 };
    assert!(fixture.packets(1).contains(&ack));
}

#[test]
fn some_drones_answer_to_one_port_only() {
    let mut fixture = Fixture::new(Vec::new());
    let from: SocketAddr = "192.168.10.2:51234".parse().unwrap();
    assert_eq!(fixture.port.answer_to(from), from);
    fixture.port.table.reply_to = ReplyTo::Port8889;
    assert_eq!(fixture.port.answer_to(from), "192.168.10.2:8889".parse().unwrap());
}
