//! Messages to the standard error while a picture has the terminal.
//!
//! Owns the standard error from [`Messages::hold`] on: it goes into a queue of the last lines, from there to
//! the code that draws them, and at the end to where it belonged. Does not draw.

use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, PipeReader, Read, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;
use std::thread::{self, JoinHandle};

use nix::unistd::dup2_stderr;
use parking_lot::Mutex;

/// Most lines that are kept, and most bytes of one.
const LINES_MAX: usize = 200;
const LINE_BYTES_MAX: u64 = 1000;

/// The messages held back. When dropped, messages go to standard error again, the kept lines first.
#[derive(Debug)]
pub struct Messages {
    newest: Newest,
    before: OwnedFd,
    reader: Option<JoinHandle<()>>,
}

/// A view of the newest messages.
#[derive(Debug, Clone, Default)]
pub struct Newest(Arc<Mutex<Kept>>);

#[derive(Debug, Default)]
struct Kept {
    lines: VecDeque<String>,
    /// Lines that gave way to newer ones.
    lost: u64,
}

impl Messages {
    /// Holds back what the whole program writes from now on.
    ///
    /// # Errors
    /// The system has no pipe, handle or thread left.
    pub fn hold() -> io::Result<Self> {
        let before = io::stderr().as_fd().try_clone_to_owned()?;
        let (read, write) = io::pipe()?;
        let newest = Newest::default();
        let into = newest.clone();
        let reader = thread::Builder::new()
            .name("tello-messages".into())
            .spawn(move || into.take_all(read))?;
        dup2_stderr(write)?;
        Ok(Self { newest, before, reader: Some(reader) })
    }

    /// A view of the newest lines, for another thread to draw.
    pub fn newest(&self) -> Newest {
        self.newest.clone()
    }
}

impl Drop for Messages {
    fn drop(&mut self) {
        // The reader ends when no process has the writing end of the pipe any more.
        if dup2_stderr(&self.before).is_ok()
            && let Some(reader) = self.reader.take()
        {
            // What it kept is there even if it panicked.
            reader.join().ok();
        }
        let kept = self.newest.0.lock();
        let mut stderr = io::stderr().lock();
        // A failed write is ignored: there is no other place for these lines.
        if kept.lost > 0 {
            writeln!(stderr, "({} earlier messages are lost)", kept.lost).ok();
        }
        for line in &kept.lines {
            writeln!(stderr, "{line}").ok();
        }
    }
}

impl Newest {
    /// The newest `count` lines, the oldest first, without what steers a terminal.
    pub fn lines(&self, count: usize) -> Vec<String> {
        let kept = self.0.lock();
        kept.lines.iter().skip(kept.lines.len().saturating_sub(count)).cloned().collect()
    }

    fn take_all(&self, read: PipeReader) {
        let mut read = BufReader::new(read);
        let mut bytes = Vec::new();
        // An error of the pipe ends the reading like its end.
        while let Ok(1..) = (&mut read).take(LINE_BYTES_MAX).read_until(b'\n', &mut bytes) {
            let text = String::from_utf8_lossy(&bytes);
            let line = text.chars().filter(|character| !character.is_control()).collect();
            bytes.clear();
            let mut kept = self.0.lock();
            if kept.lines.len() == LINES_MAX {
                kept.lines.pop_front();
                kept.lost += 1;
            }
            kept.lines.push_back(line);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(written: &[u8]) -> Newest {
        let (read, mut write) = io::pipe().unwrap();
        let newest = Newest::default();
        let into = newest.clone();
        let reader = thread::spawn(move || into.take_all(read));
        write.write_all(written).unwrap();
        drop(write);
        reader.join().unwrap();
        newest
    }

    #[test]
    fn the_newest_lines_are_kept_without_what_steers_a_terminal() {
        let newest = kept(b"one\n\x1b[2Ktwo\r\n\xffthree");
        assert_eq!(newest.lines(9), ["one", "[2Ktwo", "\u{fffd}three"]);
        assert_eq!(newest.lines(1), ["\u{fffd}three"]);
        assert!(newest.lines(0).is_empty());
    }

    #[test]
    fn memory_is_bounded_whatever_is_written() {
        let mut written = b"line\n".repeat(LINES_MAX + 7);
        written.extend(b"x".repeat(3000));
        let newest = kept(&written);
        let kept = newest.0.lock();
        assert_eq!((kept.lines.len(), kept.lost), (LINES_MAX, 10));
        assert_eq!(kept.lines.back().map(String::len), Some(1000));
    }
}
