//! The room, its walls and obstacles.

use super::*;

#[test]
fn who_comes_near_in_a_take_off_ends_it() {
    let near = |e| with_obstacles(e, |it| it.approach = ObstacleApproach::Predicted);
    let deaf = with_drone(ALOFT, |drone| drone.takes_sticks = false);
    // On the ground, in the climb, and before the drone executes sticks.
    for (before, e) in [(0, CALM), (1, ALOFT), (40, deaf)] {
        let mut fixture = Fixture::taking_off();
        let rising = |k: u32| Evidence { pose: Some(at(0.0, 1.1 + 0.04 * f64::from(k))), ..e };
        let e = |k: u32| if before == 1 { rising(k) } else { e };
        for k in 0..before {
            assert!(!fixture.tick(&e(k)).phase.is_over());
        }
        for k in 0..3 {
            assert!(!fixture.tick(&near(e(before + k))).phase.is_over(), "0.{k} s");
        }
        let decision = fixture.tick(&near(e(before + 3)));
        assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
        assert_eq!(faults(decision), [Fault::ObstacleApproaches]);
    }
    let unseen = with_obstacles(CALM, |it| it.is_unseen = true);
    assert_eq!(Fixture::taking_off().run(4, &unseen).phase, Phase::Landing);
    let by_hand = Evidence { hand: HandInput::Steering, ..near(CALM) };
    assert_eq!(Fixture::taking_off().run(9, &by_hand).phase, Phase::TakingOff, "a person sees it");
    assert_eq!(faults(Fixture::flying().run(9, &near(ALOFT))), [], "it evades");
}

#[test]
fn a_vehicle_that_would_leave_the_room_brakes_and_control_goes_on_when_it_can_stop() {
    // 0.8 s at 1 m/s: from 2.2 m on it would come to rest behind the wall at 3 m.
    let mut fixture = Fixture::flying();
    assert!(fixture.tick(&moving(2.1, 1.0)).may_steer());
    let decision = fixture.tick(&moving(2.3, 1.0));
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, false));
    assert_eq!(faults(decision), [Fault::FenceNear]);
    assert!(fixture.tick(&moving(2.6, 0.4)).may_steer(), "slow enough");
    assert!(fixture.tick(&moving(2.9, -1.0)).may_steer(), "on its way in");
}

#[test]
fn a_plan_that_knows_the_walls_decides_in_place_of_the_distance_to_rest() {
    let clear = Evidence { plan: PlanClearance::Clear, ..moving(2.3, 1.0) };
    let blocked = Evidence { plan: PlanClearance::Blocked, ..moving(0.0, 1.0) };
    // Without a plan that knows the walls the distance to rest decides.
    for (after, goes_on) in [(clear, true), (moving(2.3, 1.0), false), (moving(2.3, 0.2), true)] {
        let mut fixture = Fixture::flying();
        assert!(fixture.tick(&moving(2.1, 1.0)).may_steer());
        assert!(fixture.tick(&clear).may_steer(), "the plan stops inside");
        let decision = fixture.tick(&blocked);
        assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, true));
        assert!(decision.is_braking);
        assert_eq!(faults(decision), [Fault::PlanBlocked]);
        // 0.1 s a tick: it brakes for 0.4 s, then the plan follows the mission again.
        for _ in 0..3 {
            assert!(fixture.tick(&clear).is_braking);
        }
        let decision = fixture.tick(&after);
        assert_eq!((decision.may_steer(), decision.is_braking), (goes_on, false), "{after:?}");
    }
}

#[test]
fn an_obstacle_that_is_not_seen_brakes_until_it_is() {
    let mut fixture = Fixture::flying();
    let unseen = with_obstacles(moving(0.0, 1.0), |it| it.is_unseen = true);
    for _ in 0..10 {
        let decision = fixture.tick(&unseen);
        assert!(decision.is_braking && decision.may_steer(), "{decision:?}");
        assert_eq!(faults(decision), [Fault::ObstacleUnseen]);
    }
    let decision = fixture.tick(&moving(0.0, 0.0));
    assert!(
        decision.may_steer() && !decision.is_braking && decision.faults.is_empty(),
        "{decision:?}"
    );
    let by_hand = Evidence { hand: HandInput::Steering, operator: Operator::FlyByHand, ..unseen };
    assert!(!fixture.tick(&by_hand).is_braking, "a person flies by sight");
}

#[test]
fn by_hand_the_distance_to_rest_warns_whatever_a_plan_would_do() {
    let mut fixture = Fixture::flying();
    let by_hand = Evidence {
        plan: PlanClearance::Clear,
        hand: HandInput::Steering,
        operator: Operator::FlyByHand,
        ..moving(2.3, 1.0)
    };
    let decision = fixture.tick(&by_hand);
    assert!(decision.may_steer(), "a warning alone");
    assert_eq!(faults(decision), [Fault::FenceNear]);
}

#[test]
fn behind_the_wall_the_flight_ends() {
    let decision = Fixture::flying().tick(&moving(3.01, -1.0));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    assert!(decision.faults.contains(Fault::FenceLeft), "{:?}", decision.faults);
}

#[test]
fn an_old_pose_behind_the_wall_is_no_proof() {
    let old = Evidence { pose_age_s: Some(0.5), ..moving(3.01, 0.0) };
    let decision = Fixture::flying().tick(&old);
    assert_eq!(decision.phase, Phase::Flying);
    assert!(!decision.may_steer() && !decision.faults.contains(Fault::FenceLeft));
}

#[test]
fn without_a_room_there_are_no_walls() {
    let table = SupervisorTable { room: None, ..TABLE };
    let settings = SupervisorSettings::try_from(&table).unwrap();
    let mut fixture = Fixture { supervisor: Supervisor::new(settings, Start::Grounded), t_ns: 0 };
    let far = Evidence { pose: Some(at(500.0, 0.1)), ..CALM };
    assert_eq!(fixture.tick(&asks_to_fly(far)).phase, Phase::TakingOff);
    assert_eq!(fixture.run(100, &moving(500.0, 9.0)).phase, Phase::Flying);
}

#[test]
fn what_is_carried_may_be_carried_out_of_the_room() {
    let mut fixture = Fixture::new(Start::Carried);
    let decision = fixture.run(10, &moving(5.0, 1.0));
    assert_eq!((decision.phase, decision.may_steer()), (Phase::Flying, true));
}

#[test]
fn a_vehicle_inside_of_an_obstacle_lands_if_a_fresh_pose_shows_it() {
    let inside = with_obstacles(ALOFT, |it| it.is_vehicle_inside = true);
    assert_eq!(after(&inside), (Phase::Landing, false, vec![Fault::ObstacleEntered]));
    let stale = Evidence { pose_age_s: Some(0.26), ..inside };
    assert_eq!(after(&stale), (Phase::Flying, false, vec![Fault::MocapStale]));
    let by_hand = Evidence { hand: HandInput::Steering, ..inside };
    assert_eq!(after(&by_hand).0, Phase::Flying);
    let mut grounded = Fixture::new(Start::Grounded);
    let below = with_obstacles(CALM, |it| it.is_vehicle_inside = true);
    assert_eq!(faults(grounded.run(9, &below)), []);
}
