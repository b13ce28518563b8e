use std::io::Write;
use std::os::unix::net::UnixStream;

use tokio::time::timeout;

use super::super::guardian::SenderState;
use super::super::protocol::{DronePacket, FlightStatus};
use super::super::tests::table;
use super::super::{Protocol, TelloTable};
use super::*;
use crate::Stopper;
use crate::clock::SpanNs;

/// The guardian's messages: it watches, it has ordered a landing.
const READY: u8 = b'r';
const LANDING_ORDERED: u8 = b'L';

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

fn bind(address: SocketAddr, protocol: Protocol) -> (DroneClient, DroneLink) {
    let settings = TelloSettings::try_from(&TelloTable { protocol, state_port: 0, ..table() });
    // Also one that settings may not have.
    let settings = TelloSettings { address, ..settings.unwrap() };
    DroneClient::bind(&settings, Clock::start(), false).unwrap()
}

/// A drone that only listens, and the address of a port where nothing ever arrives.
fn drone() -> std::net::UdpSocket {
    std::net::UdpSocket::bind(("127.0.0.1", 0)).unwrap()
}

fn link() -> (DroneClient, DroneLink) {
    bind(drone().local_addr().unwrap(), Protocol::Binary)
}

/// The sockets of a client, in a runtime.
fn wire(client: &DroneClient) -> Wire {
    let usable =
        |socket: &std::net::UdpSocket| UdpSocket::from_std(socket.try_clone().unwrap()).unwrap();
    Wire {
        socket: usable(&client.socket),
        state_socket: client.state_socket.as_ref().map(usable),
        address: client.address,
        counters: Arc::clone(&client.counters),
        bytes: Vec::new(),
    }
}

fn status(battery_pct: u8) -> DroneStatus {
    DroneStatus {
        received_at: TimeNs(0),
        is_flying: false,
        is_on_ground: true,
        takes_sticks: true,
        is_battery_low: None,
        is_battery_critical: None,
        battery_pct,
        battery_v: None,
        height_m: None,
        velocity_d_mps: None,
        heading_rad: None,
        flight_mode: None,
    }
}

#[test]
fn orders_that_are_not_sent_yet_hold_up_none_and_an_ended_link_takes_none() {
    let (client, link) = link();
    for _ in 0..QUEUE_ORDERS {
        assert_eq!(link.order(DroneOrder::Land), Ok(()));
    }
    assert_eq!(link.order(DroneOrder::EmergencyStop), Err(OrderError::Busy));
    drop(client);
    assert_eq!(link.order(DroneOrder::EmergencyStop), Err(OrderError::Ended));
}

#[test]
fn of_several_statuses_the_newest_counts_and_once() {
    let (mut client, mut link) = link();
    assert_eq!(link.poll_status(), None);
    for battery_pct in [70, 69, 68] {
        client.statuses.push(status(battery_pct)).unwrap();
    }
    assert_eq!(link.poll_status(), Some(status(68)));
    assert_eq!(link.poll_status(), None);
}

#[test]
fn sticks_that_were_not_sent_are_replaced_by_newer_ones_with_their_time() {
    let (mut client, link) = link();
    assert!(!client.approved.has_changed().unwrap());
    let before = link.clock.now();
    link.send(Approved::neutral(), Some(false));
    link.send(Approved::neutral(), Some(true));
    let HandedOver { pose_is_airborne, at, .. } = *client.approved.borrow_and_update();
    assert_eq!(pose_is_airborne, Some(true));
    assert!(before <= at && at <= link.clock.now());
    assert!(!client.approved.has_changed().unwrap(), "one value, not a queue");
}

#[test]
fn only_the_text_sdk_has_a_socket_for_the_state_line() {
    let address = drone().local_addr().unwrap();
    assert!(bind(address, Protocol::Binary).0.state_socket.is_none());
    let (client, _) = bind(address, Protocol::Text);
    let port = |socket: &std::net::UdpSocket| socket.local_addr().unwrap().port();
    let state = client.state_socket.as_ref().map(port);
    assert!(state.is_some_and(|state| state != port(&client.socket)));
}

#[tokio::test]
async fn commands_are_answered_by_the_drones_port_alone_and_state_lines_by_any_port_of_it() {
    let (drone, other_port) = (drone(), drone());
    let stranger = std::net::UdpSocket::bind(("127.0.0.2", 0)).unwrap();
    let (client, link) = bind(drone.local_addr().unwrap(), Protocol::Text);
    let wire = wire(&client);
    let mut buffer = [0; 16];
    let to = ("127.0.0.1", client.socket.local_addr().unwrap().port());
    for (from, word) in [(&stranger, b"no"), (&other_port, b"no"), (&drone, b"ok")] {
        from.send_to(word, to).unwrap();
    }
    assert_eq!(wire.receive(&mut buffer).await, b"ok");
    assert_eq!(link.counters.malformed.get(), 2);
    let state_socket = client.state_socket.as_ref().unwrap();
    let to = ("127.0.0.1", state_socket.local_addr().unwrap().port());
    stranger.send_to(b"no", to).unwrap();
    other_port.send_to(b"ok", to).unwrap();
    assert_eq!(wire.receive_state(&mut buffer).await, b"ok");
    assert_eq!(link.counters.malformed.get(), 3);
}

#[tokio::test]
async fn a_datagram_that_the_system_refuses_is_counted_and_reported() {
    // Nothing can be sent to port 0.
    for (address, all, errors) in [
        (drone().local_addr().unwrap(), true, 0),
        (SocketAddr::from(([127, 0, 0, 1], 0)), false, 1),
    ] {
        let (mut client, link) = bind(address, Protocol::Binary);
        let mut wire = wire(&client);
        let sent = wire.send_all(&mut client.session).await;
        assert_eq!((sent.any, sent.all), (false, true), "nothing is due");
        client.session.advance(client.clock.now());
        let sent = wire.send_all(&mut client.session).await;
        assert_eq!((sent.any, sent.all), (true, all), "{address}");
        assert_eq!(link.counters.socket_errors.get(), errors, "{address}");
    }
}

#[tokio::test]
async fn statuses_that_find_the_queue_full_are_counted() {
    let (mut client, link) = link();
    let wire = wire(&client);
    wire.hand_on(None, &mut client.statuses);
    for _ in 0..QUEUE_STATUSES + 2 {
        wire.hand_on(Some(status(50)), &mut client.statuses);
    }
    assert_eq!(link.counters.overflow.get(), 2);
}

/// A client whose session may steer, and its guardian's end of the channel.
fn guarded(now: TimeNs) -> (DroneClient, DroneLink, UnixStream) {
    let (mut client, link) = link();
    let channel = client.start_guardian(|post| {
        let mut channel = post.channel;
        channel.write_all(&[READY])?;
        Ok(channel)
    });
    // The drone answers, stands, and is ordered to take off.
    client.session.advance(now);
    let standing = DronePacket::Status { sequence: 0, status: FlightStatus::new(false) };
    for packet in [DronePacket::ConnAck { video_port: 6038 }, standing] {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        client.session.receive(&bytes, now);
    }
    client.session.order(DroneOrder::TakeOff, now);
    assert_eq!(client.session.sender_state(now), SenderState::Steering);
    client.heartbeat.beat(SenderState::Steering, now);
    (client, link, channel.unwrap())
}

#[tokio::test]
async fn a_guardian_that_watches_changes_nothing() {
    let now = TimeNs(0);
    let (mut client, link, _channel) = guarded(now);
    let wire = wire(&client);
    wire.ask_guardian(&mut client.heartbeat, &mut client.session, now.after(SpanNs::from_ms(40)));
    assert_eq!(client.session.sender_state(now), SenderState::Steering);
    let LinkCounters { guardian_landings, guardians_lost, .. } = &*link.counters;
    assert_eq!((guardian_landings.get(), guardians_lost.get()), (0, 0));
    assert_eq!(link.counters.longest_pause(), SpanNs::from_ms(40));
}

#[tokio::test]
async fn a_landing_of_the_guardian_and_its_loss_are_gone_on_with_and_counted_apart() {
    let landed = |mut channel: UnixStream| {
        channel.write_all(&[LANDING_ORDERED]).unwrap();
        Some(channel)
    };
    let lost = |channel: UnixStream| {
        drop(channel);
        None
    };
    for (act, counts) in [(landed as fn(UnixStream) -> Option<UnixStream>, (1, 0)), (lost, (0, 1))]
    {
        let now = TimeNs(0);
        let (mut client, link, channel) = guarded(now);
        let wire = wire(&client);
        let _channel = act(channel);
        wire.ask_guardian(&mut client.heartbeat, &mut client.session, now);
        let LinkCounters { guardian_landings, guardians_lost, .. } = &*link.counters;
        assert_eq!((guardian_landings.get(), guardians_lost.get()), counts);
        assert_eq!(client.session.sender_state(now), SenderState::Landing, "no stick follows");
    }
}

#[tokio::test]
async fn a_client_that_is_stopped_on_the_ground_ends_and_its_link_with_it() {
    let (client, link) = link();
    let (stopper, stop) = Stopper::new();
    stopper.stop();
    timeout(TEST_TIMEOUT, client.run(stop)).await.expect("it did not stop").unwrap();
    assert_eq!(link.order(DroneOrder::Land), Err(OrderError::Ended));
}
