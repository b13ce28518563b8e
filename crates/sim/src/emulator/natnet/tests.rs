use tello_io::mocap::natnet::packet::{number, server_info};

use super::super::mocap::tests::{ANY, VEHICLE, Viewer, WAND, frame, watch};
use super::super::{MocapAddresses, MocapServers};
use super::*;

/// A server, and the socket of a client that does not wait.
fn fixture() -> (NatnetPort, UdpSocket) {
    let server = NatnetPort::bind(NatnetServer::unicast(ANY)).unwrap();
    let client = UdpSocket::bind(ANY).unwrap();
    client.connect(server.server.address).unwrap();
    client.set_nonblocking(true).unwrap();
    (server, client)
}

/// Kinds and bodies of what has arrived at the client.
fn arrived(client: &UdpSocket) -> Vec<(u16, Vec<u8>)> {
    let mut bytes = [0; 4096];
    let mut messages = Vec::new();
    while let Ok(count) = client.recv(&mut bytes) {
        let (kind, body) = message(&bytes[..count]).unwrap();
        messages.push((kind, body.to_vec()));
    }
    messages
}

fn ask(server: &mut NatnetPort, client: &UdpSocket, kind: u16, body: &[u8]) -> Vec<(u16, Vec<u8>)> {
    let mut bytes = Vec::new();
    encode::request(kind, body, &mut bytes);
    client.send(&bytes).unwrap();
    server.receive();
    arrived(client)
}

#[test]
fn a_client_sees_both_objects_and_that_one_is_not_tracked() {
    for (object, body) in [("tello", None), ("wand", Some(WAND)), ("#2", Some(WAND))] {
        let natnet = Some(NatnetServer::unicast(ANY));
        let mut servers =
            MocapServers::bind(MocapAddresses { natnet, ..MocapAddresses::default() }).unwrap();
        let server = servers.addresses().natnet.unwrap().address;
        let mut viewer = Viewer::udp("natnet", server, object);
        watch(&mut servers, &mut viewer);
        viewer.assert_sees(31, body);
    }
}

#[test]
fn who_asks_receives_version_and_ticks_and_later_the_rate() {
    let (mut server, client) = fixture();
    let answers = ask(&mut server, &client, id::CONNECT, b"");
    let [(_, body)] = &answers[..] else { panic!("{answers:?}") };
    let info = server_info(body).unwrap();
    assert_eq!((info.version, info.group), (Version { major: 4, minor: 1 }, None));
    assert_eq!(info.ticks_per_s, TICKS_PER_S);
    // Before the first frame it is not known what is in the room.
    assert!(ask(&mut server, &client, id::REQUEST, b"FrameRate").is_empty());
    assert!(ask(&mut server, &client, id::REQUEST_MODELDEF, b"").is_empty());
    server.send(&frame(1, Some(VEHICLE)), None);
    arrived(&client);
    let answers = ask(&mut server, &client, id::REQUEST, b"FrameRate\0");
    let [(id::RESPONSE, body)] = &answers[..] else { panic!("{answers:?}") };
    assert_eq!(number(body), Some(100.0));
    assert!(ask(&mut server, &client, id::REQUEST, b"Shutdown").is_empty());
    assert_eq!(ask(&mut server, &client, id::REQUEST_MODELDEF, b"")[0].0, id::MODELDEF);
}

#[test]
fn frames_go_to_whom_has_asked_within_ten_seconds() {
    let (mut server, client) = fixture();
    let slow = MocapFrame { rate_hz: 1.0, ..frame(1, Some(VEHICLE)) };
    server.send(&slow, None);
    assert!(arrived(&client).is_empty(), "it has not asked");
    ask(&mut server, &client, id::KEEPALIVE, b"");
    let frames = |server: &mut NatnetPort, count: u32| {
        for _ in 0..count {
            server.send(&slow, None);
        }
        arrived(&client).len()
    };
    assert_eq!(frames(&mut server, 20), 10);
    for _ in 0..3 {
        ask(&mut server, &client, id::KEEPALIVE, b"");
        assert_eq!(frames(&mut server, 7), 7, "a sign of life brings it back and keeps it");
    }
}

#[test]
fn clients_beyond_the_most_are_not_served() {
    let (mut server, first) = fixture();
    ask(&mut server, &first, id::KEEPALIVE, b"");
    for _ in 0..CLIENTS_MAX + 4 {
        let client = UdpSocket::bind(ANY).unwrap();
        client.connect(server.server.address).unwrap();
        client.set_nonblocking(true).unwrap();
        ask(&mut server, &client, id::KEEPALIVE, b"");
    }
    assert_eq!(server.clients.len(), CLIENTS_MAX);
    ask(&mut server, &first, id::KEEPALIVE, b"");
    assert_eq!(server.clients.len(), CLIENTS_MAX, "a known one takes no second place");
}

#[test]
fn a_body_that_is_not_seen_stays_in_the_frame_without_a_place() {
    let RigidBody { id, is_tracked, pos_v, .. } = rigid(OBJECT_ID, None);
    assert_eq!((id, is_tracked, pos_v), (OBJECT_ID, false, [0.0; 3]));
    let seen = rigid(OTHER_ID, Some(VEHICLE));
    assert_eq!((seen.id, seen.is_tracked, seen.pos_v), (OTHER_ID, true, VEHICLE.pos_v));
    // Half of 0.5 rad about the vertical.
    assert!((seen.quaternion[2] - 0.25_f64.sin()).abs() < 1e-12, "{:?}", seen.quaternion);
}
