use super::super::mocap::tests::{ANY, VEHICLE, Viewer, WAND, watch};
use super::super::{MocapAddresses, MocapServers};
use super::*;

/// A client's description of a type, after its greeting.
fn describes(number: i32, name: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    describe(kind::TYPE, number, str::from_utf8(name).unwrap(), &mut bytes);
    bytes
}

fn empty_message(kind: i32) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::message(&VrpnMessage { time_s: 0.0, sender: 0, kind, body: &[] }, &mut bytes);
    bytes
}

/// A session that has greeted.
fn session() -> VrpnSession {
    let mut session = VrpnSession::default();
    let mut cookie = Vec::new();
    encode::cookie(&mut cookie);
    session.receive(&cookie).unwrap();
    session
}

#[test]
fn each_object_is_a_tracker_and_one_that_is_not_seen_is_not_reported() {
    let asked = MocapAddresses { vrpn: Some(ANY), ..MocapAddresses::default() };
    // The vehicle is missing in the last of the frames.
    for (object, body, count) in [("tello", VEHICLE, 30), ("wand", WAND, 31)] {
        let mut servers = MocapServers::bind(asked).unwrap();
        let mut viewer = Viewer::tcp("vrpn", servers.addresses().vrpn.unwrap(), object);
        watch(&mut servers, &mut viewer);
        let seen = viewer.sightings.iter().filter(|seen| seen.pose.is_some()).count();
        assert!(seen <= count && count - seen <= 3, "{seen} of {count} frames of {object}");
        let newest = viewer.sightings.last().and_then(|seen| seen.pose).unwrap();
        assert!((newest[0] - body.pos_v[0]).abs() < 1e-6, "{newest}");
    }
}

#[test]
fn a_ping_is_answered_by_the_number_that_the_client_gave_it() {
    let mut session = session();
    session.receive(&empty_message(7)).unwrap();
    assert!(!session.wants_pong, "nothing is known of 7");
    session.receive(&describes(7, PING)).unwrap();
    session.receive(&describes(8, b"vrpn_Tracker Pos_Quat")).unwrap();
    session.receive(&empty_message(8)).unwrap();
    assert!(!session.wants_pong);
    session.receive(&empty_message(7)).unwrap();
    assert!(session.wants_pong);
}

#[test]
fn a_client_that_describes_types_without_end_takes_no_more_memory() {
    let mut session = session();
    for number in 0..2 * TYPES_MAX {
        session.receive(&describes(i32::try_from(number).unwrap(), PING)).unwrap();
    }
    assert_eq!(session.pings.len(), TYPES_MAX);
}

#[test]
fn what_is_no_vrpn_ends_the_connection() {
    assert!(VrpnSession::default().receive(b"GET / HTTP/1.1\r\nHost: localhost\r\n").is_err());
}
