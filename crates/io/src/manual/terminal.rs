//! Keys of the terminal that the program runs in.
//!
//! Owns the mode of the terminal while a person may steer, and puts it back, and the thread that reads
//! it. What bytes mean is `manual::keys`.

use std::io::{self, IsTerminal, Write};
use std::os::fd::AsFd;

use nix::errno::Errno;
use nix::sys::termios::{
    FlushArg, InputFlags, LocalFlags, SetArg, SpecialCharacterIndices, Termios, tcflush, tcgetattr,
    tcsetattr,
};
use nix::unistd::{getpgrp, read, tcgetpgrp};

use super::keys::{Decoder, Typed};
use super::reader::{Outlet, Readiness, wait};
use super::{InputAction, Source};

/// Value of a control character that no byte triggers.
const DISABLED: u8 = 0;

/// Asks a terminal whether it speaks the kitty keyboard protocol; others skip it.
const ASK_FOR_RELEASES: &[u8] = b"\x1b[?u";

/// Unambiguous codes, event types, the key on a US keyboard and every key as a sequence: 1 + 2 + 4 + 8. And the focus:
/// a key that is held while another window takes the keyboard is released there.
const REPORT_RELEASES: &[u8] = b"\x1b[>15u\x1b[?1004h";

/// Back to what was before [`REPORT_RELEASES`].
const REPORT_AS_BEFORE: &[u8] = b"\x1b[?1004l\x1b[<u";

/// Whether the standard input is a terminal that this program may read and change: as a background
/// job it would be stopped for that.
pub fn is_ours() -> bool {
    let stdin = io::stdin();
    if !stdin.is_terminal() {
        return false;
    }
    match tcgetpgrp(stdin.as_fd()) {
        Ok(foreground) => foreground == getpgrp(),
        // Not the terminal of our session: a process that uses it is not stopped.
        Err(error) => error == Errno::ENOTTY,
    }
}

/// Throws away the keys that were typed before: they were not meant for a drone.
pub fn discard_typed() {
    if is_ours() {
        // A terminal that refuses has no keys.
        tcflush(io::stdin(), FlushArg::TCIFLUSH).ok();
    }
}

/// The terminal with single keys, no echo, and no key that stops or kills the program in flight.
/// Dropped, it is as it was.
#[derive(Debug)]
pub(super) struct Mode {
    before: Termios,
}

impl Mode {
    /// Changes the mode. Keys that were typed before and not read are the first ones.
    ///
    /// Ctrl-C stays a signal, which lands even if no thread reads keys, and lines end as ever for whatever
    /// else is printed. Ctrl-Z and Ctrl-\ would leave a flying drone alone, Ctrl-S would hold up
    /// code that prints: all three are off.
    ///
    /// # Errors
    /// The system refuses.
    pub(super) fn enter() -> Result<Self, Errno> {
        let stdin = io::stdin();
        let before = tcgetattr(&stdin)?;
        let mode = steering(&before);
        tcsetattr(&stdin, SetArg::TCSANOW, &mode)?;
        Ok(Self { before })
    }
}

/// The mode in which a person steers on a terminal whose mode is `before`.
fn steering(before: &Termios) -> Termios {
    let mut mode = before.clone();
    mode.local_flags.remove(LocalFlags::ICANON | LocalFlags::ECHO);
    mode.input_flags.remove(InputFlags::IXON);
    for (character, value) in [
        (SpecialCharacterIndices::VSUSP, DISABLED),
        (SpecialCharacterIndices::VQUIT, DISABLED),
        (SpecialCharacterIndices::VMIN, 1),
        (SpecialCharacterIndices::VTIME, 0),
    ] {
        if let Some(slot) = mode.control_chars.get_mut(character as usize) {
            *slot = value;
        }
    }
    mode
}

impl Drop for Mode {
    fn drop(&mut self) {
        let stdin = io::stdin();
        // Keys that still repeat are not for the shell. A terminal that is gone needs no mode.
        tcflush(&stdin, FlushArg::TCIFLUSH).ok();
        tcsetattr(&stdin, SetArg::TCSANOW, &self.before).ok();
    }
}

/// Reads keys until the outlet closes or the terminal is gone.
pub(super) fn read_keys(mut outlet: Outlet) {
    let stdin = io::stdin();
    let mut decoder = Decoder::default();
    let mut reports_releases = false;
    send(ASK_FOR_RELEASES);
    let mut bytes = [0; 64];
    while outlet.is_open() {
        let count = match wait(stdin.as_fd()) {
            Readiness::Nothing => continue,
            Readiness::Data => read(stdin.as_fd(), &mut bytes),
            Readiness::Gone => Ok(0),
        };
        match count {
            Ok(0) => break,
            Ok(count) => {
                for typed in bytes.iter().take(count).filter_map(|byte| decoder.feed(*byte)) {
                    match typed {
                        Typed::Action(action) => outlet.push(Source::Terminal, action),
                        Typed::CanRelease if !reports_releases => {
                            send(REPORT_RELEASES);
                            reports_releases = true;
                        }
                        Typed::CanRelease => {}
                    }
                }
            }
            Err(Errno::EINTR | Errno::EAGAIN) => {}
            Err(_) => break,
        }
    }
    outlet.push(Source::Terminal, InputAction::Lost);
    if reports_releases {
        send(REPORT_AS_BEFORE);
    }
}

/// Writes to the terminal, if it can be written to: by the standard error, or by the output where that is
/// held back.
fn send(bytes: &[u8]) {
    let (mut stderr, mut stdout) = (io::stderr(), io::stdout());
    if stderr.is_terminal() {
        stderr.write_all(bytes).ok();
    } else if stdout.is_terminal() {
        stdout.write_all(bytes).and_then(|()| stdout.flush()).ok();
    }
}

#[cfg(test)]
mod tests;
