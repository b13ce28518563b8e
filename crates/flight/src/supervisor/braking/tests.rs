//! A vehicle that brakes before it lands.

use horizon_model::rows::Pose;

use super::super::tests::*;
use super::super::*;
use super::{LOW_M, SLOW_MPS};

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
        Evidence { is_by_hand: true, ..fast() },
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
    let by_hand = Evidence { is_by_hand: true, ..done };
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

#[test]
fn a_vehicle_comes_down_before_it_lands_unless_the_drone_is_silent() {
    let done = Evidence { is_mission_done: true, speed_mps: 0.0, ..ALOFT };
    let at = |z_m: f64, e: Evidence| Evidence { pose: Some(Pose::new(0.0, 0.0, z_m, 0.0)), ..e };
    let descends = |e: &Evidence, ticks: u32| {
        let mut fixture = Fixture::taking_off();
        fixture.supervisor.table.land_from_m = Some(0.45);
        fixture.pass(60, &ALOFT);
        (0..200).find(|_| fixture.tick(e).is_braking).expect("a brake");
        let to_m = fixture.supervisor.descends_to_m();
        fixture.pass(ticks, e);
        (fixture, to_m)
    };
    let (mut fixture, to_m) = descends(&at(1.0, done), 70);
    let to_m = to_m.unwrap();
    assert!((to_m - 0.55).abs() < 1e-9, "above the ground at 0.1 m: {to_m} m");
    assert_eq!(fixture.tick(&at(to_m + LOW_M + 0.01, done)).phase, Phase::Flying);
    let decision = fixture.tick(&at(to_m + LOW_M, done));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    // One that does not get down lands nevertheless, and so does one whose poses are not trusted.
    let (mut fixture, _) = descends(&at(1.0, done), 93);
    assert_eq!(fixture.run(3, &at(1.0, done)).phase, Phase::Landing);
    let (mut fixture, _) = descends(&at(1.0, done), 5);
    let stale = Evidence { pose_age_s: Some(0.26), ..at(1.0, done) };
    assert_eq!(fixture.tick(&stale).phase, Phase::Landing);
    let mut silent = braking();
    silent.supervisor.table.land_from_m = Some(0.45);
    assert_eq!(silent.tick(&Evidence { speed_mps: 0.1, ..fast() }).phase, Phase::Landing);
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
