//! The mocap client against servers that do everything wrong, over loopback sockets.

use std::time::Duration;

use horizon_model::rows::Pose;
use tello_io::clock::Clock;
use tello_io::mocap::{
    MocapClient, MocapCounters, MocapFeed, MocapSettings, MocapTable, ServerTable, Sighting,
};
use tello_io::{Counter, StopSignal, Stopper};
use tokio::io::AsyncWriteExt;
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

struct Fixture {
    listener: TcpListener,
    feed: MocapFeed,
    stopper: Stopper,
    task: JoinHandle<()>,
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
impl Fixture {
    async fn start() -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let (feed, stopper, task) = client(listener.local_addr().unwrap().to_string());
        Self { listener, feed, stopper, task }
    }

    async fn accept(&self) -> TcpStream {
        timeout(TEST_TIMEOUT, self.listener.accept()).await.expect("no connection").unwrap().0
    }

    /// The next sightings, received without losing the wish to see more.
    async fn take(&mut self, count: usize) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        while sightings.len() < count {
            match self.feed.sightings.pop() {
                Ok(sighting) => sightings.push(sighting),
                Err(_) => sleep(Duration::from_millis(1)).await,
            }
        }
        sightings
    }

    async fn wait_for_lines(&self, count: u64) {
        let wait = async {
            while self.feed.counters.messages.get() < count {
                sleep(Duration::from_millis(1)).await;
            }
        };
        timeout(TEST_TIMEOUT, wait).await.expect("lines are missing");
    }

    async fn frames(&mut self, count: usize) -> Vec<i64> {
        let sightings =
            timeout(TEST_TIMEOUT, self.take(count)).await.expect("sightings are missing");
        sightings.iter().map(|sighting| sighting.frame).collect()
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn client(address: String) -> (MocapFeed, Stopper, JoinHandle<()>) {
    let table = MocapTable::Relay(ServerTable { address, object: "tello".to_owned() });
    let settings = MocapSettings::try_from(&table).unwrap();
    let (client, feed) = MocapClient::new(settings, Clock::start());
    let (stopper, stop): (Stopper, StopSignal) = Stopper::new();
    (feed, stopper, tokio::spawn(client.run(stop)))
}

fn line(frame: i64) -> String {
    format!("{frame} 100.0 tello 0 1.0000 -2.0000 1.3000 0.0000 0.0000 0.3000\n")
}

#[tokio::test]
async fn several_lines_in_one_segment_arrive_in_order() {
    let mut fixture = Fixture::start().await;
    let mut server = fixture.accept().await;
    let text: String = (1..=20).map(line).collect();
    server.write_all(text.as_bytes()).await.unwrap();
    assert_eq!(fixture.frames(20).await, (1..=20).collect::<Vec<_>>());
    server.write_all(line(21).as_bytes()).await.unwrap();
    let last = timeout(TEST_TIMEOUT, fixture.take(1)).await.unwrap()[0];
    assert_eq!(last.pose, Some(Pose::new(1.0, -2.0, 1.3, 0.3)));
}

#[tokio::test]
async fn a_line_cut_at_every_byte_and_a_slow_trickle_arrive_whole() {
    let mut fixture = Fixture::start().await;
    let mut server = fixture.accept().await;
    server.set_nodelay(true).unwrap();
    for cut in 1..line(100).len() {
        let text = line(100 + i64::try_from(cut).unwrap());
        let (left, right) = text.split_at(cut);
        server.write_all(left.as_bytes()).await.unwrap();
        sleep(Duration::from_millis(1)).await;
        server.write_all(right.as_bytes()).await.unwrap();
    }
    for byte in line(1).as_bytes() {
        server.write_all(&[*byte]).await.unwrap();
        sleep(Duration::from_millis(1)).await;
    }
    let frames = fixture.frames(line(100).len()).await;
    assert_eq!(frames.last(), Some(&1));
    assert_eq!(fixture.feed.counters.malformed.get(), 0);
}

#[tokio::test]
async fn garbage_is_counted_and_the_next_line_is_read() {
    let mut fixture = Fixture::start().await;
    let mut server = fixture.accept().await;
    let noise: Vec<u8> =
        (0..1_000_000_u32).map(|k| (k % 251) as u8).filter(|b| *b != b'\n').collect();
    server.write_all(&noise).await.unwrap();
    server
        .write_all(b"\n\n1 100 tello 0 nan 2 3 0 0 0\n1 100 tello 0 1 2\n\xff\xfe\n")
        .await
        .unwrap();
    server.write_all(b"5 100 wand 0 1 2 3 0 0 0\n").await.unwrap();
    server.write_all([line(6), line(6), line(7)].concat().as_bytes()).await.unwrap();
    assert_eq!(fixture.frames(2).await, [6, 7]);
    let MocapCounters { malformed, other_object, repeated, messages, .. } = &*fixture.feed.counters;
    let counts = [malformed, other_object, repeated, messages].map(Counter::get);
    assert_eq!(counts, [5, 1, 1, 9]);
}

#[tokio::test]
async fn a_lost_server_is_connected_again() {
    let mut fixture = Fixture::start().await;
    let mut server = fixture.accept().await;
    server.write_all(format!("{}8 100.0 tello 0 1.0", line(7)).as_bytes()).await.unwrap();
    assert_eq!(fixture.frames(1).await, [7]);
    drop(server);
    let mut server = fixture.accept().await;
    server.write_all(line(7).as_bytes()).await.unwrap();
    assert_eq!(fixture.frames(1).await, [7], "a new connection counts its own frames");
    assert_eq!(fixture.feed.counters.connects.get(), 2);
    assert_eq!(fixture.feed.counters.malformed.get(), 0, "the half line is forgotten");
}

#[tokio::test]
async fn a_server_that_hangs_up_at_once_is_not_hammered() {
    let fixture = Fixture::start().await;
    let accept = async {
        loop {
            drop(fixture.listener.accept().await);
        }
    };
    timeout(Duration::from_secs(1), accept).await.expect_err("the server never ends");
    // After 0, 0.1, 0.3 and 0.7 s, and later on a loaded machine.
    let connects = fixture.feed.counters.connects.get();
    assert!((2..=4).contains(&connects), "{connects} connections in one second");
}

#[tokio::test]
async fn a_queue_that_nobody_drains_overflows_and_counts() {
    let mut fixture = Fixture::start().await;
    let mut server = fixture.accept().await;
    let text: String = (1..=500).map(line).collect();
    server.write_all(text.as_bytes()).await.unwrap();
    fixture.wait_for_lines(500).await;
    let kept = fixture.feed.sightings.slots();
    assert_eq!(fixture.feed.counters.overflow.get(), 500 - kept as u64);
    // The oldest stay; what comes after the drain is seen again.
    assert_eq!(fixture.frames(kept).await[..3], [1, 2, 3]);
    server.write_all(line(501).as_bytes()).await.unwrap();
    assert_eq!(fixture.frames(1).await, [501]);
}

#[tokio::test]
async fn the_client_stops_on_request_whatever_the_server_does() {
    // Connected to a server that never sends anything.
    let fixture = Fixture::start().await;
    let _server = fixture.accept().await;
    fixture.stopper.stop();
    timeout(TEST_TIMEOUT, fixture.task).await.expect("still running").unwrap();
    // Connected to a port at which nothing listens: the port was free a moment ago.
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let address = listener.local_addr().unwrap().to_string();
    drop(listener);
    let (mut feed, stopper, task) = client(address);
    sleep(Duration::from_millis(150)).await;
    assert_eq!(feed.counters.connects.get(), 0);
    assert!(feed.sightings.pop().is_err());
    drop(stopper);
    timeout(TEST_TIMEOUT, task).await.expect("still running").unwrap();
}
