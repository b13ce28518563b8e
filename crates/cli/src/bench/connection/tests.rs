use tello_io::clock::SpanNs;
use tello_io::tello::TelloTable;
use tello_io::tello::protocol::{Action, DronePacket, FlightStatus};

use super::*;

const LOOPBACK: (&str, u16) = ("127.0.0.1", 0);

/// A link without a guardian, and the drone's socket at its other end.
pub(in crate::bench) fn link(protocol: Protocol) -> (BenchConnection, UdpSocket) {
    let drone = UdpSocket::bind(LOOPBACK).unwrap();
    drone.set_nonblocking(true).unwrap();
    let table = TelloTable {
        protocol,
        address: drone.local_addr().unwrap().to_string(),
        local_port: 0,
        state_port: 0,
        altitude_limit_m: None,
        interface: None,
    };
    let settings = TelloSettings::try_from(&table).unwrap();
    (BenchConnection::bind(&settings, TestSite::Still).unwrap(), drone)
}

/// A person who asks for nothing, or to stop.
fn person(asks_to_stop: bool) -> Console {
    Console::of(None, asks_to_stop.into())
}

/// Names and numbers of what was sent, in its order.
fn sent(link: &BenchConnection) -> Vec<(&'static str, Option<u16>)> {
    let of = |event: &Event| match event.what {
        BenchEventKind::Sent { packet, sequence, .. } => Some((packet, sequence)),
        _ => None,
    };
    link.events().iter().filter_map(of).collect()
}

/// What has arrived at `socket`, as the record has it.
fn arrived(socket: &UdpSocket) -> Vec<String> {
    let mut buffer = vec![0; DATAGRAM_BYTES_MAX];
    let mut datagrams = Vec::new();
    while let Ok(count) = socket.recv(&mut buffer) {
        datagrams.push(hex(&buffer[..count]));
    }
    datagrams
}

/// Lets `from` send `packet` to the link, which reads it.
fn report(link: &mut BenchConnection, from: &UdpSocket, packet: DronePacket) {
    let mut bytes = Vec::new();
    packet.encode(&mut bytes);
    let port = link.socket.local_addr().unwrap().port();
    from.send_to(&bytes, ("127.0.0.1", port)).unwrap();
    link.receive();
}

fn status(is_flying: bool) -> DronePacket {
    DronePacket::Status { sequence: 0, status: FlightStatus::new(is_flying) }
}

fn ago(link: &BenchConnection, seconds: f64) -> TimeNs {
    link.clock.now().after(SpanNs::from_seconds(-seconds))
}

#[test]
fn each_step_sends_its_packets_and_no_others_and_all_are_written_down() {
    let u = [0.1, 0.0, 0.0, 0.0];
    for (step, expected) in [
        (Step::TakeOff, &[("take_off", Some(1001))][..]),
        (Step::Land, &[("land", Some(1001))]),
        (Step::Emergency, &[("emergency", None), ("emergency", None)]),
        (Step::Hello, &[("hello", None)]),
        (Step::Ask(7), &[("version", Some(7))]),
        (Step::Sticks(u, 0.0), &[("sticks", None)]),
        (Step::Second(u, 0.0), &[("sticks", None), ("sticks", None)]),
        (Step::Quiet(0.0), &[]),
        (Step::Flying(0.0), &[]),
        (Step::Down(0.0), &[]),
    ] {
        let (mut link, drone) = link(Protocol::Binary);
        assert_eq!(link.take(&step, &person(false)), Ok(()), "{step}");
        assert_eq!(sent(&link), expected, "{step}");
        assert!(
            matches!(&link.events()[0].what, BenchEventKind::Step(name) if *name == step.to_string())
        );
        let written: Vec<String> = link
            .events()
            .iter()
            .filter_map(|event| match &event.what {
                BenchEventKind::Sent { bytes, error: None, .. } => Some(bytes.clone()),
                _ => None,
            })
            .collect();
        assert_eq!(arrived(&drone), written, "{step}");
    }
}

#[test]
fn a_second_program_is_another_socket_and_its_sticks_are_not_ours() {
    let (mut link, drone) = link(Protocol::Binary);
    assert_eq!(link.take(&Step::Second([0.5, 0.0, 0.0, 0.0], 0.0), &person(false)), Ok(()));
    let mut buffer = [0; 64];
    let senders = [(); 2].map(|()| drone.recv_from(&mut buffer).unwrap().1.port());
    let port = |socket: &UdpSocket| socket.local_addr().unwrap().port();
    assert_eq!(senders, [port(&link.socket), port(&link.second)]);
    let answer = [0xff; 3];
    drone.send_to(&answer, ("127.0.0.1", port(&link.second))).unwrap();
    link.receive();
    let last = &link.events().last().unwrap().what;
    assert!(matches!(last, BenchEventKind::AtSecond(bytes) if bytes == "ffffff"), "{last:?}");
}

#[test]
fn the_text_sdk_is_asked_no_numbered_question() {
    let (mut link, drone) = link(Protocol::Text);
    assert_eq!(link.take(&Step::Ask(7), &person(false)), Ok(()));
    assert!(sent(&link).is_empty() && arrived(&drone).is_empty());
}

#[test]
fn every_order_has_a_number_of_its_own_also_past_the_largest() {
    let (mut link, _drone) = link(Protocol::Binary);
    link.sequence = u16::MAX - 1;
    for step in [Step::TakeOff, Step::Land, Step::Land] {
        assert_eq!(link.take(&step, &person(false)), Ok(()));
    }
    let numbers: Vec<_> = sent(&link).into_iter().map(|(_, number)| number.unwrap()).collect();
    assert_eq!(numbers, [u16::MAX, 0, 1]);
}

#[test]
fn a_request_to_stop_ends_a_step_before_its_time() {
    for step in [
        Step::Quiet(60.0),
        Step::Sticks([0.1; 4], 60.0),
        Step::Lands { for_s: 60.0, has_same_number: true },
        Step::Down(60.0),
    ] {
        let (mut link, _drone) = link(Protocol::Binary);
        assert_eq!(link.take(&step, &person(true)), Err(Stopped), "{step}");
        assert!(sent(&link).len() <= 1, "{step}");
    }
}

#[test]
fn after_a_request_to_stop_no_drone_is_found_and_no_motor_starts() {
    let (mut link, drone) = link(Protocol::Binary);
    report(&mut link, &drone, status(false));
    assert_eq!(link.connect(&person(true)), Err(Stopped));
    link.begin();
    assert_eq!(link.take(&Step::TakeOff, &person(true)), Err(Stopped));
    assert_eq!(sent(&link), []);
}

#[test]
fn waiting_ends_with_what_is_waited_for() {
    let (mut link, drone) = link(Protocol::Binary);
    report(&mut link, &drone, status(true));
    assert_eq!(link.take(&Step::Flying(60.0), &person(false)), Ok(()));
    report(&mut link, &drone, status(false));
    assert_eq!(link.take(&Step::Down(60.0), &person(false)), Ok(()));
    assert_eq!(
        link.take(&Step::Lands { for_s: 60.0, has_same_number: false }, &person(false)),
        Ok(())
    );
    assert!(sent(&link).is_empty(), "it is down already");
}

#[test]
fn a_drone_that_reports_standing_motors_is_down_only_after_a_take_off_had_its_time() {
    let (mut link, drone) = link(Protocol::Binary);
    assert!(!link.is_over(), "nothing is known");
    report(&mut link, &drone, status(true));
    assert!(!link.is_over());
    report(&mut link, &drone, status(false));
    assert!(link.is_over());
    assert_eq!(link.take(&Step::TakeOff, &person(false)), Ok(()));
    assert!(!link.is_over());
    link.take_off_at = Some(ago(&link, TAKE_OFF_TAIL.seconds() + 0.1));
    assert!(link.is_over());
}

#[test]
fn an_old_status_counts_as_no_status() {
    let (mut link, drone) = link(Protocol::Binary);
    report(&mut link, &drone, status(false));
    let (_, status) = link.newest.unwrap();
    assert_eq!(link.status(), Some(status));
    link.newest = Some((ago(&link, STATUS_FRESH.seconds() + 0.1), status));
    assert_eq!(link.status(), None);
    assert!(!link.is_over(), "a drone that is silent is not down");
}

#[test]
fn no_other_host_speaks_for_the_drone() {
    let (mut link, _drone) = link(Protocol::Binary);
    let stranger = UdpSocket::bind(("127.0.0.2", 0)).unwrap();
    report(&mut link, &stranger, status(false));
    assert!(link.status().is_none() && link.events().is_empty());
    // Some drones report from another of their ports.
    let other_port = UdpSocket::bind(LOOPBACK).unwrap();
    report(&mut link, &other_port, status(false));
    assert!(link.status().is_some());
}

#[test]
fn the_log_that_a_drone_offers_is_asked_for() {
    let (mut link, drone) = link(Protocol::Binary);
    report(&mut link, &drone, DronePacket::LogHeader { sequence: 3, header_id: 0x1234 });
    assert_eq!(sent(&link), [("log_header", None)]);
    assert_eq!(arrived(&drone).len(), 1);
    report(&mut link, &drone, DronePacket::Ack { action: Action::Land, sequence: 5 });
    assert_eq!(arrived(&drone).len(), 0, "an answer is not answered");
}

#[test]
fn a_new_record_is_empty_and_listening_writes_nothing_down_but_keeps_the_status() {
    let (mut link, drone) = link(Protocol::Binary);
    assert_eq!(link.take(&Step::TakeOff, &person(false)), Ok(()));
    link.ending = Some(EndingReport { began_s: 1.0, is_down: true });
    link.begin();
    assert!(link.events().is_empty());
    assert_eq!((link.take_off_at, link.ending), (None, None));
    let mut bytes = Vec::new();
    status(true).encode(&mut bytes);
    let port = link.socket.local_addr().unwrap().port();
    drone.send_to(&bytes, ("127.0.0.1", port)).unwrap();
    link.listen();
    assert!(link.events().is_empty());
    assert!(link.status().is_some_and(|status| status.is_flying));
}

#[test]
fn a_check_that_starts_no_motor_ends_without_a_packet() {
    let (mut link, drone) = link(Protocol::Binary);
    let person = person(false);
    let mut armed = Armed::new(&mut link, TestSite::Still, &person);
    assert_eq!(armed.run(&[Step::Hello, Step::Quiet(0.0)]), Ok(()));
    drop(armed);
    assert_eq!((sent(&link), arrived(&drone).len()), (vec![("hello", None)], 1));
    assert_eq!(link.ending, None);
    assert!(!link.has_lost_guardian());
}
