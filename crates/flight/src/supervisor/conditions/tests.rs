//! Motion capture, drone and commands that contradict each other, limits of a flight without a fault, and walls.

mod walls;

use horizon_model::rows::{Pose, pose};

use super::super::tests::*;
use super::super::*;
use super::*;

fn found(change: impl FnOnce(&mut Findings)) -> Evidence {
    let mut findings = NOTHING_FOUND;
    change(&mut findings);
    Evidence { findings, ..ALOFT }
}

fn outage(for_s: f64, is_held: bool, x_m: f64) -> Outage {
    let motion = EstimatedMotion { pose: at(x_m, 1.1), rate: Pose::new(1.0, 0.0, 0.0, 0.0) };
    Outage { for_s, is_held, if_applied: [motion; 2] }
}

fn moving(x_m: f64, x_mps: f64) -> Evidence {
    let pose = at(x_m, 1.1);
    let rate = Pose::new(x_mps, 0.0, 0.0, 0.0);
    Evidence { pose: Some(pose), motion: Some(EstimatedMotion { pose, rate }), ..ALOFT }
}

/// The fault that `e` shows after 0.5 s in flight, and what then holds.
fn after(e: &Evidence) -> (Phase, bool, Vec<Fault>) {
    let out = Fixture::flying().run(5, e);
    (out.phase, out.may_steer(), faults(out))
}

#[test]
fn doubt_holds_and_disagreement_lands_by_velocity_and_by_height() {
    type Change = fn(&mut Findings, Agreement);
    let ways: [Change; 2] = [|f, a| f.velocity = a, |f, a| f.height = a];
    for set in ways {
        for (agreement, phase, may_steer) in [
            (Agreement::Unknown, Phase::Flying, true),
            (Agreement::Agrees, Phase::Flying, true),
            (Agreement::Doubtful, Phase::Flying, false),
            (Agreement::Disagrees, Phase::Landing, false),
        ] {
            let e = found(|findings| set(findings, agreement));
            let (now, steers, _) = after(&e);
            assert_eq!((now, steers), (phase, may_steer), "{agreement:?}");
        }
    }
    let disagrees: [(Change, Phase); 2] =
        [(|f, a| f.velocity = a, Phase::TakingOff), (|f, a| f.height = a, Phase::Landing)];
    for (set, phase) in disagrees {
        let climbs = found(|findings| set(findings, Agreement::Disagrees));
        let climbs = Evidence { pose: CALM.pose, ..climbs };
        assert_eq!(Fixture::taking_off().tick(&climbs).phase, phase, "in the climb");
    }
    let mut fixture = Fixture::flying();
    fixture.pass(5, &found(|findings| findings.velocity = Agreement::Doubtful));
    assert!(fixture.tick(&ALOFT).may_steer(), "doubt that is over");
}

#[test]
fn a_wrong_direction_and_an_overdue_mission_land() {
    let doubtful = found(|findings| findings.heading = Agreement::Doubtful);
    assert_eq!(after(&doubtful), (Phase::Flying, false, vec![Fault::PoseDoubtful]));
    let turned = after(&found(|findings| findings.heading = Agreement::Disagrees));
    assert_eq!((turned.0, turned.1), (Phase::Landing, false));
    assert!(turned.2.contains(&Fault::HeadingWrong), "{turned:?}");
    let wrong = found(|findings| findings.is_direction_wrong = true);
    assert_eq!(after(&wrong), (Phase::Landing, false, vec![Fault::HeadingWrong]));
    let late = |overtime_s| with_tracking(ALOFT, |it| it.overtime_s = overtime_s);
    assert_eq!(after(&late(60.0)), (Phase::Flying, true, vec![]));
    assert_eq!(after(&late(60.1)), (Phase::Landing, false, vec![Fault::MissionOverdue]));
    assert_eq!(after(&late(f64::NAN)).0, Phase::Landing);
}

#[test]
fn a_vehicle_that_swings_is_landed_after_four_seconds_in_sum() {
    let error = |mps: f64| with_tracking(ALOFT, |it| it.velocity_error_mps = Some(mps));
    for (steps, pause, lands) in [(39, 0, false), (41, 0, true), (10, 20, true), (10, 60, false)] {
        let mut fixture = Fixture::flying();
        // Swings of a second between pauses, or one of four.
        for _ in 0..if pause == 0 { 1 } else { 12 } {
            fixture.pass(steps, &error(0.61));
            fixture.pass(pause + 1, &error(0.59));
        }
        let out = fixture.tick(&ALOFT);
        assert_eq!(out.phase != Phase::Flying, lands, "{steps} of {pause}: {out:?}");
        assert_eq!(out.faults.contains(Fault::TrackingLost), lands);
    }
    // What leads away from the reference counts up to twice.
    let receding = |mps: f64| with_tracking(error(mps), |it| it.is_receding = true);
    for (mps, steps) in [(0.7, 30), (0.85, 20), (3.0, 20)] {
        let mut fixture = Fixture::flying();
        assert_eq!(fixture.run(steps - 1, &receding(mps)).phase, Phase::Flying, "{mps} m/s");
        assert_eq!(fixture.run(3, &receding(mps)).phase, Phase::Landing, "{mps} m/s");
    }
    let by_hand = Evidence { hand: HandInput::Steering, ..error(2.0) };
    let mut fixture = Fixture::flying();
    fixture.pass(39, &error(2.0));
    fixture.pass(60, &by_hand);
    assert_eq!(fixture.run(39, &error(2.0)).phase, Phase::Flying, "begun anew after a person");
    assert_eq!(Fixture::new(Start::Carried).run(60, &error(2.0)).phase, Phase::Flying, "a walk");
}

#[test]
fn a_lost_reference_and_too_much_speed_land_after_a_third_of_a_second() {
    let far = with_tracking(ALOFT, |it| it.position_growth_m = Some(1.01));
    let fast = Evidence { speed_mps: 3.01, ..ALOFT };
    let sunk = with_tracking(ALOFT, |it| it.sink_depth_m = Some(0.46));
    for (e, fault) in
        [(far, Fault::TrackingLost), (sunk, Fault::TrackingLost), (fast, Fault::TooFast)]
    {
        let mut fixture = Fixture::flying();
        assert!(fixture.run(3, &e).may_steer(), "{fault:?} for 0.2 s");
        let out = fixture.tick(&e);
        assert_eq!((out.phase, faults(out)), (Phase::Landing, vec![fault]));
        let mut fixture = Fixture::flying();
        fixture.pass(3, &e);
        fixture.pass(1, &ALOFT);
        assert!(fixture.run(3, &e).may_steer(), "{fault:?}, begun anew");
    }
    let near = with_tracking(Evidence { speed_mps: 3.0, ..ALOFT }, |it| {
        it.position_growth_m = Some(1.0);
        it.sink_depth_m = Some(0.45);
    });
    assert_eq!(after(&near), (Phase::Flying, true, vec![]));
    let by_hand = Evidence { hand: HandInput::Steering, ..far };
    assert_eq!(after(&by_hand), (Phase::Flying, true, vec![]), "a person has no reference");
}

#[test]
fn a_vehicle_that_turns_away_while_commands_act_lands_after_one_and_a_half_seconds() {
    let turned = with_tracking(ALOFT, |it| it.heading_growth_rad = Some(1.01));
    let spinning = |yaw_radps: f64| {
        let lost = Evidence { outage: Some(outage(1.0, false, 0.0)), ..moving(0.0, 0.0) };
        let mut e = with_tracking(lost, |it| it.heading_growth_rad = Some(1.01));
        if let Some(motion) = &mut e.motion {
            motion.rate[pose::THETA] = yaw_radps;
        }
        e
    };
    let mut fixture = Fixture::flying();
    assert!(fixture.run(15, &turned).may_steer(), "1.4 s");
    let out = fixture.tick(&turned);
    assert_eq!((out.phase, faults(out)), (Phase::Landing, vec![Fault::TrackingLost]));
    for held in [
        with_tracking(turned, |it| it.heading_growth_rad = Some(1.0)),
        Evidence { hand: HandInput::Steering, ..turned },
        spinning(0.3),
    ] {
        assert_eq!(Fixture::flying().run(20, &held).phase, Phase::Flying, "{held:?}");
    }
    let out = Fixture::flying().run(16, &spinning(-0.31));
    assert_eq!((out.phase, faults(out)), (Phase::Landing, vec![Fault::TrackingLost]));
}

#[test]
fn an_outage_ends_at_its_limit() {
    let agrees = |findings: &mut Findings| findings.velocity = Agreement::Agrees;
    let e = |for_s| Evidence { outage: Some(outage(for_s, false, 0.0)), ..found(agrees) };
    assert_eq!(after(&e(16.0)), (Phase::Flying, true, vec![]));
    assert_eq!(after(&e(16.01)), (Phase::Landing, false, vec![Fault::OutageLong]));
}

#[test]
fn an_outage_ends_sooner_while_nothing_confirms_it() {
    type Change<'a> = &'a dyn Fn(&mut Findings);
    let agrees = |findings: &mut Findings| findings.velocity = Agreement::Agrees;
    let slow = |findings: &mut Findings| findings.drone_speed_mps = Some(0.35);
    let fast = |findings: &mut Findings| findings.drone_speed_mps = Some(0.36);
    let alone = |_: &mut Findings| {};
    let cases: [(Change<'_>, bool); 4] =
        [(&agrees, false), (&slow, false), (&fast, true), (&alone, true)];
    for (by_drone, is_alone) in cases {
        let e = Evidence { outage: Some(outage(1.0, false, 0.0)), ..found(by_drone) };
        let mut fixture = Fixture::flying();
        assert!(fixture.run(60, &e).may_steer(), "6.0 s");
        fixture.pass(1, &found(agrees));
        assert!(fixture.run(60, &e).may_steer(), "6.0 s, begun anew");
        let expected = if is_alone { vec![Fault::OutageLong] } else { vec![] };
        assert_eq!(faults(fixture.run(1, &e)), expected);
    }
}

#[test]
fn a_vehicle_that_would_have_left_is_landed_unless_the_drone_contradicts_it() {
    // 0.8 s at 1 m/s: from 2.2 m on it would come to rest behind the wall at 3 m.
    let at = |x_m| Evidence { outage: Some(outage(1.0, false, x_m)), ..ALOFT };
    let seen = Findings { velocity: Agreement::Agrees, ..NOTHING_FOUND };
    let rests = Evidence { findings: seen, ..at(2.3) };
    for (e, found) in [(at(2.1), vec![]), (at(2.3), vec![Fault::OutageUnsafe]), (rests, vec![])] {
        let mut fixture = Fixture::flying();
        assert!(fixture.run(5, &e).may_steer(), "the drone has just begun to move");
        assert_eq!(faults(fixture.run(1, &e)), found);
    }
}

#[test]
fn a_held_command_brakes_while_it_lasts() {
    let held = Evidence { outage: Some(outage(0.5, true, 0.0)), ..ALOFT };
    assert_eq!(after(&held), (Phase::Flying, true, vec![Fault::OutageHeld]));
}

#[test]
fn a_drone_that_flies_already_is_landed_and_not_ordered_to_take_off() {
    let flies = with_drone(CALM, |drone| drone.is_flying = true);
    for e in [
        asks_to_fly(flies),
        Evidence { operator: Operator::FlyByHand, hand: HandInput::Steering, ..flies },
    ] {
        let mut fixture = Fixture::new(Start::Grounded);
        let out = fixture.run(10, &e);
        assert_eq!((out.phase, out.order), (Phase::Idle, None));
        assert_eq!(faults(out), [Fault::DroneAloft]);
        // A report that was wrong for a moment counts no more.
        assert_eq!(fixture.tick(&CALM).phase, Phase::Idle);
        assert_eq!(fixture.run(10, &e).phase, Phase::Idle);
        let out = fixture.tick(&e);
        assert_eq!((out.phase, out.order), (Phase::Landing, Some(DroneOrder::Land)));
        assert_eq!(faults(out), [Fault::DroneAloft, Fault::TookOffUnasked]);
    }
}

#[test]
fn a_drone_that_stands_while_control_flies_it_ends_the_flight_after_a_second() {
    let stands = with_drone(ALOFT, |drone| drone.is_flying = false);
    let mut fixture = Fixture::new(Start::Airborne);
    assert_eq!(fixture.run(10, &stands).phase, Phase::Flying);
    assert_eq!(fixture.tick(&ALOFT).phase, Phase::Flying, "one report to the contrary starts anew");
    assert_eq!(fixture.run(10, &stands).phase, Phase::Flying);
    let out = fixture.tick(&stands);
    assert_eq!((out.phase, faults(out)), (Phase::Landing, vec![Fault::NotFlying]));
}

#[test]
fn one_report_and_silence_end_no_flight() {
    for change in [
        |drone: &mut DroneReport| drone.is_flying = false,
        |drone: &mut DroneReport| drone.is_battery_critical = true,
    ] {
        let mut fixture = Fixture::flown();
        for k in 0..18 {
            let age_s = 0.1 * f64::from(k);
            let wrong = with_drone(ALOFT, |drone| {
                change(drone);
                drone.age_s = age_s;
            });
            assert_eq!(fixture.tick(&wrong).phase, Phase::Flying, "{age_s} s");
        }
        assert_eq!(fixture.tick(&ALOFT).phase, Phase::Flying);
    }
}

#[test]
fn a_drone_that_falls_at_the_end_of_its_climb_is_known_to_stand_after_a_second() {
    let mut fixture = Fixture::taking_off();
    let mut ticks = 0;
    while fixture.tick(&ALOFT).phase == Phase::TakingOff {
        ticks += 1;
    }
    assert!(ticks < 20, "its report confirms the take-off, long before the end of the climb");
    let fallen = with_drone(CALM, |drone| drone.is_flying = false);
    let out = fixture.run(11, &fallen);
    assert_eq!(out.phase, Phase::Landing);
    assert!(faults(out).contains(&Fault::NotFlying), "{:?}", faults(out));
}

#[test]
fn the_drone_confirms_an_outage_by_a_finite_speed_up_to_the_limit() {
    for (drone_speed_mps, is_slow) in [
        (Some(0.0), true),
        (Some(DRIFT_MAX_MPS), true),
        (Some(DRIFT_MAX_MPS.next_up()), false),
        (Some(f64::NAN), false),
        (None, false),
    ] {
        let findings = Findings { drone_speed_mps, ..NOTHING_FOUND };
        assert_eq!(is_confirmed(&findings), is_slow, "{drone_speed_mps:?}");
        let doubtful = Findings { velocity: Agreement::Doubtful, ..findings };
        assert_eq!(is_confirmed(&doubtful), is_slow, "{drone_speed_mps:?}");
        assert!(is_confirmed(&Findings { velocity: Agreement::Agrees, ..findings }));
    }
}

#[test]
fn large_inputs_that_move_nothing_land_the_vehicle() {
    let hit = with_tracking(ALOFT, |it| it.has_hit = true);
    assert_eq!(after(&hit), (Phase::Landing, false, vec![Fault::Immobile]));
    let held = with_tracking(ALOFT, |it| it.pressed_s = 2.21);
    assert_eq!(after(&with_tracking(ALOFT, |it| it.pressed_s = 2.2)).0, Phase::Flying);
    assert_eq!(after(&held), (Phase::Landing, false, vec![Fault::Immobile]));
    let by_hand = Evidence { hand: HandInput::Steering, ..held };
    assert_eq!(faults(Fixture::flying().run(9, &by_hand)), [], "a person may press on");
    let mut never = Fixture::flying();
    never.supervisor.table.failsafe.pressed_s = None;
    assert!(never.run(9, &held).may_steer(), "without the key, as in older logs");
    assert_eq!(faults(never.tick(&hit)), [Fault::Immobile], "a collision has no key");
}

#[test]
fn a_vehicle_that_stands_still_below_its_reference_lands() {
    let findings = Findings { still_s: Some(0.8), ..NOTHING_FOUND };
    let stands =
        with_tracking(Evidence { findings, ..ALOFT }, |it| it.height_deficit_m = Some(0.21));
    let mut fixture = Fixture::flying();
    assert_eq!(faults(fixture.run(12, &stands)), []);
    assert_eq!(faults(fixture.tick(&stands)), [Fault::Immobile]);
    // A plan that brakes does not climb.
    let waits = with_obstacles(stands, |it| it.is_unseen = true);
    assert_eq!(faults(Fixture::flying().run(50, &waits)), [Fault::ObstacleUnseen]);
    let in_outage = Evidence { outage: Some(outage(1.0, true, 0.0)), ..stands };
    let mut fixture = Fixture::flying();
    assert!(!fixture.run(24, &in_outage).faults.contains(Fault::Immobile));
    assert!(fixture.tick(&in_outage).faults.contains(Fault::Immobile));
    for flies in [
        with_tracking(stands, |it| it.height_deficit_m = Some(0.2)),
        with_tracking(stands, |it| it.height_deficit_m = None),
        Evidence { findings: NOTHING_FOUND, ..stands },
        with_poses(stands, |it| it.is_repeated = true),
        Evidence { pose_age_s: Some(0.26), ..stands },
        Evidence { hand: HandInput::Steering, ..stands },
        // A hold, in which nothing is asked of it.
        Evidence { findings: Findings { velocity: Agreement::Doubtful, ..findings }, ..stands },
    ] {
        assert!(!Fixture::flying().run(40, &flies).faults.contains(Fault::Immobile), "{flies:?}");
    }
}

#[test]
fn a_dead_time_that_is_too_long_lands_after_three_seconds() {
    let late = Evidence { is_dead_time_long: true, ..ALOFT };
    let mut fixture = Fixture::flying();
    assert!(fixture.run(30, &late).may_steer(), "for 2.9 s");
    let out = fixture.tick(&late);
    assert_eq!((out.phase, faults(out)), (Phase::Landing, vec![Fault::DeadTimeLong]));
    let by_hand = Evidence { hand: HandInput::Steering, ..late };
    assert_eq!(faults(Fixture::flying().run(60, &by_hand)), [], "a person sees it");
}

#[test]
fn an_error_or_a_speed_or_an_outage_that_is_no_number_ends_the_flight() {
    let astray = with_tracking(ALOFT, |it| it.position_growth_m = Some(f64::NAN));
    let fast = Evidence { speed_mps: f64::NAN, ..ALOFT };
    let long = Evidence { outage: Some(outage(f64::NAN, false, 0.0)), ..ALOFT };
    for (e, fault) in
        [(astray, Fault::TrackingLost), (fast, Fault::TooFast), (long, Fault::OutageLong)]
    {
        assert_eq!(after(&e), (Phase::Landing, false, vec![fault]));
    }
}

#[test]
fn either_of_the_motions_that_an_outage_hides_may_have_left_the_room() {
    let [near, far] = [0.0, 2.3].map(|x_m| outage(1.0, false, x_m).if_applied[0]);
    for (if_applied, expected) in
        [([near, far], [Fault::OutageUnsafe]), ([far, near], [Fault::OutageUnsafe])]
    {
        let e =
            Evidence { outage: Some(Outage { if_applied, ..outage(1.0, false, 0.0) }), ..ALOFT };
        assert_eq!(faults(Fixture::flying().run(6, &e)), expected);
    }
}

#[test]
fn limits_themselves_are_still_good() {
    let e = Evidence { pose_age_s: Some(0.25), ..CALM };
    let e = with_drone(e, |drone| (drone.age_s, drone.battery_pct) = (2.0, 30));
    let out = Fixture::new(Start::Grounded).tick(&asks_to_fly(e));
    assert_eq!((out.phase, faults(out)), (Phase::TakingOff, vec![]));
    let mut fixture = Fixture::flying();
    let e = Evidence { pose_age_s: Some(1.0), ..ALOFT };
    let out = fixture.tick(&with_drone(e, |drone| drone.battery_pct = 10));
    assert_eq!(out.phase, Phase::Flying);
    assert_eq!(faults(out), [Fault::MocapStale, Fault::BatteryLow]);
    // Ten periods at once, by `late_periods_max`.
    let out = Fixture::flying().tick(&Evidence { skipped: 10, ..ALOFT });
    assert_eq!((out.may_steer(), faults(out)), (true, vec![]));
}

#[test]
fn a_charge_that_is_critical_for_a_second_lands_the_drone() {
    for critical in [
        with_drone(ALOFT, |drone| drone.is_battery_critical = true),
        with_drone(ALOFT, |drone| drone.battery_pct = 9),
    ] {
        let mut fixture = Fixture::flying();
        assert_eq!(fixture.run(10, &critical).phase, Phase::Flying);
        fixture.pass(1, &ALOFT);
        assert_eq!(fixture.run(10, &critical).phase, Phase::Flying, "a sag begins anew");
        let out = fixture.tick(&critical);
        assert_eq!((out.phase, out.order), (Phase::Landing, Some(DroneOrder::Land)));
        assert!(out.faults.contains(Fault::BatteryCritical), "{:?}", out.faults);
    }
    let least = with_drone(ALOFT, |drone| drone.battery_pct = 10);
    assert_eq!(Fixture::flying().run(30, &least).phase, Phase::Flying, "the limit itself");
}
