//! One flight in virtual time that leaves a log, as a real one does.

use std::fmt::{self, Display, Formatter};
use std::path::{Path, PathBuf};

use anyhow::{Result, ensure};
use horizon_model::setting::SettingError;
use serde::Serialize;
use tello_eval::flight_log::{self, Origin, TickRecord};
use tello_eval::scene::Scene;
use tello_flight::cycle::{FlightTable, Timing};
use tello_flight::{Fault, Mission, Phase};
use tello_io::atomic_file;
use tello_io::log::LogError;

use crate::SimTable;
use crate::virtual_time::VirtualFlight;

/// Longest flight beside twice the planned time of its mission. s
const BESIDE_S: f64 = 60.0;

/// How a flight ended, and where its log is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Logged {
    /// The log.
    pub log: PathBuf,
    /// Seed of the flight.
    pub seed: u64,
    /// Phase at the end.
    pub phase: Phase,
    /// The faults that ended it; after a mission that was done none but a landing confirmed by one source.
    pub ended_by: Vec<Fault>,
    /// Targets reached, by the estimate.
    pub targets_reached: usize,
    /// Targets to reach.
    pub targets_count: usize,
    /// Virtual time of the flight. s
    pub lasted_s: f64,
}

impl Logged {
    /// Whether all targets were reached and the vehicle landed, and no fault landed it.
    pub fn is_success(&self) -> bool {
        self.phase.is_success(self.targets_reached, self.targets_count, &self.ended_by)
    }
}

impl Display for Logged {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self { log, seed, phase, ended_by, targets_reached, targets_count, lasted_s } = self;
        let reason = Fault::ending_names(ended_by);
        writeln!(
            f,
            "seed {seed}: {}{reason}, {targets_reached} of {targets_count} targets, {lasted_s:.2} s; log {}",
            phase.name(),
            log.display()
        )
    }
}

/// Flies `flight` with `seed` until the vehicle is down and writes every tick to a new log at `path`, whose
/// clock starts in 1970: equal arguments write equal records. Times of solvers are zero.
///
/// # Errors
/// A setting that breaks its rule; the log cannot be written.
pub fn fly(flight: &FlightTable, sim: &SimTable, seed: u64, path: &Path) -> Result<Logged> {
    fly_until(flight, sim, seed, path, &|| false)
}

/// Flies and writes a log as [`fly`]; gives up without a log once `is_stopped` returns true.
///
/// # Errors
/// As [`fly`]; the flight was stopped.
pub fn fly_until(
    flight: &FlightTable,
    sim: &SimTable,
    seed: u64,
    path: &Path,
    is_stopped: &dyn Fn() -> bool,
) -> Result<Logged> {
    if atomic_file::is_there(path) {
        return Err(LogError::Exists { path: path.to_owned() }.into());
    }
    // A torn log would be in the way of the next try.
    let logged =
        atomic_file::write(path, false, |part| fly_into(part, flight, sim, seed, is_stopped))?;
    Ok(Logged { log: path.to_owned(), ..logged })
}

/// Flies as [`fly_until`]; the log is at `path` whether it is finished or not.
fn fly_into(
    path: &Path,
    flight: &FlightTable,
    sim: &SimTable,
    seed: u64,
    is_stopped: &dyn Fn() -> bool,
) -> Result<Logged> {
    let mut flown = VirtualFlight::new(flight, sim, seed)?;
    let shape = flown.new_outcome();
    let mut scene = Scene::new(flight, 0)?;
    let mut log = flight_log::create_of(Origin::Simulated, path, flight, 0, &shape)?;
    let mut tick = TickRecord::with_buffers(&shape);
    let (targets_count, steps_max) = bounds(flight)?;
    let mut newest = None;
    for _ in 0..steps_max {
        ensure!(!is_stopped(), "interrupted");
        tick.out.clone_from(flown.tick()?);
        tick.inbox = flown.inbox().clone();
        // A period without a tick has no record.
        if newest.replace(tick.inbox.step) == Some(tick.inbox.step) {
            continue;
        }
        tick.timing = Timing { step: tick.inbox.step, ..Timing::default() };
        flight_log::write_tick(&mut log, &tick)?;
        scene.write(&mut log, &tick)?;
        if tick.out.phase().is_over() {
            break;
        }
    }
    log.finish()?;
    Ok(Logged {
        log: path.to_owned(),
        seed,
        phase: tick.out.phase(),
        ended_by: tick
            .out
            .decision
            .map(|decision| decision.ended_by.iter().collect())
            .unwrap_or_default(),
        targets_reached: tick.out.targets_reached,
        targets_count,
        lasted_s: tick.inbox.now.seconds(),
    })
}

/// Targets to reach, and most ticks.
fn bounds(flight: &FlightTable) -> Result<(usize, u64), SettingError> {
    let mission = Mission::new(&flight.mission, flight.cycle.dt_s)?;
    let steps = (2.0 * mission.planned_s() + BESIDE_S) / flight.cycle.dt_s;
    Ok((mission.targets_count(), horizon_model::whole(steps.ceil()) as u64))
}

#[cfg(test)]
mod tests;
