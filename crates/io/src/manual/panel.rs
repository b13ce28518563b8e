//! Keys and axes of one source, each with a dead man's timer.
//!
//! Owns how long a key or an axis acts without news of it, and what has to be pushed anew before it acts
//! again. A held key is reported again and again, by its repetitions; a stick in a hand is never
//! still. What stays silent counts as let go: a release may be lost, a radio out of range, a person gone.

use horizon_model::rows::{Sticks, stick};

use super::Direction;
use crate::clock::{SpanNs, TimeNs};

/// How long something acts without news of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Timers {
    /// A key that cannot report its release, after each press or repetition.
    pub(super) pulse: SpanNs,
    /// A key that can, after its press and each repetition.
    pub(super) hold: SpanNs,
    /// Any key, after its press, whatever is repeated: repetitions are made by a computer, and not by the
    /// finger on the key.
    pub(super) press_max: SpanNs,
    /// A pushed axis, after the last event of its device.
    pub(super) axis_silent: SpanNs,
}

/// Notes to the person.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Note {
    /// A key was let go in the person's place.
    KeyExpired = 1,
    /// A stick of a silent device was centred in the person's place.
    AxisExpired = 2,
    /// An order to take off that was not executed in time, or of a drone that was moved, counts no more.
    TakeOffLapsed = 3,
}

/// A steering key.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum Key {
    /// Let go.
    #[default]
    Up,
    /// Pushes its stick.
    Down(Push),
    /// May still be held, and does nothing until it is pressed anew.
    NeedsRelease {
        /// Its last press or repetition.
        heard: TimeNs,
    },
}

/// A key that acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Push {
    /// When it was pressed.
    since: TimeNs,
    /// Its last press or repetition.
    heard: TimeNs,
    /// When it ends without another.
    until: TimeNs,
    /// Whether its release will be reported.
    has_release: bool,
}

impl Push {
    fn new(at: TimeNs, has_release: bool, timers: &Timers) -> Self {
        Self { since: at, heard: at, until: at, has_release }.renewed(at, has_release, timers)
    }

    /// The same after a repetition at `at`. Never shorter than before, and never longer than any key acts.
    fn renewed(self, at: TimeNs, has_release: bool, timers: &Timers) -> Self {
        let span = if has_release { timers.hold } else { timers.pulse };
        let until = self.until.max(at.after(span)).min(self.since.after(timers.press_max));
        Self { heard: at, until, has_release: self.has_release || has_release, ..self }
    }
}

/// An axis of a gamepad.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Axis {
    /// Its place, -1..=1, the dead zone removed.
    place: f64,
    /// Whether it does nothing until it is centred.
    needs_release: bool,
}

impl Axis {
    fn acts(self) -> bool {
        !self.needs_release && self.place.abs() > 0.0
    }
}

/// Keys and axes of one source.
#[derive(Debug, Clone, Default)]
pub(super) struct Panel {
    keys: [Key; Direction::ALL.len()],
    axes: [Axis; stick::COUNT],
    /// Time of the last event of the device.
    heard: Option<TimeNs>,
    note: Option<Note>,
}

impl Panel {
    /// Lets go of whatever has been silent for too long at `at`.
    pub(super) fn expire(&mut self, at: TimeNs, timers: &Timers) {
        for key in &mut self.keys {
            let Key::Down(push) = *key else { continue };
            if at < push.until {
                continue;
            }
            let is_longest = push.until >= push.since.after(timers.press_max);
            *key = if push.has_release || is_longest {
                self.note = Some(Note::KeyExpired);
                Key::NeedsRelease { heard: push.heard }
            } else {
                Key::Up
            };
        }
        let is_silent = |heard: TimeNs| at.since(heard) >= timers.axis_silent;
        if self.heard.is_some_and(is_silent) {
            for axis in self.axes.iter_mut().filter(|axis| axis.acts()) {
                axis.needs_release = true;
                self.note = Some(Note::AxisExpired);
            }
        }
    }

    /// Release since the last call.
    pub(super) fn take_note(&mut self) -> Option<Note> {
        self.note.take()
    }

    /// Deflection that is asked for, as fractions of the largest.
    pub(super) fn asked(&self) -> Sticks {
        let mut asked = Sticks::zeros();
        for (row, axis) in self.axes.iter().enumerate().filter(|(_, axis)| axis.acts()) {
            asked[row] = axis.place;
        }
        for (direction, key) in Direction::ALL.iter().zip(&self.keys) {
            if matches!(key, Key::Down(_)) {
                let (row, sign) = direction.push();
                asked[row] += sign;
            }
        }
        asked
    }

    /// The device sent something.
    pub(super) fn receive(&mut self, at: TimeNs) {
        self.heard = Some(at);
    }

    /// A key was pressed; `has_release`: its release will be reported. Whether it acts.
    ///
    /// Some terminals report repetitions as presses: a press within a pulse of the one before continues it.
    pub(super) fn press(
        &mut self,
        direction: Direction,
        at: TimeNs,
        has_release: bool,
        timers: &Timers,
    ) -> bool {
        let Some(key) = self.key(direction) else { return false };
        *key = match *key {
            Key::Down(push) => Key::Down(push.renewed(at, has_release, timers)),
            Key::NeedsRelease { heard } if at.since(heard) <= timers.pulse => {
                Key::NeedsRelease { heard: at }
            }
            Key::Up | Key::NeedsRelease { .. } => Key::Down(Push::new(at, has_release, timers)),
        };
        matches!(key, Key::Down(_))
    }

    /// A key is still held.
    pub(super) fn repeat(&mut self, direction: Direction, at: TimeNs, timers: &Timers) {
        match self.key(direction) {
            Some(Key::Down(push)) => *push = push.renewed(at, true, timers),
            Some(Key::NeedsRelease { heard }) => *heard = at,
            _ => {}
        }
    }

    /// A repetition of any key: whatever acts and can be released is renewed. A keyboard repeats the last key alone.
    pub(super) fn repeat_all(&mut self, at: TimeNs, timers: &Timers) {
        for key in &mut self.keys {
            if let Key::Down(push) = key
                && push.has_release
            {
                *push = push.renewed(at, true, timers);
            }
        }
    }

    /// A key was let go.
    pub(super) fn lift(&mut self, direction: Direction) {
        if let Some(key) = self.key(direction) {
            *key = Key::Up;
        }
    }

    /// An axis stands at `place`. Whether it acts.
    pub(super) fn move_axis(&mut self, row: usize, place: f64) -> bool {
        let Some(axis) = self.axes.get_mut(row) else { return false };
        axis.place = place;
        // False at the centre, and for a NaN: both let the axis act anew.
        axis.needs_release &= place.abs() > 0.0;
        axis.acts()
    }

    /// Nothing acts until it is pushed anew.
    pub(super) fn release(&mut self) {
        for key in &mut self.keys {
            if let Key::Down(push) = *key {
                *key = Key::NeedsRelease { heard: push.heard };
            }
        }
        for axis in &mut self.axes {
            axis.needs_release |= axis.acts();
        }
    }

    fn key(&mut self, direction: Direction) -> Option<&mut Key> {
        let known = Direction::ALL.iter().zip(&mut self.keys);
        known.into_iter().find_map(|(known, key)| (*known == direction).then_some(key))
    }
}

#[cfg(test)]
mod tests;
