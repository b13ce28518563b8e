//! What flies: the reader of the motion capture, the drone's link and the control thread.
//!
//! Owns the order in which they end: control first, then the link, which lands a drone that still flies and takes an
//! emergency stop until its end, then the guardian.

use std::thread::JoinHandle;

use anyhow::{Context, Result, anyhow};
use tello_eval::flight_log::TickRecord;
use tello_eval::flight_summary::LoopEnd;
use tello_io::Stopper;
use tello_io::log::Recorder;
use tello_io::tello::{DroneClient, LinkError};
use tokio::sync::oneshot;
use tokio::task;

use super::control_loop::{ControlLoop, ControlThread};
use super::drill::{self, InjectedFailure};
use super::guardian::Guardian;
use super::sources::Sources;

/// The running threads and tasks. Dropped, they land the drone: [`ControlThread`].
pub(super) struct Threads {
    mocap: JoinHandle<()>,
    link: task::JoinHandle<Result<(), LinkError>>,
    control: ControlThread,
    is_done: oneshot::Receiver<()>,
    stopper: Stopper,
    guardian: Option<Guardian>,
}

impl Threads {
    /// Starts them, the link as a task of the calling thread's runtime, control on `core` if one is named.
    ///
    /// # Errors
    /// The system gives no thread.
    pub(super) fn start(
        sources: Sources,
        link: DroneClient,
        control: ControlLoop,
        guardian: Option<Guardian>,
        core: Option<usize>,
    ) -> Result<Self> {
        let (stopper, stop) = Stopper::new();
        let mocap = sources.start(stop.clone())?;
        let link = tokio::spawn(link.run(stop));
        let (done, is_done) = oneshot::channel();
        let control = ControlThread::start(control, core, done)?;
        Ok(Self { mocap, link, control, is_done, stopper, guardian })
    }

    /// Waits for the end of the control loop, then of the links: how the loop ended, the log to close, and whether the
    /// links failed.
    ///
    /// # Errors
    /// The control thread panicked, or its ticker failed.
    pub(super) async fn run_to_end(
        self,
        drill: Option<InjectedFailure>,
    ) -> Result<(LoopEnd, Recorder<TickRecord>, Result<()>)> {
        if let Some(drill) = drill {
            tokio::spawn(drill.inject_into_link(self.link.abort_handle()));
        }
        tokio::select! {
            // An error is the end of the control thread, too.
            _ = self.is_done => {}
            () = drill::inject_into_main(drill) => {}
        }
        let control = self.control.join();
        // Before any error leaves: the link lands a drone that still flies.
        self.stopper.stop();
        let control = control.context("the control thread panicked").and_then(|ended| Ok(ended?));
        let link = self.link.await;
        let mocap = self.mocap.join();
        if let (Some(guardian), Ok(Ok(()))) = (self.guardian, &link) {
            guardian.end();
        }
        let (end, recorder) = control?;
        let links = match mocap {
            Ok(()) => link.map_err(Into::into).and_then(|link| Ok(link?)),
            Err(_panic) => Err(anyhow!("the reader of the motion capture panicked")),
        };
        Ok((end, recorder, links))
    }
}
