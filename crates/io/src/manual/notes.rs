//! Warns the person when a timer let go of a key or a stick in the person's place, or an order counts no more.
//!
//! Owns the way from the control thread to the terminal. The control thread leaves a number; a thread of its
//! own writes: a terminal that blocks must hold up neither the flight nor a reader of keys.

use std::io::{self, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};
use std::thread;
use std::time::Duration;

use super::panel::Note;

/// Time between two looks for a note.
const PERIOD: Duration = Duration::from_millis(100);

/// The newest note that was not shown yet; 0 for none. A newer one replaces an older.
#[derive(Debug, Clone, Default)]
pub(super) struct Notes(Arc<AtomicU8>);

impl Notes {
    /// Leaves a note. Real time: never waits.
    pub(super) fn leave(&self, note: Note) {
        self.0.store(note as u8, Ordering::Relaxed);
    }

    fn take(&self) -> Option<&'static str> {
        let left = self.0.swap(0, Ordering::Relaxed);
        let mut notes = [Note::KeyExpired, Note::AxisExpired, Note::TakeOffLapsed].into_iter();
        notes.find(|note| *note as u8 == left).map(Note::text)
    }
}

impl Note {
    fn text(self) -> &'static str {
        match self {
            Self::KeyExpired => {
                "a key was held for too long, or its repetitions stopped: it counts as released; \
                 press it again"
            }
            Self::AxisExpired => {
                "the gamepad is silent with a stick pushed: the stick counts as centred; centre it, \
                 then push it again"
            }
            Self::TakeOffLapsed => {
                "the take-off could not begin in time, or the drone was moved: the order counts no more; \
                 order it again"
            }
        }
    }
}

/// Starts the thread that writes notes to the standard error until `ends` is set. It is not joined: the terminal may
/// block it for ever.
///
/// # Errors
/// The system gives no thread.
pub(super) fn show(notes: Notes, ends: Arc<AtomicBool>) -> io::Result<()> {
    let write = move || {
        while !ends.load(Ordering::Relaxed) {
            if let Some(text) = notes.take() {
                // No terminal, no reader.
                writeln!(io::stderr(), "\nwarning: {text}").ok();
            }
            thread::sleep(PERIOD);
        }
    };
    thread::Builder::new().name("tello-notes".into()).spawn(write).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_note_is_shown_once() {
        let notes = Notes::default();
        assert_eq!(notes.take(), None);
        notes.leave(Note::KeyExpired);
        notes.clone().leave(Note::AxisExpired);
        assert!(notes.take().is_some_and(|text| text.contains("gamepad")));
        assert_eq!(notes.take(), None);
    }
}
