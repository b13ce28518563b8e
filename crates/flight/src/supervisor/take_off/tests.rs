//! Where a take-off may begin, and when it is ordered again.

use horizon_model::rows::Pose;

use super::super::tests::*;
use super::super::*;
use super::*;

#[test]
fn a_vehicle_starts_where_its_room_allows_and_anywhere_without_a_pose() {
    let supervisor = Fixture::new(Start::Grounded).supervisor;
    for (pose, may_start) in [
        (Some(at(3.0, 0.1)), true),
        (Some(at(3.01, 0.1)), false),
        (Some(at(f64::NAN, 0.1)), false),
        (None, true),
    ] {
        assert_eq!(supervisor.may_start(&Evidence { pose, ..CALM }), may_start, "{pose:?}");
    }
}

#[test]
fn a_take_off_is_over_four_seconds_after_its_newest_order_or_eight_if_it_was_not_seen() {
    let mut supervisor = Fixture::new(Start::Grounded).supervisor;
    assert!(supervisor.is_past_take_off(&CALM), "none was ordered");
    supervisor.take_off.ordered_ns = Some(-1_000_000_000);
    for (seen, past_ns) in [
        (TakeOffSeen::No, 7_000_000_000),
        (TakeOffSeen::Measured, 3_000_000_000),
        (TakeOffSeen::Reported, 3_000_000_000),
    ] {
        supervisor.take_off.seen = seen;
        for (t_ns, is_past) in [(past_ns - 1, false), (past_ns, true)] {
            let found = supervisor.is_past_take_off(&Evidence { t_ns, ..CALM });
            assert_eq!(found, is_past, "{seen:?}, {t_ns} ns");
        }
    }
}

#[test]
fn a_take_off_is_repeated_only_while_the_drone_stands_where_it_stood_and_nobody_is_near() {
    let repeated = |early: Evidence, later: Evidence| {
        let mut fixture = Fixture::taking_off();
        fixture.pass(5, &early);
        (0..110).filter(|_| fixture.tick(&later).order == Some(DroneOrder::TakeOff)).count()
    };
    let moved = |by: Pose| Evidence { pose: CALM.pose.map(|at| at + by), ..CALM };
    assert_eq!(repeated(CALM, CALM), 2, "every 3 s until the take-off takes too long");
    for touched in [
        moved(Pose::new(0.031, 0.0, 0.0, 0.0)),
        moved(Pose::new(0.0, 0.0, 0.04, 0.0)),
        moved(Pose::new(0.0, 0.0, 0.0, -0.16)),
    ] {
        assert_eq!(repeated(touched, CALM), 0, "{:?}", touched.pose);
    }
    let noisy = moved(Pose::new(0.015, 0.02, 0.015, 0.14));
    assert_eq!(repeated(noisy, CALM), 2);
    let near = with_obstacles(CALM, |it| it.blocks_take_off = true);
    assert_eq!((repeated(near, near), repeated(near, CALM)), (0, 2));
}
