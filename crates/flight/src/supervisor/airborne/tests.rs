//! Landings that one source alone confirms, and sources that do not count.

use horizon_model::rows::Pose;

use super::super::tests::*;
use super::super::*;
use super::*;

/// A drone that stands by its own report, at this height; it was at 0.2 m before the take-off.
fn stands_at(e: Evidence, height_m: Option<f64>) -> Evidence {
    with_drone(e, |drone| (drone.is_flying, drone.height_m) = (false, height_m))
}

/// Ordered to land in the air, after a take-off from 0.2 m by the drone's own height.
fn landing_from_0_2_m() -> Fixture {
    let mut fixture = Fixture::new(Start::Grounded);
    fixture.pass(1, &stands_at(CALM, Some(0.2)));
    fixture.pass(1, &asks_to_fly(stands_at(CALM, Some(0.2))));
    fixture.pass(50, &with_drone(ALOFT, |drone| drone.height_m = Some(1.2)));
    fixture.pass(1, &asks_to_land(ALOFT));
    fixture
}

/// How many of so many ticks with `e` order a landing.
fn landings(fixture: &mut Fixture, ticks: u32, e: &Evidence) -> usize {
    (0..ticks).filter(|_| fixture.tick(e).order == Some(DroneOrder::Land)).count()
}

#[test]
fn a_landing_is_ordered_until_one_source_alone_has_lasted_and_the_other_is_named() {
    for (e, fault) in [(MUTE, Fault::LandedByPose), (BLIND, Fault::LandedByDrone)] {
        let mut fixture = Fixture::landing();
        assert_eq!(landings(&mut fixture, 100, &e), 20);
        assert_eq!(
            fixture.supervisor.phase(),
            Phase::Landing,
            "longer than the time for a landing"
        );
        let decision = fixture.tick(&e);
        assert_eq!((decision.phase, decision.order), (Phase::Landed, None));
        let sources = [Fault::LandedByPose, Fault::LandedByDrone];
        let is_named = |decision: Decision| sources.map(|fault| decision.faults.contains(fault));
        assert_eq!(is_named(decision), sources.map(|one| one == fault));
        assert_eq!(is_named(fixture.run(50, &CALM)), is_named(decision), "to the end");
        // Both report so for a second: nothing is missing.
        let mut fixture = Fixture::landing();
        fixture.pass(50, &e);
        let decision = fixture.run(11, &CALM);
        assert_eq!((decision.phase, is_named(decision)), (Phase::Landed, [false, false]));
        // The one that was missing comes back and contradicts it.
        let mut fixture = Fixture::landing();
        fixture.pass(99, &e);
        let contradicts = if fault == Fault::LandedByPose {
            with_drone(CALM, |drone| drone.is_flying = true)
        } else {
            Evidence { pose: ALOFT.pose, ..CALM }
        };
        assert_eq!(fixture.tick(&contradicts).phase, Phase::LandingUnconfirmed, "10 s");
        assert_eq!(landings(&mut fixture, 100, &e), 20);
    }
}

#[test]
fn a_pose_that_came_to_the_floor_by_a_jump_does_not_count() {
    let aside = with_poses(MUTE, |it| it.jump_m = Some(1.51));
    let down = with_poses(MUTE, |it| it.drop_m = Some(0.31));
    let near = with_poses(MUTE, |it| {
        it.jump_m = Some(1.5);
        it.drop_m = Some(0.3);
    });
    for (jump, counts) in [(aside, false), (down, false), (near, true)] {
        let mut fixture = Fixture::landing();
        assert_eq!(fixture.tick(&jump).pose_is_airborne, counts.then_some(false));
        let decision = fixture.run(200, &MUTE);
        assert_eq!(decision.pose_is_airborne, counts.then_some(false));
        let phase = if counts { Phase::Landed } else { Phase::LandingUnconfirmed };
        assert_eq!(decision.phase, phase, "{jump:?}");
        // The drone alone decides, later than with a pose.
        let mut fixture = Fixture::landing();
        fixture.pass(1, &jump);
        let decision = fixture.run(11, &CALM);
        assert_eq!(decision.phase == Phase::Landed, counts, "{jump:?}");
        // Back in the air it is the vehicle again.
        let mut fixture = Fixture::landing();
        fixture.pass(1, &jump);
        assert_eq!(fixture.tick(&ALOFT).pose_is_airborne, Some(true));
        assert_eq!(fixture.run(11, &CALM).phase, Phase::Landed);
    }
}

#[test]
fn a_jump_in_flight_discredits_the_pose_for_the_landing() {
    let mut fixture = Fixture::flying();
    fixture.pass(1, &CALM);
    let decision = fixture.tick(&with_poses(CALM, |it| it.jump_m = Some(9.0)));
    assert_eq!(decision.phase, Phase::Landing);
    assert_eq!(fixture.run(200, &MUTE).phase, Phase::LandingUnconfirmed);
}

#[test]
fn a_drone_that_stands_in_the_air_by_its_own_height_does_not_count() {
    let blind = |height_m| stands_at(BLIND, height_m);
    for (e, ticks, phase) in [
        // 1.1 m above the ground: it reports no flight, and nothing confirms the landing.
        (blind(Some(1.3)), 150, Phase::LandingUnconfirmed),
        (blind(Some(0.7)), 150, Phase::LandingUnconfirmed),
        // 0.4 m: a height that drifts.
        (blind(Some(0.6)), 99, Phase::Landing),
        (blind(Some(0.6)), 101, Phase::Landed),
        (blind(None), 101, Phase::Landed),
        // With the pose on the floor the pose decides alone.
        (stands_at(CALM, Some(1.3)), 100, Phase::Landing),
        (stands_at(CALM, Some(1.3)), 101, Phase::Landed),
        (stands_at(CALM, Some(0.6)), 11, Phase::Landed),
    ] {
        let decision = landing_from_0_2_m().run(ticks, &e);
        assert_eq!(decision.phase, phase, "{ticks} ticks of {e:?}");
    }
}

#[test]
fn a_low_drone_that_reports_to_fly_is_not_down() {
    let mut fixture = Fixture::new(Start::Grounded);
    fixture.pass(1, &CALM);
    fixture.pass(50, &asks_to_fly(ALOFT));
    let low = Evidence { pose: CALM.pose, ..asks_to_land(ALOFT) };
    assert_eq!(fixture.run(50, &low).phase, Phase::Landing);
    let down = with_drone(low, |drone| drone.is_flying = false);
    assert_eq!(fixture.run(12, &down).phase, Phase::Landed);
}

#[test]
fn what_is_carried_waits_for_its_first_pose_and_needs_no_drone() {
    let mut fixture = Fixture::new(Start::Carried);
    let unseen = Evidence { pose_age_s: None, drone: None, ..ALOFT };
    let decision = fixture.run(100, &unseen);
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, false));
    let decision = fixture.run(100, &with_drone(ALOFT, |drone| drone.is_flying = false));
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, true));
    assert_eq!(fixture.run(12, &asks_to_land(ALOFT)).phase, Phase::Landed);
}

/// A landing 5 s after the take-off order, seen by `pose` and `drone` as given for so many ticks.
fn landing_seen(ticks: u32, height_m: Option<f64>, drone: Option<bool>) -> Phase {
    let mut fixture = Fixture::new(Start::Grounded);
    fixture.pass(1, &CALM);
    fixture.pass(1, &asks_to_fly(CALM));
    fixture.pass(50, &ALOFT);
    fixture.pass(1, &asks_to_land(ALOFT));
    let seen = Evidence {
        pose: height_m.map(at_height),
        pose_age_s: Some(if height_m.is_some() { 0.01 } else { 9.0 }),
        drone: drone.map(|is_flying| DroneReport { is_flying, ..REPORT }),
        ..ALOFT
    };
    fixture.run(ticks, &asks_to_land(seen)).phase
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
        // One source alone confirms later.
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
fn the_ruling_has_the_height_by_the_pose() {
    let mut fixture = Fixture::new(Start::Grounded);
    fixture.pass(1, &CALM);
    fixture.pass(1, &asks_to_fly(CALM));
    for (e, expected) in [
        (CALM, Some(false)),
        (ALOFT, Some(true)),
        (Evidence { pose_age_s: Some(0.5), ..ALOFT }, None),
        (Evidence { pose: None, ..ALOFT }, None),
    ] {
        assert_eq!(fixture.tick(&e).pose_is_airborne, expected, "{e:?}");
    }
}

#[test]
fn the_drone_has_risen_by_a_fresh_height_above_that_on_the_ground() {
    let risen = |ground_m: Option<f64>, height_m: Option<f64>, age_s: f64| {
        let mut supervisor = Fixture::new(Start::Grounded).supervisor;
        supervisor.take_off.drone_ground_m = ground_m;
        let e = with_drone(ALOFT, |drone| (drone.height_m, drone.age_s) = (height_m, age_s));
        supervisor.drone_has_risen(&e)
    };
    assert!(!risen(Some(0.0), Some(CLIMB_MIN_M), 0.1));
    assert!(risen(Some(0.0), Some(CLIMB_MIN_M.next_up()), 2.0));
    assert!(!risen(Some(0.0), Some(0.6), 2.01), "an old report");
    assert!(!risen(Some(0.6), Some(0.2), 0.1), "it sinks");
    assert!(risen(Some(-0.3), Some(0.1), 0.1), "by 0.4 m from below its zero");
    assert!(!risen(None, Some(0.6), 0.1) && !risen(Some(0.0), None, 0.1));
}

#[test]
fn a_height_that_is_no_number_is_none_and_the_drone_decides() {
    for (z_m, ground_m) in [(f64::NAN, Some(0.1)), (1.1, Some(f64::NAN)), (1.1, None)] {
        let mut supervisor = Fixture::new(Start::Grounded).supervisor;
        supervisor.take_off.ground_m = ground_m;
        for is_flying in [false, true] {
            let e = Evidence { pose: Some(at_height(z_m)), ..ALOFT };
            let e = with_drone(e, |drone| drone.is_flying = is_flying);
            assert_eq!(supervisor.pose_is_airborne(&e), None, "{z_m} m");
            assert_eq!(supervisor.is_take_off_complete(&e), is_flying, "{z_m} m");
        }
    }
}

/// In flight after a take-off, with poses at `e` that are repeated until they are lost.
fn landing_of_a_frozen_stream(e: &Evidence) -> Fixture {
    let mut fixture = Fixture::new(Start::Grounded);
    fixture.pass(1, &CALM);
    fixture.pass(1, &asks_to_fly(CALM));
    fixture.pass(50, &ALOFT);
    let frozen = with_poses(*e, |it| it.is_repeated = true);
    fixture.pass(9, &Evidence { pose_age_s: Some(0.3), ..frozen });
    fixture.pass(1, &Evidence { pose_age_s: Some(1.1), ..frozen });
    assert_eq!(fixture.supervisor.phase(), Phase::Landing);
    fixture
}

#[test]
fn a_pose_in_the_air_that_stood_still_in_flight_does_not_contradict_a_drone_that_stands() {
    let stands = |e: Evidence| with_drone(e, |drone| drone.is_flying = false);
    let moved =
        |far_m: f64| Evidence { pose: ALOFT.pose.map(|at| at + Pose::repeat(far_m)), ..ALOFT };
    // On the ground and in a landing a stream may repeat its pose, which then counts as new.
    for (e, phase) in [
        (ALOFT, Phase::Landed),
        (moved(0.01), Phase::Landed),
        (moved(0.02), Phase::LandingUnconfirmed),
    ] {
        let decision = landing_of_a_frozen_stream(&ALOFT).run(250, &stands(e));
        assert_eq!(decision.phase, phase, "{:?}", e.pose);
        assert_eq!(decision.faults.contains(Fault::LandedByDrone), phase == Phase::Landed);
    }
    // Without the drone's report nothing is confirmed, and a pose on the floor counts though it stands still.
    let mut fixture = landing_of_a_frozen_stream(&ALOFT);
    let mute = Evidence { drone: None, ..ALOFT };
    assert_eq!(fixture.run(250, &mute).phase, Phase::LandingUnconfirmed);
    let mut fixture = landing_of_a_frozen_stream(&Evidence { pose: CALM.pose, ..ALOFT });
    assert_eq!(fixture.run(60, &stands(CALM)).phase, Phase::Landed);
}
