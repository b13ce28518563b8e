//! Timers of what is held, and what a change of the pilot releases.

use super::tests::{Desk, FULL, assert_near};
use super::*;

/// Longest times of the settings of these tests, and the time constant with which sticks return. ms
const HOLD: i64 = 900;
const PRESS_MAX: i64 = 3_000;
const AXIS_SILENT: i64 = 2_000;
const SETTLE: i64 = 1_000;

fn held_is_level(desk: &mut Desk, ms: i64) {
    let u = desk.sticks_after(ms);
    assert!(u.norm() < 1e-3, "{u:?}");
}

#[test]
fn a_key_whose_release_is_lost_is_let_go() {
    for source in [Source::Terminal, Source::Device] {
        let mut desk = Desk::new();
        desk.act(source, InputAction::Press(Direction::Forward));
        assert_near(desk.sticks_after(HOLD - 20)[stick::PITCH], FULL);
        let (before, after) = (desk.sticks_after(0), desk.sticks_after(60));
        assert!(after[stick::PITCH] < before[stick::PITCH], "{after:?}");
        assert_eq!(desk.controls.take_note(), Some(Note::KeyExpired));
        held_is_level(&mut desk, SETTLE);
        // A terminal that thaws: what was held at that time counts for nothing.
        desk.sticks_holding(source, &[Direction::Forward], 1_000);
        held_is_level(&mut desk, 0);
        desk.act(source, InputAction::Release(Direction::Forward));
        desk.act(source, InputAction::Press(Direction::Forward));
        assert_near(desk.sticks_after(HOLD - 20)[stick::PITCH], FULL);
    }
}

#[test]
fn a_key_that_is_pressed_again_without_a_release_acts_again() {
    let mut desk = Desk::new();
    desk.key(InputAction::Press(Direction::Up));
    held_is_level(&mut desk, HOLD + SETTLE);
    desk.key(InputAction::Press(Direction::Up));
    assert_near(desk.sticks_after(HOLD - 20)[stick::THROTTLE], FULL);
}

#[test]
fn repetitions_keep_a_key_and_none_for_longer_than_the_longest_press() {
    for (source, action) in [
        (Source::Terminal, InputAction::Repeat as fn(Direction) -> InputAction),
        (Source::Device, InputAction::Repeat),
        // A terminal that reports repetitions as presses, and one that knows no releases.
        (Source::Terminal, InputAction::Press),
        (Source::Terminal, InputAction::Pulse),
    ] {
        let mut desk = Desk::new();
        let hold = |desk: &mut Desk, ms: i64| {
            for _ in 0..ms / 40 {
                desk.act(source, action(Direction::Right));
                desk.after(40);
            }
            desk.sticks_after(0)[stick::ROLL]
        };
        desk.act(source, InputAction::Press(Direction::Right));
        if action(Direction::Right) == InputAction::Pulse(Direction::Right) {
            desk = Desk::new();
        }
        assert_near(hold(&mut desk, PRESS_MAX - 40), FULL);
        assert!(hold(&mut desk, SETTLE + 80).abs() < 1e-3, "{:?}", action(Direction::Right));
        assert_eq!(desk.controls.take_note(), Some(Note::KeyExpired));
        assert_eq!(desk.controls.take_note(), None);
        // Let go, and pressed again.
        desk.act(source, InputAction::Release(Direction::Right));
        desk.after(500);
        desk.act(source, action(Direction::Right));
        desk.act(source, InputAction::Press(Direction::Right));
        assert!(hold(&mut desk, 600) > 0.9 * FULL);
    }
}

#[test]
fn a_terminal_repeats_the_last_key_alone_and_the_others_are_kept_with_it() {
    let mut desk = Desk::new();
    desk.act(Source::Terminal, InputAction::Press(Direction::Forward));
    desk.after(200);
    desk.act(Source::Terminal, InputAction::Press(Direction::TurnLeft));
    let u = desk.sticks_holding(Source::Terminal, &[Direction::TurnLeft], 2_000);
    assert_near(u[stick::PITCH], FULL);
    assert_near(u[stick::YAW], FULL);
    // The last one is let go: none is repeated any more.
    desk.act(Source::Terminal, InputAction::Release(Direction::TurnLeft));
    held_is_level(&mut desk, HOLD + SETTLE);
}

#[test]
fn pulses_of_one_key_do_not_keep_another() {
    let mut desk = Desk::new();
    desk.act(Source::Terminal, InputAction::Pulse(Direction::Forward));
    for _ in 0..25 {
        desk.after(40);
        desk.act(Source::Terminal, InputAction::Pulse(Direction::Right));
    }
    assert!(desk.sticks_after(0)[stick::PITCH].abs() < 1e-3);
}

#[test]
fn a_stray_repetition_presses_nothing() {
    let mut desk = Desk::new();
    desk.key(InputAction::Repeat(Direction::Up));
    assert_eq!(desk.after(100), ManualInput::default());
}

#[test]
fn keys_of_a_window_that_lost_the_keyboard_are_let_go_at_once() {
    let mut desk = Desk::new();
    desk.act(Source::Terminal, InputAction::Press(Direction::Backward));
    desk.after(300);
    desk.act(Source::Terminal, InputAction::LetGo);
    desk.sticks_holding(Source::Terminal, &[Direction::Backward], SETTLE);
    held_is_level(&mut desk, 0);
}

#[test]
fn a_silent_gamepad_keeps_no_stick() {
    let mut desk = Desk::new();
    desk.key(InputAction::Axis(stick::PITCH, 0.8));
    assert_near(desk.sticks_after(AXIS_SILENT - 20)[stick::PITCH], 0.8 * FULL);
    assert_eq!(desk.controls.take_note(), None);
    held_is_level(&mut desk, 40 + SETTLE);
    assert_eq!(desk.controls.take_note(), Some(Note::AxisExpired));
    // Back in range: a stick that was never centred steers nothing.
    for place in [0.8, 0.81, 0.4] {
        desk.key(InputAction::Axis(stick::PITCH, place));
        held_is_level(&mut desk, 500);
    }
    desk.key(InputAction::Axis(stick::PITCH, 0.0));
    desk.key(InputAction::Axis(stick::PITCH, 0.4));
    assert_near(desk.sticks_after(SETTLE)[stick::PITCH], 0.4 * FULL);
}

#[test]
fn any_news_of_a_gamepad_keeps_its_sticks() {
    let mut desk = Desk::new();
    desk.key(InputAction::Axis(stick::PITCH, 1.0));
    for news in [InputAction::Alive, InputAction::Axis(stick::YAW, 0.0), InputAction::Alive] {
        assert_near(desk.sticks_after(AXIS_SILENT - 20)[stick::PITCH], FULL);
        desk.key(news);
    }
    // What this computer repeats by itself shows nothing of the device.
    desk.after(1_000);
    desk.key(InputAction::Repeat(Direction::Up));
    held_is_level(&mut desk, 1_000 + SETTLE);
}

#[test]
fn what_is_held_at_a_change_of_the_pilot_counts_when_it_is_pushed_anew() {
    for change in [
        vec![InputAction::Automatic],
        vec![InputAction::Automatic, InputAction::Manual],
        vec![InputAction::Manual],
        vec![InputAction::Order(PersonOrder::Land)],
        vec![InputAction::Order(PersonOrder::EmergencyStop)],
    ] {
        let mut desk = Desk::new();
        desk.key(InputAction::Press(Direction::Forward));
        desk.key(InputAction::Axis(stick::THROTTLE, 1.0));
        desk.after(500);
        for action in &change {
            desk.key(*action);
            desk.after(20);
        }
        let is_by_hand = change != [InputAction::Automatic];
        // Still held, and the stick moves a little.
        for _ in 0..30 {
            desk.key(InputAction::Repeat(Direction::Forward));
            desk.key(InputAction::Axis(stick::THROTTLE, 0.9));
            let input = desk.after(40);
            assert_eq!(input.sticks.is_some(), is_by_hand, "{change:?}");
        }
        let u = desk.after(0).sticks.unwrap_or_default();
        assert!(u.norm() < 1e-3, "{change:?}: {u:?}");
        desk.key(InputAction::Axis(stick::THROTTLE, 0.0));
        desk.key(InputAction::Axis(stick::THROTTLE, 1.0));
        desk.key(InputAction::Release(Direction::Forward));
        desk.key(InputAction::Press(Direction::Forward));
        let u = desk.sticks_after(800);
        assert_near(u[stick::THROTTLE], FULL);
        assert_near(u[stick::PITCH], FULL);
    }
}

#[test]
fn a_person_who_takes_over_from_another_device_finds_level_sticks() {
    let mut desk = Desk::new();
    desk.key(InputAction::Axis(stick::PITCH, 1.0));
    desk.after(500);
    desk.act(Source::Terminal, InputAction::Pulse(Direction::Right));
    // The hand on the gamepad trembles.
    for _ in 0..25 {
        desk.key(InputAction::Axis(stick::PITCH, 0.95));
        desk.act(Source::Terminal, InputAction::Pulse(Direction::Right));
        desk.after(40);
    }
    let u = desk.sticks_after(0);
    assert!(u[stick::PITCH].abs() < 1e-3, "{u:?}");
    assert_near(u[stick::ROLL], FULL);
    desk.act(Source::Remote, InputAction::Manual);
    desk.act(Source::Terminal, InputAction::Pulse(Direction::Right));
    held_is_level(&mut desk, SETTLE);
}
