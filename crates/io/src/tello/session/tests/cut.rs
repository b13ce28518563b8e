//! From the order to cut the motors to the drone that lies still.

use super::*;

fn cuts(bench: &Bench) -> Vec<i64> {
    bench.times(|said| said == Said::Cut)
}

#[test]
fn a_cut_goes_out_three_times_at_once_and_every_200_ms() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.approve(0, 0.5);
    bench.order(10, Order::Cut);
    bench.run(11, 900);
    assert_eq!(cuts(&bench), [10, 10, 10, 210, 410, 610, 810]);
}

#[test]
fn nothing_but_the_cut_follows_it() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.order(10, Order::Cut);
    for now_ms in 11..5_000 {
        bench.approve(now_ms, 0.5);
        bench.order(now_ms, Order::TakeOff);
        bench.order(now_ms, Order::Land);
        // Without a copy more: it is under way.
        bench.order(now_ms, Order::Cut);
        bench.run(now_ms, now_ms);
    }
    let others: Vec<_> = bench.sent.iter().filter(|(_, said)| *said != Said::Cut).collect();
    assert!(others.is_empty(), "{others:?}");
    assert_eq!(cuts(&bench).len(), 3 + 24);
}

#[test]
fn a_cut_ends_a_landing_and_comes_after_one() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.order(0, Order::Land);
    bench.order(100, Order::Cut);
    bench.run(100, 1_900);
    assert_eq!(bench.times(is_landing), [0]);
    assert_eq!(cuts(&bench).len(), 3 + 9);

    let mut landed = Bench::connected();
    landed.order(0, Order::Land);
    landed.hear(1, &status(false));
    landed.order(10, Order::Cut);
    assert_eq!(cuts(&landed), [10, 10, 10]);
}

#[test]
fn a_cut_is_repeated_until_the_drone_has_been_still_for_1_s() {
    let mut bench = Bench::connected();
    bench.order(0, Order::TakeOff);
    bench.order(1_000, Order::Cut);
    // The flag "flying" comes late in a take-off: until 5 s after the order it says nothing.
    for now_ms in (1_100..6_100).step_by(100) {
        // One status of a drone that bounces.
        bench.hear(now_ms, &status(now_ms == 5_200));
        bench.run(now_ms, now_ms + 99);
    }
    let last = *cuts(&bench).last().unwrap();
    assert_eq!(last, 6_000, "not over at 6.1 s");
    for now_ms in (6_100..7_500).step_by(100) {
        bench.hear(now_ms, &status(false));
        bench.run(now_ms, now_ms + 99);
    }
    // At rest since 5.3 s.
    assert_eq!(*cuts(&bench).last().unwrap(), 6_200);
    bench.sent.clear();
    bench.approve(7_500, 0.5);
    bench.order(7_500, Order::Land);
    bench.order(7_500, Order::TakeOff);
    assert_eq!(bench.sent, []);
    bench.order(7_501, Order::Cut);
    assert_eq!(cuts(&bench), [7_501, 7_501, 7_501], "it can be cut again");
}

#[test]
fn a_drone_that_was_never_heard_is_cut_all_the_same() {
    let mut bench = Bench::new(false);
    bench.run(0, 0);
    bench.order(10, Order::Cut);
    bench.run(10, 2_500);
    assert_eq!(cuts(&bench).len(), 3 + 12);
    // Not even the request for a connection stands between two cuts.
    assert_eq!(bench.times(|said| said == Said::ConnReq), [0]);
}

#[test]
fn a_dry_run_cuts_nothing() {
    let mut bench = Bench::new(true);
    bench.run(0, 0);
    bench.order(1, Order::Cut);
    bench.run(1, 900);
    assert_eq!(cuts(&bench), [0; 0]);
    assert_eq!(bench.session.counters.orders.get(), 0);
}

#[test]
fn a_stopped_session_cuts_until_the_drone_lies_still() {
    let mut bench = Bench::connected();
    bench.hear(0, &status(true));
    bench.order(10, Order::Cut);
    bench.session.stop(ms(20));
    bench.hear(100, &status(false));
    bench.run(100, 1_099);
    assert!(!bench.session.is_over(ms(1_099)), "still for less than 1 s");
    bench.hear(1_100, &status(false));
    assert!(bench.session.is_over(ms(1_100)));
    assert_eq!(bench.times(is_landing), [0; 0]);

    let mut silent = Bench::connected();
    silent.order(10, Order::Cut);
    silent.session.stop(ms(20));
    silent.run(20, 15_019);
    assert!(!silent.session.is_over(ms(15_019)));
    assert!(silent.session.is_over(ms(15_020)));
}
