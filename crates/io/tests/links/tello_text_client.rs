//! The drone link in the text SDK against a drone that answers badly.

use std::net::SocketAddr;
use std::time::Duration;

use horizon_model::rows::Sticks;
use tello_flight::gate::{Gate, GateTable};
use tello_io::Stopper;
use tello_io::clock::Clock;
use tello_io::tello::{
    Approved, DroneClient, DroneLink, DroneOrder, LinkError, Protocol, TelloSettings, TelloTable,
};
use tokio::net::UdpSocket;
use tokio::task::JoinHandle;
use tokio::time::{sleep, timeout};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

/// A drone made of two sockets, and the host that talks to it.
struct Fixture {
    drone: UdpSocket,
    host: Option<SocketAddr>,
    /// Where the host listens for the state line.
    state_port: u16,
    link: DroneLink,
    stopper: Stopper,
    task: JoinHandle<Result<(), LinkError>>,
}

#[expect(clippy::unwrap_used, clippy::expect_used, reason = "a test may panic")]
impl Fixture {
    /// A fixture whose drone has answered in its worst way and is connected.
    async fn connected() -> Self {
        let drone = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let table = TelloTable {
            protocol: Protocol::Text,
            address: drone.local_addr().unwrap().to_string(),
            local_port: 0,
            state_port: 0,
            altitude_limit_m: None,
            interface: None,
        };
        let settings = TelloSettings::try_from(&table).unwrap();
        let (client, link) = DroneClient::bind(&settings, Clock::start(), false).unwrap();
        let (stopper, stop) = Stopper::new();
        let task = tokio::spawn(client.run(stop));
        let mut fixture = Self { drone, host: None, state_port: 0, link, stopper, task };
        assert_eq!(fixture.receive().await, "command");
        fixture.send(b"\xcc\x18\x01\xb9\x88\x56\x00\x09\x00").await;
        fixture.send(b"OK\r\n").await;
        let port = fixture.receive().await;
        let ports = port.strip_prefix("port ").expect("no port").split_once(' ').unwrap();
        fixture.state_port = ports.0.parse().unwrap();
        fixture.send(format!("unknown command: {port}").as_bytes()).await;
        fixture
    }

    async fn send(&self, reply: &[u8]) {
        self.drone.send_to(reply, self.host.unwrap()).await.unwrap();
    }

    async fn send_state(&self, time_s: u32) {
        let host = SocketAddr::new(self.host.unwrap().ip(), self.state_port);
        let line = format!("tof:80;bat:77;time:{time_s};\r\n");
        self.drone.send_to(line.as_bytes(), host).await.unwrap();
    }

    async fn receive(&mut self) -> String {
        let mut buffer = [0; 200];
        let received = timeout(TEST_TIMEOUT, self.drone.recv_from(&mut buffer)).await;
        let (count, host) = received.expect("the host is silent").unwrap();
        self.host = Some(host);
        String::from_utf8(buffer[..count].to_vec()).unwrap()
    }

    /// What the host sends next, each answered twice and wrongly, until it sends `wanted`.
    async fn receive_until(&mut self, wanted: &str) -> Vec<String> {
        let mut heard = Vec::new();
        loop {
            let command = self.receive().await;
            for reply in ["error Not joystick", "ok", "ok"] {
                self.send(reply.as_bytes()).await;
            }
            if command == wanted {
                return heard;
            }
            heard.push(command);
        }
    }

    /// Ends the host, which would land a drone that never reports that it stands for 15 s.
    fn end(self) {
        self.stopper.stop();
        self.task.abort();
    }

    async fn fly(&mut self) {
        // The motors' seconds grow.
        self.send_state(3).await;
        self.send_state(4).await;
        let poll = async {
            while !self.link.poll_status().is_some_and(|status| status.is_flying) {
                sleep(Duration::from_millis(1)).await;
            }
        };
        timeout(TEST_TIMEOUT, poll).await.expect("no status");
    }
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn approved(pitch: f64) -> Approved {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 1.0 }, Protocol::Text).unwrap();
    gate.pass(&Sticks::new(0.0, pitch, 0.0, 0.0), Some(0.0))
}

#[tokio::test]
async fn wrong_and_doubled_answers_stop_neither_sticks_nor_landing() {
    let mut fixture = Fixture::connected().await;
    fixture.fly().await;
    fixture.link.send(approved(0.504), None);
    assert_eq!(fixture.receive().await, "rc 0 50 0 0");
    for pitch in [0.1, 0.2, -0.3] {
        fixture.link.send(approved(pitch), None);
        let wanted = format!("rc 0 {:.0} 0 0", 100.0 * pitch);
        let others = fixture.receive_until(&wanted).await;
        assert!(others.iter().all(|text| text.starts_with("rc ")), "{others:?}");
    }
    fixture.link.order(DroneOrder::Land).unwrap();
    fixture.receive_until("land").await;
    for _ in 0..3 {
        fixture.link.send(approved(0.5), None);
        fixture.link.order(DroneOrder::TakeOff).unwrap();
        let next = fixture.receive_until("land").await;
        assert_eq!(next, ["rc 0 0 0 0"], "directly before every landing");
    }
    fixture.end();
}

#[tokio::test]
async fn a_drone_that_never_answers_costs_the_control_thread_no_time() {
    let mut fixture = Fixture::connected().await;
    fixture.fly().await;
    let clock = Clock::start();
    for _ in 0..10_000 {
        fixture.link.send(approved(0.5), None);
        fixture.link.poll_status();
    }
    // 10 000 ticks take milliseconds; one awaited reply would take seconds.
    let took_s = clock.now().since(tello_io::clock::TimeNs(0)).seconds();
    assert!(took_s < 1.0, "{took_s} s");
    fixture.link.order(DroneOrder::Land).unwrap();
    fixture.receive_until("land").await;
    fixture.end();
}
