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

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// Longer than a thread takes to start.
    const MINUTE: SpanNs = SpanNs::from_ms(60_000);

    #[test]
    fn a_frame_that_has_arrived_is_not_waited_for() {
        let (clock, arrival) = (Clock::start(), Arrival::new());
        arrival.note(TimeNs(7));
        let until = clock.now().after(MINUTE);
        assert_eq!(arrival.wait(clock, TimeNs(7), until), Some(TimeNs(7)));
        assert_eq!(arrival.wait(clock, TimeNs(-9), until), Some(TimeNs(7)));
    }

    #[test]
    fn a_frame_before_the_window_is_none_once_the_window_is_over() {
        let (clock, arrival) = (Clock::start(), Arrival::new());
        assert_eq!(arrival.wait(clock, TimeNs(0), clock.now()), None, "nothing arrived");
        arrival.note(TimeNs(7));
        assert_eq!(arrival.wait(clock, TimeNs(8), clock.now()), None);
    }

    #[test]
    fn a_frame_wakes_the_thread_that_waits_and_one_that_is_too_early_does_not() {
        let (clock, arrival) = (Clock::start(), Arc::new(Arrival::new()));
        let until = clock.now().after(MINUTE);
        let waiting = thread::spawn({
            let arrival = Arc::clone(&arrival);
            move || arrival.wait(clock, TimeNs(10), until)
        });
        while arrival.waiting.get().is_none() {
            thread::yield_now();
        }
        arrival.note(TimeNs(9));
        arrival.note(TimeNs(10));
        assert_eq!(waiting.join().unwrap(), Some(TimeNs(10)));
    }
}
