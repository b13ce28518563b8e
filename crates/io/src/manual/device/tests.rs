//! The layout, by events as the kernel makes them. A real or virtual device is not needed, and not
//! tested: few machines that build let a test make one.

use evdev::{EventType, InputEvent};

use super::super::Direction;
use super::super::settings::tests::table;
use super::*;

fn settings() -> ManualSettings {
    ManualSettings::try_from(&table()).unwrap()
}

/// A gamepad of 16 bits a stick.
fn layout() -> Layout {
    let axis = |code| (code, AbsInfo::new(0, -32_768, 32_767, 16, 128, 0));
    let axes = [
        AbsoluteAxisCode::ABS_X,
        AbsoluteAxisCode::ABS_Y,
        AbsoluteAxisCode::ABS_RX,
        AbsoluteAxisCode::ABS_RY,
    ];
    Layout::new(settings(), axes.map(axis).into_iter())
}

fn key(layout: &mut Layout, code: KeyCode, value: i32) -> Option<InputAction> {
    layout.action(&InputEvent::new(EventType::KEY.0, code.0, value).destructure())
}

fn place(layout: &mut Layout, code: AbsoluteAxisCode, value: i32) -> Option<InputAction> {
    layout.action(&InputEvent::new(EventType::ABSOLUTE.0, code.0, value).destructure())
}

#[test]
fn keys_are_held_until_they_are_released() {
    let mut layout = layout();
    let forward = Direction::Forward;
    assert_eq!(key(&mut layout, KeyCode::KEY_W, 1), Some(InputAction::Press(forward)));
    assert_eq!(key(&mut layout, KeyCode::KEY_W, 2), Some(InputAction::Repeat(forward)));
    assert_eq!(layout.held().collect::<Vec<_>>(), [forward], "reported again and again");
    assert_eq!(key(&mut layout, KeyCode::KEY_W, 0), Some(InputAction::Release(forward)));
    assert_eq!(layout.held().count(), 0);
    assert_eq!(
        key(&mut layout, KeyCode::KEY_BACKSPACE, 1),
        Some(InputAction::Order(PersonOrder::EmergencyStop))
    );
    assert_eq!(key(&mut layout, KeyCode::KEY_BACKSPACE, 0), None);
    assert_eq!(key(&mut layout, KeyCode::KEY_F5, 1), None);
}

#[test]
fn interrupt_lands_on_a_keyboard_that_no_terminal_sees() {
    let mut layout = layout();
    assert_eq!(key(&mut layout, KeyCode::KEY_LEFTCTRL, 1), None);
    assert_eq!(key(&mut layout, KeyCode::KEY_C, 1), Some(InputAction::Order(PersonOrder::Land)));
    assert_eq!(key(&mut layout, KeyCode::KEY_LEFTCTRL, 0), None);
    assert_eq!(key(&mut layout, KeyCode::KEY_C, 1), Some(InputAction::Automatic));
}

#[test]
fn buttons_act_when_they_are_pressed() {
    let mut layout = layout();
    for (button, action) in [
        (KeyCode::BTN_SELECT, InputAction::Order(PersonOrder::EmergencyStop)),
        (KeyCode::BTN_START, InputAction::Order(PersonOrder::TakeOff)),
        (KeyCode::BTN_EAST, InputAction::Order(PersonOrder::Land)),
        (KeyCode::BTN_WEST, InputAction::Manual),
        (KeyCode::BTN_NORTH, InputAction::Manual),
        (KeyCode::BTN_SOUTH, InputAction::Automatic),
    ] {
        assert_eq!(key(&mut layout, button, 1), Some(action));
        assert_eq!(key(&mut layout, button, 0), None);
    }
}

#[test]
fn sticks_reach_their_whole_way_and_rest_in_their_dead_zone() {
    let mut layout = layout();
    for (axis, row, sign) in [
        (AbsoluteAxisCode::ABS_X, stick::YAW, -1.0),
        (AbsoluteAxisCode::ABS_Y, stick::THROTTLE, -1.0),
        (AbsoluteAxisCode::ABS_RX, stick::ROLL, 1.0),
        (AbsoluteAxisCode::ABS_RY, stick::PITCH, -1.0),
    ] {
        for (value, fraction) in [(32_767, 1.0), (-32_768, -1.0), (0, 0.0), (3_000, 0.0)] {
            let Some(InputAction::Axis(at, pushed)) = place(&mut layout, axis, value) else {
                panic!("{axis:?} at {value} is no event");
            };
            assert_eq!(at, row, "{axis:?}");
            let gap = pushed - sign * fraction;
            assert!(gap.abs() < 1e-9, "{axis:?} at {value}: {pushed}");
        }
    }
    // 55 % of the way is half of the excess over the dead zone of 10 %.
    let Some(InputAction::Axis(_, half)) = place(&mut layout, AbsoluteAxisCode::ABS_RX, 18_022)
    else {
        panic!("a pushed stick is no event");
    };
    assert!((half - 0.5).abs() < 1e-3, "{half}");
}

#[test]
fn axes_of_no_or_unknown_range_report_nothing() {
    let flat = (AbsoluteAxisCode::ABS_RX, AbsInfo::new(0, 7, 7, 0, 0, 0));
    let mut layout = Layout::new(settings(), [flat].into_iter());
    assert_eq!(place(&mut layout, AbsoluteAxisCode::ABS_RX, 7), None);
    assert_eq!(place(&mut layout, AbsoluteAxisCode::ABS_RY, 100), None);
    assert_eq!(place(&mut layout, AbsoluteAxisCode::ABS_HAT0X, 1), None);
}

#[test]
fn a_file_that_is_no_input_device_is_refused_with_its_name() {
    let error = open("/dev/null").unwrap_err().to_string();
    assert!(error.contains("/dev/null"), "{error}");
    let error = open("/dev/input/no-such-device").unwrap_err().to_string();
    assert!(error.contains("/dev/input/no-such-device"), "{error}");
}
