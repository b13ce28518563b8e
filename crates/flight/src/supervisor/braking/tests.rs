//! A vehicle that brakes before it lands.

use horizon_model::rows::Pose;

use super::super::tests::*;
use super::super::*;
use super::{LOW_M, SLOW_MPS};

/// Fast, and the drone silent for too long.
fn fast() -> Evidence {
    Evidence { speed_mps: 1.0, ..with_drone(ALOFT, |drone| drone.age_s = 2.01) }
}

fn braking() -> Bench {
    let mut bench = Bench::flying();
    bench.pass(1, &Evidence { speed_mps: 1.0, ..ALOFT });
    let decision = bench.tick(&fast());
    assert_eq!((decision.phase, decision.pilot), (Phase::Flying, Some(Pilot::Controller)));
    assert!(decision.is_braking);
    assert_eq!(faults(decision), [Fault::DroneSilent]);
    bench
}

#[test]
fn it_lands_when_it_is_slow_or_has_braked_for_long_enough() {
    let decision = braking().tick(&Evidence { speed_mps: 0.2, ..fast() });
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    // 0.1 s a tick.
    let mut bench = braking();
    assert_eq!(bench.run(14, &fast()).phase, Phase::Flying);
    let decision = bench.tick(&fast());
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
    let mut bench = Bench::flying();
    bench.pass(1, &Evidence { pose_age_s: Some(0.26), ..ALOFT });
    assert_eq!(bench.tick(&fast()).phase, Phase::Landing);
}

#[test]
fn a_flight_that_brakes_ends_even_if_its_reason_goes_away() {
    let mut bench = braking();
    let again = Evidence { speed_mps: 1.0, ..ALOFT };
    let decision = bench.tick(&again);
    assert!(decision.is_braking && decision.may_steer());
    assert_eq!(faults(decision), [Fault::DroneSilent], "it stays the reason");
    assert_eq!(bench.tick(&ALOFT).phase, Phase::Landing);
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
    let mut bench = Bench::flying();
    bench.pass(20, &by_hand);
    let hold = (TABLE.finish_hold_s * 10.0).round();
    let is_braking = |bench: &mut Bench| {
        let decision = bench.tick(&fast);
        (decision.phase, decision.is_braking)
    };
    for _ in 0..100 {
        match is_braking(&mut bench) {
            (Phase::Flying, false) => {}
            found => {
                assert_eq!(found, (Phase::Flying, true));
                break;
            }
        }
    }
    let decision = bench.tick(&done);
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    let mut bench = Bench::flying();
    let ticks = (0..100).take_while(|_| bench.tick(&done).phase == Phase::Flying).count();
    assert!((ticks as f64 - hold).abs() <= 1.0, "{ticks} ticks for {hold}");
}

#[test]
fn a_vehicle_comes_down_before_it_lands_unless_the_drone_is_silent() {
    let done = Evidence { is_mission_done: true, speed_mps: 0.0, ..ALOFT };
    let at = |z_m: f64, e: Evidence| Evidence { pose: Some(Pose::new(0.0, 0.0, z_m, 0.0)), ..e };
    let descends = |e: &Evidence, ticks: u32| {
        let mut bench = Bench::taking_off();
        bench.supervisor.table.land_from_m = Some(0.45);
        bench.pass(60, &ALOFT);
        (0..200).find(|_| bench.tick(e).is_braking).expect("a brake");
        let to_m = bench.supervisor.descends_to_m();
        bench.pass(ticks, e);
        (bench, to_m)
    };
    let (mut bench, to_m) = descends(&at(1.0, done), 70);
    let to_m = to_m.unwrap();
    assert!((to_m - 0.55).abs() < 1e-9, "above the ground at 0.1 m: {to_m} m");
    assert_eq!(bench.tick(&at(to_m + LOW_M + 0.01, done)).phase, Phase::Flying);
    let decision = bench.tick(&at(to_m + LOW_M, done));
    assert_eq!((decision.phase, decision.order), (Phase::Landing, Some(DroneOrder::Land)));
    // One that does not get down lands nevertheless, and so does one whose poses are not trusted.
    let (mut bench, _) = descends(&at(1.0, done), 93);
    assert_eq!(bench.run(3, &at(1.0, done)).phase, Phase::Landing);
    let (mut bench, _) = descends(&at(1.0, done), 5);
    let stale = Evidence { pose_age_s: Some(0.26), ..at(1.0, done) };
    assert_eq!(bench.tick(&stale).phase, Phase::Landing);
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
    let bench = Bench::flying();
    let slow = Evidence { t_ns: bench.t_ns, speed_mps: 0.0, ..ALOFT };
    assert!(!bench.supervisor.has_braked(&slow, &bench.supervisor.assess(&slow)));
}

#[test]
fn an_obstacle_that_comes_near_is_let_past_before_the_landing_for_a_minute_at_most() {
    let done = Evidence { is_mission_done: true, ..ALOFT };
    let comes = with_obstacles(done, |it| it.is_approached = true);
    let walks = with_obstacles(done, |it| it.may_be_approached = true);
    let hidden = with_obstacles(done, |it| it.is_unseen = true);
    let ends_after = |evidence: &dyn Fn(usize) -> Evidence| {
        let mut bench = Bench::flying();
        let flies = |k: &usize| bench.tick(&evidence(*k)).phase == Phase::Flying;
        (0..1000).take_while(flies).count() as f64 / 10.0 - TABLE.finish_hold_s
    };
    let until = |end: usize, e: Evidence| move |k: usize| if k < end { e } else { done };
    for (name, evidence, expected_s) in [
        ("none", &(|_| done) as &dyn Fn(usize) -> Evidence, 0.0),
        ("gone after 7 s", &until(70, walks), 11.0 - TABLE.finish_hold_s),
        ("hidden for 7 s", &until(70, hidden), 7.0 - TABLE.finish_hold_s),
        ("walks on", &|_| walks, 60.0),
        ("pauses", &|k| if k % 40 == 0 { walks } else { done }, 60.0),
        ("stays hidden", &|_| hidden, 60.0),
        ("comes again and again", &|k| if k % 100 < 60 { walks } else { comes }, 60.0),
        ("comes after a minute", &until(670, comes), 67.0 - TABLE.finish_hold_s),
        ("never stops coming", &|_| comes, 70.0),
    ] {
        let found_s = ends_after(evidence);
        assert!((found_s - expected_s.max(0.0)).abs() < 0.15, "{name}: {found_s} s");
    }
}

#[test]
fn nobody_takes_off_where_the_moving_obstacle_was_near_within_four_seconds() {
    let mut bench = Bench::new(Start::Grounded);
    let stays_down =
        |bench: &mut Bench, e: &Evidence| faults(bench.tick(e)).contains(&Fault::StartMisplaced);
    assert!(!stays_down(&mut bench, &CALM));
    assert!(stays_down(&mut bench, &with_obstacles(CALM, |it| it.may_be_approached = true)));
    // 0.1 s a tick.
    let free_after = (0..50).find(|_| !stays_down(&mut bench, &CALM));
    assert_eq!(free_after, Some(39), "4 s");
}

#[test]
fn a_drone_that_keeps_an_old_command_is_landed_at_once() {
    let unseen = [EstimatedMotion { pose: at(0.0, 1.1), rate: Pose::zeros() }; 2];
    let held = Outage { for_s: 0.5, is_held: true, unseen };
    assert_eq!(braking().tick(&Evidence { outage: Some(held), ..fast() }).phase, Phase::Landing);
}

#[test]
fn an_obstacle_came_near_in_the_four_seconds_after_it_did_and_not_by_walking_beside() {
    let mut bench = Bench::flying();
    bench.pass(1, &with_obstacles(ALOFT, |it| it.may_be_approached = true));
    assert!(!bench.supervisor.was_approached(bench.t_ns), "it only walks near");
    let came_ns = bench.t_ns;
    bench.pass(1, &with_obstacles(ALOFT, |it| it.is_approached = true));
    let after_ms = [0, 3999, 4000, 9000];
    let found = after_ms.map(|ms| bench.supervisor.was_approached(came_ns + ms * 1_000_000));
    assert_eq!(found, [true, true, false, false]);
}
