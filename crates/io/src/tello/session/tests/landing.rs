//! From the first reason to land to the end of the session.

use super::*;

#[test]
fn neutral_sticks_go_directly_before_a_landing_but_not_before_every_one() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.approve(0, 0.5);
    fixture.session.order(DroneOrder::Land, ms(10));
    for now_ms in 10..1_200 {
        fixture.session.approve(approved(0.5), ms(now_ms), ms(now_ms));
        fixture.session.advance(ms(now_ms));
    }
    let sent: Vec<Message> = fixture.session.drain().collect();
    let is_neutral = |message: &Message| {
        let Message::Binary(HostPacket::Sticks { u, .. }) = message else { return false };
        *u == Sticks::zeros()
    };
    let land = |sequence| Message::Binary(HostPacket::Action { action: Action::Land, sequence });
    let [first, second, alone] = sent.chunks(2).collect::<Vec<_>>()[..] else { panic!("{sent:?}") };
    for (pair, sequence) in [first, second].into_iter().zip(1..) {
        assert!(is_neutral(&pair[0]) && pair[1] == land(sequence), "{pair:?}, number {sequence}");
    }
    assert_eq!(alone, [land(3)]);
    assert_eq!(fixture.session.counters.sticks.get(), 1, "these are no sticks of the flight");
}

#[test]
fn a_lost_drone_is_asked_for_directly_before_a_landing() {
    let mut fixture = Fixture::connected();
    fixture.order(300, DroneOrder::Land);
    fixture.run(300, 4_400);
    let request = fixture.times(|sent| sent == Sent::ConnReq);
    assert_eq!(request, [2_300, 4_300], "lost at 2 s");
    assert_eq!(fixture.times(is_landing), (300..=4_400).step_by(500).collect::<Vec<_>>());
    for (index, _) in
        fixture.sent.iter().enumerate().filter(|(_, (_, sent))| *sent == Sent::ConnReq)
    {
        assert!(is_landing(fixture.sent[index + 1].1), "{:?}", fixture.sent);
    }
}

#[test]
fn nothing_answers_the_drones_questions_between_two_landings() {
    let mut fixture = Fixture::connected();
    fixture.order(0, DroneOrder::Land);
    fixture.receive(100, &bytes(DronePacket::DateTimeRequest { sequence: 0 }));
    fixture.receive(110, &bytes(DronePacket::LogHeader { sequence: 5, header_id: 1 }));
    fixture.run(110, 400);
    assert_eq!(fixture.times(|sent| sent == Sent::Answer), [0; 0]);
    fixture.stand(400);
    fixture.run(400, 800);
    fixture.receive(800, &bytes(DronePacket::DateTimeRequest { sequence: 0 }));
    assert_eq!(fixture.times(|sent| sent == Sent::Answer), [800], "it is down");
}

#[test]
fn a_landing_that_the_socket_refused_goes_out_again_soon() {
    let mut fixture = Fixture::connected();
    fixture.order(0, DroneOrder::Land);
    fixture.session.note_refused(ms(3));
    fixture.run(3, 600);
    assert_eq!(fixture.times(is_landing), [0, 53, 553]);
    fixture.session.note_refused(ms(1_040));
    fixture.run(601, 1_100);
    assert_eq!(fixture.times(is_landing)[3..], [1_053], "sooner, never later");
    fixture.order(1_110, DroneOrder::EmergencyStop);
    fixture.session.note_refused(ms(1_110));
    fixture.run(1_110, 1_200);
    assert_eq!(fixture.times(|sent| sent == Sent::EmergencyStop), [1_110, 1_110, 1_110, 1_160]);
}

#[test]
fn a_silent_control_thread_means_neutral_sticks_and_then_a_landing() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.approve(0, 0.5);
    fixture.run(1, 1_900);
    for (at, sent) in &fixture.sent {
        match sent {
            Sent::Roll(roll) if *at < 100 => assert!((roll - 0.5).abs() < 1e-12, "{at}"),
            Sent::Roll(roll) => assert!(*at < 1_000 && roll.abs() < 1e-12, "{roll} at {at} ms"),
            Sent::Order(order, _) => assert_eq!((*order, at % 500), (DroneOrder::Land, 0), "{at}"),
            other => panic!("{other:?} at {at} ms"),
        }
    }
    assert!(matches!(fixture.session.phase, SessionPhase::Landing { .. }));
    assert_eq!(fixture.times(is_roll), (0..1_000).step_by(20).collect::<Vec<_>>());
    assert_eq!(fixture.times(is_landing), [1_000, 1_500]);
    assert_eq!(fixture.session.counters.neutralised.get(), 45);
    assert_eq!(fixture.session.counters.watchdog_landings.get(), 1);
    // A control thread that wakes up may not cancel the landing.
    fixture.sent.clear();
    fixture.approve(1_901, 0.5);
    fixture.order(1_901, DroneOrder::TakeOff);
    fixture.run(1_901, 2_999);
    assert_eq!(fixture.times(is_roll), [0; 0]);
    assert_eq!(fixture.times(is_landing), [2_000, 2_500]);
    assert_eq!(fixture.times(|sent| matches!(sent, Sent::Order(DroneOrder::TakeOff, _))), [0; 0]);
}

#[test]
fn nothing_but_the_landing_is_sent_until_the_drone_is_down() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.approve(0, 0.5);
    fixture.order(10, DroneOrder::Land);
    for now_ms in 11..1_200 {
        fixture.approve(now_ms, 0.5);
        fixture.order(now_ms, DroneOrder::Land);
        fixture.order(now_ms, DroneOrder::TakeOff);
        fixture.run(now_ms, now_ms);
    }
    fixture.receive(1_200, &status(true));
    fixture.run(1_200, 1_600);
    fixture.stand(1_600);
    fixture.approve(1_700, 0.5);
    fixture.run(1_700, 3_500);
    let landings = [(10, 1), (510, 2), (1_010, 3), (1_510, 4)]
        .map(|(at, number)| (at, Sent::Order(DroneOrder::Land, number)));
    assert_eq!(fixture.sent[0], (0, Sent::Roll(0.5)));
    assert_eq!(fixture.sent[1..], landings, "anything else cancels a landing");
}

#[test]
fn a_flight_that_was_landed_is_not_followed_by_another() {
    let mut fixture = Fixture::connected();
    fixture.order(0, DroneOrder::Land);
    fixture.stand(1);
    fixture.order(10, DroneOrder::TakeOff);
    fixture.approve(20, 0.5);
    fixture.run(20, 1_900);
    assert_eq!(fixture.sent, [(0, Sent::Order(DroneOrder::Land, 1))]);
    // It was on the ground by its own word only, or another program ordered the take-off.
    fixture.receive(1_900, &status(true));
    fixture.run(1_900, 2_300);
    fixture.order(2_310, DroneOrder::Land);
    fixture.run(2_310, 2_410);
    let again =
        [(1_900, Sent::Order(DroneOrder::Land, 2)), (2_400, Sent::Order(DroneOrder::Land, 3))];
    assert_eq!(fixture.sent[1..], again);
    fixture.stand(2_450);
    fixture.run(2_450, 2_800);
    fixture.order(2_950, DroneOrder::Land);
    assert_eq!(
        fixture.sent.last(),
        Some(&(2_950, Sent::Order(DroneOrder::Land, 4))),
        "by order at once"
    );
}

#[test]
fn a_landing_that_is_ordered_in_every_period_is_repeated_no_sooner() {
    let mut fixture = Fixture::connected();
    for now_ms in 0..4_900 {
        if now_ms % 100 == 0 {
            fixture.receive(now_ms, &status(false));
        }
        if now_ms % 20 == 0 {
            fixture.order(now_ms, DroneOrder::Land);
        }
        fixture.run(now_ms, now_ms);
    }
    assert_eq!(fixture.times(is_landing), (0..4_900).step_by(500).collect::<Vec<_>>());
}

#[test]
fn a_stopped_session_lands_until_the_drone_stands() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.session.stop(ms(100));
    fixture.note(100);
    for now_ms in (101..6_000).step_by(100) {
        // The drone ignored the first landings: it was taking off.
        fixture.receive(now_ms, &status(now_ms > 3_000));
        fixture.approve(now_ms, 0.5);
        fixture.order(now_ms, DroneOrder::TakeOff);
        fixture.run(now_ms, now_ms + 99);
        assert!(!fixture.session.is_over(ms(now_ms)), "{now_ms} ms");
    }
    fixture.stand(6_001);
    assert!(!fixture.session.is_over(ms(6_300)), "one status is not enough");
    fixture.run(6_001, 6_301);
    assert!(fixture.session.is_over(ms(6_301)));
    let expected: Vec<_> = (100..=6_100).step_by(500).collect();
    assert_eq!(fixture.times(is_landing), expected);
    assert_eq!(fixture.sent.len(), 1 + expected.len(), "{:?}", fixture.sent);
}

#[test]
fn a_stopped_session_gives_a_silent_drone_15_s() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.order(200, DroneOrder::Land);
    fixture.session.stop(ms(300));
    fixture.run(300, 15_299);
    assert!(!fixture.session.is_over(ms(15_299)));
    assert!(fixture.session.is_over(ms(15_300)));
    assert_eq!(fixture.times(is_landing), (200..15_300).step_by(500).collect::<Vec<_>>());
    assert!(!fixture.times(|sent| sent == Sent::ConnReq).is_empty(), "the link was not asked for");
}

#[test]
fn a_stopped_session_with_nothing_in_the_air_is_over_at_once() {
    let never_connected = {
        let mut fixture = Fixture::new(false);
        fixture.run(0, 0);
        fixture.approve(0, 0.5);
        fixture
    };
    let standing = {
        let mut fixture = Fixture::connected();
        fixture.approve(0, 0.0);
        fixture.receive(0, &status(false));
        fixture
    };
    let dry_run = {
        let mut fixture = Fixture::new(true);
        fixture.order(0, DroneOrder::TakeOff);
        fixture.receive(0, &status(true));
        fixture
    };
    for mut fixture in [never_connected, standing, dry_run] {
        assert!(!fixture.session.is_over(ms(1)), "not stopped");
        fixture.sent.clear();
        fixture.session.stop(ms(1));
        fixture.note(1);
        assert!(fixture.session.is_over(ms(1)), "{:?}", fixture.session);
        assert_eq!(fixture.sent, []);
    }
}

#[test]
fn a_landing_ordered_during_the_take_off_goes_on_until_it_is_heard() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.order(1_000, DroneOrder::Land);
    // The flag "flying" comes late in a take-off, and a landing ordered then is ignored.
    fixture.receive(1_100, &status(false));
    fixture.run(1_100, 7_999);
    assert_eq!(fixture.times(is_landing).len(), 14);
    fixture.stand(8_000);
    fixture.run(8_000, 9_900);
    assert_eq!(fixture.times(is_landing).len(), 15, "down for 0.3 s from 8 s on");
}

#[test]
fn a_control_thread_that_dies_after_the_take_off_order_is_noticed() {
    let mut fixture = Fixture::standing();
    fixture.order(0, DroneOrder::TakeOff);
    fixture.run(0, 1_000);
    assert_eq!(fixture.times(is_landing), [1_000]);
}

#[test]
fn in_doubt_the_drone_is_airborne() {
    let mut fixture = Fixture::connected();
    assert!(!fixture.session.may_be_airborne(ms(0)), "nothing was ever sent");
    fixture.approve(0, 0.0);
    assert!(fixture.session.may_be_airborne(ms(0)), "steered, and never heard of");
    fixture.receive(1, &status(false));
    assert!(!fixture.session.may_be_airborne(ms(1)), "it reports standing");
    fixture.order(2, DroneOrder::TakeOff);
    assert!(fixture.session.may_be_airborne(ms(4_999)), "it may be taking off");
    fixture.receive(5_010, &status(true));
    assert!(fixture.session.may_be_airborne(ms(9_000)), "it reports flying");
}

#[test]
fn a_drone_that_has_landed_and_connects_again_is_sent_nothing_but_the_request() {
    let mut fixture = Fixture::new(false);
    fixture.session = Session::binary(0, Some(3), false, Arc::clone(&fixture.session.counters));
    fixture.run(0, 0);
    fixture.order(0, DroneOrder::Land);
    fixture.stand(1);
    fixture.run(1, 400);
    fixture.sent.clear();
    fixture.run(400, 2_100);
    fixture.receive(2_100, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    fixture.run(2_100, 4_050);
    assert!(fixture.session.counters.is_connected());
    assert_eq!(fixture.sent, [(2_001, Sent::ConnReq)], "no setting, which may end a landing");
}

#[test]
fn a_standing_drone_gets_sticks_before_the_first_landing() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(false));
    fixture.approve(1, 0.0);
    fixture.receive(2, &status(false));
    fixture.approve(21, 0.0);
    assert_eq!(fixture.times(is_roll), [1, 21]);
}
