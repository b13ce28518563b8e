//! Seeded flights in virtual time, on all cores: what a controller is worth.
//!
//! Owns who flies which seeds. A flight is `batch/flight.rs`, what many of them amount to
//! `batch/table.rs`, how two controllers compare on the same seeds `batch/paired.rs`. The result
//! depends on neither the number of threads nor the time of day.

mod earlier_flights;
mod flight;
mod laps;
mod paired;
mod table;

use std::ops::Range;

use anyhow::Result;

use crate::SimTable;
use crate::seeds::fly_each;

pub(crate) use flight::source;
pub use flight::{Contender, Ending, FlightRow, Flown, Largest, SolverCounts};
pub use laps::{LapSpread, Laps};
pub use paired::Comparison;
pub use table::Batch;

/// Flights of each seed, in the order of the seeds: one of each contender.
///
/// After an interrupt no further seed is begun.
///
/// `on_flown` is called after every seed.
///
/// # Errors
/// A setting that breaks its rule.
pub fn fly(
    contenders: &[Contender],
    sim: &SimTable,
    seeds: Range<u64>,
    is_interrupted: &(dyn Fn() -> bool + Sync),
    on_flown: &(dyn Fn() + Sync),
) -> Result<Vec<Vec<Flown>>> {
    fly_each(seeds, is_interrupted, on_flown, |seed| {
        contenders.iter().map(|contender| contender.fly(sim, seed)).collect()
    })
}

/// Keys of `sim` that differ from the built-in ones and count over sockets alone: in virtual time nothing is sent, and
/// a flight begins in the air at its first target.
///
/// # Errors
/// None in practice: the built-in settings are ours.
pub fn ignored(sim: &SimTable) -> Result<Vec<&'static str>> {
    let usual = crate::settings(None)?;
    let (drone, of_usual) = (&sim.drone, &usual.drone);
    let differing = [
        ("start", sim.start != usual.start),
        ("mocap_rate_hz", sim.mocap_rate_hz > usual.mocap_rate_hz),
        ("drone.air", drone.air != of_usual.air),
        ("drone.sdk", drone.sdk != of_usual.sdk),
        ("drone.binary_first", drone.binary_first != of_usual.binary_first),
        ("drone.reply_to", drone.reply_to != of_usual.reply_to),
    ];
    Ok(differing.into_iter().filter(|(_, differs)| *differs).map(|(key, _)| key).collect())
}

/// Flights by seed, each of all contenders, as flights by contender.
pub fn by_contender(by_seed: Vec<Vec<Flown>>) -> Vec<Vec<Flown>> {
    let mut by_contender: Vec<Vec<Flown>> = Vec::new();
    for flown in by_seed {
        by_contender.resize(flown.len(), Vec::new());
        for (flights, flight) in by_contender.iter_mut().zip(flown) {
            flights.push(flight);
        }
    }
    by_contender
}

#[cfg(test)]
mod tests;
