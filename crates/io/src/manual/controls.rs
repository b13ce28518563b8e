//! What a person's keys and sticks mean: a function of the events and of time.
//!
//! Owns who steers, which keys are down, the smoothing of the sticks and what happens when a device
//! is lost. It refuses to know where an event comes from beyond its [`Source`]; devices and bytes are
//! `manual::device` and `manual::terminal`.

use tello_model::rows::{Sticks, stick};

use super::{Ask, Hand, ManualSettings};
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
    /// What was done.
    pub act: Act,
}

/// What a person can do.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Act {
    /// An order to the drone.
    Ask(Ask),
    /// Take the sticks.
    Manual,
    /// Give the sticks back to the controller.
    Automatic,
    /// A key is down until it is released.
    Press(Direction),
    /// A key that will not report its release was pressed or repeated.
    Pulse(Direction),
    /// A key is up.
    Release(Direction),
    /// A stick of a gamepad stands here, its dead zone removed: row of [`stick`] and -1..=1.
    Axis(usize, f64),
    /// The source is gone: unplugged or closed.
    Lost,
}

/// Where a steering key pushes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
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
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Right,
        Self::Left,
        Self::Forward,
        Self::Backward,
        Self::TurnLeft,
        Self::TurnRight,
        Self::Up,
        Self::Down,
    ];

    /// The row of [`stick`] and the sign of the push.
    fn push(self) -> (usize, f64) {
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

/// A steering key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Key {
    #[default]
    Up,
    /// Down until it is released.
    Down,
    /// Down until then, unless it is repeated: a dead man's switch.
    DownUntil(TimeNs),
}

/// Keys and axes of one source.
#[derive(Debug, Clone, Default)]
struct Panel {
    keys: [Key; Direction::ALL.len()],
    axes: Sticks,
}

impl Panel {
    /// Deflection asked for at `now`, as shares of the largest.
    fn asked(&self, now: TimeNs) -> Sticks {
        let mut asked = self.axes;
        for (direction, key) in Direction::ALL.iter().zip(&self.keys) {
            let is_down = match key {
                Key::Up => false,
                Key::Down => true,
                Key::DownUntil(end) => now < *end,
            };
            if is_down {
                let (row, sign) = direction.push();
                asked[row] += sign;
            }
        }
        asked
    }

    fn set(&mut self, direction: Direction, key: Key) {
        for (known, slot) in Direction::ALL.iter().zip(&mut self.keys) {
            // A repetition does not shorten what only a release ends.
            let keeps = *slot == Key::Down && matches!(key, Key::DownUntil(_));
            if *known == direction && !keeps {
                *slot = key;
            }
        }
    }
}

/// The person at the controls, as far as the program knows.
#[derive(Debug, Clone)]
pub struct Controls {
    settings: ManualSettings,
    terminal: Panel,
    device: Panel,
    remote: Panel,
    /// What the person used last while steering; `None`: the controller steers.
    steering: Option<Source>,
    /// When the source that steered was lost.
    lost_at: Option<TimeNs>,
    /// Strongest order since the last [`Controls::hand`].
    ask: Option<Ask>,
    /// The smoothed sticks.
    u: Sticks,
    asked_at: Option<TimeNs>,
}

impl Controls {
    /// Nobody touches anything yet: the controller steers.
    pub fn new(settings: ManualSettings) -> Self {
        Self {
            settings,
            terminal: Panel::default(),
            device: Panel::default(),
            remote: Panel::default(),
            steering: None,
            lost_at: None,
            ask: None,
            u: Sticks::zeros(),
            asked_at: None,
        }
    }

    /// Takes note of `event`.
    pub fn hear(&mut self, event: &Event) {
        let Event { at, source, act } = *event;
        let pulse_end = at.after(self.settings.pulse);
        match act {
            Act::Ask(ask) => self.ask = self.ask.max(Some(ask)),
            Act::Manual => self.take(source),
            Act::Automatic => {
                self.steering = None;
                self.lost_at = None;
            }
            Act::Press(direction) => self.steer(source, direction, Key::Down),
            Act::Pulse(direction) => self.steer(source, direction, Key::DownUntil(pulse_end)),
            Act::Release(direction) => self.panel(source).set(direction, Key::Up),
            Act::Axis(row, value) => {
                if let Some(axis) = self.panel(source).axes.get_mut(row) {
                    *axis = value;
                }
                if value.abs() > 0.0 {
                    self.take(source);
                }
            }
            Act::Lost => {
                *self.panel(source) = Panel::default();
                if self.steering == Some(source) {
                    self.lost_at = Some(at);
                }
            }
        }
    }

    /// What the person wants at `now`; called once per tick.
    ///
    /// The sticks follow the asked deflection `d` as `u <- u + (1 - exp(-dt / tau)) (d - u)`: the
    /// published program's `u <- c d + (1 - c) u` with `c` from the time that really passed.
    ///
    /// Real time: no allocation, constant cost.
    pub fn hand(&mut self, now: TimeNs) -> Hand {
        let dt_s = self.asked_at.map_or(0.0, |before| now.since(before).seconds().max(0.0));
        self.asked_at = Some(now);
        let panels = [&self.terminal, &self.device, &self.remote];
        let asked = panels.map(|panel| panel.asked(now)).into_iter().sum::<Sticks>();
        let largest = self.settings.deflection;
        let gain = -(-dt_s / self.settings.smoothing_s).exp_m1();
        let mut ask = self.ask.take();
        if self.steering.is_some() {
            let deflection = asked.map(|share| (share * largest).clamp(-largest, largest));
            self.u += (deflection - self.u) * gain;
        } else {
            self.u = Sticks::zeros();
        }
        if self.lost_at.is_some_and(|lost_at| now.since(lost_at) >= LOST_LANDS_AFTER) {
            ask = ask.max(Some(Ask::Land));
        }
        Hand { ask, sticks: self.steering.map(|_| self.u) }
    }

    fn panel(&mut self, source: Source) -> &mut Panel {
        match source {
            Source::Terminal => &mut self.terminal,
            Source::Device => &mut self.device,
            Source::Remote => &mut self.remote,
        }
    }

    fn take(&mut self, source: Source) {
        self.steering = Some(source);
        self.lost_at = None;
    }

    fn steer(&mut self, source: Source, direction: Direction, key: Key) {
        self.panel(source).set(direction, key);
        self.take(source);
    }
}

#[cfg(test)]
mod tests;
