//! The files of `--params` and `--vehicle`: what a flight takes from them, and what it leaves in the latter.

use std::net::SocketAddr;

use anyhow::{Context, Result};
use tello_eval::flight_summary::{LoopEnd, Summary};
use tello_eval::parameter_file::{self, ParameterFile, TakesParameters as _};
use tello_eval::vehicle::{self, FlightDone};
use tello_flight::cycle::FlightTable;
use tello_io::atomic_file;
use tello_io::clock::{CivilTime, Clock};
use tello_io::config::FlyTable;

use super::Arguments;
use crate::stdio;

/// Lets the settings take the file of `--params` or `--vehicle`.
///
/// # Errors
/// The file breaks a rule, is of simulated flights where the drone may be a real one, or could not be written after the
/// flight.
pub(super) fn take_parameters(arguments: &Arguments, table: &mut FlyTable) -> Result<()> {
    if let Some(path) = &arguments.params {
        let file = ParameterFile::read(path)?;
        if !(arguments.sim || arguments.dry_run || is_on_this_machine(table)) {
            file.check_is_real().with_context(|| format!("in {}", path.display()))?;
        }
        table.cycle.take(&file).with_context(|| parameter_file::of(path))?;
    }
    if let Some(path) = &arguments.vehicle {
        vehicle::before_flight(path, &mut table.cycle, arguments.sim)?;
        if !path.exists() {
            stdio::note(format_args!(
                "note: {} is not there yet: the flight makes it",
                path.display()
            ));
        }
        if !arguments.dry_run {
            let hint = "after the flight --vehicle writes it; --params only reads one";
            atomic_file::probe(path).context(hint)?;
        }
    }
    Ok(())
}

/// Whether the drone of the settings is one of this machine: a simulated one.
pub(super) fn is_on_this_machine(table: &FlyTable) -> bool {
    table.tello.address.parse().is_ok_and(|address: SocketAddr| address.ip().is_loopback())
}

/// Writes what the flight identified to the vehicle file, if it ended well. An error changes nothing of the flight.
pub(super) fn save_vehicle_parameters(
    arguments: &Arguments,
    flight: &FlightTable,
    summary: &Summary,
    end: &LoopEnd,
    clock: Clock,
) {
    let Some(path) = arguments.vehicle.as_deref() else { return };
    let Some(found) = end.found.as_ref().filter(|_| summary.is_success()) else {
        stdio::note(format_args!("{} stays as it was: the flight ended early", path.display()));
        return;
    };
    let date = CivilTime::from_unix_ns(clock.utc_start_ns()).to_string();
    let done = FlightDone { found, date: &date, is_simulated: arguments.sim };
    match vehicle::after_flight(path, &flight.cycle, &done) {
        Ok(changed) => {
            let moves = changed
                .iter()
                .map(|row| format!("{} {:.3} -> {:.3}", row.name, row.before, row.after));
            let moves: Vec<String> = moves.collect();
            stdio::note(format_args!("{}: updated {}", path.display(), moves.join(", ")));
        }
        Err(error) => stdio::note(format_args!(
            "{} stays as it was: {}",
            path.display(),
            stdio::chain(&error)
        )),
    }
}

#[cfg(test)]
mod tests;
