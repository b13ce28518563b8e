use std::io::{BufRead, BufReader};
use std::net::{Ipv4Addr, TcpStream, UdpSocket};
use std::time::Duration;

use horizon_model::check::amax;
use horizon_model::rows::{Pose, Sticks, pose};
use tello_io::clock::{TimeNs, TimeOfDay};
use tello_io::mocap::parse_line;
use tello_io::tello::protocol::{Action, DronePacket, FlightStatus, HostPacket};

use super::*;
use crate::drone::DronePhase;
use crate::world::tests::table;
use crate::{Profile, SimStart, SimTable};

const ANY: SocketAddr = SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// The nominal drone on a clean day without a breath of wind.
fn emulator(start: SimStart) -> Emulator {
    let mut table = SimTable { profile: Profile::Clean, has_spread: false, start, ..table() };
    table.plant.disturbance_h_mps = 0.0;
    table.plant.disturbance_v_mps = 0.0;
    Emulator::start(World::new(&table, 1).unwrap(), ANY, relay_on(ANY)).unwrap()
}

fn relay_on(address: SocketAddr) -> MocapAddresses {
    MocapAddresses { relay: Some(address), ..MocapAddresses::default() }
}

fn relay_address(emulator: &Emulator) -> SocketAddr {
    emulator.mocap().relay.unwrap()
}

/// A host with a plain socket.
struct Host(UdpSocket);

impl Host {
    fn new(emulator: &Emulator) -> Self {
        let socket = UdpSocket::bind(ANY).unwrap();
        socket.connect(emulator.drone_address()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
        Self(socket)
    }

    fn connected(emulator: &Emulator) -> Self {
        let host = Self::new(emulator);
        host.send(&HostPacket::ConnReq { video_port: 6038 });
        assert_eq!(host.receive(), DronePacket::ConnAck { video_port: 6038 });
        host
    }

    fn send(&self, packet: &HostPacket) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        self.0.send(&bytes).unwrap();
    }

    fn steer(&self, u: Sticks) {
        self.send(&HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() });
    }

    fn receive(&self) -> DronePacket {
        let mut bytes = [0; 2048];
        let length = self.0.recv(&mut bytes).unwrap();
        DronePacket::decode(&bytes[..length]).unwrap()
    }

    /// First of the coming packets that `pick` takes; ten seconds bring about 100.
    fn find<T>(&self, pick: impl Fn(DronePacket) -> Option<T>) -> T {
        (0..100).find_map(|_| pick(self.receive())).expect("no such packet within ten seconds")
    }

    fn status(&self) -> FlightStatus {
        self.find(|packet| match packet {
            DronePacket::Status { status, .. } => Some(status),
            _ => None,
        })
    }

    fn ack(&self) -> (Action, u16) {
        self.find(|packet| match packet {
            DronePacket::Ack { action, sequence } => Some((action, sequence)),
            _ => None,
        })
    }
}

/// Lines of the relay from now on.
fn relay_lines(emulator: &Emulator) -> impl Iterator<Item = String> + use<> {
    let stream = TcpStream::connect(relay_address(emulator)).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    BufReader::new(stream).lines().map(Result::unwrap)
}

fn frame_of(line: &str) -> i64 {
    parse_line(line.as_bytes()).unwrap().frame
}

/// Waits until the truth is as asked for, at most 10 s.
fn wait_for(emulator: &Emulator, is_reached: impl Fn(&Truth) -> bool) -> Truth {
    for _ in 0..1000 {
        let truth = emulator.truth();
        if is_reached(&truth) {
            return truth;
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    panic!("not within 10 s: {:?}", emulator.truth());
}

const IN_THE_AIR: SimStart = SimStart::Air { x: 0.5, y: -0.5, z: 1.3, theta: 0.0 };

#[test]
#[ignore = "seconds of real time: in .ci/run all"]
fn a_host_connects_steers_and_lands() {
    let emulator = emulator(SimStart::Air { x: 0.5, y: -0.5, z: 0.5, theta: 0.0 });
    let host = Host::connected(&emulator);
    let status = host.status();
    assert!(status.is_flying() && (4..=6).contains(&status.height_dm), "{status:?}");
    assert_eq!(status.battery_pct, 90);

    // psi = theta + theta_0 = -0.06: forward is nearly +x, left nearly +y.
    host.steer(Sticks::new(-0.5, 0.5, 0.0, 0.0));
    let truth = wait_for(&emulator, |truth| truth.pose[pose::X] > 0.8);
    assert!(truth.pose[pose::Y] > -0.4, "{truth:?}");

    host.send(&HostPacket::Action { action: Action::Land, sequence: 513 });
    assert_eq!(host.ack(), (Action::Land, 513));
    wait_for(&emulator, |truth| truth.phase == DronePhase::Grounded);
    assert!((0..100).any(|_| host.status().is_on_ground()));
    emulator.stop().unwrap();
}

#[test]
fn a_new_host_is_asked_for_the_time_and_the_log() {
    let emulator = emulator(IN_THE_AIR);
    let host = Host::connected(&emulator);
    assert!(matches!(host.receive(), DronePacket::DateTimeRequest { .. }));
    assert!(matches!(host.receive(), DronePacket::LogHeader { .. }));
    host.find(|packet| match packet {
        DronePacket::WifiStrength { strength_pct: 90, .. } => Some(()),
        _ => None,
    });
}

#[test]
fn strangers_and_garbage_are_not_heard() {
    let emulator = emulator(SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 });
    let host = Host::new(&emulator);
    host.send(&HostPacket::Action { action: Action::TakeOff, sequence: 1 });
    for garbage in [&b"takeoff"[..], b"", b"conn_req:", &[0xCC; 900]] {
        host.0.send(garbage).unwrap();
    }
    let host = Host::connected(&emulator);
    assert_eq!(emulator.truth().phase, DronePhase::Grounded);
    host.send(&HostPacket::Action { action: Action::TakeOff, sequence: 2 });
    assert_eq!(host.ack(), (Action::TakeOff, 2));
    assert_eq!(emulator.truth().phase, DronePhase::TakingOff);
}

#[test]
fn every_client_of_the_relay_sees_the_drone() {
    let emulator = emulator(IN_THE_AIR);
    let (mut first, second) = (relay_lines(&emulator), relay_lines(&emulator));
    let line = first.next().unwrap();
    let seen = parse_line(line.as_bytes()).unwrap();
    assert_eq!(seen.object, "tello");
    // The relay prints four decimals.
    assert!(amax(&(seen.pose().unwrap() - Pose::new(0.5, -0.5, 1.3, 0.0))) < 1e-4, "{line}");
    drop(first);
    let frames: Vec<i64> = second.take(20).map(|line| frame_of(&line)).collect();
    // A machine under load may skip steps, but never repeats or reorders them.
    assert!(frames.is_sorted_by(|a, b| a < b), "{frames:?}");
}

#[test]
fn the_world_keeps_the_pace_of_the_clock() {
    let emulator = emulator(IN_THE_AIR);
    let clock = Clock::start();
    let frames: Vec<(TimeNs, i64)> =
        relay_lines(&emulator).take(51).map(|line| (clock.now(), frame_of(&line))).collect();
    let (&(early, first), &(late, last)) = (frames.first().unwrap(), frames.last().unwrap());
    let lived_s = (last - first) as f64 * crate::DT_S;
    let passed_s = late.since(early).seconds();
    // Of one second; a loaded machine may read either end late.
    assert!((lived_s - passed_s).abs() < 0.25, "{lived_s} s lived in {passed_s} s");
}

#[test]
fn faults_are_switched_live() {
    let emulator = emulator(IN_THE_AIR);
    let mut is_seen =
        relay_lines(&emulator).map(|line| parse_line(line.as_bytes()).unwrap().at.is_some());
    assert_eq!(is_seen.next(), Some(true));
    // Lines on their way are older than the switch.
    emulator.set_fault(InjectedFault::MocapLost, true);
    assert!(is_seen.by_ref().take(200).any(|is_seen| !is_seen));
    emulator.set_fault(InjectedFault::MocapLost, false);
    assert!(is_seen.by_ref().take(200).any(|is_seen| is_seen));

    emulator.set_fault(InjectedFault::DroneDeaf, true);
    let host = Host::new(&emulator);
    host.0.set_read_timeout(Some(Duration::from_millis(100))).unwrap();
    host.send(&HostPacket::ConnReq { video_port: 6038 });
    assert!(host.0.recv(&mut [0; 64]).is_err(), "a drone that ignores packets answered");
}

#[test]
fn a_busy_port_is_refused_with_a_way_out() {
    let first = emulator(IN_THE_AIR);
    let world = World::new(&table(), 1).unwrap();
    let error = Emulator::start(world.clone(), first.drone_address(), relay_on(ANY)).unwrap_err();
    let message = error.to_string();
    let address = first.drone_address().to_string();
    assert!(message.starts_with("the emulated drone cannot use"), "{message}");
    assert!(message.contains(&address) && message.contains("port 0"), "{message}");
    let error = Emulator::start(world, ANY, relay_on(relay_address(&first))).unwrap_err();
    assert!(error.to_string().contains("the emulated relay"), "{error}");
}

#[test]
fn a_stopped_emulator_gives_its_ports_back() {
    let first = emulator(IN_THE_AIR);
    let (drone_address, relay) = (first.drone_address(), relay_address(&first));
    first.stop().unwrap();
    let world = World::new(&table(), 1).unwrap();
    Emulator::start(world, drone_address, relay_on(relay)).unwrap().stop().unwrap();
}

/// Datagram that a host in the text SDK receives within 5 s.
fn text_reply(socket: &UdpSocket) -> Vec<u8> {
    let mut bytes = [0; 2048];
    let length = socket.recv(&mut bytes).unwrap();
    bytes[..length].to_vec()
}

#[test]
fn the_first_answer_in_the_text_sdk_has_a_status_before_it_or_not() {
    for (binary_first, first) in [(true, &b"\xcc\x18\x01\xb9\x88\x56\x00"[..]), (false, b"ok")] {
        let mut table = table();
        table.drone.binary_first = binary_first;
        let emulator = Emulator::start(World::new(&table, 1).unwrap(), ANY, relay_on(ANY)).unwrap();
        let host = Host::new(&emulator).0;
        host.send(b"command").unwrap();
        assert_eq!(text_reply(&host)[..first.len()], *first);
        if binary_first {
            assert_eq!(text_reply(&host), b"ok");
        }
        host.send(b"battery?").unwrap();
        assert_eq!(text_reply(&host), b"90", "one reply for each question");
    }
}

/// Heading, clockwise from above, of the next record of the flight log. rad
fn logged_yaw_rad(host: &Host) -> f64 {
    let mut bytes = [0; 2048];
    for _ in 0..200 {
        let length = host.0.recv(&mut bytes).unwrap();
        let Some(record) = bytes[..length].strip_prefix(b"\xcc") else { continue };
        if record[4..6] == [0x51, 0x10] {
            // 8 bytes of header, a byte to skip, 10 bytes around the record; XORed with its tick.
            assert_eq!((record[9], record[10], length), (0x55, 132, 144));
            let float = |at: usize| {
                let raw = [0, 1, 2, 3].map(|k| record[9 + 10 + at + k] ^ record[15]);
                f64::from(f32::from_le_bytes(raw))
            };
            return 2.0 * float(60).atan2(float(48));
        }
    }
    panic!("no record of the flight log");
}

#[test]
#[ignore = "seconds of real time: in .ci/run all"]
fn the_flight_log_comes_when_its_header_is_acknowledged_and_has_the_heading() {
    let emulator = emulator(IN_THE_AIR);
    let host = Host::connected(&emulator);
    let is_log = |datagram: &[u8]| datagram.get(5..7) == Some(&[0x51, 0x10]);
    let mut bytes = [0; 2048];
    for _ in 0..10 {
        let length = host.0.recv(&mut bytes).unwrap();
        assert!(!is_log(&bytes[..length]), "no host asked for it");
    }
    host.send(&HostPacket::LogHeaderAck { sequence: 1, header_id: 1 });
    let before = (emulator.truth().pose[pose::THETA], logged_yaw_rad(&host));
    host.steer(Sticks::new(0.0, 0.0, 0.6, 0.0));
    wait_for(&emulator, |truth| truth.pose[pose::THETA] > before.0 + 1.0);
    host.steer(Sticks::zeros());
    std::thread::sleep(Duration::from_millis(1500));
    while host.0.set_nonblocking(true).is_ok() && host.0.recv(&mut bytes).is_ok() {}
    host.0.set_nonblocking(false).unwrap();
    let turned = logged_yaw_rad(&host) - before.1;
    let truly = emulator.truth().pose[pose::THETA] - before.0;
    assert!(truly > 0.9 && (turned + truly).abs() < 0.1, "{turned} rad, truly {truly} rad");
}

#[test]
fn a_host_in_the_text_sdk_gets_a_status_an_ok_and_state_lines() {
    let mut table = SimTable {
        profile: Profile::Clean,
        start: SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 },
        ..table()
    };
    table.drone.sdk = crate::SdkVersion::V3_0;
    let emulator = Emulator::start(World::new(&table, 1).unwrap(), ANY, relay_on(ANY)).unwrap();
    let host = Host::new(&emulator).0;
    let state = UdpSocket::bind(ANY).unwrap();
    state.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    host.send(b"command").unwrap();
    assert_eq!(text_reply(&host)[..7], *b"\xcc\x18\x01\xb9\x88\x56\x00");
    assert_eq!(text_reply(&host), b"ok");
    // SDK mode and the binary protocol exclude each other.
    host.send(b"conn_req:\x96\x17").unwrap();
    let port = state.local_addr().unwrap().port();
    host.send(format!("port {port} 11111").as_bytes()).unwrap();
    assert_eq!(text_reply(&host), b"ok");
    let line = String::from_utf8(text_reply(&state)).unwrap();
    assert!(line.starts_with("mid:-2;") && line.contains(";bat:90;"), "{line}");
    host.send(b"battery?").unwrap();
    assert_eq!(text_reply(&host), b"90");
}

#[test]
fn frames_that_are_late_come_late_over_the_socket() {
    let emulator = emulator(IN_THE_AIR);
    let mut lines = relay_lines(&emulator);
    lines.next().unwrap();
    emulator.set_fault(InjectedFault::MocapLag { delay_s: 0.6 }, true);
    let clock = Clock::start();
    let arrivals: Vec<_> =
        lines.by_ref().take(30).map(|line| (clock.now(), frame_of(&line))).collect();
    let times = std::iter::once(TimeNs(0)).chain(arrivals.iter().map(|(at, _)| *at));
    let gaps = times.clone().skip(1).zip(times).map(|(at, before)| at.since(before));
    let gap = gaps.max().unwrap();
    assert!(gap > SpanNs::from_ms(400), "{gap:?} without a line");
    assert!(arrivals.windows(2).all(|pair| pair[1].1 == pair[0].1 + 1), "{arrivals:?}");
}

#[test]
fn a_drone_that_starts_anew_waits_for_a_host_to_ask() {
    let emulator = emulator(IN_THE_AIR);
    let host = Host::connected(&emulator);
    assert!(host.status().is_flying());
    let reboot = InjectedFault::DroneReboot { falls: false };
    emulator.set_fault(reboot, true);
    std::thread::sleep(Duration::from_millis(100));
    emulator.set_fault(reboot, false);
    std::thread::sleep(Duration::from_millis(100));
    let before = emulator.truth().received.sticks;
    host.steer(Sticks::new(0.0, 0.5, 0.0, 0.0));
    std::thread::sleep(Duration::from_millis(100));
    assert_eq!(emulator.truth().received.sticks, before, "it knows no host");
    let host = Host::connected(&emulator);
    assert!(host.status().is_flying());
    host.steer(Sticks::new(0.0, 0.5, 0.0, 0.0));
    wait_for(&emulator, |truth| truth.received.sticks > before);
}
