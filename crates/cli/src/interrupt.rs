//! Ctrl-C, SIGTERM or a closed terminal during long work: a flag that the work polls, so that what is done is kept.
//! Ctrl-C or SIGTERM again: the end.

use std::fs;
use std::io;
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context as _, Result};
use tello_io::atomic_file;
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};

use crate::stdio;

/// Whether the user asked to stop. All clones give the same answer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens for Ctrl-C, SIGTERM and SIGHUP until the program ends.
    pub(crate) fn listen() -> Result<Self> {
        let interrupt = Self::default();
        let asked = Arc::clone(&interrupt.0);
        let mut next = signals()?;
        let wait = move || {
            if next().is_some() {
                stdio::note("stopping");
                asked.store(true, Ordering::Relaxed);
            }
            // A terminal that closes may send its signal twice.
            let is_again = |signal: &i32| *signal != SignalKind::hangup().as_raw_value();
            if let Some(signal) = std::iter::from_fn(&mut next).find(is_again) {
                leave(signal);
            }
        };
        spawn(wait)?;
        Ok(interrupt)
    }

    /// Whether it was asked for.
    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// From now on Ctrl-C, SIGTERM and SIGHUP remove the files that are not finished, and end the program.
///
/// # Errors
/// The system refuses.
pub(crate) fn leave_no_unfinished_file() -> Result<()> {
    let mut next = signals()?;
    spawn(move || {
        if let Some(signal) = next() {
            leave(signal);
        }
    })
}

/// What waits for the next SIGINT, SIGTERM or SIGHUP, none of which ends the program by itself any more.
fn signals() -> Result<impl FnMut() -> Option<i32> + Send> {
    let why = "cannot listen for Ctrl-C and SIGTERM";
    let runtime = runtime().context(why)?;
    let listen = |kind: SignalKind| {
        let _entered = runtime.enter();
        signal(kind).context(why)
    };
    let (mut pressed, mut ended) =
        (listen(SignalKind::interrupt())?, listen(SignalKind::terminate())?);
    // As `nohup` wants it, a signal that is ignored stays so.
    let mut closed = if is_hangup_ignored() { None } else { Some(listen(SignalKind::hangup())?) };
    Ok(move || {
        runtime.block_on(async {
            let closed = async {
                match &mut closed {
                    Some(closed) => closed.recv().await,
                    None => std::future::pending().await,
                }
            };
            tokio::select! {
                asked = pressed.recv() => asked.map(|()| SignalKind::interrupt().as_raw_value()),
                asked = ended.recv() => asked.map(|()| SignalKind::terminate().as_raw_value()),
                asked = closed => asked.map(|()| SignalKind::hangup().as_raw_value()),
            }
        })
    })
}

/// Whether this process was started to outlive its terminal.
pub(crate) fn is_hangup_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = ignored.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok());
    ignored.is_some_and(|mask| mask & 1 == 1)
}

/// A runtime for this thread.
///
/// # Errors
/// The system refuses.
pub(crate) fn runtime() -> io::Result<Runtime> {
    // It panics if it cannot open its sockets.
    UnixStream::pair().and_then(|_| UnixStream::pair())?;
    Builder::new_current_thread().enable_all().build()
}

fn spawn(wait: impl FnOnce() + Send + 'static) -> Result<()> {
    let thread = thread::Builder::new().name("interrupt".into()).spawn(wait);
    thread.map(drop).context("cannot listen for Ctrl-C")
}

/// Ends the program with the exit code that shells show for one that is ended by `signal`.
#[expect(clippy::exit, reason = "nobody waits for the work")]
fn leave(signal: i32) {
    atomic_file::remove_unfinished();
    std::process::exit(128 + signal)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use nix::sys::signal::{Signal, raise};

    use super::*;

    #[test]
    fn a_signal_asks_for_the_end_and_ends_nothing_by_itself() {
        let interrupt = Interrupt::listen().unwrap();
        assert!(!interrupt.is_asked());
        // A second SIGTERM would end the tests.
        let asks = if is_hangup_ignored() { Signal::SIGTERM } else { Signal::SIGHUP };
        raise(asks).unwrap();
        let is_heard = (0..60_000).any(|_| {
            thread::sleep(Duration::from_millis(1));
            interrupt.clone().is_asked()
        });
        assert!(is_heard, "within a minute");
        raise(Signal::SIGHUP).unwrap();
    }
}
