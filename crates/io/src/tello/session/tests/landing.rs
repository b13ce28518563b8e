//! From the first reason to land to the end of the session.

use super::*;

#[test]
fn every_landing_follows_neutral_sticks_directly() {
    let mut bench = Bench::connected();
    bench.receive(0, &status(true));
    bench.approve(0, 0.5);
    bench.session.order(DroneOrder::Land, ms(10));
    for now_ms in 10..1_200 {
        bench.session.approve(approved(0.5), ms(now_ms), ms(now_ms));
        bench.session.advance(ms(now_ms));
    }
    let sent: Vec<Message> = bench.session.drain().collect();
    let is_neutral = |message: &Message| {
        let Message::Binary(HostPacket::Sticks { u, .. }) = message else { return false };
        *u == Sticks::zeros()
    };
    assert_eq!(sent.len(), 6, "{sent:?}");
    for (pair, sequence) in sent.chunks(2).zip(1..) {
        let land = Message::Binary(HostPacket::Action { action: Action::Land, sequence });
        assert!(is_neutral(&pair[0]) && pair[1] == land, "{pair:?}, number {sequence}");
    }
    assert_eq!(bench.session.counters.sticks.get(), 1, "these are no sticks of the flight");
}

#[test]
fn a_lost_drone_is_asked_for_directly_before_a_landing() {
    let mut bench = Bench::connected();
    bench.order(300, DroneOrder::Land);
    bench.run(300, 4_400);
    let request = bench.times(|sent| sent == Sent::ConnReq);
    assert_eq!(request, [2_300, 4_300], "lost at 2 s");
    assert_eq!(bench.times(is_landing), (300..=4_400).step_by(500).collect::<Vec<_>>());
    for (index, _) in bench.sent.iter().enumerate().filter(|(_, (_, sent))| *sent == Sent::ConnReq)
    {
        assert!(is_landing(bench.sent[index + 1].1), "{:?}", bench.sent);
    }
}

#[test]
fn nothing_answers_the_drones_questions_between_two_landings() {
    let mut bench = Bench::connected();
    bench.order(0, DroneOrder::Land);
    bench.receive(100, &bytes(DronePacket::DateTimeRequest { sequence: 0 }));
    bench.receive(110, &bytes(DronePacket::LogHeader { sequence: 5, header_id: 1 }));
    bench.run(110, 400);
    assert_eq!(bench.times(|sent| sent == Sent::Answer), [0; 0]);
    bench.stand(400);
    bench.run(400, 800);
    bench.receive(800, &bytes(DronePacket::DateTimeRequest { sequence: 0 }));
    assert_eq!(bench.times(|sent| sent == Sent::Answer), [800], "it is down");
}

#[test]
fn a_landing_that_the_socket_refused_goes_out_again_soon() {
    let mut bench = Bench::connected();
    bench.order(0, DroneOrder::Land);
    bench.session.note_refused(ms(3));
    bench.run(3, 600);
    assert_eq!(bench.times(is_landing), [0, 53, 553]);
    bench.session.note_refused(ms(1_040));
    bench.run(601, 1_100);
    assert_eq!(bench.times(is_landing)[3..], [1_053], "sooner, never later");
    bench.order(1_110, DroneOrder::EmergencyStop);
    bench.session.note_refused(ms(1_110));
    bench.run(1_110, 1_200);
    assert_eq!(bench.times(|sent| sent == Sent::EmergencyStop), [1_110, 1_110, 1_110, 1_160]);
}

#[test]
fn a_silent_control_thread_means_neutral_sticks_and_then_a_landing() {
    let mut bench = Bench::connected();
    bench.receive(0, &status(true));
    bench.approve(0, 0.5);
    bench.run(1, 1_900);
    for (at, sent) in &bench.sent {
        match sent {
            Sent::Roll(roll) if *at < 100 => assert!((roll - 0.5).abs() < 1e-12, "{at}"),
            Sent::Roll(roll) => assert!(*at < 1_000 && roll.abs() < 1e-12, "{roll} at {at} ms"),
            Sent::Order(order, _) => assert_eq!((*order, at % 500), (DroneOrder::Land, 0), "{at}"),
            other => panic!("{other:?} at {at} ms"),
        }
    }
    assert!(matches!(bench.session.phase, SessionPhase::Landing { .. }));
    assert_eq!(bench.times(is_roll), (0..1_000).step_by(20).collect::<Vec<_>>());
    assert_eq!(bench.times(is_landing), [1_000, 1_500]);
    assert_eq!(bench.session.counters.neutralised.get(), 45);
    assert_eq!(bench.session.counters.watchdog_landings.get(), 1);
    // A control thread that wakes up may not cancel the landing.
    bench.sent.clear();
    bench.approve(1_901, 0.5);
    bench.order(1_901, DroneOrder::TakeOff);
    bench.run(1_901, 2_999);
    assert_eq!(bench.times(is_roll), [0; 0]);
    assert_eq!(bench.times(is_landing), [2_000, 2_500]);
    assert_eq!(bench.times(|sent| matches!(sent, Sent::Order(DroneOrder::TakeOff, _))), [0; 0]);
}

#[test]
fn nothing_but_the_landing_is_sent_until_the_drone_is_down() {
    let mut bench = Bench::connected();
    bench.receive(0, &status(true));
    bench.approve(0, 0.5);
    bench.order(10, DroneOrder::Land);
    for now_ms in 11..1_200 {
        bench.approve(now_ms, 0.5);
        bench.order(now_ms, DroneOrder::Land);
        bench.order(now_ms, DroneOrder::TakeOff);
        bench.run(now_ms, now_ms);
    }
    bench.receive(1_200, &status(true));
    bench.run(1_200, 1_600);
    bench.stand(1_600);
    bench.approve(1_700, 0.5);
    bench.run(1_700, 3_500);
    let landings = [(10, 1), (510, 2), (1_010, 3), (1_510, 4)]
        .map(|(at, number)| (at, Sent::Order(DroneOrder::Land, number)));
    assert_eq!(bench.sent[0], (0, Sent::Roll(0.5)));
    assert_eq!(bench.sent[1..], landings, "anything else cancels a landing");
}

#[test]
fn a_flight_that_was_landed_is_not_followed_by_another() {
    let mut bench = Bench::connected();
    bench.order(0, DroneOrder::Land);
    bench.stand(1);
    bench.order(10, DroneOrder::TakeOff);
    bench.approve(20, 0.5);
    bench.run(20, 1_900);
    assert_eq!(bench.sent, [(0, Sent::Order(DroneOrder::Land, 1))]);
    // It was on the ground by its own word only, or another program ordered the take-off.
    bench.receive(1_900, &status(true));
    bench.run(1_900, 2_300);
    bench.order(2_310, DroneOrder::Land);
    bench.run(2_310, 2_410);
    let again =
        [(1_900, Sent::Order(DroneOrder::Land, 2)), (2_400, Sent::Order(DroneOrder::Land, 3))];
    assert_eq!(bench.sent[1..], again);
    bench.stand(2_450);
    bench.run(2_450, 2_800);
    bench.order(2_950, DroneOrder::Land);
    assert_eq!(
        bench.sent.last(),
        Some(&(2_950, Sent::Order(DroneOrder::Land, 4))),
        "by order at once"
    );
}

#[test]
fn a_landing_that_is_ordered_in_every_period_is_repeated_no_sooner() {
    let mut bench = Bench::connected();
    for now_ms in 0..4_900 {
        if now_ms % 100 == 0 {
            bench.receive(now_ms, &status(false));
        }
        if now_ms % 20 == 0 {
            bench.order(now_ms, DroneOrder::Land);
        }
        bench.run(now_ms, now_ms);
    }
    assert_eq!(bench.times(is_landing), (0..4_900).step_by(500).collect::<Vec<_>>());
}

#[test]
fn a_stopped_session_lands_until_the_drone_stands() {
    let mut bench = Bench::standing();
    bench.order(0, DroneOrder::TakeOff);
    bench.session.stop(ms(100));
    bench.note(100);
    for now_ms in (101..6_000).step_by(100) {
        // The drone ignored the first landings: it was taking off.
        bench.receive(now_ms, &status(now_ms > 3_000));
        bench.approve(now_ms, 0.5);
        bench.order(now_ms, DroneOrder::TakeOff);
        bench.run(now_ms, now_ms + 99);
        assert!(!bench.session.is_over(ms(now_ms)), "{now_ms} ms");
    }
    bench.stand(6_001);
    assert!(!bench.session.is_over(ms(6_300)), "one status is not enough");
    bench.run(6_001, 6_301);
    assert!(bench.session.is_over(ms(6_301)));
    let expected: Vec<_> = (100..=6_100).step_by(500).collect();
    assert_eq!(bench.times(is_landing), expected);
    assert_eq!(bench.sent.len(), 1 + expected.len(), "{:?}", bench.sent);
}

#[test]
fn a_stopped_session_gives_a_silent_drone_15_s() {
    let mut bench = Bench::connected();
    bench.receive(0, &status(true));
    bench.order(200, DroneOrder::Land);
    bench.session.stop(ms(300));
    bench.run(300, 15_299);
    assert!(!bench.session.is_over(ms(15_299)));
    assert!(bench.session.is_over(ms(15_300)));
    assert_eq!(bench.times(is_landing), (200..15_300).step_by(500).collect::<Vec<_>>());
    assert!(!bench.times(|sent| sent == Sent::ConnReq).is_empty(), "the link was not asked for");
}

#[test]
fn a_stopped_session_with_nothing_in_the_air_is_over_at_once() {
    let never_connected = {
        let mut bench = Bench::new(false);
        bench.run(0, 0);
        bench.approve(0, 0.5);
        bench
    };
    let standing = {
        let mut bench = Bench::connected();
        bench.approve(0, 0.0);
        bench.receive(0, &status(false));
        bench
    };
    let dry_run = {
        let mut bench = Bench::new(true);
        bench.order(0, DroneOrder::TakeOff);
        bench.receive(0, &status(true));
        bench
    };
    for mut bench in [never_connected, standing, dry_run] {
        assert!(!bench.session.is_over(ms(1)), "not stopped");
        bench.sent.clear();
        bench.session.stop(ms(1));
        bench.note(1);
        assert!(bench.session.is_over(ms(1)), "{:?}", bench.session);
        assert_eq!(bench.sent, []);
    }
}

#[test]
fn a_landing_ordered_during_the_take_off_goes_on_until_it_is_heard() {
    let mut bench = Bench::standing();
    bench.order(0, DroneOrder::TakeOff);
    bench.order(1_000, DroneOrder::Land);
    // The flag "flying" comes late in a take-off, and a landing ordered then is ignored.
    bench.receive(1_100, &status(false));
    bench.run(1_100, 7_999);
    assert_eq!(bench.times(is_landing).len(), 14);
    bench.stand(8_000);
    bench.run(8_000, 9_900);
    assert_eq!(bench.times(is_landing).len(), 15, "down for 0.3 s from 8 s on");
}

#[test]
fn a_control_thread_that_dies_after_the_take_off_order_is_noticed() {
    let mut bench = Bench::standing();
    bench.order(0, DroneOrder::TakeOff);
    bench.run(0, 1_000);
    assert_eq!(bench.times(is_landing), [1_000]);
}

#[test]
fn in_doubt_the_drone_is_airborne() {
    let mut bench = Bench::connected();
    assert!(!bench.session.may_be_airborne(ms(0)), "nothing was ever sent");
    bench.approve(0, 0.0);
    assert!(bench.session.may_be_airborne(ms(0)), "steered, and never heard of");
    bench.receive(1, &status(false));
    assert!(!bench.session.may_be_airborne(ms(1)), "it says that it stands");
    bench.order(2, DroneOrder::TakeOff);
    assert!(bench.session.may_be_airborne(ms(4_999)), "it may be taking off");
    bench.receive(5_010, &status(true));
    assert!(bench.session.may_be_airborne(ms(9_000)), "it says that it flies");
}

#[test]
fn a_drone_that_has_landed_and_connects_again_is_sent_nothing_but_the_request() {
    let mut bench = Bench::new(false);
    bench.session = Session::binary(0, Some(3), false, Arc::clone(&bench.session.counters));
    bench.run(0, 0);
    bench.order(0, DroneOrder::Land);
    bench.stand(1);
    bench.run(1, 400);
    bench.sent.clear();
    bench.run(400, 2_100);
    bench.receive(2_100, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    bench.run(2_100, 4_050);
    assert!(bench.session.counters.is_connected());
    assert_eq!(bench.sent, [(2_001, Sent::ConnReq)], "no setting, which may end a landing");
}
