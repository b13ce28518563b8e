//! A vehicle that brakes before it lands.

use horizon_model::rows::Pose;

use super::super::tests::*;
use super::super::*;
use super::{LOW_M, SLOW_MPS};

const DONE: Evidence = Evidence { is_mission_done: true, speed_mps: 0.0, ..ALOFT };

/// Fast, and the drone silent for too long.
fn fast() -> Evidence {
    Evidence { speed_mps: 1.0, ..with_drone(ALOFT, |drone| drone.age_s = 2.01) }
}

fn braking() -> Fixture {
    let mut fixture = Fixture::flying();
    fixture.pass(1, &Evidence { speed_mps: 1.0, ..ALOFT });
    let decision = fixture.tick(&fast());
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Controller)));
    assert!(decision.is_braking);
    assert_eq!(faults(decision), [Fault::DroneSilent]);
    fixture
}

#[test]
fn it_lands_when_it_is_slow_or_has_braked_for_long_enough() {
    let decision = braking().tick(&Evidence { speed_mps: 0.2, ..fast() });
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    // 0.1 s a tick.
    let mut fixture = braking();
    assert_eq!(fixture.run(14, &fast()).phase, Phase::Flying);
    let decision = fixture.tick(&fast());
    assert_eq!((decision.phase, decision.is_braking), (Phase::Landing, false));
}

#[test]
fn it_lands_at_once_when_the_controller_may_no_longer_steer() {
    for e in [
        Evidence { pose_age_s: Some(0.26), ..fast() },
        Evidence { speed_mps: f64::NAN, ..fast() },
        with_poses(fast(), |it| it.jump_m = Some(1.51)),
        asks_to_land(fast()),
    ] {
        assert_eq!(braking().tick(&e).phase, Phase::Landing, "{e:?}");
    }
    // Nor does it begin to brake where the controller does not steer.
    let mut fixture = Fixture::flying();
    fixture.pass(1, &Evidence { pose_age_s: Some(0.26), ..ALOFT });
    assert_eq!(fixture.tick(&fast()).phase, Phase::Landing);
}

#[test]
fn a_flight_that_brakes_ends_even_if_its_reason_goes_away() {
    let mut fixture = braking();
    let again = Evidence { speed_mps: 1.0, ..ALOFT };
    let decision = fixture.tick(&again);
    assert!(decision.is_braking && decision.may_steer());
    assert_eq!(faults(decision), [Fault::DroneSilent], "it stays the reason");
    assert_eq!(fixture.tick(&ALOFT).phase, Phase::Landing);
}

#[test]
fn a_speed_just_above_the_limit_is_braked_on_and_so_is_one_before_a_wall_that_a_plan_meets() {
    for e in [
        Evidence { speed_mps: SLOW_MPS.next_up(), ..fast() },
        Evidence { plan: PlanClearance::Blocked, ..fast() },
    ] {
        let decision = braking().tick(&e);
        assert_eq!((decision.phase, decision.is_braking), (Phase::Flying, true), "{e:?}");
    }
}

#[test]
fn a_mission_that_is_done_lands_a_vehicle_at_rest_and_brakes_one_that_a_person_hands_back() {
    let done = Evidence { is_mission_done: true, ..ALOFT };
    let by_hand = Evidence { hand: HandInput::Steering, ..done };
    let fast = Evidence { speed_mps: 0.8, ..done };
    let mut fixture = Fixture::flying();
    fixture.pass(20, &by_hand);
    let hold = (TABLE.finish_hold_s * 10.0).round();
    let is_braking = |fixture: &mut Fixture| {
        let decision = fixture.tick(&fast);
        (decision.phase, decision.is_braking)
    };
    for _ in 0..100 {
        match is_braking(&mut fixture) {
            (Phase::Flying, false) => {}
            found => {
                assert_eq!(found, (Phase::Flying, true));
                break;
            }
        }
    }
    let decision = fixture.tick(&done);
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    let mut fixture = Fixture::flying();
    let ticks = (0..100).take_while(|_| fixture.tick(&done).phase == Phase::Flying).count();
    assert!((ticks as f64 - hold).abs() <= 1.0, "{ticks} ticks for {hold}");
}

/// `e` at this height.
fn high(z_m: f64, e: &Evidence) -> Evidence {
    Evidence { pose: Some(Pose::new(0.0, 0.0, z_m, 0.0)), ..*e }
}

/// A vehicle that begins to come down from 1.5 m to 0.55 m, with `e`, after its mission.
fn descending(e: &Evidence) -> Fixture {
    let mut fixture = Fixture::taking_off();
    fixture.supervisor.table.land_from_m = Some(0.45);
    fixture.pass(60, &ALOFT);
    (0..200).find(|_| fixture.tick(&high(1.5, e)).is_braking).expect("a brake");
    fixture
}

/// Ticks of 0.1 s until a vehicle lands that comes down by `down_m` a tick; `None` in 30 s.
fn lands_after(e: &Evidence, down_m: f64) -> Option<u32> {
    let mut fixture = descending(&Evidence { outage: None, ..*e });
    (1..300).find(|k| {
        let z_m = (1.5 - down_m * f64::from(*k)).max(0.55);
        fixture.tick(&high(z_m, e)).phase == Phase::Landing
    })
}

#[test]
fn a_vehicle_comes_down_before_it_lands_unless_the_drone_is_silent() {
    let mut fixture = descending(&DONE);
    let to_m = fixture.supervisor.descends_to_m().unwrap();
    assert!((to_m - 0.55).abs() < 1e-9, "above the ground at 0.1 m: {to_m} m");
    assert_eq!(fixture.tick(&high(to_m + LOW_M + 0.01, &DONE)).phase, Phase::Flying);
    let decision = fixture.tick(&high(to_m + LOW_M, &DONE));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    for e in [
        Evidence { pose_age_s: Some(0.26), ..high(1.0, &DONE) },
        Evidence { speed_mps: f64::NAN, ..high(1.0, &DONE) },
    ] {
        assert_eq!(descending(&DONE).tick(&e).phase, Phase::Landing, "{e:?}");
    }
    let mut silent = braking();
    silent.supervisor.table.land_from_m = Some(0.45);
    assert_eq!(silent.tick(&Evidence { speed_mps: 0.1, ..fast() }).phase, Phase::Landing);
}

#[test]
fn a_vehicle_that_does_not_get_lower_or_receives_nothing_is_landed() {
    let if_applied = [EstimatedMotion { pose: at(0.0, 1.1), rate: Pose::zeros() }; 2];
    let released = Outage { for_s: 0.5, is_held: false, if_applied };
    let drifts = Evidence { speed_mps: 1.0, ..DONE };
    for (what, e, down_m, expected) in [
        ("comes down", DONE, 0.04, 23),
        ("stands on something", DONE, 0.0, 15),
        ("hardly sinks", DONE, 0.005, 15),
        ("sinks slowly", DONE, 0.008, 95),
        ("never becomes slow", drifts, 0.04, 15),
        ("an outage", Evidence { outage: Some(released), ..DONE }, 0.04, 1),
    ] {
        let found = lands_after(&e, down_m);
        let is_near = found.is_some_and(|found| found.abs_diff(expected) <= 1);
        assert!(is_near, "{what}: {found:?} instead of {expected}");
    }
}

#[test]
fn a_vehicle_that_came_down_lets_somebody_past_before_it_lands_unless_a_fault_ends_the_flight() {
    let comes = with_obstacles(DONE, |it| it.approach = ObstacleApproach::Predicted);
    let hidden = with_obstacles(DONE, |it| it.is_unseen = true);
    let silent = |e: Evidence| with_drone(e, |drone| drone.age_s = 2.01);
    // From the tick in which it is done on: 2 s, then 60 s, while it comes 70 s.
    for (what, near, expected) in [
        ("nobody", DONE, 0),
        ("comes", comes, 700),
        ("hidden", hidden, 600),
        ("silent drone", silent(comes), 0),
    ] {
        let mut fixture = descending(&DONE);
        let found = (0..1000).find(|_| fixture.tick(&high(0.6, &near)).phase == Phase::Landing);
        let is_near = found.is_some_and(|found: u32| found.abs_diff(expected) <= 2);
        assert!(is_near, "{what}: {found:?} instead of {expected}");
    }
    let mut fixture = descending(&DONE);
    // It evades upwards, and comes down again.
    assert_eq!(fixture.run(100, &high(0.6, &comes)).phase, Phase::Flying);
    assert_eq!(fixture.run(100, &high(0.9, &comes)).phase, Phase::Flying);
    let gone = (1..100).find(|_| fixture.tick(&high(0.6, &DONE)).phase == Phase::Landing);
    assert_eq!(gone, Some(40), "4 s after it is gone");
    // Who stayed for long leaves time to come down.
    let mut fixture = descending(&DONE);
    assert_eq!(fixture.run(200, &high(1.4, &comes)).phase, Phase::Flying);
    let mut heights_m = (0..100).map(|k| (1.4 - 0.04 * (f64::from(k) - 41.0).max(0.0)).max(0.55));
    let low_m = heights_m.find(|z_m| fixture.tick(&high(*z_m, &DONE)).phase == Phase::Landing);
    assert!(low_m.is_some_and(|z_m| z_m < 0.61), "{low_m:?} m");
}

#[test]
fn a_person_who_takes_over_ends_the_brake_unless_the_flight_ends_by_hand_too() {
    let by_hand = |e: Evidence| Evidence { hand: HandInput::Steering, ..e };
    let mut fixture = descending(&DONE);
    fixture.pass(3, &high(1.4, &DONE));
    let decision = fixture.run(100, &by_hand(high(1.2, &DONE)));
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Person)));
    assert!(!decision.is_braking && decision.faults.is_empty(), "{decision:?}");
    assert_eq!(fixture.supervisor.descends_to_m(), None);
    // Handed back, the mission is done anew.
    let decision = fixture.run(20, &high(1.2, &DONE));
    assert_eq!((decision.phase, decision.is_braking), (Phase::Flying, false));
    let decision = fixture.tick(&high(1.2, &DONE));
    assert_eq!((decision.phase, decision.is_braking), (Phase::Flying, true));
    // A person judges a silent drone, an empty battery ends every flight.
    let mut silent = braking();
    let decision = silent.tick(&by_hand(fast()));
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Person)));
    assert!(decision.ended_by.is_empty(), "{decision:?}");
    assert_eq!(silent.tick(&fast()).phase, Phase::Landing, "handed back");
    let mut empty = Fixture::flying();
    let critical = with_drone(Evidence { speed_mps: 1.0, ..ALOFT }, |drone| drone.battery_pct = 9);
    (0..20).find(|_| empty.tick(&critical).is_braking).expect("a brake");
    assert_eq!(empty.tick(&by_hand(critical)).phase, Phase::Landing);
}

#[test]
fn a_fault_that_holds_the_sticks_ends_the_braking_by_a_landing() {
    let failed = Evidence { has_estimator_failed: true, ..fast() };
    assert_eq!(braking().tick(&failed).phase, Phase::Landing);
}

#[test]
fn a_vehicle_that_has_nothing_to_land_for_never_has_braked() {
    let fixture = Fixture::flying();
    let slow = Evidence { t_ns: fixture.t_ns, speed_mps: 0.0, ..ALOFT };
    assert!(!fixture.supervisor.has_braked(&slow, &fixture.supervisor.assess(&slow)));
}

#[test]
fn a_drone_that_keeps_an_old_command_is_landed_at_once() {
    let if_applied = [EstimatedMotion { pose: at(0.0, 1.1), rate: Pose::zeros() }; 2];
    let held = Outage { for_s: 0.5, is_held: true, if_applied };
    assert_eq!(braking().tick(&Evidence { outage: Some(held), ..fast() }).phase, Phase::Landing);
}
