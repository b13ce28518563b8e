//! A control thread or a sender that is late.

use tello_flight::drone::CONTROL_SILENCE_NEUTRAL;

use super::*;

#[test]
fn sticks_that_waited_for_the_sender_have_spent_a_part_of_their_time() {
    let mut fixture = Fixture::connected();
    fixture.session.approve(approved(0.5), ms(0), ms(60));
    fixture.note(60);
    fixture.run(61, 140);
    let rolls: Vec<_> = [(60, 0.5), (80, 0.5), (100, 0.0), (120, 0.0), (140, 0.0)]
        .map(|(at, roll)| (at, Sent::Roll(roll)))
        .into();
    assert_eq!(fixture.sent, rolls, "neutral at {CONTROL_SILENCE_NEUTRAL:?}");
    fixture.approve(150, 0.5);
    fixture.session.approve(approved(0.5), ms(151), ms(300));
    fixture.note(300);
    assert_eq!(fixture.sent.last(), Some(&(300, Sent::Roll(0.0))), "too old when they are sent");
}

#[test]
fn a_session_that_was_not_advanced_for_1_s_lands_instead_of_steering_on() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    fixture.approve(0, 0.5);
    fixture.approve(1_000, 0.5);
    assert_eq!(fixture.sent[1..], [(1_000, Sent::Order(DroneOrder::Land, 1))]);
    assert_eq!(fixture.session.counters.watchdog_landings.get(), 1);
}

#[test]
fn sticks_that_are_too_old_at_the_start_begin_nothing() {
    let mut fixture = Fixture::connected();
    fixture.session.approve(approved(0.5), ms(0), ms(1_000));
    fixture.run(1_000, 1_900);
    assert_eq!(fixture.sent, []);
    assert!(matches!(fixture.session.phase, SessionPhase::Quiet));
    fixture.approve(1_901, 0.5);
    assert_eq!(fixture.times(is_roll), [1_901]);
}

#[test]
fn sticks_are_repeated_no_sooner_however_often_the_session_is_advanced() {
    let mut fixture = Fixture::connected();
    fixture.approve(0, 0.5);
    // Every packet of the drone advances the session, too.
    for now_ms in 1..=60 {
        fixture.session.advance(ms(now_ms));
        fixture.note(now_ms);
    }
    assert_eq!(fixture.times(is_roll), [0, 20, 40, 60]);
}
