//! Ctrl-C during long work: a flag that the work polls, so that what is done is kept. Again: the end.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;

use anyhow::{Context, Result};
use tokio::signal::unix::{SignalKind, signal};

use crate::stdio;

/// Whether the user asked to stop. All clones give the same answer.
#[derive(Debug, Clone, Default)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Listens for Ctrl-C until the program ends.
    pub(crate) fn listen() -> Result<Self> {
        let interrupt = Self::default();
        let asked = Arc::clone(&interrupt.0);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        // Before the thread runs: from here on Ctrl-C ends nothing by itself.
        let mut pressed = {
            let _entered = runtime.enter();
            signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?
        };
        let wait = move || {
            if runtime.block_on(pressed.recv()).is_some() {
                stdio::note("stopping");
                asked.store(true, Ordering::Relaxed);
            }
            if runtime.block_on(pressed.recv()).is_some() {
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

/// The second Ctrl-C does not wait for the work.
#[expect(clippy::exit, reason = "who asks twice does not want to wait for anything")]
fn leave() {
    std::process::exit(130)
}
