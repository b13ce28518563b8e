//! Output of the program on the console.
//!
//! Owns the standard output and the standard error. Neither needs a reader: one that is gone, as
//! `head` once it has its lines, ends no work, least of all a flight, and changes no exit code.

use std::fmt::Display;
use std::io::{self, ErrorKind, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::panic;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use anyhow::{Context, Result};
use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use serde::Serialize;

/// Bytes that a pipe with room takes without a wait: `PIPE_BUF` of Linux. bytes
const PIECE: usize = 4096;

/// Longest wait of a flight until a piece of its summary is read.
const SUMMARY_PIECE_TIMEOUT: Duration = Duration::from_secs(1);

/// Whether this program has more important things to do than to wait for a reader.
static NEVER_WAITS: AtomicBool = AtomicBool::new(false);

/// From here on messages and panics that the standard error does not take at once are not printed, and the
/// report waits a second for its reader: a pipe without a reader, and a terminal that hangs, hold up nothing.
pub(crate) fn never_wait() {
    NEVER_WAITS.store(true, Ordering::Relaxed);
    let print = panic::take_hook();
    panic::set_hook(Box::new(move |panic| {
        if is_taken(io::stderr().as_fd(), PollTimeout::ZERO) {
            print(panic);
        }
    }));
}

/// Result of a command on the standard output: one JSON object, or a text for people.
///
/// # Errors
/// As [`line()`].
pub(crate) fn report(report: &(impl Display + Serialize), is_json: bool) -> Result<()> {
    if is_json { line(serde_json::to_string(report)?) } else { write(report) }
}

/// A line on the standard output.
///
/// # Errors
/// It cannot be written, e.g. to a disk that is full.
pub(crate) fn line(text: impl Display) -> Result<()> {
    write(format_args!("{text}\n"))
}

/// An error with its causes; a cause that the text already ends in is not repeated.
pub(crate) fn chain(error: &anyhow::Error) -> String {
    error.chain().skip(1).fold(error.to_string(), |text, cause| {
        let cause = cause.to_string();
        if text.ends_with(&cause) { text } else { format!("{text}: {cause}") }
    })
}

/// A line beside what was asked for, on the standard error.
pub(crate) fn note(text: impl Display) {
    note_raw(format_args!("{}\n", printable(&text.to_string())));
}

/// `text` without what a terminal would obey: names of files may hold anything.
fn printable(text: &str) -> String {
    let is_obeyed = |c: char| c.is_control() && !matches!(c, '\n' | '\r' | '\t');
    text.replace(is_obeyed, "\u{fffd}")
}

/// As [`note`], without an end of the line.
pub(crate) fn note_raw(text: impl Display) {
    if NEVER_WAITS.load(Ordering::Relaxed) {
        put(io::stderr().as_fd(), text.to_string().as_bytes(), PollTimeout::ZERO).ok();
    } else {
        write!(io::stderr(), "{text}").ok();
    }
}

fn write(text: impl Display) -> Result<()> {
    let text = printable(&text.to_string());
    let mut out = io::stdout().lock();
    let written = if NEVER_WAITS.load(Ordering::Relaxed) {
        let timeout = PollTimeout::try_from(SUMMARY_PIECE_TIMEOUT).unwrap_or(PollTimeout::ZERO);
        put(out.as_fd(), text.as_bytes(), timeout)
    } else {
        write!(out, "{text}").and_then(|()| out.flush())
    };
    match written {
        Err(error) if error.kind() == ErrorKind::BrokenPipe => Ok(()),
        result => result.context("cannot write to the standard output"),
    }
}

/// Writes piece by piece what is taken, each within `timeout`.
///
/// # Errors
/// A piece was not taken in time; as `write`.
fn put(file: BorrowedFd<'_>, text: &[u8], timeout: PollTimeout) -> io::Result<()> {
    let mut left = text;
    while !left.is_empty() {
        if !is_taken(file, timeout) {
            return Err(io::Error::new(ErrorKind::TimedOut, "nobody reads it"));
        }
        let piece = left.get(..PIECE).unwrap_or(left);
        match nix::unistd::write(file, piece) {
            Ok(count) => left = left.get(count..).unwrap_or_default(),
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            Err(error) => return Err(error.into()),
        }
    }
    Ok(())
}

/// Whether a piece is taken without waiting, or refused with an error, before `timeout` is over.
fn is_taken(file: BorrowedFd<'_>, timeout: PollTimeout) -> bool {
    let mut files = [PollFd::new(file, PollFlags::POLLOUT)];
    poll(&mut files, timeout).is_ok_and(|ready| ready > 0)
}

#[cfg(test)]
mod tests {
    use std::io::Read;

    use super::*;

    fn is_readable(reader: &io::PipeReader) -> bool {
        let mut files = [PollFd::new(reader.as_fd(), PollFlags::POLLIN)];
        poll(&mut files, PollTimeout::ZERO).is_ok_and(|ready| ready > 0)
    }

    #[test]
    fn what_a_terminal_would_obey_is_replaced() {
        assert_eq!(printable("a\x1b[31mb\tc\u{9b}\n"), "a\u{fffd}[31mb\tc\u{fffd}\n");
    }

    #[test]
    fn a_cause_is_named_once() {
        let denied = || io::Error::from(ErrorKind::PermissionDenied);
        let text = |first: String| chain(&anyhow::Error::new(denied()).context(first));
        assert_eq!(text("cannot open a".into()), "cannot open a: permission denied");
        assert_eq!(
            text(format!("cannot open a: {}", denied())),
            "cannot open a: permission denied"
        );
    }

    #[test]
    fn a_pipe_takes_what_it_has_room_for_and_holds_up_nobody() {
        let (mut reader, writer) = io::pipe().unwrap();
        let line = [b'x'; 10_000];
        // The capacity of a pipe depends on the system.
        let taken = (0..1000).take_while(|_| put(writer.as_fd(), &line, PollTimeout::ZERO).is_ok());
        let taken = taken.count();
        assert!(taken < 1000, "a pipe without an end");
        let full = put(writer.as_fd(), &line, PollTimeout::ZERO);
        assert_eq!(full.unwrap_err().kind(), ErrorKind::TimedOut);
        assert!(!is_taken(writer.as_fd(), PollTimeout::from(50_u8)));
        let mut buffer = vec![0; 1 << 20];
        while is_readable(&reader) {
            assert!(reader.read(&mut buffer).unwrap() > 0);
        }
        put(writer.as_fd(), &line, PollTimeout::ZERO).unwrap();
        drop(reader);
        let gone = put(writer.as_fd(), &line, PollTimeout::ZERO);
        assert_eq!(gone.unwrap_err().kind(), ErrorKind::BrokenPipe);
    }
}
