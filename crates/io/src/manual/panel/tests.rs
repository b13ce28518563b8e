use super::*;

const TIMERS: Timers = Timers {
    pulse: SpanNs::from_ms(100),
    hold: SpanNs::from_ms(500),
    press_max: SpanNs::from_ms(2000),
    axis_silent: SpanNs::from_ms(300),
};

fn at(ms: i64) -> TimeNs {
    TimeNs(0).after(SpanNs::from_ms(ms))
}

/// A panel whose forward key was pressed at 0 ms.
fn pressed(has_release: bool) -> Panel {
    let mut panel = Panel::default();
    assert!(panel.press(Direction::Forward, at(0), has_release, &TIMERS));
    panel
}

/// Deflection of a row, and what was let go, at a time.
fn look(panel: &mut Panel, row: usize, ms: i64) -> (f64, Option<Note>) {
    panel.expire(at(ms), &TIMERS);
    (panel.asked()[row], panel.take_note())
}

#[test]
fn a_key_without_a_release_acts_for_a_pulse_and_may_be_pressed_at_once() {
    let mut panel = pressed(false);
    assert_eq!(look(&mut panel, stick::PITCH, 99), (1.0, None));
    assert_eq!(look(&mut panel, stick::PITCH, 100), (0.0, None), "its end is nothing to note");
    assert!(panel.press(Direction::Forward, at(101), false, &TIMERS));
    assert_eq!(look(&mut panel, stick::PITCH, 200), (1.0, None));
}

#[test]
fn a_key_with_a_release_that_was_lost_is_let_go_and_has_to_be_pressed_anew() {
    let mut panel = pressed(true);
    assert_eq!(look(&mut panel, stick::PITCH, 499), (1.0, None));
    assert_eq!(look(&mut panel, stick::PITCH, 500), (0.0, Some(Note::KeyExpired)));
    assert_eq!(look(&mut panel, stick::PITCH, 501), (0.0, None), "noted once");
    panel.repeat(Direction::Forward, at(600), &TIMERS);
    // Within a pulse of a repetition it is one more of them.
    assert!(!panel.press(Direction::Forward, at(700), true, &TIMERS));
    assert!(panel.press(Direction::Forward, at(801), true, &TIMERS));
    panel.lift(Direction::Forward);
    assert_eq!(look(&mut panel, stick::PITCH, 802), (0.0, None));
}

#[test]
fn no_repetition_lets_a_key_act_longer_than_any() {
    let mut panel = pressed(true);
    for ms in (0..2000).step_by(50) {
        panel.repeat(Direction::Forward, at(ms), &TIMERS);
        assert_eq!(look(&mut panel, stick::PITCH, ms), (1.0, None), "{ms} ms");
    }
    assert_eq!(look(&mut panel, stick::PITCH, 1999), (1.0, None));
    assert_eq!(look(&mut panel, stick::PITCH, 2000), (0.0, Some(Note::KeyExpired)));
    // Presses that are repetitions, of a key without a release.
    let mut panel = pressed(false);
    for ms in (0..2000).step_by(50) {
        assert!(panel.press(Direction::Forward, at(ms), false, &TIMERS));
    }
    assert_eq!(look(&mut panel, stick::PITCH, 2000), (0.0, Some(Note::KeyExpired)));
}

#[test]
fn a_repetition_of_any_key_renews_only_keys_with_a_release() {
    let mut panel = pressed(true);
    panel.press(Direction::Up, at(0), false, &TIMERS);
    panel.repeat_all(at(80), &TIMERS);
    panel.expire(at(579), &TIMERS);
    assert_eq!(panel.asked(), Sticks::new(0.0, 1.0, 0.0, 0.0));
    assert_eq!(look(&mut panel, stick::PITCH, 580), (0.0, Some(Note::KeyExpired)));
}

#[test]
fn keys_of_one_stick_add_up_and_to_its_axis() {
    let mut panel = pressed(true);
    panel.press(Direction::Backward, at(0), true, &TIMERS);
    panel.press(Direction::TurnRight, at(0), true, &TIMERS);
    assert!(panel.move_axis(stick::YAW, 0.25));
    panel.move_axis(stick::THROTTLE, -0.5);
    assert_eq!(panel.asked(), Sticks::new(0.0, 0.0, -0.75, -0.5));
    assert!(!panel.move_axis(stick::COUNT, 1.0), "there is no such stick");
}

#[test]
fn an_axis_of_a_silent_device_acts_again_once_it_was_centred() {
    let mut panel = Panel::default();
    assert!(panel.move_axis(stick::ROLL, 0.5));
    panel.receive(at(0));
    assert_eq!(look(&mut panel, stick::ROLL, 299), (0.5, None));
    assert_eq!(look(&mut panel, stick::ROLL, 300), (0.0, Some(Note::AxisExpired)));
    panel.receive(at(301));
    assert!(!panel.move_axis(stick::ROLL, 0.6), "not centred since");
    assert!(!panel.move_axis(stick::ROLL, 0.0));
    assert!(panel.move_axis(stick::ROLL, 0.7));
    assert_eq!(look(&mut panel, stick::ROLL, 302), (0.7, None));
}

#[test]
fn an_axis_without_a_number_does_not_act() {
    let mut panel = Panel::default();
    assert!(!panel.move_axis(stick::ROLL, f64::NAN));
    assert_eq!(panel.asked(), Sticks::zeros());
    assert!(panel.move_axis(stick::ROLL, -1.0));
}

#[test]
fn nothing_acts_after_a_release_until_it_is_pushed_anew() {
    let mut panel = pressed(true);
    panel.move_axis(stick::ROLL, 0.5);
    panel.release();
    assert_eq!(panel.asked(), Sticks::zeros());
    assert_eq!(panel.take_note(), None, "the person did it");
    assert!(!panel.press(Direction::Forward, at(100), true, &TIMERS), "a repetition");
    assert!(!panel.move_axis(stick::ROLL, 0.4));
    assert!(panel.press(Direction::Forward, at(201), true, &TIMERS));
    panel.move_axis(stick::ROLL, 0.0);
    assert!(panel.move_axis(stick::ROLL, 0.4));
    assert_eq!(panel.asked(), Sticks::new(0.4, 1.0, 0.0, 0.0));
}
