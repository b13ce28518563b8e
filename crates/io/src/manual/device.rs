//! A keyboard or a gamepad of the machine, through the kernel's input events.
//!
//! Owns opening the device, its thread, and the layout of a gamepad; keys have the layout of
//! `manual::keys`. Unlike a terminal it reports every release, and that it is unplugged.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::os::fd::AsFd;
use std::thread;
use std::time::Duration;

use evdev::{AbsInfo, AbsoluteAxisCode, Device, EventSummary, KeyCode};
use horizon_model::rows::stick;

use super::keys::{KeyMotion, action_of};
use super::reader::{Outlet, Readiness, wait};
use super::{Direction, InputAction, ManualError, ManualSettings, PersonOrder, Source};
use crate::clock::SpanNs;

/// Time between two looks whether all keys are up before the flight, and most looks.
const RELEASE_PERIOD: Duration = Duration::from_millis(50);
const RELEASE_LOOKS: usize = 40;

/// How often held controls and a sign of life of the device are reported.
const REPORT_PERIOD: SpanNs = SpanNs::from_ms(100);

/// Where a device's events become acts: a function of the events.
#[derive(Debug)]
pub(super) struct Layout {
    settings: ManualSettings,
    /// First and last place of each axis.
    ranges: BTreeMap<u16, (i32, i32)>,
    is_ctrl: bool,
    /// Which keys of [`Direction::ALL`] are down.
    is_down: [bool; Direction::ALL.len()],
}

impl Layout {
    /// The layout of a device whose axes are `axes`.
    pub(super) fn new(
        settings: ManualSettings,
        axes: impl Iterator<Item = (AbsoluteAxisCode, AbsInfo)>,
    ) -> Self {
        let ranges = axes.map(|(code, axis)| (code.0, (axis.minimum(), axis.maximum())));
        let is_down = [false; Direction::ALL.len()];
        Self { settings, ranges: ranges.collect(), is_ctrl: false, is_down }
    }

    /// Action of `event`; `None` without a meaning.
    pub(super) fn action(&mut self, event: &EventSummary) -> Option<InputAction> {
        match event {
            EventSummary::Key(_, code, value) => self.key(*code, *value),
            EventSummary::AbsoluteAxis(_, code, place) => self.axis(*code, *place),
            _ => None,
        }
    }

    fn key(&mut self, code: KeyCode, value: i32) -> Option<InputAction> {
        let motion = match value {
            0 => KeyMotion::Release,
            1 => KeyMotion::Press,
            _ => KeyMotion::Repeat,
        };
        if matches!(code, KeyCode::KEY_LEFTCTRL | KeyCode::KEY_RIGHTCTRL) {
            self.is_ctrl = motion != KeyMotion::Release;
            return None;
        }
        if let Some(action) = button(code) {
            return (motion == KeyMotion::Press).then_some(action);
        }
        let action = action_of(u32::from(character(code)?), self.is_ctrl, motion)?;
        let (direction, is_down) = match action {
            InputAction::Press(direction) => (direction, true),
            InputAction::Release(direction) => (direction, false),
            _ => return Some(action),
        };
        let mut known = Direction::ALL.iter().zip(&mut self.is_down);
        if let Some((_, key)) = known.find(|(known, _)| **known == direction) {
            *key = is_down;
        }
        Some(action)
    }

    /// The steering keys that are down.
    pub(super) fn held(&self) -> impl Iterator<Item = Direction> + use<> {
        let known = Direction::ALL.iter().copied().zip(self.is_down);
        known.filter_map(|(direction, is_down)| is_down.then_some(direction))
    }

    /// Throttle and yaw on the left stick, pitch and roll on the right, as most pilots have it.
    fn axis(&self, code: AbsoluteAxisCode, place: i32) -> Option<InputAction> {
        // A gamepad's axes grow to the right and downwards.
        let (row, sign) = match code {
            AbsoluteAxisCode::ABS_X => (stick::YAW, -1.0),
            AbsoluteAxisCode::ABS_Y => (stick::THROTTLE, -1.0),
            AbsoluteAxisCode::ABS_RX => (stick::ROLL, 1.0),
            AbsoluteAxisCode::ABS_RY => (stick::PITCH, -1.0),
            _ => return None,
        };
        let (first, last) = *self.ranges.get(&code.0)?;
        let range = f64::from(last) - f64::from(first);
        if range <= 0.0 {
            return None;
        }
        let fraction = 2.0 * (f64::from(place) - f64::from(first)) / range - 1.0;
        Some(InputAction::Axis(
            row,
            sign * self.settings.excess_over_dead_zone(fraction.clamp(-1.0, 1.0)),
        ))
    }
}

/// Buttons of a gamepad. Select is small, in the middle and under no finger that steers.
fn button(code: KeyCode) -> Option<InputAction> {
    match code {
        KeyCode::BTN_SELECT => Some(InputAction::Order(PersonOrder::EmergencyStop)),
        KeyCode::BTN_START => Some(InputAction::Order(PersonOrder::TakeOff)),
        KeyCode::BTN_EAST => Some(InputAction::Order(PersonOrder::Land)),
        // The button with an X on it: drivers of Xbox pads send BTN_X, which is BTN_NORTH, others the place, west.
        KeyCode::BTN_WEST | KeyCode::BTN_NORTH => Some(InputAction::Manual),
        KeyCode::BTN_SOUTH => Some(InputAction::Automatic),
        _ => None,
    }
}

/// The character of a key, by its place on a keyboard of the United States.
fn character(code: KeyCode) -> Option<u8> {
    Some(match code {
        KeyCode::KEY_BACKSPACE => 0x7f,
        KeyCode::KEY_T => b't',
        KeyCode::KEY_R => b'r',
        KeyCode::KEY_Q => b'q',
        KeyCode::KEY_E => b'e',
        KeyCode::KEY_C => b'c',
        KeyCode::KEY_W => b'w',
        KeyCode::KEY_A => b'a',
        KeyCode::KEY_S => b's',
        KeyCode::KEY_D => b'd',
        KeyCode::KEY_I => b'i',
        KeyCode::KEY_J => b'j',
        KeyCode::KEY_K => b'k',
        KeyCode::KEY_L => b'l',
        _ => return None,
    })
}

fn is_gamepad(device: &Device) -> bool {
    let has_buttons = device.supported_keys().is_some_and(|keys| keys.contains(KeyCode::BTN_SOUTH));
    let has_sticks = device.supported_absolute_axes().is_some_and(|axes| {
        axes.contains(AbsoluteAxisCode::ABS_X) && axes.contains(AbsoluteAxisCode::ABS_RX)
    });
    has_buttons && has_sticks
}

fn is_keyboard(device: &Device) -> bool {
    device
        .supported_keys()
        .is_some_and(|keys| keys.contains(KeyCode::KEY_W) && keys.contains(KeyCode::KEY_BACKSPACE))
}

/// Opens the device that the settings call `name`, for this program alone: a letter that is typed
/// into another window must not steer.
///
/// # Errors
/// There is none, it cannot be opened, it is neither keyboard nor gamepad, or another program has it.
pub(super) fn open(name: &str) -> Result<Device, ManualError> {
    let mut device = if name == "gamepad" {
        let mut devices = evdev::enumerate().map(|(_, device)| device);
        devices.find(is_gamepad).ok_or(ManualError::NoGamepad)?
    } else {
        Device::open(name).map_err(|source| ManualError::Open { name: name.into(), source })?
    };
    if !(is_gamepad(&device) || is_keyboard(&device)) {
        return Err(ManualError::Unfit { name: name.into() });
    }
    await_release(&device);
    device.grab().map_err(|source| ManualError::Grab { name: name.into(), source })?;
    Ok(device)
}

/// Waits two seconds at most for every key to be up. If Enter on this keyboard started the flight, its release would
/// reach this program alone, and the key would stay down for all others.
fn await_release(device: &Device) {
    for _ in 0..RELEASE_LOOKS {
        match device.get_key_state() {
            Ok(keys) if keys.iter().next().is_some() => thread::sleep(RELEASE_PERIOD),
            _ => return,
        }
    }
}

/// Reads events until the outlet closes or the device is unplugged.
///
/// Keys that are down are reported again and again: few keyboards repeat more than one. Events without a
/// meaning are reported as news of the device.
pub(super) fn read_events(mut device: Device, mut layout: Layout, mut outlet: Outlet) {
    let mut reported_at = outlet.now();
    let mut has_news = false;
    while outlet.is_open() {
        match wait(device.as_fd()) {
            Readiness::Nothing => {}
            Readiness::Gone => break,
            Readiness::Data => match device.fetch_events() {
                Ok(events) => {
                    has_news = true;
                    for action in events.filter_map(|event| layout.action(&event.destructure())) {
                        outlet.push(Source::Device, action);
                    }
                }
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(_) => break,
            },
        }
        if outlet.now().since(reported_at) >= REPORT_PERIOD {
            reported_at = outlet.now();
            if std::mem::take(&mut has_news) {
                outlet.push(Source::Device, InputAction::Alive);
            }
            for direction in layout.held() {
                outlet.push(Source::Device, InputAction::Repeat(direction));
            }
        }
    }
    if outlet.is_open() {
        outlet.push(Source::Device, InputAction::Lost);
        // No terminal, no reader.
        writeln!(io::stderr(), "\nwarning: the input device is gone").ok();
    }
}

#[cfg(test)]
mod tests;
