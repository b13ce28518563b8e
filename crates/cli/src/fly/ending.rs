//! The end of a flight: the log is closed, the terminal given back, the program ended in time.

use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Result, anyhow};
use parking_lot::Mutex;
use tello_eval::flight_log::TickRecord;
use tello_eval::flight_summary::{Summary, Tally};
use tello_io::log::Recorder;
use tello_io::manual::Inputs;

use super::tui::Screen;
use super::view::View;
use crate::stdio;

/// Longest wait at the end for the threads that use the terminal.
const TERMINAL_JOIN_TIMEOUT: Duration = Duration::from_millis(500);

/// Time from the end of a flight whose terminal hangs to the end of the process: the summary may go elsewhere.
const EXIT_TIMEOUT_HUNG_TERMINAL: Duration = Duration::from_secs(1);

/// Wait for the disk of the log that is noted, and the longest one.
const DISK_WAIT_NOTED: Duration = Duration::from_secs(2);
pub(super) const DISK_WAIT_MAX: Duration = Duration::from_mins(1);

/// Longest time from the end of the flight to the end of the process, for a summary that is not read.
const EXIT_TIMEOUT: Duration = Duration::from_secs(5);

/// Closes the log, and sums up the flight whatever became of it.
pub(super) fn close_log(recorder: Recorder<TickRecord>, tally: &Mutex<Tally>) -> Summary {
    let mut is_noted = false;
    let log = recorder.stop(|waited| {
        if waited >= DISK_WAIT_NOTED && !std::mem::replace(&mut is_noted, true) {
            stdio::note("the flight is over; waits up to a minute for the disk of the log");
        }
        waited >= DISK_WAIT_MAX
    });
    let mut summary = tally.lock().summary();
    match log {
        // Writing to a file whose name was removed is no error.
        Ok(log) if log.path.exists() => summary.log = Some(log.path),
        Ok(log) => summary.log_error = Some(format!("{} was removed", log.path.display())),
        Err(error) => summary.log_error = Some(error.to_string()),
    }
    if let Some(error) = &summary.log_error {
        stdio::note(format_args!("error: the log is incomplete: {error}"));
    }
    summary
}

/// What shows the flight and reads keys. Dropped in the order of the fields, the keys before the screen, it leaves the
/// terminal as it was.
pub(super) struct Display {
    /// The thread that shows the flight on the terminal.
    pub(super) status_line: JoinHandle<()>,
    /// The live page.
    pub(super) view: Option<View>,
    pub(super) inputs: Inputs,
    pub(super) screen: Option<Screen>,
}

impl Display {
    /// Closes the live page, waits for the thread that shows the flight, then gives the terminal back. Returns the time
    /// that the rest of the program may take: a terminal that hangs takes no summary.
    ///
    /// # Errors
    /// The thread panicked, or there is none left to wait for it.
    pub(super) fn close(self) -> Result<Duration> {
        let Self { status_line, view, inputs, screen } = self;
        // Every record is seen: viewers receive the last one.
        drop(view);
        let leave = move || {
            let picture = status_line.join();
            drop(inputs);
            drop(screen);
            picture
        };
        let left = thread::Builder::new().name("tello-terminal".into()).spawn(leave)?;
        for _ in 0..TERMINAL_JOIN_TIMEOUT.as_millis() / 10 {
            if left.is_finished() {
                let joined = left.join().and_then(|picture| picture);
                joined.map_err(|_panic| anyhow!("the status line panicked"))?;
                return Ok(EXIT_TIMEOUT);
            }
            thread::sleep(Duration::from_millis(10));
        }
        Ok(EXIT_TIMEOUT_HUNG_TERMINAL)
    }
}

/// Ends the program in time, and shows the summary of a flight whose links or screen broke.
pub(super) fn conclude(
    summary: Summary,
    links: Result<()>,
    left: Result<Duration>,
) -> Result<Summary> {
    let exit_timeout = *left.as_ref().unwrap_or(&EXIT_TIMEOUT);
    let outcome = links.and(left.map(drop));
    end_within(exit_timeout, outcome.as_ref().map_or(2, |()| i32::from(!summary.is_complete())))?;
    if outcome.is_err() {
        stdio::note(&summary);
    }
    outcome.map(|()| summary)
}

/// Ends the program after `timeout` if it has not ended by then: the drone is down and the log closed.
#[expect(clippy::exit, reason = "a terminal that hangs must not keep the program")]
fn end_within(timeout: Duration, code: i32) -> Result<()> {
    thread::Builder::new().name("tello-end".into()).spawn(move || {
        thread::sleep(timeout);
        std::process::exit(code)
    })?;
    Ok(())
}
