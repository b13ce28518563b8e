use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream, UdpSocket};

use super::*;
use crate::Stopper;
use crate::clock::TimeNs;
use crate::mocap::natnet::encode;
use crate::mocap::natnet::packet::{FrameEnd, ServerInfo, Version, id, message};
use crate::mocap::{MocapTable, NatnetTable, ServerTable, UdpTable};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A client with its connection, and the other ends of both.
struct Fixture {
    client: MocapClient,
    feed: MocapFeed,
    wire: Wire,
    stream: MocapStream,
    server: TcpStream,
}

impl Fixture {
    async fn new(kind: fn(ServerTable) -> MocapTable) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap().to_string();
        let table = kind(ServerTable { address, object: "tello".to_owned() });
        let settings = MocapSettings::try_from(&table).unwrap();
        let wire = Connector::new(&settings).open().await.unwrap();
        let stream = MocapStream::new(&settings);
        let (server, _) = listener.accept().await.unwrap();
        let (client, feed) = MocapClient::new(settings, Clock::start());
        Self { client, feed, wire, stream, server }
    }

    /// What is left of the connection after `bytes`, after which the server hangs up or goes on to listen.
    async fn read(mut self, bytes: &[u8], hangs_up: bool) -> MocapFeed {
        self.server.write_all(bytes).await.unwrap();
        let server = (!hangs_up).then_some(self.server);
        let read = self.client.read_connection(self.wire, &mut self.stream);
        timeout(TEST_TIMEOUT, read).await.expect("the connection was not given up");
        drop(server);
        self.feed
    }
}

async fn relay() -> Fixture {
    Fixture::new(MocapTable::Relay).await
}

fn line(frame: usize, object: &str) -> String {
    format!("{frame} 100.0 {object} 0 1.0 -2.0 1.3 0.0 0.0 0.3\n")
}

fn has_arrival(feed: &MocapFeed) -> bool {
    format!("{:?}", feed.arrival) != format!("{:?}", Arrival::new())
}

#[tokio::test]
async fn frames_wait_in_their_order_and_their_arrival_is_noted() {
    let lines: String = (7..10).map(|frame| line(frame, "tello")).collect();
    let mut feed = relay().await.read(lines.as_bytes(), true).await;
    assert!(has_arrival(&feed));
    let frames: Vec<i64> =
        std::iter::from_fn(|| feed.sightings.pop().ok()).map(|sighting| sighting.frame).collect();
    assert_eq!(frames, [7, 8, 9]);
    assert_eq!((feed.counters.messages.get(), feed.counters.overflow.get()), (3, 0));
}

#[tokio::test]
async fn a_message_about_another_object_wakes_no_thread() {
    let feed = relay().await.read(line(7, "wand").as_bytes(), true).await;
    assert_eq!((feed.counters.messages.get(), feed.counters.sightings.get()), (1, 0));
    assert!(!has_arrival(&feed));
}

#[tokio::test]
async fn what_finds_the_queue_full_is_lost_and_counted_and_what_waits_stays() {
    const MORE: usize = 10;
    let lines: String = (0..QUEUE_SIGHTINGS + MORE).map(|frame| line(frame, "tello")).collect();
    let mut feed = relay().await.read(lines.as_bytes(), true).await;
    assert_eq!(feed.counters.overflow.get(), MORE as u64);
    assert_eq!(feed.sightings.slots(), QUEUE_SIGHTINGS);
    assert_eq!(feed.sightings.pop().unwrap().frame, 0);
}

#[tokio::test]
async fn a_stream_that_makes_no_sense_is_given_up_with_its_reason() {
    let fixture = Fixture::new(MocapTable::Datastream).await;
    let feed = fixture.read(&[0xff; 64], false).await;
    assert_eq!(feed.counters.malformed.get(), 1);
    let why = format!("{:?}", feed.counters);
    assert!(why.contains("Magic"), "{why}");
}

#[tokio::test]
async fn a_damaged_length_behind_frames_ends_the_connection_before_poses_count_as_lost() {
    let Fixture { mut client, wire, mut stream, mut server, .. } = relay().await;
    server.write_all(line(7, "tello").as_bytes()).await.unwrap();
    let trickle = async {
        loop {
            if server.write_all(b"1").await.is_err() {
                std::future::pending::<()>().await;
            }
            sleep(Duration::from_millis(20)).await;
        }
    };
    let begun = Clock::start();
    tokio::select! {
        () = client.read_connection(wire, &mut stream) => {}
        () = trickle => {}
    }
    let took_s = begun.now().since(TimeNs(0)).seconds();
    // 0.5 s; a loaded machine may be late.
    assert!((0.4..2.0).contains(&took_s), "{took_s} s");
}

#[tokio::test]
async fn the_task_hears_from_the_control_loop_whether_the_vehicle_flies() {
    let fixture = relay().await;
    assert!(!fixture.client.is_airborne(), "at first it is on the ground");
    for is_airborne in [true, false] {
        fixture.feed.airborne.store(is_airborne, Ordering::Relaxed);
        assert_eq!(fixture.client.is_airborne(), is_airborne);
    }
}

#[tokio::test]
async fn a_natnet_server_that_fell_silent_is_asked_again_within_a_second() {
    let server = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = server.local_addr().unwrap().to_string();
    let table = NatnetTable { address, object: "#7".into(), rate_hz: Some(100.0), frame: None };
    let settings = MocapSettings::try_from(&MocapTable::Natnet(table)).unwrap();
    let (client, _feed) = MocapClient::new(settings, Clock::start());
    let (stopper, stop) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    let mut chunk = [0; 2048];
    let version = Version { major: 4, minor: 1 };
    let (mut bytes, mut client) = (Vec::new(), None);
    while client.is_none() {
        let (count, from) =
            timeout(TEST_TIMEOUT, server.recv_from(&mut chunk)).await.unwrap().unwrap();
        client = message(&chunk[..count]).filter(|(kind, _)| *kind == id::CONNECT).map(|_| from);
    }
    let info = ServerInfo { version, ticks_per_s: 1, group: None };
    encode::server_info(&info, "Motive", &mut bytes);
    server.send_to(&bytes, client.unwrap()).await.unwrap();
    bytes.clear();
    encode::frame(version, 1, &[], &FrameEnd::default(), &mut bytes);
    server.send_to(&bytes, client.unwrap()).await.unwrap();
    let silent = Clock::start();
    let asked_s = loop {
        let count = timeout(TEST_TIMEOUT, server.recv(&mut chunk)).await.unwrap().unwrap();
        if matches!(message(&chunk[..count]), Some((id::CONNECT, _))) {
            break silent.now().since(TimeNs(0)).seconds();
        }
    };
    // Twice 0.25 s; a loaded machine may be late.
    assert!((0.2..1.0).contains(&asked_s), "{asked_s} s");
    stopper.stop();
    task.await.unwrap();
}

#[tokio::test]
async fn a_group_that_cannot_be_joined_has_its_reason_and_ever_longer_pauses() {
    let server = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let address = server.local_addr().unwrap().to_string();
    let table = NatnetTable { address, object: "#7".into(), rate_hz: Some(100.0), frame: None };
    let settings = MocapSettings::try_from(&MocapTable::Natnet(table)).unwrap();
    let (mut client, feed) = MocapClient::new(settings, Clock::start());
    let version = Version { major: 4, minor: 1 };
    // Another program has its port, for itself alone.
    let taken = std::net::UdpSocket::bind("239.255.42.99:0").unwrap();
    let group = Some(taken.local_addr().unwrap().to_string().parse().unwrap());
    let answer = async {
        let mut chunk = [0; 2048];
        loop {
            let (count, from) = server.recv_from(&mut chunk).await.unwrap();
            if matches!(message(&chunk[..count]), Some((id::CONNECT, _))) {
                let mut bytes = Vec::new();
                let info = ServerInfo { version, ticks_per_s: 1, group };
                encode::server_info(&info, "Motive", &mut bytes);
                server.send_to(&bytes, from).await.unwrap();
            }
        }
    };
    // Each attempt begins without a reason: the newest counts.
    let mut why = None;
    let watch = async {
        loop {
            why = feed.counters.unopened().or(why.take());
            sleep(Duration::from_millis(5)).await;
        }
    };
    let read = async { tokio::join!(client.read_forever(), answer, watch) };
    timeout(Duration::from_secs(2), read).await.unwrap_err();
    let connects = feed.counters.connects.get();
    // At 0, 0.1, 0.3, 0.7 and 1.5 s.
    assert!((1..=5).contains(&connects), "{connects}");
    let why = why.unwrap();
    assert!(why.starts_with("the multicast group 239.255.42.99 cannot be joined: "), "{why}");
}

#[tokio::test]
async fn an_order_to_stop_ends_the_task_before_it_connects() {
    let Fixture { client, feed, .. } = relay().await;
    let (stopper, stop) = Stopper::new();
    stopper.stop();
    timeout(TEST_TIMEOUT, client.run(stop)).await.expect("it did not stop");
    assert_eq!(feed.counters.connects.get(), 0);
    assert!(feed.sightings.is_abandoned(), "the queue ends with the task");
}

#[tokio::test]
async fn a_port_of_another_program_is_named_and_a_server_that_is_away_is_not_an_error() {
    let taken = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let listen = taken.local_addr().unwrap().to_string();
    let away =
        MocapTable::Relay(ServerTable { address: "127.0.0.1:9".into(), object: "tello".into() });
    let udp = MocapTable::Udp(UdpTable { listen, object: "tello".into(), rate_hz: 100.0 });
    for (table, expected) in [(udp, true), (away, false)] {
        let settings = MocapSettings::try_from(&table).unwrap();
        let (mut client, feed) = MocapClient::new(settings, Clock::start());
        // Longer than a first attempt, shorter than forever.
        timeout(Duration::from_secs(1), client.read_forever()).await.unwrap_err();
        let why = feed.counters.unopened();
        assert_eq!(why.is_some_and(|why| why.contains("in use")), expected, "{table:?}");
        assert_eq!(feed.counters.connects.get(), 0);
    }
}
