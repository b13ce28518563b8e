//! The hand-off from the control thread to the thread that writes the log.
//!
//! Owns a pool of records that are built once and travel in a circle: filled by the control thread,
//! written by the log's thread, handed back. The control side takes and gives in constant time; it
//! never waits, allocates or frees. When the disk is slower than the flight the pool runs empty, and
//! what could not be recorded is counted.

use std::sync::atomic::{Ordering, fence};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use super::{LogError, LogWriter, Summary};

/// How often the log's thread looks for records.
const POLL: Duration = Duration::from_millis(5);

/// The control thread's end of the log.
///
/// Dropping it lets the log's thread write what it has and close the file on its own.
#[derive(Debug)]
pub struct Recorder<T> {
    idle: Consumer<Box<T>>,
    filled: Producer<Box<T>>,
    dropped: u64,
    thread: JoinHandle<Result<Summary, LogError>>,
}

impl<T: Send + 'static> Recorder<T> {
    /// Starts the log's thread, which passes every record to `write` and flushes `log` about once in
    /// `flush_period` (it counts its own pauses: a busy disk flushes later). `pool` is all that can
    /// be under way at a time. The only allocation.
    ///
    /// # Errors
    /// [`LogError::Thread`].
    pub fn start(
        log: LogWriter,
        pool: Vec<T>,
        flush_period: Duration,
        write: impl FnMut(&mut LogWriter, &T) -> Result<(), LogError> + Send + 'static,
    ) -> Result<Self, LogError> {
        let (mut returned, idle) = RingBuffer::new(pool.len());
        let (filled, waiting) = RingBuffer::new(pool.len());
        for record in pool {
            give_back(&mut returned, Box::new(record));
        }
        let path = log.path().to_owned();
        let desk = Desk { log, waiting, returned, write };
        let thread = thread::Builder::new()
            .name("log".into())
            .spawn(move || desk.run(flush_period))
            .map_err(|source| LogError::Thread { path, source })?;
        Ok(Self { idle, filled, dropped: 0, thread })
    }

    /// A record to fill and [`submit`](Self::submit), with the contents of an earlier use. `None`, and
    /// counted, if all are under way or the log has failed.
    ///
    /// Real time: no allocation, constant cost.
    pub fn borrow(&mut self) -> Option<Box<T>> {
        let record = if self.is_writing() { self.idle.pop().ok() } else { None };
        self.dropped += u64::from(record.is_none());
        record
    }

    /// Sends a borrowed record to be written.
    ///
    /// Real time: no allocation, constant cost.
    pub fn submit(&mut self, record: Box<T>) {
        self.dropped += u64::from(self.filled.push(record).is_err());
    }

    /// Number of records that were not taken.
    pub fn dropped(&self) -> u64 {
        self.dropped
    }

    /// Whether the log takes records: false after its first error, which [`stop`](Self::stop) tells.
    pub fn is_writing(&self) -> bool {
        !self.filled.is_abandoned()
    }

    /// Waits until everything submitted is written and the log is closed.
    ///
    /// # Errors
    /// The first error of the log's thread, which ended it; [`LogError::ThreadPanicked`].
    pub fn stop(self) -> Result<Summary, LogError> {
        let Self { idle, filled, thread, .. } = self;
        drop((idle, filled));
        thread.thread().unpark();
        match thread.join() {
            Ok(result) => result,
            Err(_panic) => Err(LogError::ThreadPanicked),
        }
    }
}

/// The thread's end of the log.
struct Desk<T, W> {
    log: LogWriter,
    waiting: Consumer<Box<T>>,
    returned: Producer<Box<T>>,
    write: W,
}

impl<T, W: FnMut(&mut LogWriter, &T) -> Result<(), LogError>> Desk<T, W> {
    fn run(mut self, flush_period: Duration) -> Result<Summary, LogError> {
        let mut unflushed = Duration::ZERO;
        loop {
            // Asked before the ring is emptied: nothing can be submitted after a yes.
            let is_last = self.waiting.is_abandoned();
            fence(Ordering::Acquire);
            self.write_waiting()?;
            if is_last {
                return self.log.finish();
            }
            thread::park_timeout(POLL);
            unflushed += POLL;
            if unflushed >= flush_period {
                unflushed = Duration::ZERO;
                self.log.flush()?;
            }
        }
    }

    /// Writes what waits at this moment, not what comes meanwhile: a slow disk must not keep the
    /// flush away.
    fn write_waiting(&mut self) -> Result<(), LogError> {
        for _ in 0..self.waiting.slots() {
            let Ok(record) = self.waiting.pop() else { break };
            (self.write)(&mut self.log, &record)?;
            give_back(&mut self.returned, record);
        }
        Ok(())
    }
}

/// Returns a record to the pool, whose ring has room for all of them.
fn give_back<T>(returned: &mut Producer<Box<T>>, record: Box<T>) {
    let is_room = returned.push(record).is_ok();
    debug_assert!(is_room, "more records than the pool was built with");
}

#[cfg(test)]
mod tests;
