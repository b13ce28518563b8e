//! Each fault ends in its documented reaction, in the whole loop, after the drone really flew.

use std::path::Path;

use tello_control::{Fault, Phase, Start};
use tello_ctl::config;
use tello_ctl::cycle::Operator;
use tello_ctl::virtual_time::VirtualFlight;
use tello_model::rows::pose;
use tello_sim::plant::STANDING_M;
use tello_sim::{Fault as SimFault, Profile, ScriptedFault};

/// When the faults of this file begin: in the middle of the mission. s
const FAULT_AT_S: f64 = 14.0;

/// A flight with one scripted fault, tick by tick until it is over.
struct Story {
    phases: Vec<Phase>,
    faults: Vec<Fault>,
    /// Largest stick that was sent while the newest pose was older than the gate allows. 1
    stick_while_stale: f64,
    /// Largest stick that was sent in ticks after the first order to land. 1
    stick_after_landing: f64,
    height_max_m: f64,
    height_end_m: f64,
}

/// Charge at the start, charge that is too low to fly on. %
type Battery = (f64, u8);

/// A battery that has nothing to do with the story.
const FULL: Battery = (90.0, 8);

#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly(script: &[ScriptedFault], land_at_s: Option<f64>, (charge, critical): Battery) -> Story {
    let (mut fly_table, _) = config::fly(None, None).unwrap();
    // Long enough for every fault to come in the middle of it.
    let mission =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../configs/missions/big_square.json");
    let mission = config::mission(&mission).unwrap();
    let mut sim = config::sim(None).unwrap();
    sim.profile = Profile::Clean;
    sim.faults = script.to_vec();
    sim.battery_pct = charge;
    fly_table.cycle.supervisor.battery_critical_pct = critical;
    fly_table.cycle.supervisor.battery_low_pct = critical + 1;
    let flight = config::flight(&fly_table, mission, Start::Grounded);
    let stale_s = flight.cycle.gate.stale_s;
    let mut virtual_flight = VirtualFlight::new(&flight, &sim, 5).unwrap();
    let mut story = Story {
        phases: vec![],
        faults: vec![],
        stick_while_stale: 0.0,
        stick_after_landing: 0.0,
        height_max_m: 0.0,
        height_end_m: 0.0,
    };
    let mut seen_at_s = 0.0;
    for step in 0..5_000_u32 {
        let now_s = f64::from(step) * flight.cycle.dt_s;
        if land_at_s.is_some_and(|land_at_s| now_s >= land_at_s) {
            virtual_flight.set_operator(Operator::Land);
        }
        let out = virtual_flight.tick().unwrap();
        let (phase, ruling, u_sent) = (out.phase(), out.ruling.unwrap(), out.u_sent);
        if virtual_flight.inbox().sightings.iter().any(|sighting| sighting.pose.is_some()) {
            seen_at_s = now_s;
        }
        if story.phases.last() != Some(&phase) {
            story.phases.push(phase);
        }
        for fault in ruling.faults.iter() {
            if !story.faults.contains(&fault) {
                story.faults.push(fault);
            }
        }
        if now_s - seen_at_s > stale_s {
            story.stick_while_stale = story.stick_while_stale.max(u_sent.amax());
        }
        if story.phases.contains(&Phase::Landing) {
            story.stick_after_landing = story.stick_after_landing.max(u_sent.amax());
        }
        story.height_end_m = virtual_flight.true_pose()[pose::Z];
        story.height_max_m = story.height_max_m.max(story.height_end_m);
        if matches!(phase, Phase::Landed | Phase::Fault) && story.height_end_m < STANDING_M + 0.01 {
            break;
        }
    }
    story
}

fn scripted(fault: SimFault, for_s: f64) -> [ScriptedFault; 1] {
    [ScriptedFault { fault, from_s: FAULT_AT_S, for_s }]
}

fn assert_landed(story: &Story, fault: Fault) {
    assert!(story.height_max_m > 0.8, "never became airborne: {} m", story.height_max_m);
    assert!(story.phases.contains(&Phase::Flying), "{:?}", story.phases);
    assert!(story.phases.contains(&Phase::Landing), "{:?}", story.phases);
    assert!(story.faults.contains(&fault), "{fault:?} is not among {:?}", story.faults);
    assert!(story.height_end_m < STANDING_M + 0.01, "still {} m high", story.height_end_m);
    assert!(story.stick_while_stale <= 0.0, "{}", story.stick_while_stale);
    assert!(story.stick_after_landing <= 0.0, "{}", story.stick_after_landing);
}

#[test]
fn mocap_that_falls_silent_in_flight_lands_the_drone() {
    assert_landed(&fly(&scripted(SimFault::MocapSilent, 1e3), None, FULL), Fault::MocapLost);
}

#[test]
fn an_object_that_is_lost_in_flight_lands_the_drone() {
    assert_landed(&fly(&scripted(SimFault::MocapLost, 1e3), None, FULL), Fault::MocapLost);
}

#[test]
fn a_short_loss_holds_and_the_flight_goes_on() {
    let story = fly(&scripted(SimFault::MocapSilent, 0.8), None, FULL);
    assert!(story.faults.contains(&Fault::MocapStale), "{:?}", story.faults);
    assert!(story.stick_while_stale <= 0.0, "{}", story.stick_while_stale);
    assert_eq!(story.phases.last(), Some(&Phase::Landed), "{:?}", story.phases);
    assert!(!story.faults.contains(&Fault::MocapLost), "{:?}", story.faults);
}

#[test]
fn a_drone_that_stops_reporting_is_told_to_land() {
    assert_landed(&fly(&scripted(SimFault::DroneMute, 1e3), None, FULL), Fault::DroneSilent);
}

#[test]
fn a_drone_that_hears_nothing_lands_by_itself_and_is_not_steered_on() {
    // Its own watchdog brings it down after 15 s; what it says ends the flight for control.
    let story = fly(&scripted(SimFault::DroneDeaf, 1e3), None, FULL);
    assert_landed(&story, Fault::NotFlying);
}

#[test]
fn the_operator_lands_the_drone() {
    assert_landed(&fly(&[], Some(FAULT_AT_S), FULL), Fault::OperatorStop);
}

#[test]
fn an_empty_battery_lands_the_drone() {
    // Enough to take off; the first seconds of flight take it below the limit.
    assert_landed(&fly(&[], None, (20.0, 18)), Fault::BatteryCritical);
}

#[test]
fn a_low_battery_keeps_the_drone_on_the_ground() {
    let story = fly(&[], Some(20.0), (8.0, 14));
    assert!(story.faults.contains(&Fault::BatteryLow), "{:?}", story.faults);
    assert!(story.height_max_m < STANDING_M + 0.01, "took off to {} m", story.height_max_m);
}
