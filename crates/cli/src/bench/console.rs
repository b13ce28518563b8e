//! The person at the bench: lines of the terminal, and the signals that ask to stop.
//!
//! Owns a thread that reads lines and one that counts signals, so that neither ever holds up the drone.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, TryRecvError, sync_channel};
use std::thread;

use anyhow::{Context, Result, bail};
use nix::sys::signal::Signal;

use super::connection::BenchConnection;
use crate::fly::signals;
use crate::stdio;

/// Who is asked, and who may stop a check.
#[derive(Debug)]
pub(super) struct Console {
    /// `None`: no question is asked.
    lines: Option<Receiver<String>>,
    asked: Arc<Asked>,
}

/// What signals asked for.
#[derive(Debug, Default)]
struct Asked {
    /// Whether any of them asked to stop.
    to_stop: AtomicBool,
    /// How often it was Ctrl-C, which during an ending stops the motors.
    by_keys: AtomicU32,
}

impl Asked {
    /// Only a person presses Ctrl-C: a terminal that closes sends its SIGHUP more than once, a system that shuts down
    /// its SIGTERM, and a drone in the air would fall.
    fn hear(&self, signal: Option<Signal>) {
        if signal == Some(Signal::SIGINT) {
            self.by_keys.fetch_add(1, Ordering::Relaxed);
        }
        // After the count: who sees the request sees the Ctrl-C that made it, too.
        self.to_stop.store(true, Ordering::Release);
    }
}

impl Console {
    /// Without `is_unattended` a person has to sit at a terminal.
    pub(super) fn open(is_unattended: bool) -> Result<Self> {
        if !is_unattended && !io::stdin().is_terminal() {
            bail!("the bench asks before every check: run it on a terminal, or give --yes");
        }
        signals::block()?;
        let asked = Arc::new(Asked::default());
        let heard = Arc::clone(&asked);
        signals::listen(move |signal| heard.hear(signal))?;
        let lines = if is_unattended { None } else { Some(read_lines()?) };
        Ok(Self { lines, asked })
    }

    /// How often Ctrl-C was pressed.
    pub(super) fn interrupts(&self) -> u32 {
        self.asked.by_keys.load(Ordering::Relaxed)
    }

    fn is_signalled(&self) -> bool {
        self.asked.to_stop.load(Ordering::Acquire)
    }

    /// Whether a signal, Enter or a closed terminal asks to stop.
    pub(super) fn asks_to_stop(&self) -> bool {
        let is_typed = |lines: &Receiver<String>| lines.try_recv() != Err(TryRecvError::Empty);
        self.is_signalled() || self.lines.as_ref().is_some_and(is_typed)
    }

    /// The answer to `question`, trimmed; `None` without a person to ask, or after a request to stop. The link is
    /// read meanwhile.
    pub(super) fn ask(&self, question: &str, link: &mut BenchConnection) -> Option<String> {
        let lines = self.lines.as_ref()?;
        stdio::note(question);
        loop {
            link.listen();
            match lines.try_recv() {
                Ok(line) => return Some(line.trim().into()),
                Err(TryRecvError::Empty) if !self.is_signalled() => {}
                Err(_) => return None,
            }
        }
    }

    /// Drops lines that were typed too early: they would stop the check.
    pub(super) fn forget_lines(&self) {
        while self.lines.as_ref().is_some_and(|lines| lines.try_recv().is_ok()) {}
    }

    /// Whether there is no person to ask.
    pub(super) fn is_unattended(&self) -> bool {
        self.lines.is_none()
    }
}

fn read_lines() -> Result<Receiver<String>> {
    let (to, lines) = sync_channel(16);
    let read = move || {
        for line in io::stdin().lines() {
            let Ok(line) = line else { return };
            if to.send(line).is_err() {
                return;
            }
        }
    };
    thread::Builder::new()
        .name("bench-lines".into())
        .spawn(read)
        .context("cannot read the terminal")?;
    Ok(lines)
}

#[cfg(test)]
mod tests;
