//! From the order of an emergency stop to the drone that lies still.

use super::*;

fn stops(fixture: &Fixture) -> Vec<i64> {
    fixture.times(|sent| sent == Sent::EmergencyStop)
}

#[test]
fn neutral_sticks_and_three_emergency_stops_go_out_at_once_and_one_every_200_ms() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.approve(0, 0.5);
    fixture.order(10, DroneOrder::EmergencyStop);
    fixture.run(11, 100);
    for now_ms in (100..900).step_by(100) {
        fixture.stand(now_ms);
        fixture.run(now_ms, now_ms + 99);
    }
    let first = [(0, Sent::Roll(0.5)), (10, Sent::Roll(0.0)), (10, Sent::EmergencyStop)];
    assert_eq!(fixture.sent[..3], first);
    assert_eq!(stops(&fixture), [10, 10, 10, 210, 410, 610, 810], "it obeys");
    assert_eq!(fixture.times(is_landing), [0; 0]);
}

#[test]
fn a_drone_that_does_not_obey_is_ordered_to_land_after_every_emergency_stop() {
    // By its status, by the pose, by neither.
    for (reported, sees) in [(Some(true), None), (Some(false), Some(true)), (None, None)] {
        let mut fixture = Fixture::connected();
        fixture.approve(0, 0.5);
        fixture.order(10, DroneOrder::EmergencyStop);
        for now_ms in 11..20_000 {
            if now_ms % 100 == 0
                && let Some(is_flying) = reported
            {
                fixture.receive(now_ms, &status(is_flying));
            }
            if now_ms % 20 == 0 {
                fixture.observe_pose(now_ms, sees);
            }
            fixture.run(now_ms, now_ms);
        }
        let case = format!("status {reported:?}, pose {sees:?}");
        let landings: Vec<_> = (610..20_000).step_by(400).collect();
        assert_eq!(fixture.times(is_landing), landings, "{case}");
        let alone = [10, 10, 10, 210, 410].into_iter();
        let stops_expected: Vec<_> = alone.chain((810..20_000).step_by(400)).collect();
        assert_eq!(stops(&fixture), stops_expected, "{case}");
        assert!(matches!(fixture.session.phase, SessionPhase::EmergencyStop(_)), "{case}");
    }
}

#[test]
fn the_sequence_ends_when_status_and_pose_agree_that_the_drone_is_down() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.order(10, DroneOrder::EmergencyStop);
    for now_ms in 11..6_000 {
        if now_ms % 100 == 0 {
            fixture.receive(now_ms, &status(now_ms < 1_000));
        }
        if now_ms % 20 == 0 {
            // The status denies the flight a second before the drone is down.
            fixture.observe_pose(now_ms, Some(now_ms < 2_000));
        }
        fixture.run(now_ms, now_ms);
    }
    assert_eq!(fixture.times(is_landing), [610, 1_010, 1_410, 1_810]);
    let last = *stops(&fixture).last().unwrap();
    assert_eq!(last, 2_810, "1 s after both agree");
    assert!(matches!(fixture.session.phase, SessionPhase::MotorsStopped));
    // A pose in the air, again: the agreement was wrong.
    fixture.observe_pose(6_000, Some(true));
    fixture.run(6_000, 7_000);
    assert_eq!(stops(&fixture).iter().filter(|at| **at >= 6_000).count(), 3 + 2 + 1);
    assert_eq!(fixture.times(is_landing)[4..], [6_600, 7_000]);
}

#[test]
fn no_order_and_no_sticks_of_the_control_thread_follow_an_emergency_stop() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.order(10, DroneOrder::EmergencyStop);
    for now_ms in 11..5_000 {
        fixture.approve(now_ms, 0.5);
        fixture.order(now_ms, DroneOrder::TakeOff);
        fixture.order(now_ms, DroneOrder::Land);
        // Without a copy more: it goes on already.
        fixture.order(now_ms, DroneOrder::EmergencyStop);
        fixture.run(now_ms, now_ms);
    }
    let is_step = |sent: Sent| sent == Sent::EmergencyStop || is_landing(sent);
    let others: Vec<_> = fixture.sent.iter().filter(|(_, sent)| !is_step(*sent)).collect();
    // The drone was not heard for 2 s.
    let requests = [&(2_210, Sent::ConnReq), &(4_210, Sent::ConnReq)];
    assert_eq!(others, [&[&(10, Sent::Roll(0.0))][..], &requests[..]].concat());
    assert_eq!(fixture.times(is_step).len(), 3 + 24);
}

#[test]
fn an_emergency_stop_ends_a_landing_and_comes_after_one() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.order(0, DroneOrder::Land);
    fixture.order(100, DroneOrder::EmergencyStop);
    fixture.run(100, 1_900);
    assert_eq!(fixture.times(is_landing), [0, 700, 1_100, 1_500, 1_900]);
    assert_eq!(stops(&fixture), [100, 100, 100, 300, 500, 900, 1_300, 1_700]);

    let mut landed = Fixture::connected();
    landed.order(0, DroneOrder::Land);
    landed.receive(1, &status(false));
    landed.run(1, 400);
    landed.order(410, DroneOrder::EmergencyStop);
    assert_eq!(stops(&landed), [410, 410, 410]);
}

#[test]
fn an_emergency_stop_is_repeated_until_the_drone_has_been_still_for_1_s() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.order(1_000, DroneOrder::EmergencyStop);
    // The flag "flying" comes late in a take-off: until 5 s after the order it reports nothing.
    for now_ms in (1_100..6_100).step_by(100) {
        // One status of a drone that bounces.
        fixture.observe_pose(now_ms, Some(false));
        fixture.receive(now_ms, &status(now_ms == 5_200));
        fixture.run(now_ms, now_ms + 99);
    }
    let last = *stops(&fixture).last().unwrap();
    assert_eq!(last, 6_000, "not over at 6.1 s");
    // In doubt it flies: the landings end when the flag counts, but for the bounce.
    assert_eq!(*fixture.times(is_landing).last().unwrap(), 5_200);
    for now_ms in (6_100..7_500).step_by(100) {
        fixture.stand(now_ms);
        fixture.run(now_ms, now_ms + 99);
    }
    // At rest since 5.3 s.
    assert_eq!(*stops(&fixture).last().unwrap(), 6_200);
    fixture.sent.clear();
    fixture.approve(7_500, 0.5);
    fixture.order(7_500, DroneOrder::Land);
    fixture.order(7_500, DroneOrder::TakeOff);
    assert_eq!(fixture.sent, []);
    fixture.order(7_501, DroneOrder::EmergencyStop);
    assert_eq!(stops(&fixture), [7_501, 7_501, 7_501], "it can be stopped again");
}

#[test]
fn a_drone_that_was_never_heard_is_stopped_and_landed_all_the_same() {
    let mut fixture = Fixture::new(false);
    fixture.run(0, 0);
    fixture.order(10, DroneOrder::EmergencyStop);
    fixture.run(10, 2_500);
    assert_eq!(fixture.times(is_landing), [610, 1_010, 1_410, 1_810, 2_210]);
    assert_eq!(stops(&fixture).len(), 3 + 2 + 5);
    // The request for a connection stands before the neutral sticks of a landing, never between two emergency stops.
    assert_eq!(fixture.times(|sent| sent == Sent::ConnReq), [0, 2_210]);
    let request = fixture.sent.iter().rposition(|(_, sent)| *sent == Sent::ConnReq).unwrap();
    assert!(is_landing(fixture.sent[request + 1].1), "{:?}", fixture.sent);
}

#[test]
fn a_dry_run_sends_no_emergency_stop() {
    let mut fixture = Fixture::new(true);
    fixture.run(0, 0);
    fixture.order(1, DroneOrder::EmergencyStop);
    fixture.run(1, 900);
    assert_eq!(stops(&fixture), [0; 0]);
    assert_eq!(fixture.session.counters.orders.get(), 0);
}

#[test]
fn a_stopped_session_repeats_the_emergency_stop_until_the_drone_lies_still() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.order(10, DroneOrder::EmergencyStop);
    fixture.session.stop(ms(20));
    for now_ms in (100..1_100).step_by(100) {
        fixture.stand(now_ms);
        fixture.run(now_ms, now_ms + 99);
    }
    assert!(!fixture.session.is_over(ms(1_099)), "still for less than 1 s");
    fixture.stand(1_100);
    assert!(fixture.session.is_over(ms(1_100)));
    assert_eq!(fixture.times(is_landing), [0; 0]);

    let mut silent = Fixture::connected();
    silent.order(10, DroneOrder::EmergencyStop);
    silent.session.stop(ms(20));
    silent.run(20, 15_019);
    assert!(!silent.session.is_over(ms(15_019)));
    assert!(silent.session.is_over(ms(15_020)));
}

#[test]
fn a_drone_that_is_down_by_one_source_alone_is_landed_beside_the_emergency_stops_for_10_s() {
    for (reported, sees) in [(Some(false), None), (None, Some(false))] {
        let mut fixture = Fixture::connected();
        fixture.order(10, DroneOrder::EmergencyStop);
        for now_ms in 11..14_000 {
            if now_ms % 100 == 0 {
                fixture.observe_pose(now_ms, sees);
                if let Some(is_flying) = reported {
                    fixture.receive(now_ms, &status(is_flying));
                }
            }
            fixture.run(now_ms, now_ms);
        }
        let landings: Vec<_> = (610..10_100).step_by(400).collect();
        assert_eq!(fixture.times(is_landing), landings, "status {reported:?}, pose {sees:?}");
        assert!(
            stops(&fixture).iter().all(|at| *at < 10_100),
            "status {reported:?}, pose {sees:?}"
        );
        assert!(matches!(fixture.session.phase, SessionPhase::MotorsStopped));
    }
}
