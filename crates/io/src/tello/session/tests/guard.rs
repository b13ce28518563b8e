//! The messages to the guardian, and what becomes of its landings.

use super::*;
use crate::tello::guardian::SenderState;

fn sender_state(fixture: &Fixture, now_ms: i64) -> SenderState {
    fixture.session.sender_state(ms(now_ms))
}

#[test]
fn a_drone_that_may_be_in_the_air_is_guarded_until_it_stands() {
    let mut fixture = Fixture::connected();
    assert_eq!(sender_state(&fixture, 0), SenderState::Idle);
    fixture.receive(0, &status(false));
    fixture.order(10, DroneOrder::TakeOff);
    assert_eq!(sender_state(&fixture, 10), SenderState::Steering, "before the order is sent");
    fixture.receive(20, &status(true));
    fixture.approve(30, 0.5);
    assert_eq!(sender_state(&fixture, 6_000), SenderState::Steering);
    fixture.order(6_010, DroneOrder::Land);
    assert_eq!(sender_state(&fixture, 6_010), SenderState::Landing);
    fixture.receive(9_000, &status(false));
    assert_eq!(sender_state(&fixture, 9_000), SenderState::Landing, "its own word alone");
    for now_ms in (9_100..9_500).step_by(100) {
        fixture.stand(now_ms);
    }
    assert_eq!(sender_state(&fixture, 9_400), SenderState::Idle);
}

#[test]
fn nothing_is_guarded_in_a_dry_run_and_an_emergency_stop_is_followed_by_landings() {
    let mut dry = Fixture::new(true);
    dry.receive(0, &bytes(DronePacket::ConnAck { video_port: VIDEO_PORT }));
    dry.receive(0, &status(true));
    dry.order(10, DroneOrder::TakeOff);
    assert_eq!(sender_state(&dry, 20), SenderState::Idle);
    let mut stopped = Fixture::connected();
    stopped.receive(0, &status(true));
    stopped.order(10, DroneOrder::EmergencyStop);
    assert_eq!(sender_state(&stopped, 10), SenderState::Landing);
    for now_ms in (100..1_300).step_by(100) {
        stopped.stand(now_ms);
    }
    assert_eq!(sender_state(&stopped, 1_200), SenderState::Idle, "it is down");
}

#[test]
fn what_waits_to_be_sent_does_not_follow_a_landing_of_the_guardian() {
    let mut fixture = Fixture::connected();
    fixture.receive(0, &status(true));
    // Decided, and not sent yet.
    fixture.session.approve(approved(0.5), ms(10), ms(10));
    fixture.session.adopt_landing(ms(10));
    fixture.note(10);
    fixture.approve(20, 0.5);
    fixture.order(20, DroneOrder::TakeOff);
    fixture.run(20, 1_000);
    assert_eq!(fixture.times(is_roll), [0; 0]);
    assert_eq!(take_offs(&fixture), [0; 0]);
    assert_eq!(fixture.times(is_landing).first(), Some(&10));
    let mut ground = Fixture::connected();
    ground.receive(0, &status(false));
    ground.session.order(DroneOrder::TakeOff, ms(10));
    ground.session.adopt_landing(ms(10));
    ground.note(10);
    assert_eq!(take_offs(&ground), [0; 0], "a take-off follows the landing");
}

#[test]
fn an_answer_that_waits_to_be_sent_goes_out_before_a_landing_of_the_guardian() {
    let mut fixture = Fixture::connected();
    fixture.session.receive(&bytes(DronePacket::DateTimeRequest { sequence: 0 }), ms(10));
    fixture.session.adopt_landing(ms(10));
    fixture.note(10);
    assert_eq!(fixture.sent, [(10, Sent::Answer), (10, Sent::Order(DroneOrder::Land, 1))]);
}
