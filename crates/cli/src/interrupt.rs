//! Ctrl-C or SIGTERM during long work: a flag that the work polls, so that what is done is kept. Again: the end.

use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context as _, Result};
use tello_io::whole_file;
use tokio::signal::unix::{Signal, SignalKind, signal};

use crate::stdio;

/// Whether the user asked to stop. All clones give the same answer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens for Ctrl-C and SIGTERM until the program ends.
    pub(crate) fn listen() -> Result<Self> {
        let interrupt = Self::default();
        let asked = Arc::clone(&interrupt.0);
        let mut next = signals()?;
        let wait = move || {
            if next().is_some() {
                stdio::note("stopping");
                asked.store(true, Ordering::Relaxed);
            }
            if next().is_some() {
                leave(SignalKind::interrupt().as_raw_value());
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

/// From now on Ctrl-C and SIGTERM remove the files that are not finished, and end the program.
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

/// What waits for the next SIGINT or SIGTERM, neither of which ends the program by itself any more.
fn signals() -> Result<impl FnMut() -> Option<i32> + Send> {
    let why = "cannot listen for Ctrl-C and SIGTERM";
    // The runtime panics if it cannot open its sockets.
    UnixStream::pair().and_then(|_| UnixStream::pair()).context(why)?;
    let runtime =
        tokio::runtime::Builder::new_current_thread().enable_all().build().context(why)?;
    let (mut pressed, mut ended) = {
        let _entered = runtime.enter();
        let listen = || -> std::io::Result<(Signal, Signal)> {
            Ok((signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?))
        };
        listen().context(why)?
    };
    Ok(move || {
        runtime.block_on(async {
            tokio::select! {
                asked = pressed.recv() => asked.map(|()| SignalKind::interrupt().as_raw_value()),
                asked = ended.recv() => asked.map(|()| SignalKind::terminate().as_raw_value()),
            }
        })
    })
}

fn spawn(wait: impl FnOnce() + Send + 'static) -> Result<()> {
    let thread = thread::Builder::new().name("interrupt".into()).spawn(wait);
    thread.map(drop).context("cannot listen for Ctrl-C")
}

/// Ends the program with the exit code that shells show for one that is ended by `signal`.
#[expect(clippy::exit, reason = "nobody waits for the work")]
fn leave(signal: i32) {
    whole_file::remove_unfinished();
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
        // A second one would end the tests.
        raise(Signal::SIGTERM).unwrap();
        let is_heard = (0..60_000).any(|_| {
            thread::sleep(Duration::from_millis(1));
            interrupt.clone().is_asked()
        });
        assert!(is_heard, "within a minute");
    }
}
