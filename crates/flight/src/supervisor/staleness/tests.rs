//! Poses that are old, still, repeated, or where no vehicle can be.

use super::super::tests::*;
use super::super::*;
use crate::monitor::Findings;

#[test]
fn a_still_pose_takes_the_commands_and_then_the_flight() {
    for (still_s, phase, may_steer, expected) in [
        (0.25, Phase::Flying, true, vec![]),
        (0.3, Phase::Flying, false, vec![Fault::MocapFrozen]),
        (1.01, Phase::Landing, false, vec![Fault::MocapLost, Fault::MocapFrozen]),
        (f64::NAN, Phase::Landing, false, vec![Fault::MocapLost, Fault::MocapFrozen]),
    ] {
        let findings = Findings { frozen_s: Some(still_s), ..NOTHING_FOUND };
        let e = Evidence { findings, ..ALOFT };
        let decision = Fixture::flying().tick(&e);
        assert_eq!((decision.phase, decision.may_steer()), (phase, may_steer), "{still_s}");
        assert_eq!(faults(decision), expected, "{still_s}");
    }
    // In the climb it is still although the drone reports its rise, from 0.2 m to 0.6 m.
    let still = |height_m| {
        let e = Evidence { findings: Findings { still_s: Some(9.0), ..NOTHING_FOUND }, ..CALM };
        with_drone(e, |drone| drone.height_m = Some(height_m))
    };
    for (height_m, expected) in [(0.5, vec![]), (0.6, vec![Fault::MocapFrozen])] {
        let mut fixture = Fixture::new(Start::Grounded);
        fixture.pass(1, &asks_to_fly(still(0.2)));
        assert_eq!(faults(fixture.run(3, &still(height_m))), []);
        assert_eq!(faults(fixture.tick(&still(height_m))), expected, "{height_m} m");
        let phase = if expected.is_empty() { Phase::TakingOff } else { Phase::Landing };
        assert_eq!(fixture.run(8, &still(height_m)).phase, phase, "{height_m} m");
    }
    // On the ground everything is still.
    let still = Evidence { findings: Findings { still_s: Some(9.0), ..NOTHING_FOUND }, ..CALM };
    let decision = Fixture::new(Start::Grounded).tick(&asks_to_fly(still));
    assert_eq!(decision.phase, Phase::TakingOff);
}

#[test]
fn a_frozen_stream_is_named_once_its_pose_is_stale() {
    let frozen = |pose_age_s| {
        with_poses(Evidence { pose_age_s: Some(pose_age_s), ..ALOFT }, |it| it.is_repeated = true)
    };
    let mut fixture = Fixture::flying();
    assert!(fixture.tick(&frozen(0.2)).may_steer());
    let decision = fixture.tick(&frozen(0.3));
    assert_eq!(faults(decision), [Fault::MocapStale, Fault::MocapFrozen]);
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, false));
    assert_eq!(fixture.tick(&frozen(1.1)).phase, Phase::Landing);
}

#[test]
fn jumps_and_shifts_within_the_limits_are_good() {
    for e in
        [with_poses(ALOFT, |it| it.jump_m = Some(1.5)), with_poses(ALOFT, |it| it.shift_m = 1.5)]
    {
        let decision = Fixture::flying().tick(&e);
        assert_eq!((decision.may_steer(), faults(decision)), (true, vec![]));
    }
}

#[test]
fn poses_that_were_shifted_by_more_than_the_limit_or_by_no_number_end_the_flight() {
    for shift_m in [1.5_f64.next_up(), f64::INFINITY, f64::NAN] {
        for mut fixture in [Fixture::flying(), Fixture::taking_off()] {
            let decision = fixture.tick(&with_poses(ALOFT, |it| it.shift_m = shift_m));
            assert_eq!(
                (decision.phase, decision.may_steer()),
                (Phase::Landing, false),
                "{shift_m}"
            );
            assert_eq!(faults(decision), [Fault::MocapJumped], "{shift_m}");
        }
    }
}

#[test]
fn a_pose_is_stale_above_the_limit_without_an_age_or_with_none_that_is_a_number() {
    let supervisor = Fixture::new(Start::Airborne).supervisor;
    for (pose_age_s, is_stale) in [
        (Some(-0.1), false),
        (Some(0.25), false),
        (Some(0.25_f64.next_up()), true),
        (Some(f64::INFINITY), true),
        (Some(f64::NAN), true),
        (None, true),
    ] {
        let e = Evidence { pose_age_s, ..ALOFT };
        assert_eq!(supervisor.is_pose_stale(&e), is_stale, "{pose_age_s:?}");
    }
}

#[test]
fn what_is_asked_of_poses_before_a_take_off_is_not_asked_in_flight_and_jumps_only_there() {
    let undated = UNDATED;
    let pose = Some(at(2.9, 2.0));
    let e = with_poses(Evidence { pose, incidents: undated, ..ALOFT }, |it| it.is_settled = false);
    assert_eq!(faults(Fixture::flying().tick(&e)), []);
    // On the ground the vehicle may be put elsewhere by hand.
    let [put_aside, shifted] =
        [with_poses(CALM, |it| it.jump_m = Some(9.0)), with_poses(CALM, |it| it.shift_m = 9.0)];
    for e in [put_aside, shifted, with_poses(CALM, |it| it.shift_m = f64::NAN)] {
        assert_eq!(faults(Fixture::new(Start::Grounded).tick(&e)), [], "{e:?}");
    }
}

#[test]
fn a_repeated_pose_that_is_fresh_is_not_frozen() {
    let e = with_poses(Evidence { pose_age_s: Some(0.25), ..ALOFT }, |it| it.is_repeated = true);
    assert_eq!(faults(Fixture::flying().tick(&e)), []);
}
