mod switches;

use horizon_model::rows::Sticks;
use tello_io::clock::TimeOfDay;

use super::*;
use crate::drone::DronePhase;
use crate::fault::ScriptedFault;
use crate::world::tests::table;
use crate::{Profile, SimStart, SimTable};

const TAKE_OFF: HostPacket = HostPacket::Action { action: Action::TakeOff, sequence: 7 };
const LAND: HostPacket = HostPacket::Action { action: Action::Land, sequence: 8 };

fn sticks(u: Sticks) -> HostPacket {
    HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() }
}

/// A world without chance, on the ground, with scripted faults.
fn world(faults: Vec<ScriptedFault>) -> World {
    let start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 };
    let table = SimTable { profile: Profile::Clean, has_spread: false, start, faults, ..table() };
    World::new(&table, 1).unwrap()
}

fn wait(world: &mut World, steps: u32) {
    for _ in 0..steps {
        world.receive(&sticks(Sticks::zeros()));
        world.advance();
    }
}

#[test]
fn every_question_is_answered_with_its_number() {
    let mut world = world(Vec::new());
    for (sequence, query) in (100..).zip(Query::ALL) {
        let answer = world.receive(&HostPacket::Query { sequence, query });
        let Some(DronePacket::Answer { sequence: answered, answer }) = answer else {
            panic!("{query:?}: {answer:?}");
        };
        assert_eq!((answered, answer.query()), (sequence, query));
    }
}

#[test]
fn a_flight_from_the_first_packet_to_the_last() {
    let mut world = world(Vec::new());
    let request = HostPacket::ConnReq { video_port: 6038 };
    assert_eq!(world.receive(&request), Some(DronePacket::ConnAck { video_port: 6038 }));
    assert!(world.flight_status().unwrap().is_on_ground());
    let ack = |action, sequence| Some(DronePacket::Ack { action, sequence });
    assert_eq!(world.receive(&TAKE_OFF), ack(Action::TakeOff, 7));
    assert_eq!(world.receive(&LAND), None, "the first seconds of a take-off hear no landing");
    wait(&mut world, 300);
    let status = world.flight_status().unwrap();
    assert!(status.is_flying() && !status.is_on_ground(), "{status:?}");
    assert!((9..=11).contains(&status.height_dm), "{status:?}");
    assert_eq!((status.battery_pct, status.fly_time_ds), (90, 60));

    for _ in 0..100 {
        assert_eq!(world.receive(&sticks(Sticks::new(0.0, 0.5, 0.0, 0.0))), None);
        world.advance();
    }
    assert!(world.truth().pose[pose::X] > 0.3, "{:?}", world.truth());
    assert!(world.flight_status().unwrap().vel_north_dm_s > 3);

    assert_eq!(world.receive(&LAND), ack(Action::Land, 8));
    wait(&mut world, 300);
    let status = world.flight_status().unwrap();
    assert!(status.is_on_ground() && !status.is_flying(), "{status:?}");
}

#[test]
fn a_landing_can_be_taken_back() {
    let mut world = world(Vec::new());
    world.receive(&TAKE_OFF);
    wait(&mut world, 300);
    assert!(world.receive(&LAND).is_some());
    assert_eq!(world.truth().phase, DronePhase::Landing(crate::drone::Cause::Order));
    assert!(world.receive(&HostPacket::CancelLanding { sequence: 9 }).is_some());
    assert_eq!(world.truth().phase, DronePhase::Flying);
    assert_eq!(world.receive(&HostPacket::CancelLanding { sequence: 10 }), None);
}

#[test]
fn a_deaf_drone_hears_nothing_and_a_mute_one_reports_nothing() {
    let fault = |fault, from_s| ScriptedFault { fault, from_s, for_s: 1.0 };
    let mut world =
        world(vec![fault(InjectedFault::DroneDeaf, 0.0), fault(InjectedFault::DroneMute, 1.0)]);
    assert_eq!(world.receive(&TAKE_OFF), None);
    assert_eq!(world.truth().phase, DronePhase::Grounded);
    assert!(world.flight_status().is_some());
    wait(&mut world, 50);
    assert_eq!(world.receive(&TAKE_OFF), None);
    assert_eq!(world.truth().phase, DronePhase::TakingOff);
    assert_eq!(world.flight_status(), None);
    wait(&mut world, 50);
    assert!(world.flight_status().is_some());
}
