//! When the loop ends, and what an order of a person means.

use horizon_model::rows::Sticks;

use super::*;

const PATIENCE: SpanNs = SpanNs::from_ms(10_000);

/// The first time, in ms, at which a loop ends that is in `phase` from 1000 ms on; `None` within 30 s.
fn end_ms(
    phase: Phase,
    is_flying: bool,
    pose_is_airborne: Option<bool>,
    change: fn(&mut Inbox),
) -> Option<i64> {
    let mut over = Over::new(PATIENCE);
    over.is_flying = is_flying;
    let mut inbox = Inbox::new();
    change(&mut inbox);
    inbox.now = TimeNs(0).after(SpanNs::from_ms(1000));
    assert!(!over.is_over(&inbox, Phase::Flying, None), "in flight");
    (1000..31_000).step_by(20).find(|ms| {
        inbox.now = TimeNs(0).after(SpanNs::from_ms(*ms));
        over.is_over(&inbox, phase, pose_is_airborne)
    })
}

#[test]
fn the_loop_goes_on_in_flight_and_for_a_while_after_it() {
    for phase in [Phase::TakingOff, Phase::Flying, Phase::Landing] {
        assert_eq!(end_ms(phase, true, None, |_| ()), None, "{phase:?}");
    }
    assert_eq!(end_ms(Phase::Landed, true, None, |_| ()), Some(1520));
    assert_eq!(end_ms(Phase::Fault, false, None, |_| ()), Some(1520));
    assert_eq!(end_ms(Phase::MotorsStopped, false, Some(false), |_| ()), Some(1520));
}

#[test]
fn a_drone_that_still_flies_after_a_fault_is_given_fifteen_seconds() {
    for phase in [Phase::Fault, Phase::MotorsStopped] {
        assert_eq!(end_ms(phase, true, None, |_| ()), Some(16_020), "{phase:?}, by its report");
        assert_eq!(
            end_ms(phase, false, Some(true), |_| ()),
            Some(16_020),
            "{phase:?}, by the pose"
        );
    }
}

#[test]
fn on_the_ground_the_loop_waits_as_long_as_it_is_patient_and_for_a_person_longer() {
    assert_eq!(end_ms(Phase::Idle, false, None, |_| ()), Some(11_020));
    assert_eq!(end_ms(Phase::Idle, false, None, |inbox| inbox.manual = Some([0.0; 4])), None);
    let asks = |inbox: &mut Inbox| inbox.operator = Operator::Land;
    assert_eq!(end_ms(Phase::Idle, false, None, asks), Some(1000));
}

#[test]
fn a_take_off_with_the_sticks_held_is_one_by_hand() {
    let hand = |sticks| Hand { ask: None, sticks, has_expired: false };
    let held = hand(Some(Sticks::zeros()));
    assert_eq!(meaning(Ask::TakeOff, &held), Operator::FlyByHand);
    assert_eq!(meaning(Ask::TakeOff, &hand(None)), Operator::Fly);
    for hand in [held, hand(None)] {
        assert_eq!(meaning(Ask::Land, &hand), Operator::Land);
        assert_eq!(meaning(Ask::EmergencyStop, &hand), Operator::EmergencyStop);
    }
}

#[test]
fn a_report_that_is_missing_leaves_the_one_before() {
    let mut over = Over::new(PATIENCE);
    over.is_flying = true;
    over.hear(None);
    assert!(over.is_flying);
}

#[test]
fn an_order_to_take_off_lapses_on_the_ground_and_no_other_does() {
    let at = |s: i64| TimeNs(0).after(SpanNs::from_ms(1000 * s));
    let mut orders = Orders::to_fly(PATIENCE);
    assert!(!orders.lapse(at(10), Phase::Idle) && orders.strongest == Operator::Fly);
    assert!(orders.lapse(at(11), Phase::Idle) && orders.strongest == Operator::Wait);
    assert!(!orders.lapse(at(12), Phase::Idle), "once");
    orders.give(Operator::FlyByHand, at(20));
    assert!(!orders.lapse(at(30), Phase::Idle) && orders.strongest == Operator::FlyByHand);
    assert!(!orders.lapse(at(40), Phase::Flying), "it is obeyed");
    for order in [Operator::Land, Operator::EmergencyStop] {
        orders.give(order, at(41));
        orders.give(Operator::Fly, at(42));
        assert!(!orders.lapse(at(90), Phase::Idle) && orders.strongest == order);
    }
}
