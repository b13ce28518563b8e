//! A keyboard of the kernel: pressed, released and unplugged, through the reader to the hand.
//!
//! Needs `/dev/uinput`, which few machines that build have; there the layout by events alone is what
//! is checked, in `manual::device`.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use evdev::uinput::VirtualDevice;
use evdev::{AttributeSet, EventType, InputEvent, KeyCode};
use horizon_model::rows::stick;
use tello_io::clock::Clock;
use tello_io::manual::{
    Inputs, ManualControls, ManualInput, ManualSettings, ManualTable, PersonOrder,
};

/// A keyboard that this test presses, and its file; `None` where the kernel does not allow to make one.
fn keyboard() -> Option<(VirtualDevice, PathBuf)> {
    let keys = AttributeSet::from_iter([KeyCode::KEY_W, KeyCode::KEY_BACKSPACE]);
    let made = VirtualDevice::builder()
        .and_then(|builder| builder.name("tello-ctl test keyboard").with_keys(&keys)?.build());
    let mut device = made.ok()?;
    let path = device.enumerate_dev_nodes_blocking().ok()?.next()?.ok()?;
    // The file is there before its rights are.
    sleep(Duration::from_millis(500));
    Some((device, path))
}

#[expect(clippy::expect_used, reason = "a test may panic")]
fn key(device: &mut VirtualDevice, code: KeyCode, value: i32) {
    let event = InputEvent::new(EventType::KEY.0, code.0, value);
    device.emit(&[event]).expect("the kernel takes a key");
}

/// The hand after a tenth of a second of polls, with the strongest order among them.
fn polled(controls: &mut ManualControls, clock: Clock) -> ManualInput {
    let mut order = None;
    let mut input = ManualInput::default();
    for _ in 0..5 {
        sleep(Duration::from_millis(20));
        input = controls.poll(clock.now());
        order = order.max(input.order);
    }
    ManualInput { order, ..input }
}

#[test]
fn a_keyboard_steers_until_it_is_released_and_lands_when_it_is_unplugged() {
    let Some((mut device, path)) = keyboard() else {
        eprintln!("NOT CHECKED: no virtual keyboard, since /dev/uinput cannot be used");
        return;
    };
    let table = ManualTable {
        device: Some(path.display().to_string()),
        deflection: 0.5,
        smoothing_s: 0.01,
        pulse_s: 0.15,
        hold_s: 0.9,
        press_max_s: 3.0,
        axis_silent_s: 2.0,
        dead_zone: 0.1,
    };
    let settings = ManualSettings::try_from(&table).expect("valid settings");
    let clock = Clock::start();
    let (mut controls, _inputs) = Inputs::open(&settings, false, clock).expect("a keyboard");
    assert_eq!(polled(&mut controls, clock), ManualInput::default());

    key(&mut device, KeyCode::KEY_W, 1);
    let pitch = |input: ManualInput| input.sticks.map_or(f64::NAN, |u| u[stick::PITCH]);
    let held = pitch(polled(&mut controls, clock));
    assert!(held > 0.45, "{held}");
    key(&mut device, KeyCode::KEY_W, 0);
    let released = pitch(polled(&mut controls, clock));
    assert!(released.abs() < 0.05, "{released}");
    key(&mut device, KeyCode::KEY_BACKSPACE, 1);
    assert_eq!(polled(&mut controls, clock).order, Some(PersonOrder::EmergencyStop));

    drop(device);
    assert_eq!(polled(&mut controls, clock).order, None, "another device has a second");
    sleep(Duration::from_secs(1));
    assert_eq!(polled(&mut controls, clock).order, Some(PersonOrder::Land));
}
