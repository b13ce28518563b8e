//! The arrival of a mocap frame, as it wakes the thread that waits for it.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicI64, Ordering};
use std::thread::{self, Thread};

use super::{Clock, SpanNs, TimeNs};

/// When the newest frame arrived: written by the task that reads the source, waited for by the control thread.
#[derive(Debug)]
pub struct Arrival {
    /// ns since the start of the clock
    newest_ns: AtomicI64,
    waiting: OnceLock<Thread>,
}

impl Arrival {
    /// Nothing has arrived, and no thread waits.
    pub fn new() -> Self {
        Self { newest_ns: AtomicI64::new(i64::MIN), waiting: OnceLock::new() }
    }

    /// A frame arrived at `at`, and can be taken from its queue. Wakes the thread that waits.
    pub fn note(&self, at: TimeNs) {
        self.newest_ns.store(at.0, Ordering::Release);
        if let Some(thread) = self.waiting.get() {
            thread.unpark();
        }
    }

    /// Waits until a frame has arrived at or after `from`, at most until `until`; when it arrived.
    ///
    /// Real time: no allocation but for the first call, which makes this thread the one that is woken.
    pub(super) fn wait(&self, clock: Clock, from: TimeNs, until: TimeNs) -> Option<TimeNs> {
        self.waiting.get_or_init(thread::current);
        loop {
            let newest = TimeNs(self.newest_ns.load(Ordering::Acquire));
            if newest >= from {
                return Some(newest);
            }
            let left = until.since(clock.now());
            if left <= SpanNs(0) {
                return None;
            }
            thread::park_timeout(left.duration());
        }
    }
}

impl Default for Arrival {
    fn default() -> Self {
        Self::new()
    }
}
