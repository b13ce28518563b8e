//! The hand-off from the control thread to the thread that writes the log.
//!
//! Owns a pool of records that are built once and travel in a circle: filled by the control thread,
//! written by the log's thread, handed back. The control side takes and gives in constant time; it
//! never waits, allocates or frees. When the disk is slower than the flight the pool runs empty, and
//! what could not be recorded is counted. When the log fails the records go on in their circle: whatever
//! else is done with them does not depend on the log.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering, fence};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use super::{LogError, LogWriter, Summary, io_error};

/// How often the log's thread looks for records.
const POLL: Duration = Duration::from_millis(5);

/// The control thread's end of the log.
///
/// Dropping it lets the log's thread write what it has and close the file on its own.
#[derive(Debug)]
pub struct Recorder<T> {
    idle: Consumer<Box<T>>,
    filled: Producer<Box<T>>,
    /// Records that are not in the log, counted by both ends.
    dropped: Arc<AtomicU64>,
    thread: JoinHandle<Result<Summary, LogError>>,
}

impl<T: Send + 'static> Recorder<T> {
    /// Starts the log's thread, which passes every record to `write` and flushes `log` about once in
    /// `flush_period` (it counts its own pauses: a busy disk flushes later). After the first error, which ends
    /// the log, `write` is given `None` in its place. `pool` is all that can be in transit at a time. All
    /// allocations of the control side are here.
    ///
    /// # Errors
    /// [`LogError::Io`].
    pub fn start(
        log: LogWriter,
        pool: Vec<T>,
        flush_period: Duration,
        write: impl FnMut(Option<&mut LogWriter>, &T) -> Result<(), LogError> + Send + 'static,
    ) -> Result<Self, LogError> {
        let (mut returned, idle) = RingBuffer::new(pool.len());
        let (filled, waiting) = RingBuffer::new(pool.len());
        for record in pool {
            give_back(&mut returned, Box::new(record));
        }
        let path = log.path().to_owned();
        let dropped = Arc::new(AtomicU64::new(0));
        let count = Arc::clone(&dropped);
        let writing = Writing { log: Ok(log), waiting, returned, write, dropped: count };
        let thread = thread::Builder::new()
            .name("tello-log".into())
            .spawn(move || writing.run(flush_period))
            .map_err(io_error("start the thread that writes", &path))?;
        Ok(Self { idle, filled, dropped, thread })
    }

    /// A record to fill and [`submit`](Self::submit), with the contents of an earlier use. `None`, and
    /// counted, if all are in transit or the log's thread has panicked.
    ///
    /// Real time: no allocation, constant cost.
    pub fn borrow(&mut self) -> Option<Box<T>> {
        let is_taken = !self.filled.is_abandoned();
        let record = if is_taken { self.idle.pop().ok() } else { None };
        self.dropped.fetch_add(record.is_none().into(), Ordering::Relaxed);
        record
    }

    /// Sends a borrowed record to be written.
    ///
    /// Real time: no allocation, constant cost.
    pub fn submit(&mut self, record: Box<T>) {
        let is_lost = self.filled.push(record).is_err();
        self.dropped.fetch_add(is_lost.into(), Ordering::Relaxed);
    }

    /// Number of records that are not in the log: not taken, or met by the log's thread after the log had
    /// failed.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Waits until everything submitted is written and the log is closed. Asks `is_given_up` again and again, with
    /// the time waited (its own pauses): after a yes the log is left to a thread that ends with the program.
    ///
    /// # Errors
    /// The first error, which ended the log; [`LogError::Unfinished`]; [`LogError::ThreadPanicked`].
    pub fn stop(self, mut is_given_up: impl FnMut(Duration) -> bool) -> Result<Summary, LogError> {
        let Self { idle, filled, thread, .. } = self;
        drop((idle, filled));
        thread.thread().unpark();
        let mut waited = Duration::ZERO;
        while !thread.is_finished() {
            if is_given_up(waited) {
                return Err(LogError::Unfinished);
            }
            thread::sleep(POLL);
            waited += POLL;
        }
        match thread.join() {
            Ok(result) => result,
            Err(_panic) => Err(LogError::ThreadPanicked),
        }
    }
}

/// The thread's end of the log.
struct Writing<T, W> {
    /// The log, or the error that ended it.
    log: Result<LogWriter, LogError>,
    waiting: Consumer<Box<T>>,
    returned: Producer<Box<T>>,
    write: W,
    dropped: Arc<AtomicU64>,
}

impl<T, W: FnMut(Option<&mut LogWriter>, &T) -> Result<(), LogError>> Writing<T, W> {
    fn run(mut self, flush_period: Duration) -> Result<Summary, LogError> {
        let mut unflushed = Duration::ZERO;
        loop {
            // Asked before the ring is emptied: nothing can be submitted after a yes.
            let is_last = self.waiting.is_abandoned();
            fence(Ordering::Acquire);
            self.write_waiting();
            if is_last {
                let mut log = self.log?;
                log.note_dropped(self.dropped.load(Ordering::Relaxed))?;
                return log.finish();
            }
            thread::park_timeout(POLL);
            unflushed += POLL;
            if unflushed >= flush_period {
                unflushed = Duration::ZERO;
                let flushed = self.log.as_mut().map_or(Ok(()), LogWriter::flush);
                self.note(flushed);
            }
        }
    }

    /// Writes what waits at this moment, not what comes meanwhile: a slow disk must not keep the
    /// flush away.
    fn write_waiting(&mut self) {
        for _ in 0..self.waiting.slots() {
            let Ok(record) = self.waiting.pop() else { break };
            let written = (self.write)(self.log.as_mut().ok(), &record);
            give_back(&mut self.returned, record);
            self.note(written);
            if self.log.is_err() {
                self.dropped.fetch_add(1, Ordering::Relaxed);
            }
        }
    }

    /// The first error ends the log.
    fn note(&mut self, result: Result<(), LogError>) {
        if let (Err(error), true) = (result, self.log.is_ok()) {
            self.log = Err(error);
        }
    }
}

/// Returns a record to the pool, whose ring has room for all of them.
fn give_back<T>(returned: &mut Producer<Box<T>>, record: Box<T>) {
    let is_room = returned.push(record).is_ok();
    debug_assert!(is_room, "more records than the pool was built with");
}

#[cfg(test)]
mod tests;
