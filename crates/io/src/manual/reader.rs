//! Common parts of the reader threads: when to read, where events go, when to end.

use std::os::fd::BorrowedFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use nix::errno::Errno;
use nix::poll::{PollFd, PollFlags, poll};
use rtrb::{Producer, PushError};

use super::{Event, InputAction, PersonOrder, Source};
use crate::EmergencyRequest;
use crate::clock::{Clock, TimeNs};

/// How long a reader waits for data before it checks whether it shall end. ms
const POLL_MS: u16 = 100;

/// Pause between two tries to put an event into a full queue.
const QUEUE_PAUSE: Duration = Duration::from_millis(2);

/// Where a reader's events go.
#[derive(Debug)]
pub(super) struct Outlet {
    events: Producer<Event>,
    emergency: EmergencyRequest,
    clock: Clock,
    ends: Arc<AtomicBool>,
}

impl Outlet {
    /// An outlet that closes when `ends` is set: an emergency stop is heard also when the other end is gone.
    pub(super) fn new(
        events: Producer<Event>,
        emergency: EmergencyRequest,
        clock: Clock,
        ends: Arc<AtomicBool>,
    ) -> Self {
        Self { events, emergency, clock, ends }
    }

    /// Whether the reader is to go on.
    pub(super) fn is_open(&self) -> bool {
        !self.ends.load(Ordering::Relaxed)
    }

    /// Now, by the clock of the events.
    pub(super) fn now(&self) -> TimeNs {
        self.clock.now()
    }

    /// Hands an event over; waits while the queue is full. A release that got lost would leave a
    /// stick where it is. An emergency stop waits for nothing.
    pub(super) fn push(&mut self, source: Source, action: InputAction) {
        if action == InputAction::Order(PersonOrder::EmergencyStop) {
            self.emergency.ask();
        }
        let mut event = Event { at: self.clock.now(), source, action };
        while let Err(PushError::Full(refused)) = self.events.push(event) {
            if !self.is_open() || self.events.is_abandoned() {
                return;
            }
            event = refused;
            thread::sleep(QUEUE_PAUSE);
        }
    }
}

/// Result of [`wait`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Readiness {
    /// Nothing for now.
    Nothing,
    /// There is something to read.
    Data,
    /// Hung up or unplugged, and everything was read.
    Gone,
}

/// Waits a tenth of a second for `file` to have something to read.
pub(super) fn wait(file: BorrowedFd<'_>) -> Readiness {
    let mut files = [PollFd::new(file, PollFlags::POLLIN)];
    match poll(&mut files, POLL_MS) {
        Ok(0) | Err(Errno::EINTR) => return Readiness::Nothing,
        Ok(_) => {}
        Err(_) => return Readiness::Gone,
    }
    let [file] = files;
    match file.revents() {
        Some(seen) if seen.contains(PollFlags::POLLIN) => Readiness::Data,
        _ => Readiness::Gone,
    }
}

#[cfg(test)]
mod tests;
