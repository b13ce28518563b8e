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
#[cfg(test)]
mod testing;

use std::ops::Range;

use anyhow::Result;

use crate::SimTable;
use crate::seeds::fly_each;

pub(crate) use flight::source;
pub use flight::{Contender, Ending, FlightRow, Flown, Largest, SolverCounts};
pub use laps::{LapSpread, Laps};
pub use paired::Comparison;
pub use table::Batch;

/// Flights of every contender, in the order of the contenders; each in the order of its seeds.
///
/// All contenders fly a seed before it counts as done. After an interrupt no further seed is begun:
/// the seeds that are missing are missing for all.
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
    let by_seed = fly_each(seeds, is_interrupted, on_flown, |seed| {
        contenders.iter().map(|contender| contender.fly(sim, seed)).collect()
    })?;
    let mut flown = by_contender(by_seed);
    flown.resize(contenders.len(), Vec::new());
    Ok(flown)
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

/// Transposes flights `[contender][seed]` to `[seed][contender]`, and drops their tracks: what a part file holds.
pub fn by_seed(by_contender: Vec<Vec<Flown>>) -> Vec<Vec<Flown>> {
    let mut by_seed: Vec<Vec<Flown>> = Vec::new();
    for flights in by_contender {
        by_seed.resize(by_seed.len().max(flights.len()), Vec::new());
        for (seed, flight) in by_seed.iter_mut().zip(flights) {
            seed.push(Flown { track_w: Vec::new(), ..flight });
        }
    }
    by_seed
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A flight of a seed with a track, distinguished by its time.
    fn flown(seed: u64, finish_s: f64) -> Flown {
        let mut flown = Flown::example(Some(finish_s), 0.2);
        flown.row.seed = seed;
        flown.track_w = vec![(1.0, 2.0)];
        flown
    }

    #[test]
    fn what_counts_over_sockets_alone_is_named() {
        let mut sim = crate::settings(None).unwrap();
        assert_eq!(ignored(&sim).unwrap(), [""; 0]);
        sim.drone.air.loss = 0.5;
        sim.start = crate::Start::Ground { x: 9.0, y: 0.0, theta: 0.0 };
        assert_eq!(ignored(&sim).unwrap(), ["start", "drone.air"]);
    }

    #[test]
    fn flights_by_seed_are_those_by_contender_turned_around() {
        let by_contender = vec![
            vec![flown(7, 10.0), flown(8, 11.0), flown(9, 12.0)],
            vec![flown(7, 20.0), flown(8, 21.0), flown(9, 22.0)],
        ];
        let by_seed = by_seed(by_contender.clone());
        assert_eq!(by_seed.len(), 3);
        for (seed, flights) in (7..).zip(&by_seed) {
            assert!(flights.iter().all(|flown| flown.row.seed == seed), "{seed}: {flights:?}");
            assert!(
                flights.iter().all(|flown| flown.track_w.is_empty()),
                "no track in a part file"
            );
        }
        let back = super::by_contender(by_seed);
        let rows = |flights: &[Vec<Flown>]| -> Vec<Vec<FlightRow>> {
            flights.iter().map(|own| own.iter().map(|flown| flown.row.clone()).collect()).collect()
        };
        assert_eq!(rows(&back), rows(&by_contender));
        assert!(super::by_contender(Vec::new()).is_empty());
    }
}
