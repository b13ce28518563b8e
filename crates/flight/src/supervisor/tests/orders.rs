//! When take-off and landing are ordered, and when they are confirmed.

use super::*;

/// Like `CALM`, with the drone reporting to fly: motors on, still low.
fn spinning() -> Evidence {
    with_drone(CALM, |drone| drone.is_flying = true)
}

/// Ticks with `e` until `order` comes; the number of ticks comes back.
fn ticks_until(fixture: &mut Fixture, order: Option<DroneOrder>, e: &Evidence) -> Option<u32> {
    (1..=200).find(|_| fixture.tick(e).order == order)
}

#[test]
fn take_off_is_ordered_again_after_three_seconds_on_the_ground() {
    let mut fixture = Fixture::taking_off();
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::TakeOff), &CALM), Some(30));
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::TakeOff), &CALM), Some(30));
}

#[test]
fn take_off_is_not_ordered_again_ten_seconds_after_it_was_asked_for() {
    let table = SupervisorTable { take_off_timeout_s: 60.0, ..TABLE };
    let settings = SupervisorSettings::try_from(&table).unwrap();
    let mut fixture = Fixture { supervisor: Supervisor::new(settings, Start::Grounded), t_ns: 0 };
    for expected in [Some(1), Some(30), Some(30), Some(30), None] {
        let found = ticks_until(&mut fixture, Some(DroneOrder::TakeOff), &asks_to_fly(CALM));
        assert_eq!(found, expected);
    }
    let until_ns = fixture.supervisor.phase_since_ns + 10_000_000_000;
    let may_repeat = |t_ns| fixture.supervisor.may_repeat_take_off(&Evidence { t_ns, ..CALM });
    assert_eq!([until_ns - 1, until_ns].map(may_repeat), [true, false]);
}

#[test]
fn a_drone_that_is_silent_on_the_ground_is_not_started_by_hand_either() {
    let by_hand = Evidence { operator: Operator::FlyByHand, hand: HandInput::Neutral, ..CALM };
    for (age_s, phase) in [(1.9, Phase::TakingOff), (2.1, Phase::Idle)] {
        let mut fixture = Fixture::new(Start::Grounded);
        let e = with_drone(by_hand, |drone| drone.age_s = age_s);
        assert_eq!(fixture.tick(&e).phase, phase, "{age_s} s");
    }
}

#[test]
fn nobody_steers_a_drone_that_takes_no_sticks_unless_its_report_is_old() {
    for (e, may_steer) in [
        (ALOFT, true),
        (with_drone(ALOFT, |drone| drone.takes_sticks = false), false),
        (
            Evidence {
                hand: HandInput::Steering,
                ..with_drone(ALOFT, |drone| {
                    (drone.takes_sticks, drone.age_s) = (false, 3.0);
                })
            },
            true,
        ),
    ] {
        let decision = Fixture::new(Start::Airborne).run(3, &e);
        assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, may_steer));
    }
}

#[test]
fn take_off_is_not_ordered_again_unless_the_drone_reports_to_stand() {
    for e in [
        spinning(),
        Evidence { drone: None, ..CALM },
        with_drone(CALM, |drone| drone.battery_pct = 29),
        Evidence { pose_age_s: Some(0.5), ..CALM },
    ] {
        let mut fixture = Fixture::taking_off();
        fixture.pass(20, &CALM);
        for _ in 0..30 {
            let decision = fixture.tick(&e);
            assert_ne!(decision.order, Some(DroneOrder::TakeOff), "{e:?}");
        }
    }
}

#[test]
fn a_drone_that_flew_and_stands_again_in_the_take_off_is_landed_and_never_ordered_again() {
    let mut fixture = Fixture::taking_off();
    fixture.pass(1, &spinning());
    fixture.pass(9, &CALM);
    // A report that was wrong for a moment counts no more.
    assert_eq!(fixture.tick(&spinning()).phase, Phase::TakingOff);
    assert_eq!(fixture.run(10, &CALM).phase, Phase::TakingOff);
    let decision = fixture.tick(&CALM);
    assert_eq!((decision.phase, faults(decision)), (Phase::Landing, vec![Fault::NotFlying]));
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::TakeOff), &CALM), None);
}

#[test]
fn a_drone_that_rose_without_a_report_is_landed_when_the_report_is_overdue() {
    let mut fixture = Fixture::taking_off();
    fixture.pass(1, &Evidence { pose: Some(at_height(0.26)), ..CALM });
    // 4 s after the order its report counts, and has to last for a second.
    for _ in 0..48 {
        let decision = fixture.tick(&CALM);
        assert_eq!((decision.phase, decision.order), (Phase::TakingOff, None));
    }
    let decision = fixture.run(2, &CALM);
    assert_eq!((decision.phase, faults(decision)), (Phase::Landing, vec![Fault::NotFlying]));
}

#[test]
fn a_drone_that_has_risen_by_more_than_three_centimetres_gets_no_second_order() {
    for (height_m, order) in [(0.03, Some(DroneOrder::TakeOff)), (0.04, None)] {
        let mut fixture = Fixture::new(Start::Grounded);
        let at = |height_m| Evidence { pose: Some(at_height(height_m)), ..CALM };
        fixture.pass(1, &at(0.0));
        fixture.pass(1, &asks_to_fly(at(0.0)));
        fixture.pass(29, &at(height_m));
        assert_eq!(
            fixture.tick(&at(height_m)).order,
            order,
            "{height_m} m, 3 s after the first order"
        );
        let has_risen = [0.15, 0.16].map(|height_m| fixture.supervisor.has_risen(&at(height_m)));
        assert_eq!(has_risen, [false, true]);
    }
}

#[test]
fn a_take_off_that_is_not_confirmed_in_time_ends_in_landing() {
    let low = Evidence { pose: Some(at_height(0.4)), ..spinning() };
    // By the poses it has not risen either, or it has to some extent.
    for (e, ticks) in [(spinning(), 31), (low, 80)] {
        let mut fixture = Fixture::taking_off();
        assert_eq!(fixture.run(ticks - 1, &e).phase, Phase::TakingOff, "{ticks}");
        let decision = fixture.tick(&e);
        assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
        assert_eq!(faults(decision), [Fault::TakeOffTimeout]);
        let decision = fixture.run(20, &CALM);
        assert_eq!(
            (decision.phase, faults(decision)),
            (Phase::Landed, vec![Fault::TakeOffTimeout])
        );
    }
}

#[test]
fn a_drone_that_flies_and_is_not_seen_to_stay_down_is_given_its_time() {
    let low = Evidence { pose: Some(at_height(0.4)), ..spinning() };
    for e in [low, Evidence { pose: None, ..CALM }, CALM] {
        let mut fixture = Fixture::taking_off();
        fixture.pass(1, &spinning());
        assert_eq!(fixture.run(9, &e).phase, Phase::TakingOff, "{e:?}");
        assert_eq!(fixture.run(21, &spinning()).phase, Phase::TakingOff, "{e:?}");
    }
}

#[test]
fn a_take_off_confirmed_at_the_last_moment_is_good() {
    let mut fixture = Fixture::taking_off();
    fixture.pass(79, &Evidence { pose: Some(at_height(0.4)), ..spinning() });
    let decision = fixture.tick(&ALOFT);
    assert_eq!((decision.phase, decision.faults.is_empty()), (Phase::Flying, true));
}

#[test]
fn the_rise_above_the_ground_decides_what_is_airborne() {
    // The ground is at 0.25 m and the vehicle must rise by 0.5 m, whatever the drone reports.
    for (height_m, is_flying, phase) in [
        (Some(0.75), false, Phase::Flying),
        (Some(0.75), true, Phase::Flying),
        (Some(0.74), true, Phase::TakingOff),
        (None, false, Phase::TakingOff),
        // Without a height the report of the drone counts.
        (None, true, Phase::Flying),
    ] {
        let mut fixture = Fixture::new(Start::Grounded);
        let ground = Evidence { pose: Some(at_height(0.25)), ..CALM };
        fixture.pass(1, &asks_to_fly(ground));
        let e = with_drone(ground, |drone| drone.is_flying = is_flying);
        let decision = fixture.tick(&Evidence { pose: height_m.map(at_height), ..e });
        assert_eq!(decision.phase, phase, "{height_m:?} m, flying {is_flying}");
    }
}

#[test]
fn without_a_fresh_position_the_drone_counts_as_airborne() {
    for (e, phase) in [
        (Evidence { pose_age_s: Some(0.5), ..ALOFT }, Phase::Flying),
        (Evidence { pose: None, ..ALOFT }, Phase::Flying),
        // High, but by an old position and not by the drone.
        (Evidence { pose_age_s: Some(0.5), drone: CALM.drone, ..ALOFT }, Phase::TakingOff),
    ] {
        assert_eq!(Fixture::taking_off().tick(&e).phase, phase, "{e:?}");
    }
}

#[test]
fn the_ground_is_where_the_newest_fresh_position_was_before_the_take_off() {
    let mut fixture = Fixture::new(Start::Grounded);
    let at = |height_m| Evidence { pose: Some(at_height(height_m)), ..CALM };
    fixture.pass(1, &at(0.9));
    fixture.pass(1, &at(0.25));
    fixture.pass(1, &Evidence { pose_age_s: Some(0.5), ..at(0.0) });
    fixture.pass(1, &asks_to_fly(at(0.25)));
    assert_eq!(fixture.tick(&at(0.74)).phase, Phase::TakingOff);
    assert_eq!(fixture.tick(&at(0.76)).phase, Phase::Flying);
}

#[test]
fn settling_begins_when_the_take_off_is_confirmed_and_not_in_a_flight_that_began_aloft() {
    let mut fixture = Fixture::taking_off();
    fixture.pass(25, &spinning());
    assert!(!fixture.run(15, &ALOFT).may_steer());
    assert!(fixture.tick(&ALOFT).may_steer());
    assert!(Fixture::new(Start::Airborne).tick(&ALOFT).may_steer());
}

#[test]
fn a_mission_is_done_when_it_stays_done() {
    let mut fixture = Fixture::flying();
    let done = Evidence { is_mission_done: true, ..ALOFT };
    assert_eq!(fixture.run(20, &done).phase, Phase::Flying);
    assert_eq!(fixture.tick(&ALOFT).phase, Phase::Flying);
    assert_eq!(fixture.run(20, &done).phase, Phase::Flying);
    assert_eq!(fixture.tick(&done).phase, Phase::Landing);
}

#[test]
fn landing_is_ordered_every_half_second_until_the_vehicle_is_down() {
    let mut fixture = Fixture::landing();
    for _ in 0..4 {
        assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::Land), &ALOFT), Some(5));
    }
    assert_eq!(fixture.run(11, &CALM).phase, Phase::Landed);
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::Land), &ALOFT), None);
}

#[test]
fn an_operator_who_changes_his_mind_still_lands() {
    let mut fixture = Fixture::landing();
    let decision = fixture.run(30, &asks_to_fly(ALOFT));
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Landing, false));
}

#[test]
fn a_vehicle_is_down_once_it_looks_grounded_for_a_second() {
    let mut fixture = Fixture::landing();
    assert_eq!(fixture.run(10, &CALM).phase, Phase::Landing);
    assert_eq!(fixture.tick(&ALOFT).phase, Phase::Landing);
    assert_eq!(fixture.run(10, &CALM).phase, Phase::Landing);
    assert_eq!(fixture.tick(&CALM).phase, Phase::Landed);
}

#[test]
fn an_old_report_of_the_drone_does_not_make_it_land() {
    let silent = with_drone(CALM, |drone| drone.age_s = 2.01);
    assert_eq!(Fixture::landing().run(30, &silent).phase, Phase::Landing);
}

#[test]
fn a_silent_drone_is_down_when_it_is_back_at_the_ground() {
    // The ground is at 0.25 m, half of the airborne height above it at 0.5 m.
    for (height_m, phase) in [(0.49, Phase::Landed), (0.5, Phase::LandingUnconfirmed)] {
        let mut fixture = Fixture::new(Start::Grounded);
        fixture.pass(1, &asks_to_fly(Evidence { pose: Some(at_height(0.25)), ..CALM }));
        fixture.pass(30, &ALOFT);
        let silent = with_drone(ALOFT, |drone| drone.age_s = 3.0);
        assert_eq!(fixture.run(20, &silent).phase, Phase::Landing);
        let decision = fixture.run(101, &Evidence { pose: Some(at_height(height_m)), ..silent });
        assert_eq!(decision.phase, phase, "{height_m} m");
        let is_alone = phase == Phase::Landed;
        assert_eq!(decision.faults.contains(Fault::LandedByPose), is_alone);
        assert!(decision.faults.contains(Fault::DroneSilent));
    }
}

#[test]
fn a_running_take_off_is_not_mistaken_for_a_landing() {
    // The drone ignores a landing now and will fly in a moment.
    let mut fixture = Fixture::taking_off();
    fixture.pass(1, &asks_to_land(CALM));
    // Ordered at tick 0 and never seen: confirmed from tick 80 on, down 10 ticks later: 89 is the last one before.
    assert_eq!(fixture.run(88, &CALM).phase, Phase::Landing);
    assert_eq!(fixture.tick(&CALM).phase, Phase::Landed);
    // It was seen: from tick 40 on.
    let mut fixture = Fixture::taking_off();
    fixture.pass(1, &with_drone(CALM, |drone| drone.is_flying = true));
    fixture.pass(1, &asks_to_land(CALM));
    assert_eq!(fixture.run(47, &CALM).phase, Phase::Landing);
    assert_eq!(fixture.tick(&CALM).phase, Phase::Landed);
}

#[test]
fn a_landing_that_is_not_confirmed_is_a_fault_and_goes_on() {
    let mut fixture = Fixture::landing();
    let decision = fixture.run(99, &ALOFT);
    assert_eq!(decision.phase, Phase::Landing, "9.9 s");
    let decision = fixture.tick(&ALOFT);
    assert_eq!(decision.phase, Phase::LandingUnconfirmed, "10.0 s");
    assert_eq!(faults(decision), [Fault::LandingTimeout, Fault::OperatorStop]);
    for _ in 0..4 {
        assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::Land), &asks_to_fly(ALOFT)), Some(5));
    }
    let decision = fixture.run(11, &CALM);
    assert_eq!((decision.phase, decision.order), (Phase::LandingUnconfirmed, None));
    assert_eq!(faults(decision), [Fault::LandingTimeout, Fault::OperatorStop]);
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::Land), &CALM), None);
}

#[test]
fn a_landing_confirmed_at_the_last_moment_is_good() {
    let mut fixture = Fixture::landing();
    fixture.pass(89, &ALOFT);
    let decision = fixture.run(11, &CALM);
    assert_eq!((decision.phase, faults(decision)), (Phase::Landed, vec![Fault::OperatorStop]));
}

#[test]
fn without_a_guardian_or_after_a_standstill_nothing_takes_off_and_what_flies_is_landed() {
    for (incidents, fault) in
        [(GUARDIAN_LOST, Fault::GuardianLost), (STALLED, Fault::ProgramStalled)]
    {
        let mut fixture = Fixture::new(Start::Grounded);
        fixture.pass(1, &CALM);
        let decision = fixture.tick(&Evidence { incidents, ..asks_to_fly(CALM) });
        assert_eq!((decision.phase, decision.order), (Phase::Idle, None), "{fault:?}");
        assert_eq!(faults(decision), [fault]);
        let decision = fixture.tick(&Evidence { incidents, ..asks_to_fly(spinning()) });
        assert_eq!(
            (decision.phase, decision.order),
            (Phase::Landing, Some(DroneOrder::Land)),
            "{fault:?}"
        );
    }
}

#[test]
fn an_operator_can_land_a_drone_that_flies_without_an_order() {
    let mut fixture = Fixture::new(Start::Grounded);
    assert_eq!(fixture.run(10, &spinning()).phase, Phase::Idle);
    let decision = fixture.tick(&asks_to_land(spinning()));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    let old = with_drone(spinning(), |drone| drone.age_s = 2.01);
    let mut fixture = Fixture::new(Start::Grounded);
    assert_eq!(fixture.tick(&asks_to_land(old)).phase, Phase::Idle);
}

#[test]
fn one_solve_in_three_may_fail_for_ever_and_one_in_two_may_not() {
    for (every, ends) in [(3, false), (2, true)] {
        let mut fixture = Fixture::flying();
        for tick in 0..1000 {
            fixture.pass(1, &Evidence { has_estimator_failed: tick % every == 0, ..ALOFT });
        }
        assert_eq!(fixture.supervisor.phase() != Phase::Flying, ends, "one in {every}");
    }
}

#[test]
fn an_emergency_stop_is_ordered_once_though_all_sources_show_the_drone_down() {
    let mut fixture = Fixture::landing();
    assert_eq!(fixture.run(110, &ALOFT).phase, Phase::LandingUnconfirmed);
    assert_eq!(fixture.run(30, &CALM).order, None, "down");
    let stop = Evidence { operator: Operator::EmergencyStop, ..CALM };
    assert_eq!(fixture.tick(&stop).order, Some(DroneOrder::EmergencyStop));
    assert_eq!(ticks_until(&mut fixture, Some(DroneOrder::EmergencyStop), &stop), None);
}

#[test]
fn one_missed_period_per_ten_ticks_never_ends_a_flight_and_one_per_five_does() {
    for (every, ends) in [(10, false), (5, true)] {
        let mut fixture = Fixture::flying();
        for tick in 0..2000 {
            let skipped = u64::from(tick % every == 0);
            fixture.pass(1, &Evidence { skipped, ..ALOFT });
        }
        let phase = fixture.supervisor.phase();
        assert_eq!(phase != Phase::Flying, ends, "one per {every}: {phase:?}");
    }
}
