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
/// still cannot hold it up. The loop is given the same order with all others, unless their queue is full.
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

#[cfg(test)]
mod tests {
    use std::future::Future;
    use std::pin::pin;
    use std::task::{Context, Waker};

    use super::*;

    fn is_ordered(signal: &mut StopSignal) -> bool {
        pin!(signal.ordered()).poll(&mut Context::from_waker(Waker::noop())).is_ready()
    }

    #[test]
    fn the_order_to_stop_reaches_every_holder_for_good_by_word_or_by_drop() {
        for give in [Stopper::stop, drop::<Stopper>] {
            let (stopper, mut signal) = Stopper::new();
            let mut other = signal.clone();
            assert!(!is_ordered(&mut signal) && !is_ordered(&mut other));
            give(stopper);
            let mut late = signal.clone();
            for signal in [&mut signal, &mut other, &mut late] {
                assert!(is_ordered(signal) && is_ordered(signal));
            }
        }
    }

    #[test]
    fn an_emergency_stop_is_taken_once_by_whichever_holder_asks_first() {
        let request = EmergencyRequest::default();
        let sender = request.clone();
        assert!(!sender.take());
        request.ask();
        request.ask();
        assert_eq!([sender.take(), sender.take(), request.take()], [true, false, false]);
        request.ask();
        assert!(sender.take(), "a later one is another one");
    }
}
