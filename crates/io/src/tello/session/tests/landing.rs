//! From the first reason to land to the end of the session.

use super::*;

#[test]
fn a_lost_drone_is_asked_for_between_two_landings() {
    let mut bench = Bench::connected();
    bench.order(300, Order::Land);
    bench.run(300, 2_100);
    assert_eq!(bench.times(|said| said == Said::ConnReq), [2_000]);
    assert_eq!(bench.times(is_landing), [300, 800, 1_300, 1_800]);
}

#[test]
fn a_silent_control_thread_means_neutral_sticks_and_then_a_landing() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.approve(0, 0.5);
    bench.run(1, 1_900);
    for (at, said) in &bench.sent {
        match said {
            Said::Roll(roll) if *at < 100 => assert!((roll - 0.5).abs() < 1e-12, "{at}"),
            Said::Roll(roll) => assert!(*at < 1_000 && roll.abs() < 1e-12, "{roll} at {at} ms"),
            Said::Order(order, _) => assert_eq!((*order, at % 500), (Order::Land, 0), "{at}"),
            other => panic!("{other:?} at {at} ms"),
        }
    }
    assert_eq!(bench.times(is_roll), (0..1_000).step_by(20).collect::<Vec<_>>());
    assert_eq!(bench.times(is_landing), [1_000, 1_500]);
    assert_eq!(bench.session.counters.neutralised.get(), 45);
    assert_eq!(bench.session.counters.watchdog_landings.get(), 1);
    // A control thread that wakes up may not cancel the landing.
    bench.sent.clear();
    bench.approve(1_901, 0.5);
    bench.order(1_901, Order::TakeOff);
    bench.run(1_901, 2_999);
    assert_eq!(bench.times(is_roll), [0; 0]);
    assert_eq!(bench.times(is_landing), [2_000, 2_500]);
    assert_eq!(bench.times(|said| matches!(said, Said::Order(Order::TakeOff, _))), [0; 0]);
}

#[test]
fn nothing_but_the_landing_is_sent_until_the_drone_is_down() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.approve(0, 0.5);
    bench.order(10, Order::Land);
    for now_ms in 11..1_200 {
        bench.approve(now_ms, 0.5);
        bench.order(now_ms, Order::Land);
        bench.order(now_ms, Order::TakeOff);
        bench.run(now_ms, now_ms);
    }
    bench.hear(1_200, &status(true));
    bench.run(1_200, 1_600);
    bench.hear(1_600, &status(false));
    bench.approve(1_700, 0.5);
    bench.run(1_700, 3_500);
    let landing = Said::Order(Order::Land, 1);
    let landings = [10, 510, 1_010, 1_510].map(|at| (at, landing));
    assert_eq!(bench.sent[0], (0, Said::Roll(0.5)));
    assert_eq!(bench.sent[1..], landings, "anything else cancels a landing");
}

#[test]
fn a_flight_that_was_landed_is_not_followed_by_another() {
    let mut bench = Bench::connected();
    bench.order(0, Order::Land);
    bench.hear(1, &status(false));
    bench.order(10, Order::TakeOff);
    bench.approve(20, 0.5);
    bench.run(20, 1_900);
    assert_eq!(bench.sent, [(0, Said::Order(Order::Land, 1))]);
    // Somebody else took off: it can still be landed.
    bench.hear(1_900, &status(true));
    bench.order(1_910, Order::Land);
    assert_eq!(bench.sent.last(), Some(&(1_910, Said::Order(Order::Land, 2))));
}

#[test]
fn a_stopped_session_lands_until_the_drone_stands() {
    let mut bench = Bench::connected();
    bench.order(0, Order::TakeOff);
    bench.session.stop(ms(100));
    bench.note(100);
    for now_ms in (101..6_000).step_by(100) {
        // The drone ignored the first landings: it was taking off.
        bench.hear(now_ms, &status(now_ms > 3_000));
        bench.approve(now_ms, 0.5);
        bench.order(now_ms, Order::TakeOff);
        bench.run(now_ms, now_ms + 99);
        assert!(!bench.session.is_over(ms(now_ms)), "{now_ms} ms");
    }
    bench.hear(6_001, &status(false));
    assert!(bench.session.is_over(ms(6_001)));
    let expected: Vec<_> = (100..=5_600).step_by(500).collect();
    assert_eq!(bench.times(is_landing), expected);
    assert_eq!(bench.sent.len(), 1 + expected.len(), "{:?}", bench.sent);
}

#[test]
fn a_stopped_session_gives_a_silent_drone_15_s() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.order(200, Order::Land);
    bench.session.stop(ms(300));
    bench.run(300, 15_299);
    assert!(!bench.session.is_over(ms(15_299)));
    assert!(bench.session.is_over(ms(15_300)));
    assert_eq!(bench.times(is_landing), (200..15_300).step_by(500).collect::<Vec<_>>());
    assert!(!bench.times(|said| said == Said::ConnReq).is_empty(), "the link was not asked for");
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
        bench.approve(0, 0.5);
        bench.hear(0, &status(false));
        bench
    };
    let dry_run = {
        let mut bench = Bench::new(true);
        bench.order(0, Order::TakeOff);
        bench.hear(0, &status(true));
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
    let mut bench = Bench::connected();
    bench.order(0, Order::TakeOff);
    bench.order(1_000, Order::Land);
    // The flag "flying" comes late in a take-off, and a landing ordered then is ignored.
    bench.hear(1_100, &status(false));
    bench.run(1_100, 4_999);
    assert_eq!(bench.times(is_landing).len(), 8);
    bench.hear(5_000, &status(false));
    bench.run(5_000, 6_900);
    assert_eq!(bench.times(is_landing).len(), 8);
}

#[test]
fn a_control_thread_that_dies_after_the_take_off_order_is_noticed() {
    let mut bench = Bench::connected();
    bench.order(0, Order::TakeOff);
    bench.run(0, 1_000);
    assert_eq!(bench.times(is_landing), [1_000]);
}

#[test]
fn in_doubt_the_drone_is_airborne() {
    let mut bench = Bench::connected();
    assert!(!bench.session.may_be_airborne(ms(0)), "nothing was ever sent");
    bench.approve(0, 0.0);
    assert!(bench.session.may_be_airborne(ms(0)), "steered, and never heard of");
    bench.hear(1, &status(false));
    assert!(!bench.session.may_be_airborne(ms(1)), "it says that it stands");
    bench.order(2, Order::TakeOff);
    assert!(bench.session.may_be_airborne(ms(4_999)), "it may be taking off");
    bench.hear(5_010, &status(true));
    assert!(bench.session.may_be_airborne(ms(9_000)), "it says that it flies");
}
