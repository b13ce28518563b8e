//! The thread of the control loop: its priority, its start and its end.

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use tello_io::clock::request_real_time;
use tokio::sync::oneshot;

use super::{ControlLoop, LoopResult};
use crate::fly::ending::DISK_WAIT_MAX;
use crate::stdio;

/// The thread of the loop. Dropping it, as a panic beside it does, asks to land and waits for the end: the
/// log is closed then, whatever landed the drone.
pub(in crate::fly) struct ControlThread {
    thread: Option<JoinHandle<LoopResult>>,
    asks_to_land: Arc<AtomicBool>,
}

impl ControlThread {
    /// Runs `control` with the priority of real time and, if one is named, on `core`; `done` reports its end.
    ///
    /// # Errors
    /// The system gives no thread.
    pub(in crate::fly) fn start(
        control: ControlLoop,
        core: Option<usize>,
        done: oneshot::Sender<()>,
    ) -> io::Result<Self> {
        let asks_to_land = Arc::clone(&control.asks_to_land);
        let thread = thread::Builder::new().name("tello-control".into()).spawn(move || {
            for warning in request_real_time(core) {
                stdio::note(format_args!("warning: {warning}"));
            }
            let end = control.run();
            // The receiver is gone if the main thread has failed meanwhile.
            done.send(()).ok();
            end
        })?;
        Ok(Self { thread: Some(thread), asks_to_land })
    }

    /// Waits for the end; `None` after a panic.
    pub(in crate::fly) fn join(mut self) -> Option<LoopResult> {
        self.thread.take()?.join().ok()
    }
}

impl Drop for ControlThread {
    fn drop(&mut self) {
        let Some(thread) = self.thread.take() else { return };
        self.asks_to_land.store(true, Ordering::Relaxed);
        // A second panic has been printed, and no summary is left that could name a log that cannot be closed.
        if let Ok(Ok((_, recorder))) = thread.join() {
            recorder.stop(|waited| waited >= DISK_WAIT_MAX).ok();
        }
    }
}
