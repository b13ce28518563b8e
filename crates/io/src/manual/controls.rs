//! Interpretation of a person's keys and sticks: a function of the events and of time.
//!
//! Owns who steers, the smoothing of the sticks and what happens when the pilot changes or a device is
//! lost. Which keys are down, and for how long, is `manual::panel`. It refuses to know where an event comes
//! from beyond its [`Source`]; devices and bytes are `manual::device` and `manual::terminal`.

use horizon_model::rows::{Sticks, stick};
use strum::VariantArray;

use super::panel::{Note, Panel};
use super::{ManualInput, ManualSettings, PersonOrder};
use crate::clock::{SpanNs, TimeNs};

/// How long level sticks wait for another device after the one that steered is gone.
const LOST_LANDS_AFTER: SpanNs = SpanNs::from_ms(1_000);

/// Where an event comes from. Each has keys of its own: one that is released here may be held there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// Keys of the terminal.
    Terminal,
    /// The input device of the settings.
    Device,
    /// A view of the flight, maybe on another machine.
    Remote,
}

/// One thing that a person did.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Event {
    /// When it was read.
    pub at: TimeNs,
    /// From where.
    pub source: Source,
    /// Action.
    pub action: InputAction,
}

/// Action of a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum InputAction {
    /// An order to the drone.
    Order(PersonOrder),
    /// Take the sticks.
    Manual,
    /// Give the sticks back to the controller.
    Automatic,
    /// A key is down until it is released, or no longer repeated.
    Press(Direction),
    /// A key that was pressed is still down.
    Repeat(Direction),
    /// A key that will not report its release was pressed or repeated.
    Pulse(Direction),
    /// A key is up.
    Release(Direction),
    /// A stick of a gamepad stands here, its dead zone removed: row of [`stick`] and -1..=1.
    Axis(usize, f64),
    /// All keys count as released: the person looks elsewhere, and their releases will not be reported.
    LetGo,
    /// The source sent something without a meaning: it is alive.
    Alive,
    /// The source is gone: unplugged or closed.
    Lost,
}

/// Where a steering key pushes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
pub enum Direction {
    /// To the right: roll.
    Right,
    /// To the left: roll.
    Left,
    /// Forward: pitch.
    Forward,
    /// Backward: pitch.
    Backward,
    /// Counter-clockwise from above: yaw.
    TurnLeft,
    /// Clockwise from above: yaw.
    TurnRight,
    /// Up: throttle.
    Up,
    /// Down: throttle.
    Down,
}

impl Direction {
    /// Every direction.
    pub const ALL: &[Self] = Self::VARIANTS;

    /// The row of [`stick`] and the sign of the push.
    pub(super) fn push(self) -> (usize, f64) {
        match self {
            Self::Right => (stick::ROLL, 1.0),
            Self::Left => (stick::ROLL, -1.0),
            Self::Forward => (stick::PITCH, 1.0),
            Self::Backward => (stick::PITCH, -1.0),
            Self::TurnLeft => (stick::YAW, 1.0),
            Self::TurnRight => (stick::YAW, -1.0),
            Self::Up => (stick::THROTTLE, 1.0),
            Self::Down => (stick::THROTTLE, -1.0),
        }
    }
}

/// What the events so far mean: who steers, with which sticks, and the order that was given last.
#[derive(Debug, Clone)]
pub(super) struct ControlState {
    settings: ManualSettings,
    terminal: Panel,
    device: Panel,
    remote: Panel,
    /// Source that the person used last while steering; `None`: the controller steers.
    steering: Option<Source>,
    /// When the source that steered was lost.
    lost_at: Option<TimeNs>,
    /// Strongest order since the last [`ControlState::input`].
    order: Option<PersonOrder>,
    /// The smoothed sticks. 1
    u: Sticks,
    asked_at: Option<TimeNs>,
}

impl ControlState {
    /// No key is down and no stick is moved: the controller steers.
    pub(super) fn new(settings: ManualSettings) -> Self {
        Self {
            settings,
            terminal: Panel::default(),
            device: Panel::default(),
            remote: Panel::default(),
            steering: None,
            lost_at: None,
            order: None,
            u: Sticks::zeros(),
            asked_at: None,
        }
    }

    /// Takes note of `event`.
    ///
    /// Whatever is held when the pilot changes does nothing until it is pushed anew.
    pub(super) fn receive(&mut self, event: &Event) {
        let Event { at, source, action } = *event;
        let timers = self.settings.timers;
        let panel = self.panel(source);
        panel.expire(at, &timers);
        if action != InputAction::Lost && !matches!(action, InputAction::Repeat(_)) {
            // Repetitions are made by this computer, also for a device out of range.
            panel.receive(at);
        }
        let is_pushed = match action {
            InputAction::Press(direction) => panel.press(direction, at, true, &timers),
            InputAction::Pulse(direction) => panel.press(direction, at, false, &timers),
            InputAction::Axis(row, place) => panel.move_axis(row, place),
            _ => false,
        };
        match action {
            InputAction::Repeat(direction) => panel.repeat(direction, at, &timers),
            InputAction::Release(direction) => panel.lift(direction),
            InputAction::LetGo => panel.release(),
            InputAction::Lost => {
                *panel = Panel::default();
                if self.steering == Some(source) {
                    self.lost_at = Some(at);
                }
            }
            InputAction::Manual => {
                self.release();
                self.take(source);
            }
            InputAction::Automatic => {
                self.release();
                self.steering = None;
                self.lost_at = None;
            }
            InputAction::Order(order) => {
                self.order = self.order.max(Some(order));
                if order != PersonOrder::TakeOff {
                    self.release();
                }
            }
            InputAction::Press(_)
            | InputAction::Pulse(_)
            | InputAction::Axis(..)
            | InputAction::Alive => {}
        }
        if source == Source::Terminal
            && matches!(action, InputAction::Press(_) | InputAction::Repeat(_))
        {
            self.terminal.repeat_all(at, &timers);
        }
        if is_pushed {
            self.take(source);
        }
    }

    /// Order and sticks of the person at `now`; called once per tick.
    ///
    /// The sticks follow the asked deflection `d` as `u <- u + (1 - exp(-dt / smoothing_s)) (d - u)`: the
    /// published program's `u <- c d + (1 - c) u` with `c` from the time that really passed.
    ///
    /// Real time: no allocation, constant cost.
    pub(super) fn input(&mut self, now: TimeNs) -> ManualInput {
        let dt_s = self.asked_at.map_or(0.0, |before| now.since(before).seconds().max(0.0));
        self.asked_at = Some(now);
        let timers = self.settings.timers;
        let mut asked = Sticks::zeros();
        for panel in [&mut self.terminal, &mut self.device, &mut self.remote] {
            panel.expire(now, &timers);
            asked += panel.asked();
        }
        let largest = self.settings.deflection;
        let gain = -(-dt_s / self.settings.smoothing_s).exp_m1();
        let mut order = self.order.take();
        if self.steering.is_some() {
            let deflection = asked.map(|fraction| (fraction * largest).clamp(-largest, largest));
            self.u += (deflection - self.u) * gain;
        } else {
            self.u = Sticks::zeros();
        }
        if self.lost_at.is_some_and(|lost_at| now.since(lost_at) >= LOST_LANDS_AFTER) {
            order = order.max(Some(PersonOrder::Land));
        }
        ManualInput { order, sticks: self.steering.map(|_| self.u), has_expired: false }
    }

    /// Release in the person's place since the last call.
    pub(super) fn take_note(&mut self) -> Option<Note> {
        let panels = [&mut self.terminal, &mut self.device, &mut self.remote];
        // All are asked: a note that stays would be shown later.
        panels.map(Panel::take_note).into_iter().flatten().next()
    }

    fn release(&mut self) {
        for panel in [&mut self.terminal, &mut self.device, &mut self.remote] {
            panel.release();
        }
    }

    fn panel(&mut self, source: Source) -> &mut Panel {
        match source {
            Source::Terminal => &mut self.terminal,
            Source::Device => &mut self.device,
            Source::Remote => &mut self.remote,
        }
    }

    fn take(&mut self, source: Source) {
        if self.steering != Some(source) {
            for other in [Source::Terminal, Source::Device, Source::Remote] {
                if other != source {
                    self.panel(other).release();
                }
            }
        }
        self.steering = Some(source);
        self.lost_at = None;
    }
}

#[cfg(test)]
mod tests;
#[cfg(test)]
mod timer_tests;
