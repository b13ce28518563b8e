//! Ctrl-C or SIGTERM during long work: a flag that the work polls, so that what is done is kept. Again: the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context, Result};
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
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        // Before the thread runs: from here on neither ends anything by itself.
        let (mut pressed, mut ended) = {
            let _entered = runtime.enter();
            let listen = || -> std::io::Result<(Signal, Signal)> {
                Ok((signal(SignalKind::interrupt())?, signal(SignalKind::terminate())?))
            };
            listen().context("cannot listen for Ctrl-C and SIGTERM")?
        };
        let wait = move || {
            let mut next = || {
                runtime.block_on(async {
                    tokio::select! {
                        asked = pressed.recv() => asked,
                        asked = ended.recv() => asked,
                    }
                })
            };
            if next().is_some() {
                stdio::note("stopping");
                asked.store(true, Ordering::Relaxed);
            }
            if next().is_some() {
                leave();
            }
        };
        thread::Builder::new()
            .name("interrupt".into())
            .spawn(wait)
            .context("cannot listen for Ctrl-C")?;
        Ok(interrupt)
    }

    /// Whether it was asked for.
    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}

/// The second does not wait for the work.
#[expect(clippy::exit, reason = "a second Ctrl-C ends at once")]
fn leave() {
    std::process::exit(130)
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
