//! The end of a flight at the socket: a drone that denies its flight, and a system that refuses to send.

use std::time::Duration;

use horizon_model::rows::Sticks;
use tello_flight::gate::{Gate, GateTable};
use tello_io::clock::Clock;
use tello_io::tello::protocol::{Action, DronePacket, FlightStatus, HostPacket};
use tello_io::tello::{
    Approved, DroneClient, DroneLink, DroneOrder, Protocol, TelloSettings, TelloTable,
};
use tello_io::{EmergencyRequest, Stopper};
use tokio::net::UdpSocket;
use tokio::time::{sleep, timeout};

/// Far beyond what any step takes on a loaded machine.
const TEST_TIMEOUT: Duration = Duration::from_secs(10);

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn bind(address: String) -> (DroneClient, DroneLink) {
    let table = TelloTable {
        protocol: Protocol::Binary,
        address,
        local_port: 0,
        state_port: 0,
        altitude_limit_m: None,
        interface: None,
    };
    DroneClient::bind(&TelloSettings::try_from(&table).unwrap(), Clock::start(), false).unwrap()
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn forward() -> Approved {
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 1.0 }, Protocol::Binary).unwrap();
    gate.pass(&Sticks::new(0.0, 0.5, 0.0, 0.0), Some(0.0))
}

/// A drone that answers everything with a report that it stands.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
async fn deny(drone: &UdpSocket) -> HostPacket {
    let mut bytes = [0; 100];
    let (count, host) = drone.recv_from(&mut bytes).await.unwrap();
    let mut status = Vec::new();
    DronePacket::Status { sequence: 0, status: FlightStatus::new(false) }.encode(&mut status);
    drone.send_to(&status, host).await.unwrap();
    HostPacket::decode(&bytes[..count]).unwrap()
}

fn is_landing(packet: HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. })
}

fn is_neutral(packet: HostPacket) -> bool {
    matches!(packet, HostPacket::Sticks { u, .. } if u == Sticks::zeros())
}

#[tokio::test]
async fn a_drone_that_denies_its_flight_is_landed_until_the_pose_is_on_the_floor() {
    let drone = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let (client, link) = bind(drone.local_addr().unwrap().to_string());
    let (stopper, stop) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    let connect = async {
        while !link.counters.is_connected() {
            deny(&drone).await;
            sleep(Duration::from_millis(1)).await;
        }
    };
    timeout(TEST_TIMEOUT, connect).await.expect("no request for a connection");
    link.send(forward(), Some(true));
    link.order(DroneOrder::Land).unwrap();
    let mut before = None;
    let mut landings = 0;
    let listen = async {
        while landings < 4 {
            link.send(forward(), Some(true));
            let packet = deny(&drone).await;
            if is_landing(packet) {
                landings += 1;
                assert!(before.is_some_and(is_neutral), "{before:?} directly before LAND");
            } else {
                assert!(landings == 0 || is_neutral(packet), "{packet:?} after LAND");
            }
            before = Some(packet);
        }
    };
    timeout(TEST_TIMEOUT, listen).await.expect("the landing is not repeated");
    // The program ends; its control thread still sees the drone in the air, and then on the floor.
    stopper.stop();
    for _ in 0..50 {
        link.send(Approved::neutral(), Some(true));
        sleep(Duration::from_millis(10)).await;
    }
    assert!(!task.is_finished(), "it hovers");
    let settle = async {
        while !task.is_finished() {
            link.send(Approved::neutral(), Some(false));
            sleep(Duration::from_millis(10)).await;
        }
    };
    timeout(TEST_TIMEOUT, settle).await.expect("status and pose agree, and it lands on");
    task.await.unwrap().unwrap();
}

#[tokio::test]
async fn a_socket_that_refuses_a_landing_is_asked_again_soon() {
    // The system refuses to send to port 0.
    let (client, link) = bind("127.0.0.1:0".into());
    let (stopper, stop) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    link.order(DroneOrder::Land).unwrap();
    sleep(Duration::from_millis(450)).await;
    // Two packets each: one landing in this time without a repetition, nine with it.
    let errors = link.counters.socket_errors.get();
    assert!((8..=24).contains(&errors), "{errors} packets refused");
    stopper.stop();
    timeout(TEST_TIMEOUT, task).await.expect("no answer ever came").unwrap().unwrap();
}

#[tokio::test]
async fn an_emergency_stop_reaches_the_drone_though_the_control_thread_is_gone() {
    let drone = UdpSocket::bind("127.0.0.1:0").await.unwrap();
    let (mut client, link) = bind(drone.local_addr().unwrap().to_string());
    let emergency = EmergencyRequest::default();
    client.obey(emergency.clone());
    let (_stopper, stop) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    let listen = async {
        while !link.counters.is_connected() {
            deny(&drone).await;
        }
        link.send(forward(), Some(true));
        while !is_landing(deny(&drone).await) {}
        // The watchdog lands a drone whose control thread is silent.
        drop(link);
        emergency.ask();
        while deny(&drone).await != HostPacket::EmergencyStop {}
    };
    timeout(TEST_TIMEOUT, listen).await.expect("no emergency stop");
    task.abort();
}
