//! The moving obstacle near a landing or take-off.

use super::super::tests::*;
use super::super::*;

#[test]
fn a_landing_waits_for_an_obstacle_that_comes_near_for_a_minute_at_most() {
    let done = Evidence { is_mission_done: true, ..ALOFT };
    let comes = with_obstacles(done, |it| it.approach = ObstacleApproach::Predicted);
    let walks = with_obstacles(done, |it| it.approach = ObstacleApproach::Possible);
    let hidden = with_obstacles(done, |it| it.is_unseen = true);
    let ends_after = |evidence: &dyn Fn(usize) -> Evidence| {
        let mut fixture = Fixture::flying();
        let flies = |k: &usize| fixture.tick(&evidence(*k)).phase == Phase::Flying;
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
    let mut fixture = Fixture::new(Start::Grounded);
    let stays_down = |fixture: &mut Fixture, e: &Evidence| {
        faults(fixture.tick(e)).contains(&Fault::StartMisplaced)
    };
    assert!(!stays_down(&mut fixture, &CALM));
    assert!(stays_down(
        &mut fixture,
        &with_obstacles(CALM, |it| it.approach = ObstacleApproach::Possible)
    ));
    // 0.1 s a tick.
    let free_after = (0..50).find(|_| !stays_down(&mut fixture, &CALM));
    assert_eq!(free_after, Some(39), "4 s");
}

#[test]
fn an_obstacle_came_near_in_the_four_seconds_after_it_did_and_not_by_walking_beside() {
    let mut fixture = Fixture::flying();
    fixture.pass(1, &with_obstacles(ALOFT, |it| it.approach = ObstacleApproach::Possible));
    assert!(!fixture.supervisor.was_approached(fixture.t_ns), "it only walks near");
    let came_ns = fixture.t_ns;
    fixture.pass(1, &with_obstacles(ALOFT, |it| it.approach = ObstacleApproach::Predicted));
    let after_ms = [0, 3999, 4000, 9000];
    let found = after_ms.map(|ms| fixture.supervisor.was_approached(came_ns + ms * 1_000_000));
    assert_eq!(found, [true, true, false, false]);
}

#[test]
fn somebody_who_paces_beside_the_vehicle_explains_twenty_seconds_and_is_believed_again_later() {
    let comes = with_obstacles(ALOFT, |it| it.approach = ObstacleApproach::Predicted);
    let mut fixture = Fixture::flying();
    let mut counted = |ticks: u32, e: &Evidence| {
        let was_approached = |_: &u32| {
            fixture.pass(1, e);
            fixture.supervisor.was_approached(fixture.t_ns)
        };
        (0..ticks).filter(was_approached).count()
    };
    let by_hand = Evidence { hand: HandInput::Steering, ..comes };
    counted(600, &by_hand);
    let believed = counted(600, &comes);
    assert!((199..=203).contains(&believed), "{believed} ticks of 0.1 s");
    assert_eq!(counted(80, &ALOFT), 0, "the approach ends after 4 s");
    assert_eq!(counted(100, &comes), 0, "4 s do not make up for a minute");
    assert_eq!(counted(540, &ALOFT), 0, "then it is let alone for 50 s");
    let again = counted(300, &comes);
    assert!((88..=94).contains(&again), "{again} ticks");
}
