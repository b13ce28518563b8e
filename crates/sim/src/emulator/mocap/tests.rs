use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream, UdpSocket};
use std::time::Duration;

use horizon_model::check::amax;
use horizon_model::rows::Pose;
use serde_json::json;
use tello_io::clock::{SpanNs, TimeNs};
use tello_io::mocap::{MocapCounters, MocapSettings, MocapStream, MocapTable, Sighting};

use super::*;

pub(in crate::emulator) const ANY: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0);

/// The vehicle, and another object.
pub(in crate::emulator) const VEHICLE: Body<'_> =
    Body { name: b"tello", pos_v: [1.0, -2.0, 1.25], angles: [0.0, 0.0, 0.5] };
pub(in crate::emulator) const WAND: Body<'_> =
    Body { name: b"wand", pos_v: [0.5, 0.25, 0.75], angles: [0.0, 0.0, -1.0] };

pub(in crate::emulator) fn frame(number: u32, body: Option<Body<'_>>) -> MocapFrame<'_> {
    MocapFrame { number, rate_hz: 100.0, object: "tello", body }
}

/// The side of a client: sockets that do not wait.
enum Line {
    Tcp(TcpStream),
    Udp(UdpSocket),
}

impl Line {
    fn read(&mut self, bytes: &mut [u8]) -> Option<usize> {
        match self {
            Self::Tcp(socket) => socket.read(bytes).ok().filter(|count| *count > 0),
            Self::Udp(socket) => socket.recv(bytes).ok(),
        }
    }
}

/// A client of the program, at the other end of the protocol `kind`.
pub(in crate::emulator) struct Viewer {
    stream: MocapStream,
    line: Line,
    counters: MocapCounters,
    pub(in crate::emulator) sightings: Vec<Sighting>,
}

impl Viewer {
    /// Of the object `object` at `server`, with the keys that `kind` needs beside them.
    fn new(kind: &str, server: SocketAddr, object: &str, line: Line) -> Self {
        let mut table = json!({ "address": server.to_string(), "object": object });
        if kind == "vrpn" {
            table["rate_hz"] = json!(100.0);
        }
        if kind == "udp" {
            table = json!({ "listen": server.to_string(), "object": object, "rate_hz": 100.0 });
        }
        if kind == "natnet" {
            // The emulated room has z up.
            table["frame"] = json!({ "axes": ["x", "y", "z"] });
        }
        let table: MocapTable = serde_json::from_value(json!({ kind: table })).unwrap();
        let stream = MocapStream::new(&MocapSettings::try_from(&table).unwrap());
        Self { stream, line, counters: MocapCounters::default(), sightings: Vec::new() }
    }

    pub(in crate::emulator) fn tcp(kind: &str, server: SocketAddr, object: &str) -> Self {
        let socket = TcpStream::connect(server).unwrap();
        socket.set_nonblocking(true).unwrap();
        Self::new(kind, server, object, Line::Tcp(socket))
    }

    pub(in crate::emulator) fn udp(kind: &str, server: SocketAddr, object: &str) -> Self {
        let socket = UdpSocket::bind(ANY).unwrap();
        socket.connect(server).unwrap();
        socket.set_nonblocking(true).unwrap();
        Self::new(kind, server, object, Line::Udp(socket))
    }

    /// Reads what has arrived, and answers.
    pub(in crate::emulator) fn turn(&mut self, now: TimeNs) {
        let mut bytes = vec![0; 1 << 16];
        while let Some(count) = self.line.read(&mut bytes) {
            let sightings = &mut self.sightings;
            let heard = &bytes[..count];
            self.stream.push(heard, now, &self.counters, |seen| sightings.push(seen)).unwrap();
        }
        self.stream.beat();
        let mut requests = Vec::new();
        self.stream.take_requests(&mut requests);
        match &mut self.line {
            Line::Tcp(socket) => socket.write_all(&requests).unwrap(),
            Line::Udp(socket) => {
                // Each request has its length behind its kind.
                let mut rest = &requests[..];
                while let [_, _, low, high, ..] = rest {
                    let length = 4 + usize::from(u16::from_le_bytes([*low, *high]));
                    let (request, after) = rest.split_at(length);
                    socket.send(request).unwrap();
                    rest = after;
                }
            }
        }
    }

    /// Whether the newest sighting has `frame` and shows `body`.
    pub(in crate::emulator) fn assert_sees(&self, frame: u32, body: Option<Body<'_>>) {
        let newest = self.sightings.last().expect("nothing was seen");
        assert_eq!(newest.frame, i64::from(frame));
        let [x, y, z] = body.map_or([f64::NAN; 3], |body| body.pos_v);
        match (newest.pose, body) {
            (Some(seen), Some(body)) => {
                let gap = amax(&(seen - Pose::new(x, y, z, body.angles[2])));
                assert!(gap < 1e-4, "{seen} instead of {body:?}");
            }
            (seen, body) => assert_eq!(seen.is_some(), body.is_some(), "{seen:?}"),
        }
    }
}

/// Shows `viewer` thirty frames of the vehicle beside the wand, and then one without the vehicle.
pub(in crate::emulator) fn watch(servers: &mut MocapServers, viewer: &mut Viewer) {
    for number in 1..=31 {
        let body = (number < 31).then_some(VEHICLE);
        servers.push_with([frame(number, body)], Some(WAND));
        viewer.turn(TimeNs(0).after(SpanNs::from_ms(10 * i64::from(number))));
    }
    // A loaded machine may deliver the last frame late.
    for _ in 0..20 {
        if viewer.sightings.last().is_some_and(|seen| seen.frame == 31) {
            break;
        }
        std::thread::sleep(Duration::from_millis(1));
        viewer.turn(TimeNs(0).after(SpanNs::from_ms(310)));
    }
}

#[test]
fn what_is_not_asked_for_has_no_socket_and_a_free_port_is_reported() {
    let servers = MocapServers::bind(MocapAddresses::default()).unwrap();
    assert_eq!(servers.addresses(), MocapAddresses::default());
    let all = MocapAddresses {
        relay: Some(ANY),
        datastream: Some(ANY),
        qtm: Some(ANY),
        vrpn: Some(ANY),
        natnet: Some(NatnetServer::unicast(ANY)),
        udp_target: Some(ANY),
    };
    let found = MocapServers::bind(all).unwrap().addresses();
    let tcp = [found.relay, found.datastream, found.qtm, found.vrpn];
    let mut ports: Vec<u16> = tcp.iter().map(|address| address.unwrap().port()).collect();
    ports.sort_unstable();
    ports.dedup();
    assert!(ports.len() == tcp.len() && ports[0] > 0, "{ports:?}");
    assert!(found.natnet.is_some_and(|server| server.address.port() > 0));
    assert_eq!(found.udp_target, Some(ANY), "a target is no port of ours");
}

#[test]
fn a_port_that_is_taken_is_named_with_its_server() {
    let first = MocapServers::bind(MocapAddresses {
        qtm: Some(ANY),
        natnet: Some(NatnetServer::unicast(ANY)),
        ..MocapAddresses::default()
    });
    let first = first.unwrap();
    let MocapAddresses { qtm, natnet, .. } = first.addresses();
    let refused = |asked| MocapServers::bind(asked).unwrap_err().to_string();
    for (what, asked) in [
        ("relay", MocapAddresses { relay: qtm, ..MocapAddresses::default() }),
        ("DataStream server", MocapAddresses { datastream: qtm, ..MocapAddresses::default() }),
        ("QTM server", MocapAddresses { qtm, ..MocapAddresses::default() }),
        ("VRPN server", MocapAddresses { vrpn: qtm, ..MocapAddresses::default() }),
        ("NatNet server", MocapAddresses { natnet, ..MocapAddresses::default() }),
    ] {
        let message = refused(asked);
        assert!(message.starts_with(&format!("the emulated {what} cannot use")), "{message}");
    }
}

#[test]
fn the_relay_has_a_line_for_each_frame_and_for_the_vehicle_alone() {
    let asked = MocapAddresses { relay: Some(ANY), ..MocapAddresses::default() };
    let mut servers = MocapServers::bind(asked).unwrap();
    let relay = servers.addresses().relay.unwrap();
    let mut vehicle = Viewer::tcp("relay", relay, "tello");
    let mut wand = Viewer::tcp("relay", relay, "wand");
    watch(&mut servers, &mut vehicle);
    wand.turn(TimeNs(0));
    vehicle.assert_sees(31, None);
    assert_eq!(vehicle.sightings.len(), 31);
    assert!(wand.sightings.is_empty());
    servers.push_to_relay(&MocapFrame { object: "wand", ..frame(40, Some(WAND)) });
    wand.turn(TimeNs(0));
    wand.assert_sees(40, Some(WAND));
}

#[test]
fn the_datastream_server_shows_both_objects() {
    let asked = MocapAddresses { datastream: Some(ANY), ..MocapAddresses::default() };
    for (object, body) in [("tello", None), ("wand", Some(WAND))] {
        let mut servers = MocapServers::bind(asked).unwrap();
        let server = servers.addresses().datastream.unwrap();
        let mut viewer = Viewer::tcp("datastream", server, object);
        watch(&mut servers, &mut viewer);
        viewer.assert_sees(31, body);
    }
}

#[test]
fn the_names_of_a_room_are_the_vehicle_first() {
    assert_eq!(names("tello", None), ["tello"]);
    assert_eq!(names("tello", Some(WAND)), ["tello", "wand"]);
}
