//! A drone whose sender died, or cannot run, and the guardian in its place: judged by what reaches the drone.

use std::net::UdpSocket;
use std::sync::mpsc;
use std::thread;
use std::time::Duration;

use horizon_model::rows::Sticks;
use tello_flight::gate::{Gate, GateTable};
use tello_io::Stopper;
use tello_io::clock::{Clock, TimeNs};
use tello_io::tello::protocol::{Action, DronePacket, FlightStatus, HostPacket};
use tello_io::tello::{DroneClient, Guardian, Protocol, TelloSettings, TelloTable, WatchEnd};

/// Failure of the sender, half a second after the sticks began.
#[derive(Debug, Clone, Copy, PartialEq)]
enum SenderFailure {
    /// Its task is gone.
    Killed,
    /// Something blocks its thread for two seconds.
    Blocked,
    /// Nothing; the program stops it.
    None,
}

/// Packets that reached the drone, with their times, until `for_s` after the failure.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(failure: SenderFailure, for_s: u64) -> (TimeNs, Vec<(TimeNs, HostPacket)>) {
    let drone = UdpSocket::bind("127.0.0.1:0").unwrap();
    drone.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let table = TelloTable {
        protocol: Protocol::Binary,
        address: drone.local_addr().unwrap().to_string(),
        local_port: 0,
        state_port: 0,
        altitude_limit_m: None,
        interface: None,
    };
    let clock = Clock::start();
    let (failed_at, failure_time) = mpsc::channel();
    let host = thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
        let guardian = runtime.block_on(host(&table, clock, failure, for_s, &failed_at));
        // With it goes a sender that was blocked.
        drop(runtime);
        // The drone of a sender without a final message gets 60 landings, four a second for 15 s.
        assert_eq!(guardian.join().unwrap(), if failure == SenderFailure::None { 0 } else { 60 });
    });
    let mut heard = Vec::new();
    let mut bytes = [0; 2048];
    loop {
        // What was sent before the end is read before the loop ends.
        let is_over = host.is_finished();
        let Ok((count, from)) = drone.recv_from(&mut bytes) else {
            if is_over {
                break;
            }
            continue;
        };
        let packet = HostPacket::decode(&bytes[..count]).unwrap();
        if let HostPacket::ConnReq { video_port } = packet {
            for answer in [
                DronePacket::ConnAck { video_port },
                DronePacket::Status { sequence: 0, status: FlightStatus::new(true) },
            ] {
                let mut bytes = Vec::new();
                answer.encode(&mut bytes);
                drone.send_to(&bytes, from).unwrap();
            }
        }
        if failure == SenderFailure::None && is_landing(&packet) {
            let mut bytes = Vec::new();
            let status = FlightStatus::new(false);
            DronePacket::Status { sequence: 1, status }.encode(&mut bytes);
            drone.send_to(&bytes, from).unwrap();
        }
        heard.push((clock.now(), packet));
    }
    host.join().unwrap();
    (failure_time.recv().unwrap(), heard)
}

#[expect(clippy::unwrap_used, reason = "a test may panic")]
async fn host(
    table: &TelloTable,
    clock: Clock,
    failure: SenderFailure,
    for_s: u64,
    failed_at: &mpsc::Sender<TimeNs>,
) -> thread::JoinHandle<u32> {
    let settings = TelloSettings::try_from(table).unwrap();
    let (mut client, link) = DroneClient::bind(&settings, clock, false).unwrap();
    // On a thread in place of a process: what it does is the same.
    let guardian = client.start_guardian(|post| {
        Ok(thread::spawn(|| {
            let mut guardian = Guardian::start(post).unwrap();
            match guardian.watch() {
                WatchEnd::Abandoned => guardian.land_alone(),
                WatchEnd::Over | WatchEnd::OrderedLanding => 0,
            }
        }))
    });
    let guardian = guardian.unwrap();
    let (stopper, stop) = Stopper::new();
    let task = tokio::spawn(client.run(stop));
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 0.5 }, Protocol::Binary).unwrap();
    let approved = gate.pass(&Sticks::new(0.0, 0.5, 0.0, 0.0), Some(0.0));
    for _ in 0..25 {
        link.send(approved, None);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    failed_at.send(clock.now()).unwrap();
    match failure {
        SenderFailure::Killed => task.abort(),
        SenderFailure::Blocked => thread::sleep(Duration::from_secs(2)),
        SenderFailure::None => {}
    }
    // Motion capture sees a drone on the floor: the landing at the end needs two sources to be short.
    let pose_is_airborne = (failure == SenderFailure::None).then_some(false);
    for _ in 0..for_s * 50 {
        link.send(approved, pose_is_airborne);
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    drop(stopper);
    if failure == SenderFailure::None {
        task.await.unwrap().unwrap();
    }
    guardian
}

fn is_landing(packet: &HostPacket) -> bool {
    matches!(packet, HostPacket::Action { action: Action::Land, .. })
}

/// Deflected sticks after `from`.
fn deflected(heard: &[(TimeNs, HostPacket)], from: TimeNs) -> usize {
    let moves =
        |packet: &HostPacket| matches!(packet, HostPacket::Sticks { u, .. } if u.amax() > 0.0);
    heard.iter().filter(|(at, packet)| *at > from && moves(packet)).count()
}

/// When the drone was first ordered to land.
fn landed_at(heard: &[(TimeNs, HostPacket)]) -> TimeNs {
    let first = heard.iter().find(|(_, packet)| is_landing(packet));
    first.map_or(TimeNs(i64::MAX), |(at, _)| *at)
}

#[test]
#[ignore = "15 to 20 s of real time: .ci/run all runs it"]
fn a_sender_that_died_is_replaced_at_once_by_landings_behind_neutral_sticks() {
    let (failure_time_at, heard) = fly(SenderFailure::Killed, 1);
    assert!(deflected(&heard, TimeNs(0)) > 10, "never steered");
    let after_s = landed_at(&heard).since(failure_time_at).seconds();
    assert!(after_s < 0.3, "landed {after_s} s after the failure");
    let begin = heard.iter().position(|(_, packet)| is_landing(packet)).unwrap();
    let landings = &heard[begin - 1..];
    assert_eq!(landings.len(), 2 * 60);
    for pair in landings.chunks(2) {
        let [(_, neutral), (_, land)] = pair else { panic!("{pair:?}") };
        assert!(matches!(neutral, HostPacket::Sticks { u, .. } if u.amax() == 0.0), "{pair:?}");
        assert!(is_landing(land), "{pair:?}");
    }
    let last_s = landings.last().unwrap().0.since(failure_time_at).seconds();
    assert!((14.0..17.0).contains(&last_s), "the last landing after {last_s} s");
}

#[test]
#[ignore = "15 to 20 s of real time: .ci/run all runs it"]
fn a_sender_that_comes_back_goes_on_with_the_landing_and_never_steers_again() {
    let (failure_time_at, heard) = fly(SenderFailure::Blocked, 2);
    let landed_at = landed_at(&heard);
    let after_s = landed_at.since(failure_time_at).seconds();
    assert!((0.2..0.5).contains(&after_s), "landed {after_s} s after the failure");
    assert_eq!(deflected(&heard, landed_at), 0, "steers after the landing");
    let late = heard
        .iter()
        .filter(|(at, packet)| at.since(failure_time_at).seconds() > 2.5 && is_landing(packet));
    assert!(late.count() >= 1, "the sender does not repeat the landing");
}

#[test]
fn a_sender_that_lives_is_left_alone() {
    let (_, heard) = fly(SenderFailure::None, 2);
    assert!(deflected(&heard, TimeNs(0)) > 50, "never steered");
    let during = heard.iter().position(|(_, packet)| is_landing(packet)).unwrap_or(heard.len());
    // All but what follows the end of the program.
    assert!(during > 80, "landed after {during} packets of {}", heard.len());
    assert!(heard.len() - during < 20, "{} packets after the end", heard.len() - during);
}
