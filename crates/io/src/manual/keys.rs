//! Which key does what, and the bytes that a terminal sends for it.
//!
//! Owns the layout of the keys and a decoder of terminal input, plain or of the kitty keyboard
//! protocol. It refuses to know a file or a clock, and never fails: bytes that mean nothing are
//! skipped.
#![deny(clippy::indexing_slicing)]

use super::{Direction, InputAction, PersonOrder};

/// The keys in one line, for the terminal.
pub const KEYS_HELP: &str = "keys: T take off, R or Q land, Backspace EMERGENCY STOP, E by hand, \
C automatic; W/S forward, back, A/D left, right, I/K up, down, J/L turn";

/// Byte of Backspace. The key is found without looking, and begins no longer sequence as Escape does.
const BACKSPACE: u32 = 0x7f;

/// Byte of Backspace on some terminals: Ctrl-H.
const BACKSPACE_OLD: u32 = 0x08;

/// Byte of Ctrl-C where the terminal does not turn it into a signal.
const INTERRUPT: u32 = 0x03;

const ESCAPE: u8 = 0x1b;

/// After an escape: one character follows, such as `Q` for F2.
const SINGLE_SHIFT: u8 = b'O';

/// Ends the sequence that reports that another window has the keyboard now.
const FOCUS_OUT: u8 = b'O';

/// How a key moved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum KeyMotion {
    /// Pressed or repeated by a terminal that does not report releases.
    Pulse,
    /// Pressed; its release will be reported.
    Press,
    /// Held and repeated.
    Repeat,
    /// Released.
    Release,
}

/// Action of moving the key of the ASCII character `code`; `None` for a key without a meaning.
pub(super) fn action_of(code: u32, is_ctrl: bool, motion: KeyMotion) -> Option<InputAction> {
    let key = char::from_u32(code)?.to_ascii_lowercase();
    if let Some(direction) = direction(key) {
        return match motion {
            // A release counts whatever else is held: a stick must not stay.
            KeyMotion::Release => Some(InputAction::Release(direction)),
            _ if is_ctrl => None,
            KeyMotion::Pulse => Some(InputAction::Pulse(direction)),
            KeyMotion::Press => Some(InputAction::Press(direction)),
            KeyMotion::Repeat => Some(InputAction::Repeat(direction)),
        };
    }
    if motion == KeyMotion::Release {
        return None;
    }
    match (code, key) {
        (BACKSPACE | BACKSPACE_OLD, _) => Some(InputAction::Order(PersonOrder::EmergencyStop)),
        (INTERRUPT, _) => Some(InputAction::Order(PersonOrder::Land)),
        (_, 'c') if is_ctrl => Some(InputAction::Order(PersonOrder::Land)),
        _ if is_ctrl => None,
        (_, 't') => Some(InputAction::Order(PersonOrder::TakeOff)),
        (_, 'r' | 'q') => Some(InputAction::Order(PersonOrder::Land)),
        (_, 'e') => Some(InputAction::Manual),
        (_, 'c') => Some(InputAction::Automatic),
        _ => None,
    }
}

fn direction(key: char) -> Option<Direction> {
    Some(match key {
        'd' => Direction::Right,
        'a' => Direction::Left,
        'w' => Direction::Forward,
        's' => Direction::Backward,
        'j' => Direction::TurnLeft,
        'l' => Direction::TurnRight,
        'i' => Direction::Up,
        'k' => Direction::Down,
        _ => return None,
    })
}

/// Input that a byte of the terminal completes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Typed {
    /// A key with a meaning moved.
    Action(InputAction),
    /// The terminal speaks the kitty keyboard protocol and can report releases.
    CanRelease,
}

/// Terminal input, byte by byte: constant memory, no byte is refused.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    state: State,
}

#[derive(Debug, Clone, Copy, Default)]
enum State {
    #[default]
    Ground,
    /// After an escape.
    Escaped,
    /// In a control sequence.
    Sequence(Sequence),
    /// Before the character that ends the sequence of a function key, whose modifiers may stand before it.
    FunctionKey,
}

/// The numbers of a control sequence that a key needs: `code : shifted : base ; modifiers : motion u`.
#[derive(Debug, Clone, Copy, Default)]
struct Sequence {
    /// Whether nothing stood in it yet.
    is_empty: bool,
    /// Whether it began with a question mark: an answer and no key.
    is_answer: bool,
    /// Fields before this one, and numbers before this one in it.
    field: u8,
    part: u8,
    code: u32,
    /// The character of the key on a US keyboard, if that is another one.
    base: u32,
    modifiers: u32,
    motion: u32,
}

impl Decoder {
    /// Input that `byte` completes, if any.
    ///
    /// Backspace and Ctrl-C are understood at any place, in a broken sequence as well: they stop the motors and land
    /// the drone.
    pub fn feed(&mut self, byte: u8) -> Option<Typed> {
        let plain = || action_of(u32::from(byte), false, KeyMotion::Pulse).map(Typed::Action);
        let is_stop = matches!(u32::from(byte), BACKSPACE | BACKSPACE_OLD | INTERRUPT);
        let state = std::mem::take(&mut self.state);
        match state {
            _ if is_stop => plain(),
            _ if byte == ESCAPE => {
                self.state = State::Escaped;
                None
            }
            State::Escaped if byte == b'[' => {
                self.state = State::Sequence(Sequence { is_empty: true, ..Sequence::default() });
                None
            }
            State::Escaped if byte == SINGLE_SHIFT => {
                self.state = State::FunctionKey;
                None
            }
            State::FunctionKey => {
                if (0x20..=0x3f).contains(&byte) {
                    self.state = State::FunctionKey;
                }
                None
            }
            State::Ground | State::Escaped => plain(),
            // F1 to F5 of the Linux console.
            State::Sequence(sequence) if sequence.is_empty && byte == b'[' => {
                self.state = State::FunctionKey;
                None
            }
            State::Sequence(mut sequence) => {
                if (0x40..=0x7e).contains(&byte) {
                    return match byte {
                        b'u' => sequence.key(),
                        FOCUS_OUT if sequence.is_empty => Some(Typed::Action(InputAction::LetGo)),
                        _ => None,
                    };
                }
                // What cannot stand in a sequence ends it.
                if (0x20..=0x3f).contains(&byte) {
                    sequence.take(byte);
                    self.state = State::Sequence(sequence);
                }
                None
            }
        }
    }
}

impl Sequence {
    fn take(&mut self, byte: u8) {
        self.is_empty = false;
        match byte {
            b'?' => self.is_answer = true,
            b';' => (self.field, self.part) = (self.field.saturating_add(1), 0),
            b':' => self.part = self.part.saturating_add(1),
            b'0'..=b'9' => {
                let number = match (self.field, self.part) {
                    (0, 0) => &mut self.code,
                    (0, 2) => &mut self.base,
                    (1, 0) => &mut self.modifiers,
                    (1, 1) => &mut self.motion,
                    _ => return,
                };
                *number = number.saturating_mul(10).saturating_add(u32::from(byte - b'0'));
            }
            _ => {}
        }
    }

    /// The key of a finished `CSI ... u`.
    fn key(self) -> Option<Typed> {
        if self.is_answer {
            return Some(Typed::CanRelease);
        }
        let motion = match self.motion {
            0 | 1 => KeyMotion::Press,
            2 => KeyMotion::Repeat,
            3 => KeyMotion::Release,
            _ => return None,
        };
        // One more than the sum of shift 1, alt 2, ctrl 4 and others.
        let is_ctrl = self.modifiers.saturating_sub(1) & 4 != 0;
        // A Cyrillic or Greek letter has no meaning, and its key does; a Latin one is what is printed on the key.
        let is_latin = self.code < 0x80 || self.base == 0;
        action_of(if is_latin { self.code } else { self.base }, is_ctrl, motion).map(Typed::Action)
    }
}

#[cfg(test)]
mod tests;
