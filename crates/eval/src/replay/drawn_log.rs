//! Log that `--out` writes: the ticks as in the log of a flight, and its scene for viewers.
//!
//! Owns the two together; the records of each are in `flight_log` and `scene`.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use tello_flight::cycle::{FlightTable, Outcome};
use tello_io::atomic_file::Part;
use tello_io::log::{LogError, LogWriter};

use crate::flight_log::{self, Origin, TickRecord};
use crate::scene::Scene;

/// A log that viewers draw. It has its name when it is closed, and is removed if it is not: a torn one would be in the
/// way of the next try.
pub(super) struct DrawnLog {
    log: LogWriter,
    scene: Scene,
    path: PathBuf,
    part: Part,
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
        let path = path.to_owned();
        if path.exists() {
            return Err(LogError::Exists { path }.into());
        }
        let part = Part::of(&path)?;
        let log =
            flight_log::create_of(Origin::Repeated, part.path(), flight, started_unix_ns, shape)
                .with_context(|| not_written(&path))?;
        Ok(Self { log, scene: Scene::new(flight, started_unix_ns)?, path, part })
    }

    /// Appends a tick.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn write(&mut self, tick: &TickRecord) -> Result<()> {
        flight_log::write_tick(&mut self.log, tick)
            .and_then(|()| self.scene.write(&mut self.log, tick))
            .with_context(|| not_written(&self.path))
    }

    /// Closes the log.
    ///
    /// # Errors
    /// The file cannot be written.
    pub(super) fn finish(self) -> Result<()> {
        self.log.finish().with_context(|| not_written(&self.path))?;
        self.part.finish()
    }
}

fn not_written(path: &Path) -> String {
    format!("cannot write {}", path.display())
}

#[cfg(test)]
mod tests {
    use tello_flight::Start;
    use tello_flight::cycle;
    use tello_io::config;

    use super::*;

    #[test]
    fn a_log_has_its_name_when_it_is_closed_and_replaces_none() {
        let dir = std::env::temp_dir().join(format!("tello-ctl-drawn-{}", std::process::id()));
        std::fs::create_dir_all(&dir).unwrap();
        let count = || std::fs::read_dir(&dir).unwrap().count();
        let path = dir.join("a.mcap");
        let (table, mission) = config::fly(None, None).unwrap();
        let flight = config::flight(&table, mission, Start::Airborne);
        let shape = cycle::build(&flight).unwrap().new_outcome();
        let create = || DrawnLog::create(&path, &flight, 0, &shape);
        drop(create().unwrap());
        assert_eq!(count(), 0, "an unfinished log is removed");
        let log = create().unwrap();
        assert!(!path.exists() && count() == 1);
        log.finish().unwrap();
        assert!(path.exists() && count() == 1);
        assert!(create().is_err());
        std::fs::remove_dir_all(dir).unwrap();
    }
}
