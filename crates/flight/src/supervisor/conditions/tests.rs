//! Motion capture, drone and commands that contradict each other, and limits of a flight without a fault.

use super::*;

fn found(change: impl FnOnce(&mut Findings)) -> Evidence {
    let mut findings = NOTHING_FOUND;
    change(&mut findings);
    Evidence { findings, ..ALOFT }
}

fn outage(for_s: f64, is_held: bool, x_m: f64) -> Outage {
    let unseen = EstimatedMotion { pose: at(x_m, 1.1), rate: Pose::new(1.0, 0.0, 0.0, 0.0) };
    Outage { for_s, is_held, unseen: [unseen; 2] }
}

/// The fault that `e` shows after 0.5 s in flight, and what then holds.
fn after(e: &Evidence) -> (Phase, bool, Vec<Fault>) {
    let ruling = Bench::flying().run(5, e);
    (ruling.phase, ruling.may_steer(), faults(ruling))
}

#[test]
fn a_still_pose_takes_the_commands_and_then_the_flight() {
    for (still_s, phase, may_steer, expected) in [
        (0.25, Phase::Flying, true, vec![]),
        (0.3, Phase::Flying, false, vec![Fault::MocapFrozen]),
        (1.01, Phase::Landing, false, vec![Fault::MocapLost, Fault::MocapFrozen]),
    ] {
        let e = found(|findings| findings.frozen_s = Some(still_s));
        let ruling = Bench::flying().tick(&e);
        assert_eq!((ruling.phase, ruling.may_steer()), (phase, may_steer), "{still_s}");
        assert_eq!(faults(ruling), expected, "{still_s}");
    }
    // In the climb it is still although the drone reports its rise, from 0.2 m to 0.6 m.
    let still = |height_m| {
        let e = Evidence { findings: Findings { still_s: Some(9.0), ..NOTHING_FOUND }, ..CALM };
        with_drone(e, |drone| drone.height_m = Some(height_m))
    };
    for (height_m, expected) in [(0.5, vec![]), (0.6, vec![Fault::MocapFrozen])] {
        let mut bench = Bench::new(Start::Grounded);
        bench.pass(1, &asks_to_fly(still(0.2)));
        assert_eq!(faults(bench.run(3, &still(height_m))), []);
        assert_eq!(faults(bench.tick(&still(height_m))), expected, "{height_m} m");
        let phase = if expected.is_empty() { Phase::TakingOff } else { Phase::Landing };
        assert_eq!(bench.run(8, &still(height_m)).phase, phase, "{height_m} m");
    }
    // On the ground everything is still.
    let still = Evidence { findings: Findings { still_s: Some(9.0), ..NOTHING_FOUND }, ..CALM };
    let ruling = Bench::new(Start::Grounded).tick(&asks_to_fly(still));
    assert_eq!(ruling.phase, Phase::TakingOff);
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
        assert_eq!(Bench::taking_off().tick(&climbs).phase, phase, "in the climb");
    }
    let mut bench = Bench::flying();
    bench.pass(5, &found(|findings| findings.velocity = Agreement::Doubtful));
    assert!(bench.tick(&ALOFT).may_steer(), "doubt that is over");
}

#[test]
fn a_wrong_direction_and_an_overdue_mission_land() {
    let wrong = found(|findings| findings.is_direction_wrong = true);
    assert_eq!(after(&wrong), (Phase::Landing, false, vec![Fault::HeadingWrong]));
    let late = |overtime_s| Evidence { overtime_s, ..ALOFT };
    assert_eq!(after(&late(60.0)), (Phase::Flying, true, vec![]));
    assert_eq!(after(&late(60.1)), (Phase::Landing, false, vec![Fault::MissionOverdue]));
    assert_eq!(after(&late(f64::NAN)).0, Phase::Landing);
}

#[test]
fn a_lost_reference_and_too_much_speed_land_after_a_third_of_a_second() {
    let far = Evidence { tracking_m: Some(1.01), ..ALOFT };
    let fast = Evidence { speed_mps: 3.01, ..ALOFT };
    for (e, fault) in [(far, Fault::TrackingLost), (fast, Fault::TooFast)] {
        let mut bench = Bench::flying();
        assert!(bench.run(3, &e).may_steer(), "{fault:?} for 0.2 s");
        let ruling = bench.tick(&e);
        assert_eq!((ruling.phase, faults(ruling)), (Phase::Landing, vec![fault]));
        let mut bench = Bench::flying();
        bench.pass(3, &e);
        bench.pass(1, &ALOFT);
        assert!(bench.run(3, &e).may_steer(), "{fault:?}, begun anew");
    }
    let near = Evidence { tracking_m: Some(1.0), speed_mps: 3.0, ..ALOFT };
    assert_eq!(after(&near), (Phase::Flying, true, vec![]));
    let by_hand = Evidence { is_by_hand: true, ..far };
    assert_eq!(after(&by_hand), (Phase::Flying, true, vec![]), "a person has no reference");
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
    for (witness, is_alone) in cases {
        let e = Evidence { outage: Some(outage(1.0, false, 0.0)), ..found(witness) };
        let mut bench = Bench::flying();
        assert!(bench.run(60, &e).may_steer(), "6.0 s");
        bench.pass(1, &found(agrees));
        assert!(bench.run(60, &e).may_steer(), "6.0 s, begun anew");
        let expected = if is_alone { vec![Fault::OutageLong] } else { vec![] };
        assert_eq!(faults(bench.run(1, &e)), expected);
    }
}

#[test]
fn a_vehicle_that_may_have_left_unseen_is_landed_unless_the_drone_denies_it() {
    // 0.8 s at 1 m/s: from 2.2 m on it would come to rest behind the wall at 3 m.
    let at = |x_m| Evidence { outage: Some(outage(1.0, false, x_m)), ..ALOFT };
    let seen = Findings { velocity: Agreement::Agrees, ..NOTHING_FOUND };
    let denied = Evidence { findings: seen, ..at(2.3) };
    for (e, found) in [(at(2.1), vec![]), (at(2.3), vec![Fault::OutageUnsafe]), (denied, vec![])] {
        let mut bench = Bench::flying();
        assert!(bench.run(5, &e).may_steer(), "the drone has just begun to move");
        assert_eq!(faults(bench.run(1, &e)), found);
    }
}

#[test]
fn a_held_command_takes_the_commands_while_it_lasts() {
    let held = Evidence { outage: Some(outage(0.5, true, 0.0)), ..ALOFT };
    assert_eq!(after(&held), (Phase::Flying, false, vec![Fault::OutageHeld]));
}

/// A landing 5 s after the take-off order, seen by `pose` and `drone` as given for so many ticks.
fn landing_seen(ticks: u32, height_m: Option<f64>, drone: Option<bool>) -> Phase {
    let mut bench = Bench::new(Start::Grounded);
    bench.pass(1, &CALM);
    bench.pass(1, &asks_to_fly(CALM));
    bench.pass(50, &ALOFT);
    bench.pass(1, &asks_to_land(ALOFT));
    let seen = Evidence {
        pose: height_m.map(at_height),
        pose_age_s: Some(if height_m.is_some() { 0.01 } else { 9.0 }),
        drone: drone.map(|is_flying| DroneReport {
            age_s: 0.1,
            is_flying,
            height_m: None,
            battery_pct: 80,
        }),
        ..ALOFT
    };
    bench.run(ticks, &asks_to_land(seen)).phase
}

#[test]
fn all_who_can_tell_have_to_agree_that_the_vehicle_is_down() {
    for (height_m, drone, is_down) in [
        (Some(0.1), Some(false), Some(11)),
        (Some(0.1), Some(true), None),
        (Some(1.1), Some(false), None),
        (Some(1.1), None, None),
        (None, Some(true), None),
        (None, None, None),
        // One witness alone confirms later.
        (Some(0.1), None, Some(101)),
        (None, Some(false), Some(101)),
        // Rise of 0.25 m, half of `airborne_height_m`.
        (Some(0.34), Some(false), Some(11)),
        (Some(0.36), Some(false), None),
    ] {
        for ticks in [10, 11, 100, 101, 150] {
            let phase = landing_seen(ticks, height_m, drone);
            let expected = is_down.is_some_and(|from| ticks >= from);
            assert_eq!(
                phase == Phase::Landed,
                expected,
                "{height_m:?}, {drone:?}, {ticks}: {phase:?}"
            );
        }
    }
}

#[test]
fn the_ruling_tells_what_the_pose_says_of_the_height() {
    let mut bench = Bench::new(Start::Grounded);
    bench.pass(1, &CALM);
    bench.pass(1, &asks_to_fly(CALM));
    for (e, expected) in [
        (CALM, Some(false)),
        (ALOFT, Some(true)),
        (Evidence { pose_age_s: Some(0.5), ..ALOFT }, None),
        (Evidence { pose: None, ..ALOFT }, None),
    ] {
        assert_eq!(bench.tick(&e).pose_is_airborne, expected, "{e:?}");
    }
}

#[test]
fn a_drone_that_flies_already_is_not_ordered_to_take_off() {
    let flies = with_drone(CALM, |drone| drone.is_flying = true);
    for e in
        [asks_to_fly(flies), Evidence { operator: Operator::FlyByHand, is_by_hand: true, ..flies }]
    {
        let ruling = Bench::new(Start::Grounded).run(5, &e);
        assert_eq!((ruling.phase, ruling.order), (Phase::Idle, SupervisorOrder::None));
        assert_eq!(faults(ruling), [Fault::DroneAloft]);
    }
}
