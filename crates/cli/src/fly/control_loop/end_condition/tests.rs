//! When the loop ends.

use super::*;

const GROUND_WAIT: SpanNs = SpanNs::from_ms(10_000);

/// The first time, in ms, at which a loop ends that is in `phase` from 1000 ms on; `None` within 30 s.
fn end_ms(
    phase: Phase,
    is_flying: bool,
    pose_is_airborne: Option<bool>,
    change: fn(&mut Inbox),
) -> Option<i64> {
    let mut end_condition = EndCondition::new(GROUND_WAIT);
    end_condition.is_flying = is_flying;
    let mut inbox = Inbox::new();
    change(&mut inbox);
    inbox.now = TimeNs(0).after(SpanNs::from_ms(1000));
    assert!(!end_condition.update(&inbox, Phase::Flying, None), "in flight");
    (1000..31_000).step_by(20).find(|ms| {
        inbox.now = TimeNs(0).after(SpanNs::from_ms(*ms));
        end_condition.update(&inbox, phase, pose_is_airborne)
    })
}

#[test]
fn the_loop_goes_on_in_flight_and_for_a_while_after_it() {
    for phase in [Phase::TakingOff, Phase::Flying, Phase::Landing] {
        assert_eq!(end_ms(phase, true, None, |_| ()), None, "{phase:?}");
    }
    assert_eq!(end_ms(Phase::Landed, true, None, |_| ()), Some(1520));
    assert_eq!(end_ms(Phase::LandingUnconfirmed, false, None, |_| ()), Some(1520));
    assert_eq!(end_ms(Phase::MotorsStopped, false, Some(false), |_| ()), Some(1520));
}

#[test]
fn a_drone_that_still_flies_after_a_fault_is_given_fifteen_seconds() {
    for phase in [Phase::LandingUnconfirmed, Phase::MotorsStopped] {
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
fn a_report_that_is_missing_leaves_the_one_before() {
    let mut end_condition = EndCondition::new(GROUND_WAIT);
    end_condition.is_flying = true;
    end_condition.receive(None);
    assert!(end_condition.is_flying);
}
