//! Calls that last: without the interpreter's lock, and ended by Ctrl-C.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use anyhow::{Result, ensure};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use tello_eval::ident::Observer;

use crate::raised;

/// How often the interpreter is asked for signals.
const POLL: Duration = Duration::from_millis(50);

/// Set when the call shall end.
#[derive(Debug, Default)]
pub(crate) struct Stop(AtomicBool);

impl Stop {
    /// Whether the call shall end.
    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// # Errors
    /// The call shall end. Nobody sees this error: the signal's exception takes its place.
    pub(crate) fn check(&self) -> Result<()> {
        ensure!(!self.is_asked(), "interrupted");
        Ok(())
    }
}

impl Observer for Stop {
    fn is_stopped(&self) -> bool {
        self.is_asked()
    }
}

/// Runs `work` on a thread of its own; other Python threads go on meanwhile.
///
/// # Errors
/// Result of `work`, or the exception of a signal handler: `KeyboardInterrupt`.
pub(crate) fn run<T: Send>(
    py: Python<'_>,
    work: impl FnOnce(&Stop) -> Result<T> + Send,
) -> PyResult<T> {
    let stop = Stop::default();
    py.detach(|| {
        thread::scope(|scope| {
            let (done, is_done) = mpsc::channel::<()>();
            let stop = &stop;
            let worker = scope.spawn(move || {
                let result = work(stop);
                drop(done);
                result
            });
            let interrupted = loop {
                match is_done.recv_timeout(POLL) {
                    Err(RecvTimeoutError::Timeout) => {
                        let signal = Python::attach(pending);
                        if let Err(signal) = signal {
                            stop.0.store(true, Ordering::Relaxed);
                            break Some(signal);
                        }
                    }
                    Ok(()) | Err(RecvTimeoutError::Disconnected) => break None,
                }
            };
            let result = worker.join();
            match (interrupted, result) {
                (Some(signal), _) => Err(signal),
                (None, Ok(result)) => result.map_err(raised),
                (None, Err(_)) => {
                    Err(PyRuntimeError::new_err("a defect of tello_ctl: the call panicked"))
                }
            }
        })
    })
}

/// The exception of a signal that arrived meanwhile.
fn pending(py: Python<'_>) -> PyResult<()> {
    py.check_signals()
}
