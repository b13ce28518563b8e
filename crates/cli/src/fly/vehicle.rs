//! What a flight leaves in the vehicle file of `--vehicle`.

use tello_eval::vehicle::{self, FlightDone};
use tello_flight::cycle::FlightTable;
use tello_io::clock::{CivilTime, Clock};

use super::Arguments;
use super::control_loop::LoopEnd;
use super::summary::Summary;
use crate::stdio;

/// Writes what the flight taught to the vehicle file, if it ended well. An error changes nothing of the flight.
pub(super) fn remember(
    arguments: &Arguments,
    flight: &FlightTable,
    (summary, end): (&Summary, &LoopEnd),
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
            stdio::note(format_args!("{}: learnt {}", path.display(), moves.join(", ")));
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
