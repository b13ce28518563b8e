//! Every mocap source over loopback sockets, against servers that do what servers do in the field.

use std::net::SocketAddr;
use std::time::Duration;

use horizon_model::check::amax;
use horizon_model::rows::Pose;
use tello_io::Stopper;
use tello_io::clock::{Clock, TimeNs};
use tello_io::mocap::datastream::{encode, id};
use tello_io::mocap::object_stream::encode_block;
use tello_io::mocap::{
    Body, MocapClient, MocapFeed, MocapSettings, MocapTable, ServerTable, Sighting, SourceError,
    UdpTable,
};
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream, UdpSocket};
use tokio::time::{sleep, timeout};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(15);

/// After so long without a message a server is connected anew, by docs/protocol.md.
const SILENCE: Duration = Duration::from_secs(5);

const BODY: Body<'static> =
    Body { name: b"tello", pos_v: [1.0, -2.0, 1.3], angles: [0.0, 0.0, 0.3] };

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn start(table: &MocapTable) -> (MocapFeed, Stopper) {
    let (client, feed) = MocapClient::new(MocapSettings::try_from(table).unwrap(), Clock::start());
    let (stopper, stop) = Stopper::new();
    tokio::spawn(client.run(stop));
    (feed, stopper)
}

fn datastream(address: SocketAddr) -> MocapTable {
    MocapTable::Datastream(at(address))
}

fn at(address: SocketAddr) -> ServerTable {
    ServerTable { address: address.to_string(), object: "tello".to_owned() }
}

#[expect(clippy::expect_used, reason = "a test may panic")]
async fn take(feed: &mut MocapFeed, count: usize) -> Vec<Sighting> {
    let mut sightings = Vec::new();
    let fill = async {
        while sightings.len() < count {
            match feed.sightings.pop() {
                Ok(sighting) => sightings.push(sighting),
                Err(_) => sleep(Duration::from_millis(1)).await,
            }
        }
    };
    timeout(TEST_TIMEOUT, fill).await.expect("sightings are missing");
    sightings
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
async fn accept(listener: &TcpListener) -> TcpStream {
    timeout(TEST_TIMEOUT, listener.accept()).await.expect("no connection").unwrap().0
}

fn packet(fill: impl FnOnce(&mut encode::Packet<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode::packet(&mut bytes, fill);
    bytes
}

/// A DataStream packet of `frame` at 100 Hz with one subject.
fn frame(number: u32, subject: &[u8]) -> Vec<u8> {
    packet(|packet| {
        packet.stream_info(100.0);
        packet.subject_info(1, subject);
        packet.frame_info(number);
        packet.segments(id::GLOBAL_SEGMENTS, 1, &BODY);
    })
}

/// Greets a DataStream client and hears what it wants.
#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
async fn greet(listener: &TcpListener) -> TcpStream {
    let mut client = accept(listener).await;
    let ids = [1, 2, 5, 9, 100_004];
    let greeting = packet(|packet| packet.object_enums(&ids));
    client.write_all(&greeting).await.unwrap();
    let mut expected = greeting;
    expected.extend(packet(|packet| packet.request_frame(true)));
    let mut answer = vec![0; expected.len()];
    timeout(TEST_TIMEOUT, client.read_exact(&mut answer)).await.expect("no answer").unwrap();
    assert_eq!(answer, expected);
    client
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
async fn listen() -> (TcpListener, SocketAddr) {
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap();
    (listener, address)
}

fn frames(sightings: &[Sighting]) -> Vec<i64> {
    sightings.iter().map(|sighting| sighting.frame).collect()
}

#[tokio::test]
async fn an_object_stream_arrives_with_losses_and_overtaken_datagrams() {
    // A port that was free a moment ago.
    let listen = UdpSocket::bind("127.0.0.1:0").await.unwrap().local_addr().unwrap();
    let table = UdpTable { listen: listen.to_string(), object: "tello".into(), rate_hz: 100.0 };
    let (mut feed, _stopper) = start(&MocapTable::Udp(table));
    let sender = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let wand = Body { name: b"wand", ..BODY };
    let blocks: [(u32, &[Body<'_>]); 5] =
        [(1, &[wand, BODY]), (2, &[wand]), (4, &[BODY]), (3, &[BODY]), (5, &[BODY])];
    while feed.counters.connects.get() == 0 {
        sleep(Duration::from_millis(1)).await;
    }
    for (number, bodies) in blocks {
        let mut block = Vec::new();
        encode_block(number, bodies, 512, &mut block);
        sender.send_to(&block, listen).await.unwrap();
    }
    sender.send_to(b"noise", listen).await.unwrap();
    let sightings = take(&mut feed, 4).await;
    let is_seen: Vec<_> = sightings.iter().map(|s| (s.frame, s.pose.is_some())).collect();
    assert_eq!(is_seen, [(1, true), (2, false), (4, true), (5, true)]);
    let gap = sightings[0].pose.unwrap() - Pose::new(1.0, -2.0, 1.3, 0.3);
    assert!(amax(&gap) < 1e-12, "{gap}");
    let report = feed.counters.report();
    assert_eq!((report.overtaken, report.other_object, report.unseen), (1, 1, 1), "{report:?}");
}

#[tokio::test]
async fn a_datastream_that_restarts_is_greeted_again_and_counts_anew() {
    let (listener, address) = listen().await;
    let (mut feed, _stopper) = start(&datastream(address));
    let mut server = greet(&listener).await;
    server.write_all(&frame(1000, b"tello")).await.unwrap();
    server.write_all(&frame(1001, b"tello")[..100]).await.unwrap();
    assert_eq!(frames(&take(&mut feed, 1).await), [1000]);
    drop((server, listener));
    let listener = TcpListener::bind(address).await.unwrap();
    let mut server = greet(&listener).await;
    server.write_all(&frame(1, b"tello")).await.unwrap();
    let sighting = take(&mut feed, 1).await[0];
    assert_eq!(sighting.frame, 1);
    assert!(sighting.pose.is_some(), "{sighting:?}");
    let report = feed.counters.report();
    assert_eq!((report.reconnects, report.malformed), (1, 0), "half a packet is forgotten");
}

/// How long a client stays with a server that sends a frame and then does `act`.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
async fn time_to_leave<F: Future<Output = ()>>(
    listener: TcpListener,
    feed: &mut MocapFeed,
    act: impl FnOnce(TcpStream) -> F,
) -> Duration {
    let mut first = greet(&listener).await;
    first.write_all(&frame(1, b"tello")).await.unwrap();
    assert_eq!(frames(&take(feed, 1).await), [1]);
    let clock = Clock::start();
    tokio::select! {
        () = act(first) => panic!("the server came to its end"),
        _second = greet(&listener) => clock.now().since(TimeNs(0)).duration(),
    }
}

#[tokio::test]
async fn a_half_open_connection_is_left_after_five_seconds() {
    let (listener, address) = listen().await;
    let (mut feed, _stopper) = start(&datastream(address));
    let hold = |server: TcpStream| async move {
        std::future::pending::<()>().await;
        drop(server);
    };
    let stayed = time_to_leave(listener, &mut feed, hold).await;
    assert!((SILENCE..2 * SILENCE).contains(&stayed), "{stayed:?}");
    assert_eq!(feed.counters.connects.get(), 2);
}

#[tokio::test]
async fn one_byte_per_second_does_not_hold_the_client() {
    let (listener, address) = listen().await;
    let (mut feed, _stopper) = start(&datastream(address));
    let trickle = |mut server: TcpStream| async move {
        for byte in frame(2, b"tello") {
            // The client is gone at some time: that is what is waited for.
            server.write_all(&[byte]).await.ok();
            sleep(Duration::from_secs(1)).await;
        }
    };
    let stayed = time_to_leave(listener, &mut feed, trickle).await;
    assert!((SILENCE..2 * SILENCE).contains(&stayed), "{stayed:?}");
    assert_eq!(feed.counters.malformed.get(), 0);
}

#[tokio::test]
async fn frames_that_count_backwards_are_dropped_until_they_are_a_new_count() {
    let (listener, address) = listen().await;
    let (mut feed, _stopper) = start(&datastream(address));
    let mut server = greet(&listener).await;
    let backwards: Vec<u8> = (950..=1000).rev().flat_map(|k| frame(k, b"tello")).collect();
    server.write_all(&backwards).await.unwrap();
    // 21 behind is a new count, twice.
    assert_eq!(frames(&take(&mut feed, 3).await), [1000, 979, 958]);
    while feed.counters.messages.get() < 52 {
        sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(feed.counters.report().overtaken, 48);
}

#[tokio::test]
async fn another_subject_is_not_taken_for_ours() {
    let (listener, address) = listen().await;
    let (mut feed, _stopper) = start(&datastream(address));
    let mut server = greet(&listener).await;
    for (number, subject) in [(1, "tello2"), (2, "Tello"), (3, "tell"), (4, "tello")] {
        server.write_all(&frame(number, subject.as_bytes())).await.unwrap();
    }
    let sightings = take(&mut feed, 4).await;
    let is_seen: Vec<_> = sightings.iter().map(|sighting| sighting.pose.is_some()).collect();
    assert_eq!(is_seen, [false, false, false, true]);
    assert_eq!(feed.counters.report().other_object, 3);
}

#[tokio::test]
async fn a_server_of_another_protocol_is_given_up_with_a_reason() {
    let (listener, address) = listen().await;
    let (feed, _stopper) = start(&datastream(address));
    let mut server = accept(&listener).await;
    server.write_all(b"1 100.0 tello 0 1 2 3 0 0 0\n").await.unwrap();
    drop(accept(&listener).await);
    let error = feed.counters.given_up();
    assert!(matches!(error, Some(SourceError::Magic { .. })), "{error:?}");
    // The other way round, lines never end and are refused as too long.
    let (listener, address) = listen().await;
    let (feed, _stopper) = start(&MocapTable::Relay(at(address)));
    let mut server = accept(&listener).await;
    server.write_all(&[frame(1, b"tello"), vec![b'\n']].concat()).await.unwrap();
    while feed.counters.malformed.get() == 0 {
        sleep(Duration::from_millis(1)).await;
    }
    assert_eq!(feed.counters.sightings.get(), 0);
}
