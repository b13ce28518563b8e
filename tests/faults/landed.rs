//! Landings and climbs that one source reports, and reports wrong: confirmed later, or not at all.

use horizon_model::rows::pose;
use tello_flight::cycle::Operator;
use tello_flight::{Fault, Phase};
use tello_sim::virtual_time::VirtualFlight;
use tello_sim::{FlyingFlag, InjectedFault, Profile, ScriptedFault};

use super::story::{FAULT_AT_S, Moment, Story, asks, fly, fly_alone, settings};

/// How long the drone refuses to land. s
const REFUSAL_S: f64 = 9.0;

/// Another object at rest, so far from where the drone is.
fn still(offset_w_m: [f64; 3]) -> InjectedFault {
    InjectedFault::MocapStill { offset_w_m, turn_rad: 0.0, noise_m: 0.0005, noise_rad: 0.001 }
}

fn from(fault: InjectedFault, from_s: f64, for_s: f64) -> ScriptedFault {
    ScriptedFault { fault, from_s, for_s }
}

/// LAND goes on, twice a second, for as long as the drone flies; nobody says "landed" before that.
fn assert_lands_what_flies(story: &Story, ordered_at_s: f64) {
    let flies = |moment: &&Moment| {
        moment.at_s > ordered_at_s && moment.drone != tello_sim::DronePhase::Grounded
    };
    let (mut landings, mut until_s) = (0, ordered_at_s);
    for moment in story.moments.iter().filter(flies) {
        assert_ne!(moment.phase, Phase::Landed, "{moment:?}");
        landings += moment.landings;
        until_s = moment.at_s;
    }
    assert!(until_s - ordered_at_s >= REFUSAL_S, "down after {} s", until_s - ordered_at_s);
    let expected = (until_s - ordered_at_s) * 2.0;
    assert!(landings as f64 >= expected - 1.5, "{landings} of {expected} orders to land");
    story.assert_down();
}

#[test]
fn a_silent_drone_that_refuses_to_land_is_landed_on_whatever_object_lies_on_the_floor() {
    for offset_w_m in [[0.0, 0.0, -1.1], [2.0, 0.0, -1.1]] {
        let script = [
            from(still(offset_w_m), FAULT_AT_S, 1e3),
            from(InjectedFault::DroneMute, FAULT_AT_S, 1e3),
            from(InjectedFault::DroneRefusesLand, FAULT_AT_S, REFUSAL_S),
        ];
        let story = fly(&settings(&script), 60.0, asks(Operator::Land, FAULT_AT_S));
        story.assert_sound();
        assert_lands_what_flies(&story, FAULT_AT_S);
        assert_eq!(story.last().phase, Phase::LandingUnconfirmed, "nobody confirms it");
    }
}

#[test]
fn a_drone_that_reports_no_flight_does_not_count_against_its_own_height() {
    const BLIND_AT_S: f64 = 6.0;
    let script = [
        from(InjectedFault::MocapSilent, BLIND_AT_S, 1e3),
        from(InjectedFault::DroneRefusesLand, 0.1, BLIND_AT_S + REFUSAL_S + 3.0),
    ];
    let mut settings = settings(&script);
    settings.1.drone.status.flying = FlyingFlag::Standing;
    let story = fly(&settings, 60.0, asks(Operator::Land, BLIND_AT_S + 2.0));
    let ordered_at_s = story.first(0.0, |moment| moment.landings > 0).unwrap();
    assert_lands_what_flies(&story, ordered_at_s);
}

#[test]
fn one_source_alone_confirms_a_landing_later_and_the_other_is_named() {
    for (fault, missing) in [
        (InjectedFault::DroneMute, Fault::LandedByPose),
        (InjectedFault::MocapSilent, Fault::LandedByDrone),
    ] {
        let script = [from(fault, FAULT_AT_S, 1e3)];
        let story = fly(&settings(&script), 60.0, asks(Operator::Land, FAULT_AT_S));
        let down_s =
            story.first(FAULT_AT_S, |moment| moment.drone == tello_sim::DronePhase::Grounded);
        let after_s = story.last().at_s - down_s.unwrap();
        assert!((8.0..12.5).contains(&after_s), "{fault:?}: {after_s} s on the ground");
        assert_eq!(story.last().phase, Phase::Landed);
        assert!(story.last().faults.contains(&missing), "{:?}", story.last());
    }
    let story = fly(&settings(&[]), 60.0, asks(Operator::Land, FAULT_AT_S));
    let down_s = story.first(FAULT_AT_S, |moment| moment.drone == tello_sim::DronePhase::Grounded);
    let after_s = story.last().at_s - down_s.unwrap();
    assert!(after_s < 1.3, "both: {after_s} s on the ground");
    assert_eq!(story.last().faults, [Fault::OperatorStop]);
}

#[test]
fn a_height_that_is_wrong_in_the_climb_lands() {
    let scaled = InjectedFault::MocapFrame { turn_rad: 0.0, is_mirrored: false, scale: 0.1 };
    // Where the drone is at 0.3 m.
    let probe = fly_alone(&settings(&[]), 8.0);
    let ground_m = probe.moments[0].pose[pose::Z];
    let low_s = probe.first(0.0, |moment| moment.pose[pose::Z] > ground_m + 0.3).unwrap();
    for script in [from(scaled, 0.0, 1e3), from(still([0.0; 3]), low_s, 1e3)] {
        let mut settings = settings(&[script]);
        // A tenth of the height on the ground is below the floor of the filter.
        settings.0.cycle.filter.floor_m = 0.0;
        let story = fly_alone(&settings, 40.0);
        let ordered_s = story.first(0.0, |moment| moment.take_offs > 0).unwrap();
        let received_s = story.first(0.0, |moment| moment.landings > 0).unwrap();
        let ended_by = story.moments.iter().find(|moment| moment.landings > 0);
        let landed_s = received_s - ordered_s;
        assert!(landed_s < 8.5, "{script:?}: LAND after {landed_s} s, {ended_by:?}");
        assert!(!story.has(Fault::TakeOffTimeout), "{script:?}: {landed_s} s, {ended_by:?}");
        assert!(story.moments.iter().all(|moment| moment.phase != Phase::Flying), "{script:?}");
    }
}

#[test]
fn no_climb_of_a_healthy_drone_contradicts_its_poses() {
    let profiles = [
        Profile::Clean,
        Profile::GoodDay,
        Profile::Typical,
        Profile::BadDay,
        Profile::MildOutages,
        Profile::Outages,
    ];
    for (profile, seed) in
        profiles.into_iter().flat_map(|profile| (0..10).map(move |s| (profile, s)))
    {
        let (flight, mut sim) = settings(&[]);
        sim.profile = profile;
        let mut virtual_flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
        let mut climbs = 0;
        for _ in 0..600 {
            let decision = virtual_flight.tick().unwrap().decision.unwrap();
            if climbs > 50 && decision.phase == Phase::Flying {
                break;
            }
            if decision.phase == Phase::TakingOff {
                climbs += 1;
                for fault in [Fault::PoseDoubtful, Fault::PoseInconsistent, Fault::MocapFrozen] {
                    assert!(
                        !decision.faults.contains(fault),
                        "{profile:?}, seed {seed}: {fault:?}"
                    );
                }
            }
        }
        assert!(climbs > 50, "{profile:?}, seed {seed}: no climb");
    }
}
