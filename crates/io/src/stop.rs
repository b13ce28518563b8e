//! Orders that pass by the control loop: the end of the program to its socket tasks, and a person's emergency stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

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

/// A person's emergency stop, from the readers of keys, devices and views to the sender: a control loop that stands
/// still cannot hold it up. The loop is given the same order with all others.
#[derive(Debug, Clone, Default)]
pub struct EmergencyRequest(Arc<AtomicBool>);

impl EmergencyRequest {
    /// Asks for the emergency stop.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Relaxed);
    }

    /// Whether it was asked for since the last call.
    pub fn take(&self) -> bool {
        self.0.swap(false, Ordering::Relaxed)
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
