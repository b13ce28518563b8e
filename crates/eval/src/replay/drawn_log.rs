//! What `--out` writes: the ticks as in the log of a flight, and its scene for viewers.
//!
//! Owns the two together; what each of them writes is `flight_log` and `scene`.

use std::path::Path;

use anyhow::Result;
use tello_flight::cycle::{FlightTable, Outcome};
use tello_io::log::LogWriter;

use crate::flight_log::{self, TickRecord};
use crate::scene::Scene;

/// A log that viewers draw.
pub(super) struct DrawnLog {
    log: LogWriter,
    scene: Scene,
}

impl DrawnLog {
    /// Creates the log of `flight` at `path`; `shape` is any outcome of the flight's cycle.
    ///
    /// # Errors
    /// The file cannot be created; the mission breaks its rules.
    pub(super) fn create(
        path: &Path,
        flight: &FlightTable,
        started_unix_ns: u64,
        shape: &Outcome,
    ) -> Result<Self> {
        Ok(Self {
            log: flight_log::create(path, flight, started_unix_ns, shape)?,
            scene: Scene::new(flight, started_unix_ns)?,
        })
    }

    /// Appends a tick.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write(&mut self, tick: &TickRecord) -> Result<()> {
        flight_log::write_tick(&mut self.log, tick)?;
        Ok(self.scene.write(&mut self.log, tick)?)
    }

    /// Closes the log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn finish(self) -> Result<()> {
        self.log.finish()?;
        Ok(())
    }
}
