//! The drone link against a drone made of one socket.

use std::net::SocketAddr;
use std::time::Duration;

use horizon_model::rows::{Sticks, stick};
use tello_flight::gate::{Gate, GateTable};
use tello_io::tello::protocol::{Action, DronePacket, FlightStatus, HostPacket};
use tello_io::tello::{
    Approved, DroneClient, DroneLink, DroneOrder, DroneStatus, LinkError, OrderError, Protocol,
    TelloSettings, TelloTable,
};
use tello_io::{Stopper, clock::Clock};
use tokio::time::{sleep, timeout};
use tokio::{net::UdpSocket, task::JoinHandle};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A drone, which knows its host once it has heard it.
struct Drone {
    socket: UdpSocket,
    host: Option<SocketAddr>,
}

/// The drone, and the host that talks to it.
struct Fixture {
    drone: Drone,
    link: DroneLink,
    stopper: Stopper,
    task: JoinHandle<Result<(), LinkError>>,
}

#[expect(clippy::unwrap_used, clippy::expect_used, clippy::panic, reason = "a test may panic")]
impl Fixture {
    async fn start(is_dry_run: bool) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let address = socket.local_addr().unwrap().to_string();
        let settings = settings(&table(address));
        let (client, link) = DroneClient::bind(&settings, Clock::start(), is_dry_run).unwrap();
        let (stopper, stop) = Stopper::new();
        let drone = Drone { socket, host: None };
        Self { drone, link, stopper, task: tokio::spawn(client.run(stop)) }
    }

    /// A fixture whose drone is connected and reports that it flies.
    async fn flying() -> Self {
        let mut fixture = Self::start(false).await;
        fixture.connect().await;
        fixture.drone.send_flying(true).await;
        fixture.status().await;
        fixture
    }

    async fn connect(&mut self) {
        let HostPacket::ConnReq { video_port } = self.drone.receive().await else {
            panic!("no request")
        };
        self.drone.send(DronePacket::ConnAck { video_port }).await;
        while !self.link.counters.is_connected() {
            sleep(Duration::from_millis(1)).await;
        }
    }

    async fn status(&mut self) -> DroneStatus {
        let poll = async {
            loop {
                if let Some(status) = self.link.poll_status() {
                    return status;
                }
                sleep(Duration::from_millis(1)).await;
            }
        };
        timeout(TEST_TIMEOUT, poll).await.expect("no status")
    }

    async fn stop(self) -> UdpSocket {
        self.stopper.stop();
        timeout(TEST_TIMEOUT, self.task).await.expect("still running").unwrap().unwrap();
        self.drone.socket
    }
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
impl Drone {
    async fn send(&self, packet: DronePacket) {
        let mut bytes = Vec::new();
        packet.encode(&mut bytes);
        self.socket.send_to(&bytes, self.host.unwrap()).await.unwrap();
    }

    async fn send_flying(&self, is_flying: bool) {
        self.send(DronePacket::Status { sequence: 0, status: FlightStatus::new(is_flying) }).await;
    }

    /// The next packet of the host that is no question about the drone.
    async fn receive(&mut self) -> HostPacket {
        self.receive_within(TEST_TIMEOUT).await.expect("the host is silent")
    }

    async fn receive_within(&mut self, limit: Duration) -> Option<HostPacket> {
        let mut buffer = [0; 100];
        loop {
            let received = timeout(limit, self.socket.recv_from(&mut buffer)).await.ok()?;
            let (count, host) = received.unwrap();
            self.host = Some(host);
            let packet = HostPacket::decode(&buffer[..count]).unwrap();
            if !matches!(packet, HostPacket::Query { .. }) {
                return Some(packet);
            }
        }
    }

    /// The next packet that satisfies `wanted`, and how many came before it.
    async fn receive_until(&mut self, wanted: impl Fn(HostPacket) -> bool) -> usize {
        let mut others = 0;
        while !wanted(self.receive().await) {
            others += 1;
        }
        others
    }

    /// All packets of the next `span`.
    async fn receive_for(&mut self, span: Duration) -> Vec<HostPacket> {
        let mut packets = Vec::new();
        let listen = async {
            loop {
                packets.push(self.receive().await);
            }
        };
        timeout(span, listen).await.expect_err("the drone listens for ever");
        packets
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn settings(table: &TelloTable) -> TelloSettings {
    TelloSettings::try_from(table).unwrap()
}

fn table(address: String) -> TelloTable {
    TelloTable {
        protocol: Protocol::Binary,
        address,
        local_port: 0,
        state_port: 0,
        altitude_limit_m: None,
        interface: None,
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn approved(roll: f64) -> Approved {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 1.0 }, Protocol::Binary).unwrap();
    gate.pass(&Sticks::new(roll, 0.0, 0.0, 0.0), Some(0.0))
}

fn roll_of(packet: HostPacket) -> Option<f64> {
    match packet {
        HostPacket::Sticks { u, .. } => Some(u[stick::ROLL]),
        _ => None,
    }
}

/// What was sent to the drone and not heard, but for questions about it.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn unheard(drone: &UdpSocket) -> Vec<HostPacket> {
    let mut buffer = [0; 100];
    let datagrams = std::iter::from_fn(|| {
        let count = drone.try_recv(&mut buffer).ok()?;
        Some(HostPacket::decode(&buffer[..count]).unwrap())
    });
    datagrams.filter(|packet| !matches!(packet, HostPacket::Query { .. })).collect()
}

fn is_landing(packet: HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. })
}

fn is_neutral(packet: HostPacket) -> bool {
    matches!(packet, HostPacket::Sticks { u, .. } if u == Sticks::zeros())
}

/// Asserts that `packets` are landings, each directly behind neutral sticks; the last ones may be cut off.
fn assert_landings(packets: &[HostPacket]) {
    for (index, packet) in packets.iter().enumerate() {
        let next = packets.get(index + 1);
        let is_sound =
            is_landing(*packet) || is_neutral(*packet) && next.is_none_or(|next| is_landing(*next));
        assert!(is_sound, "{packet:?}, packet {index} of {packets:?}");
        let is_led = is_landing(*packet) && index > 0;
        assert!(!is_led || is_neutral(packets[index - 1]), "{packets:?}");
    }
}

#[tokio::test]
async fn sticks_reach_the_drone_and_its_status_comes_back() {
    let mut fixture = Fixture::flying().await;
    fixture.link.send(approved(0.5), None);
    let first = roll_of(fixture.drone.receive().await);
    let again = roll_of(fixture.drone.receive().await);
    assert_eq!((first, again), (Some(0.5), Some(0.5)), "sent at once, and repeated");
    // At once, not at the next repetition.
    let latency_ms = fixture.link.counters.sticks_latency().seconds() * 1e3;
    assert!(latency_ms > 0.0 && latency_ms < 15.0, "{latency_ms} ms to the socket");
    fixture
        .drone
        .send(DronePacket::WifiStrength { sequence: 0, strength_pct: 90, disturbance: 0 })
        .await;
    fixture.drone.send_flying(false).await;
    let status = fixture.status().await;
    assert!(status.is_on_ground && !status.is_flying, "{status:?}");
    assert_eq!(fixture.link.poll_status(), None);
}

#[tokio::test]
async fn orders_carry_numbers_and_their_acknowledgement_is_counted() {
    let mut fixture = Fixture::start(false).await;
    fixture.connect().await;
    fixture.drone.send_flying(false).await;
    fixture.status().await;
    fixture.link.order(DroneOrder::TakeOff).unwrap();
    let packet = fixture.drone.receive().await;
    let HostPacket::Action { action: Action::TakeOff, sequence } = packet else {
        panic!("no take-off")
    };
    fixture.drone.send(DronePacket::Ack { action: Action::TakeOff, sequence }).await;
    let acknowledged = async {
        while fixture.link.counters.acks.get() == 0 {
            sleep(Duration::from_millis(1)).await;
        }
    };
    timeout(TEST_TIMEOUT, acknowledged).await.expect("no acknowledgement");
}

#[tokio::test]
async fn the_drones_questions_are_answered() {
    let mut fixture = Fixture::start(false).await;
    fixture.connect().await;
    fixture.drone.send(DronePacket::DateTimeRequest { sequence: 3 }).await;
    let HostPacket::DateTime { sequence: 3, time } = fixture.drone.receive().await else {
        panic!("no time")
    };
    assert!(time.year >= 2020, "{time}");
    fixture.drone.send(DronePacket::LogHeader { sequence: 4, header_id: 0x1234 }).await;
    let expected = HostPacket::LogHeaderAck { sequence: 4, header_id: 0x1234 };
    assert_eq!(fixture.drone.receive().await, expected);
}

#[tokio::test]
async fn a_control_thread_that_hangs_leaves_neutral_sticks_and_then_a_landing() {
    let mut fixture = Fixture::flying().await;
    fixture.link.send(approved(0.5), None);
    let packets = fixture.drone.receive_for(Duration::from_millis(1300)).await;
    let rolls: Vec<f64> = packets.iter().filter_map(|packet| roll_of(*packet)).collect();
    let steering = rolls.iter().take_while(|roll| **roll > 0.1).count();
    // 5 in 100 ms; a loaded machine may repeat fewer.
    assert!((1..=6).contains(&steering), "{rolls:?}");
    assert!(rolls.iter().skip(steering).all(|roll| roll.abs() < 1e-12), "{rolls:?}");
    let first_landing = packets.iter().position(|packet| is_landing(*packet)).expect("no landing");
    assert_landings(&packets[first_landing - 1..]);
    assert_eq!(fixture.link.counters.watchdog_landings.get(), 1);
}

#[tokio::test]
async fn a_control_thread_that_is_gone_ends_in_a_landing() {
    let mut fixture = Fixture::flying().await;
    fixture.link.send(approved(0.5), None);
    drop(fixture.link);
    fixture.drone.receive_until(is_landing).await;
}

#[tokio::test]
async fn neither_sticks_nor_a_take_off_follow_a_landing() {
    let mut fixture = Fixture::flying().await;
    fixture.link.send(approved(0.5), None);
    fixture.link.order(DroneOrder::Land).unwrap();
    fixture.drone.receive_until(is_landing).await;
    for _ in 0..50 {
        fixture.link.send(approved(0.5), None);
        sleep(Duration::from_millis(5)).await;
    }
    fixture.link.order(DroneOrder::TakeOff).unwrap();
    fixture.drone.send_flying(false).await;
    fixture.status().await;
    fixture.link.order(DroneOrder::TakeOff).unwrap();
    fixture.link.send(approved(0.5), None);
    let packets = fixture.drone.receive_for(Duration::from_millis(600)).await;
    assert_landings(&packets);
}

#[tokio::test]
async fn a_drone_that_never_answers_is_asked_again_and_never_steered() {
    let mut fixture = Fixture::start(false).await;
    for _ in 0..100 {
        fixture.link.send(approved(0.5), None);
        sleep(Duration::from_millis(5)).await;
    }
    let packets = fixture.drone.receive_for(Duration::from_secs(2)).await;
    let requests = packets.iter().filter(|p| matches!(p, HostPacket::ConnReq { .. })).count();
    assert_eq!(requests, 2, "{packets:?}");
    let first = packets.iter().position(|packet| roll_of(*packet).is_some());
    let mut last = packets[first.unwrap_or(packets.len())..].to_vec();
    last.retain(|packet| !matches!(packet, HostPacket::ConnReq { .. }));
    // The end of the sticks counts as a control thread that is silent.
    assert_landings(&last);
    assert!(!fixture.link.counters.is_connected());
}

#[tokio::test]
async fn garbage_and_foreign_senders_are_counted_and_survived() {
    let mut fixture = Fixture::flying().await;
    let host = fixture.drone.host.unwrap();
    let garbage = vec![0xCC; 5000];
    for datagram in [b"".as_slice(), b"ok", b"error Motor stop", &garbage, b"conn_ack:"] {
        fixture.drone.socket.send_to(datagram, host).await.unwrap();
    }
    let foreign = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let mut bytes = Vec::new();
    DronePacket::Status { sequence: 0, status: FlightStatus::new(true) }.encode(&mut bytes);
    foreign.send_to(&bytes, host).await.unwrap();
    fixture.drone.send_flying(false).await;
    assert!(!fixture.status().await.is_flying, "the foreign status was taken");
    assert_eq!(fixture.link.counters.malformed.get(), 6);
}

#[tokio::test]
async fn the_end_of_the_program_lands_a_drone_and_waits_until_it_stands() {
    let Fixture { mut drone, link, stopper, task } = Fixture::flying().await;
    link.send(approved(0.5), None);
    drone.receive_until(|packet| roll_of(packet).is_some()).await;
    stopper.stop();
    drone.receive_until(is_landing).await;
    // It was taking off: the first landings are ignored, and nothing else may be sent.
    for _ in 0..2 {
        link.send(approved(0.5), None);
        drone.send_flying(true).await;
        let packets = [drone.receive().await, drone.receive().await];
        assert!(is_neutral(packets[0]) && is_landing(packets[1]), "{packets:?}");
    }
    assert!(!task.is_finished(), "it flies");
    link.send(approved(0.5), Some(false));
    drone.send_flying(false).await;
    timeout(TEST_TIMEOUT, task).await.expect("still running").unwrap().unwrap();
}

#[tokio::test]
async fn the_end_of_the_program_leaves_a_standing_drone_alone() {
    let mut fixture = Fixture::start(false).await;
    fixture.connect().await;
    fixture.drone.send_flying(false).await;
    fixture.status().await;
    assert_eq!(unheard(&fixture.stop().await), [], "something was sent");
}

#[tokio::test]
async fn a_dry_run_connects_and_listens_but_never_steers() {
    let mut fixture = Fixture::start(true).await;
    fixture.connect().await;
    fixture.link.order(DroneOrder::TakeOff).unwrap();
    fixture.drone.send_flying(true).await;
    fixture.status().await;
    for _ in 0..20 {
        fixture.link.send(approved(0.5), None);
        sleep(Duration::from_millis(5)).await;
    }
    fixture.link.order(DroneOrder::Land).unwrap();
    assert_eq!(fixture.drone.receive_for(Duration::from_millis(100)).await, []);
    assert_eq!(unheard(&fixture.stop().await), [], "something was sent");
}

#[tokio::test]
async fn a_busy_port_and_a_missing_interface_state_what_to_do() {
    let taken = std::net::UdpSocket::bind("0.0.0.0:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let table = TelloTable { local_port: port, ..table("127.0.0.1:9".into()) };
    let refusal = |table: &TelloTable| {
        DroneClient::bind(&settings(table), Clock::start(), false).unwrap_err().to_string()
    };
    assert_eq!(
        refusal(&table),
        format!("UDP port {port} is in use: stop the other program, or set tello.local_port to 0")
    );
    let interface = Some("nowhere9".to_owned());
    let error = refusal(&TelloTable { local_port: 0, interface, ..table });
    let expected = "network interface `nowhere9` does not exist: `ip link` lists those that do";
    assert_eq!(error, expected);
}

#[tokio::test]
async fn a_full_queue_of_orders_and_an_ended_link_are_reported() {
    let fixture = Fixture::start(false).await;
    // The task has not run: nothing yields between the orders.
    let taken = (0..8).take_while(|_| fixture.link.order(DroneOrder::Land).is_ok()).count();
    assert_eq!(taken, 4);
    assert_eq!(fixture.link.order(DroneOrder::Land), Err(OrderError::Busy));
    fixture.task.abort();
    fixture.task.await.expect_err("aborted");
    assert_eq!(fixture.link.order(DroneOrder::Land), Err(OrderError::Ended));
}
