//! Seeded flights in virtual time, on all cores: what a controller is worth.
//!
//! Owns who flies which seeds. A flight is `batch/flight.rs`, what many of them amount to
//! `batch/table.rs`, how two controllers compare on the same seeds `batch/paired.rs`. The result
//! depends on neither the number of threads nor the time of day.

mod flight;
mod paired;
mod table;

use std::ops::Range;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use tello_sim::SimTable;

pub(crate) use flight::{Contender, Ending, Flown};
pub(crate) use paired::{Comparison, median_interval};
pub(crate) use table::Batch;

use crate::interrupt::Interrupt;

/// Flights of every contender, in the order of the contenders; each in the order of its seeds.
///
/// All contenders fly a seed before it counts as done. After an interrupt no further seed is begun:
/// the seeds that are missing are missing for all.
///
/// # Errors
/// A setting that breaks its rule.
pub(crate) fn fly(
    contenders: &[Contender],
    sim: &SimTable,
    seeds: Range<u64>,
    interrupt: &Interrupt,
    bar: &ProgressBar,
) -> Result<Vec<Vec<Flown>>> {
    let of_seed = |seed| -> Result<Option<Vec<Flown>>> {
        if interrupt.is_asked() {
            return Ok(None);
        }
        let flown: Result<Vec<Flown>> =
            contenders.iter().map(|contender| contender.fly(sim, seed)).collect();
        bar.inc(1);
        flown.map(Some)
    };
    let by_seed: Result<Vec<Option<Vec<Flown>>>> = seeds.into_par_iter().map(of_seed).collect();
    let mut by_contender: Vec<Vec<Flown>> = contenders.iter().map(|_| Vec::new()).collect();
    for flown in by_seed?.into_iter().flatten() {
        for (flights, flight) in by_contender.iter_mut().zip(flown) {
            flights.push(flight);
        }
    }
    Ok(by_contender)
}

/// A bar on a terminal for `count` seeds, with their rate and the time left.
///
/// # Errors
/// None in practice: the template is ours.
pub(crate) fn progress(count: u64, is_shown: bool) -> Result<ProgressBar> {
    let bar = if is_shown { ProgressBar::new(count) } else { ProgressBar::hidden() };
    let style = "{bar:40} {pos}/{len} seeds, {per_sec}, {eta} left";
    bar.set_style(ProgressStyle::with_template(style)?);
    Ok(bar)
}
