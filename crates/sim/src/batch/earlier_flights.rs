//! Earlier flights of a vehicle, whose vehicle file the judged flight begins with.

use anyhow::Result;
use tello_eval::parameter_file::{ParameterFile, TakesParameters as _};
use tello_eval::vehicle::FlightDone;
use tello_flight::Phase;
use tello_flight::cycle::FlightTable;

use super::flight::Contender;
use crate::SimTable;
use crate::plant::PlantParams;
use crate::random::{Purpose, Random};
use crate::virtual_time::VirtualFlight;

/// Distance of the seeds of two flights of one vehicle.
const SEEDS_BETWEEN: u64 = 1 << 32;

/// The settings of `flight` after `count` flights of the vehicle of `seed`, as `fly --vehicle` would leave them.
/// Each has its own noise.
///
/// # Errors
/// A setting that breaks its rule.
pub(super) fn after(
    count: u32,
    Contender { flight, reference, time_limit_s, .. }: &Contender,
    sim: &SimTable,
    seed: u64,
) -> Result<FlightTable> {
    let mut flight = flight.clone();
    let mut file = ParameterFile::of_settings(&flight.cycle);
    let mut sim = sim.clone();
    if sim.has_spread {
        let nominal = PlantParams::try_from(sim.plant)?;
        sim.plant = *nominal.draw(&mut Random::new(seed, Purpose::Vehicle)).table();
        sim.has_spread = false;
    }
    for number in 1..=count {
        let noise = seed.wrapping_add(SEEDS_BETWEEN.wrapping_mul(number.into()));
        let mut flown = VirtualFlight::new(&flight, &sim, noise)?.without_plan();
        let mut time_s = 0.0;
        let is_done = loop {
            let out = flown.tick()?;
            if out.phase() != Phase::Flying {
                break out.targets_reached == reference.targets_count;
            }
            time_s += flight.cycle.dt_s;
            if time_s > *time_limit_s {
                break false;
            }
        };
        // As `fly`: nothing is learned from a flight that landed early.
        let found = flown.parameter_estimate().filter(|_| is_done);
        if let Some(found) = found {
            let done = FlightDone { found: &found, date: "simulated", is_simulated: true };
            file.update_parameters(&flight.cycle, &done)?;
            flight.cycle.take(&file)?;
        }
    }
    Ok(flight)
}

#[cfg(test)]
mod tests;
