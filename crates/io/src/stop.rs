//! The order to stop, from the program to its socket tasks.

use tokio::sync::watch;

/// Gives the order: by [`Stopper::stop`], or by being dropped.
#[derive(Debug)]
pub struct Stopper(watch::Sender<()>);

impl Stopper {
    /// A stopper and the receiver to clone into each task.
    pub fn new() -> (Self, StopSignal) {
        let (sender, receiver) = watch::channel(());
        (Self(sender), StopSignal(receiver))
    }

    /// Orders every holder of the [`StopSignal`] to finish.
    pub fn stop(self) {
        drop(self.0);
    }
}

/// Receives the order to stop.
#[derive(Debug, Clone)]
pub struct StopSignal(watch::Receiver<()>);

impl StopSignal {
    /// Waits for the order; returns at once if it was given. Safe to cancel.
    pub async fn ordered(&mut self) {
        // The sender never sends: the one event there is, is its end.
        while self.0.changed().await.is_ok() {}
    }
}
