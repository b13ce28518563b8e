//! A person at the sticks, and the key that stops the motors.

use super::*;

fn by_hand(e: Evidence) -> Evidence {
    Evidence { hand: HandInput::Steering, ..e }
}

/// No pose, and none for long.
fn blind(e: Evidence) -> Evidence {
    Evidence { pose_age_s: None, pose: None, ..e }
}

fn asks_for_emergency_stop(e: Evidence) -> Evidence {
    Evidence { operator: Operator::EmergencyStop, ..e }
}

#[test]
fn a_person_takes_over_at_once_and_hands_back_at_once() {
    let mut fixture = Fixture::flying();
    assert_eq!(fixture.tick(&ALOFT).pilot, Some(Pilot::Controller));
    assert_eq!(fixture.tick(&by_hand(ALOFT)).pilot, Some(Pilot::Person));
    assert_eq!(fixture.tick(&ALOFT).pilot, Some(Pilot::Controller));
}

#[test]
fn a_person_flies_on_without_a_pose_and_who_hands_back_blind_is_landed() {
    let mut fixture = Fixture::flying();
    let decision = fixture.run(300, &by_hand(blind(ALOFT)));
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Person)));
    assert!(decision.faults.contains(Fault::MocapLost), "{:?}", decision.faults);
    let decision = fixture.tick(&blind(ALOFT));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
}

#[test]
fn no_fault_that_blinds_or_warns_the_controller_takes_the_sticks_from_a_person() {
    let failed = Evidence { has_estimator_failed: true, has_controller_failed: true, ..ALOFT };
    for e in [
        blind(ALOFT),
        Evidence { pose: Some(at(3.5, 1.1)), ..ALOFT },
        with_poses(ALOFT, |it| it.jump_m = Some(9.0)),
        with_drone(ALOFT, |drone| drone.age_s = 5.0),
        failed,
    ] {
        let decision = Fixture::flying().run(50, &by_hand(e));
        assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Person)), "{e:?}");
        assert!(!decision.faults.is_empty(), "{e:?}");
    }
}

#[test]
fn an_empty_battery_late_ticks_and_the_order_to_land_end_a_flight_by_hand() {
    for e in [
        with_drone(ALOFT, |drone| drone.battery_pct = 9),
        Evidence { skipped: 11, ..ALOFT },
        asks_to_land(ALOFT),
    ] {
        let decision = Fixture::flying().run(11, &by_hand(e));
        assert_eq!((decision.phase, decision.pilot), (Phase::Landing, None), "{e:?}");
    }
}

#[test]
fn a_take_off_without_a_pose_needs_a_person_who_asks_for_it() {
    let on_the_ground = blind(CALM);
    for (operator, is_by_hand, phase) in [
        (Operator::FlyByHand, true, Phase::TakingOff),
        (Operator::Fly, true, Phase::Idle),
        (Operator::FlyByHand, false, Phase::Idle),
        (Operator::Wait, true, Phase::Idle),
    ] {
        let mut fixture = Fixture::new(Start::Grounded);
        let hand = if is_by_hand { HandInput::Steering } else { HandInput::Absent };
        let decision = fixture.tick(&Evidence { operator, hand, ..on_the_ground });
        assert_eq!(decision.phase, phase, "{operator:?}, by hand: {is_by_hand}");
    }
    // The drone's report confirms it, and a person needs no time to settle.
    let mut fixture = Fixture::new(Start::Grounded);
    let fly = Evidence { operator: Operator::FlyByHand, ..by_hand(on_the_ground) };
    assert_eq!(fixture.tick(&fly).order, Some(DroneOrder::TakeOff));
    let decision = fixture.tick(&with_drone(fly, |drone| drone.is_flying = true));
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Person)));
}

#[test]
fn a_battery_that_is_too_low_keeps_a_person_down_too() {
    let mut fixture = Fixture::new(Start::Grounded);
    let low = with_drone(CALM, |drone| drone.battery_pct = 29);
    let fly = Evidence { operator: Operator::FlyByHand, ..by_hand(low) };
    assert_eq!(fixture.run(10, &fly).phase, Phase::Idle);
}

#[test]
fn a_finished_mission_does_not_land_a_person() {
    let mut fixture = Fixture::flying();
    let done = Evidence { is_mission_done: true, ..ALOFT };
    assert_eq!(fixture.run(100, &by_hand(done)).phase, Phase::Flying);
    assert_eq!(fixture.run(20, &done).phase, Phase::Flying, "handed back for 1.9 s");
    assert_eq!(fixture.tick(&done).phase, Phase::Landing, "handed back for 2.0 s");
}

#[test]
fn the_emergency_stop_works_in_every_phase_at_once() {
    let landed = || {
        let mut fixture = Fixture::landing();
        fixture.pass(11, &CALM);
        fixture
    };
    for mut fixture in [
        Fixture::new(Start::Grounded),
        Fixture::taking_off(),
        Fixture::flying(),
        Fixture::landing(),
        landed(),
        Fixture::new(Start::Carried),
    ] {
        let before = fixture.supervisor.phase();
        let decision = fixture.tick(&asks_for_emergency_stop(ALOFT));
        assert_eq!(
            (decision.phase, decision.order),
            (Phase::MotorsStopped, Some(DroneOrder::EmergencyStop)),
            "{before:?}"
        );
        assert!(decision.pilot.is_none() && decision.faults.contains(Fault::OperatorEmergencyStop));
        // Never taken back, whatever is asked for.
        let decision = fixture.run(3, &by_hand(asks_to_fly(ALOFT)));
        assert_eq!((decision.phase, decision.pilot), (Phase::MotorsStopped, None), "{before:?}");
    }
}

#[test]
fn an_emergency_stop_is_ordered_every_half_second_until_the_vehicle_is_down() {
    let mut fixture = Fixture::flown();
    assert_eq!(
        fixture.tick(&asks_for_emergency_stop(ALOFT)).order,
        Some(DroneOrder::EmergencyStop)
    );
    for _ in 0..3 {
        let ticks = (1..=200).find(|_| {
            fixture.tick(&asks_for_emergency_stop(ALOFT)).order == Some(DroneOrder::EmergencyStop)
        });
        assert_eq!(ticks, Some(5));
    }
    fixture.pass(11, &asks_for_emergency_stop(CALM));
    for _ in 0..50 {
        assert_eq!(fixture.tick(&asks_for_emergency_stop(CALM)).order, None);
    }
}
