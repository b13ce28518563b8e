//! Whole flights in virtual time: what a tick takes, what its log takes, how many flights a core lives
//! through.
//!
//! Owns the flights. A tick is timed alone, on the inputs of a recorded flight; a simulated flight is
//! timed with its vehicle, links and bytes, one core, without the judge of `sim --batch`.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::{Context, Result};
use horizon_control::QpKind;
use tello_eval::flight_log::{self, TickRecord};
use tello_flight::cycle::{self, FlightTable, Timing, Unwatched};
use tello_flight::{Phase, Start};
use tello_io::clock::Clock;
use tello_io::config;
use tello_sim::SimTable;
use tello_sim::virtual_time::VirtualFlight;

use super::comparison::{quantile, sorted};
use super::{Bench, Findings};

/// Settings that are flown, with sizes and a solver in place of their own.
struct Settings {
    file: &'static str,
    fine: Option<Fine>,
    qp: Option<QpKind>,
}

/// A horizon in which each step is a stage, a window, and iterations for both to converge in most ticks.
#[derive(Debug, Clone, Copy)]
struct Fine {
    horizon_steps: usize,
    window_steps: usize,
    iterations_max: u32,
}

const FINE: Fine = Fine { horizon_steps: 80, window_steps: 30, iterations_max: 4 };

const SETTINGS: [Settings; 4] = [
    Settings { file: "configs/fly.json", fine: None, qp: None },
    Settings { file: "configs/fly.json", fine: Some(FINE), qp: None },
    Settings { file: "configs/thesis/fly.json", fine: None, qp: None },
    Settings { file: "configs/thesis/fly.json", fine: None, qp: Some(QpKind::Riccati) },
];

/// Seed of the flight whose ticks are timed; the batch flies this and those that follow.
const SEED: u64 = 1001;

/// Flights of a pass of the batch.
const FLIGHTS: u64 = 6;

/// Ticks after which a flight is given up.
const TICKS_MAX: usize = 6000;

/// Goals: a tick at the median and at 99.9 %, in us, and flights in multiples of real time.
const GOALS: [f64; 3] = [500.0, 2000.0, 500.0];

/// Fraction of a tick by which two measurements of it may differ.
const NOISE: f64 = 0.05;

/// Times of one kind of flight.
#[derive(Debug, Default)]
struct Times {
    /// By tick, the least over passes: passes repeat each other, what differs is what else ran.
    tick_us: Vec<f64>,
    /// Longest of all passes.
    largest_us: f64,
    /// Of each pass.
    log_us: Vec<f64>,
    /// As `tick_us`, vehicle, links and bytes included.
    whole_us: Vec<f64>,
    /// Flights per second and multiples of real time, of each pass.
    flights_per_s: Vec<f64>,
    real_time: Vec<f64>,
}

/// Flies and times each of [`SETTINGS`].
///
/// # Errors
/// Settings that are refused, a log that cannot be written.
pub(super) fn run(bench: &Bench) -> Result<Findings> {
    let mut table =
        "| settings | ticks | median us | 99 % | 99.9 % | longest of all passes | log, us per tick \
                     | vehicle and links, us per tick | times real time without the tick | flights per s \
                     | times real time |\n|---|---|---|---|---|---|---|---|---|---|---|\n"
            .to_owned();
    let sim = tello_sim::settings(None)?;
    let mut raw = String::new();
    for Settings { file, fine, qp } in SETTINGS {
        let (mut fly, mission) = config::fly(Some(Path::new(file)), None)?;
        let (mpc, mhe) = (&mut fly.cycle.mpc, &mut fly.cycle.mhe);
        if let Some(Fine { horizon_steps, window_steps, iterations_max }) = fine {
            (mpc.horizon_steps, mpc.stages) = (horizon_steps, Vec::new());
            mhe.window_steps = window_steps;
            mpc.solver.iterations_max = iterations_max;
            mhe.solver.iterations_max = iterations_max;
        }
        mpc.solver.qp = qp.unwrap_or(mpc.solver.qp);
        let settings = format!(
            "{file}, window {}, horizon {} in {}, {:?}, up to {} iterations",
            mhe.window_steps,
            mpc.horizon_steps,
            if mpc.stages.is_empty() { "steps" } else { "stages" },
            mpc.solver.qp,
            mpc.solver.iterations_max
        );
        let flight = config::flight(&fly, mission, Start::Airborne);
        let records = record(&flight, &sim, SEED)?;
        let mut times = Times::default();
        for pass in 0..bench.repetitions {
            let tick_us = tick(&flight, &records)?;
            let us = sorted(tick_us.clone());
            let [median, p99, least] = [0.5, 0.99, 0.0].map(|fraction| quantile(&us, fraction));
            let count = us.len();
            writeln!(
                raw,
                "\"tick\",\"{settings}\",{pass},{count},{median:.3},{p99:.3},{least:.3}"
            )?;
            times.largest_us = tick_us.iter().copied().fold(times.largest_us, f64::max);
            keep_least(&mut times.tick_us, tick_us);
            keep_least(&mut times.whole_us, whole(&flight, &sim, records.len())?);
            times.log_us.push(log(bench, &flight, &records)?);
            let (flights_per_s, real_time) = batch(&flight, &sim)?;
            times.flights_per_s.push(flights_per_s);
            times.real_time.push(real_time);
        }
        let world_us = mean(&times.whole_us) - mean(&times.tick_us);
        let tick_us = sorted(times.tick_us);
        let [median, p99, p999] = [0.5, 0.99, 0.999].map(|fraction| quantile(&tick_us, fraction));
        let [log_us, flights_per_s, real_time] =
            [times.log_us, times.flights_per_s, times.real_time]
                .map(|values| quantile(&sorted(values), 0.5));
        let (ticks, largest_us) = (records.len(), times.largest_us);
        let without_tick = without_tick(flight.cycle.dt_s * 1e6, world_us, median);
        writeln!(
            table,
            "| {settings} | {ticks} | {median:.0} ({}) | {p99:.0} | {p999:.0} ({}) | {largest_us:.0} | {log_us:.1} \
             | {without_tick} | {flights_per_s:.2} | {real_time:.0} ({}) |",
            verdict(median <= GOALS[0], "500"),
            verdict(p999 <= GOALS[1], "2000"),
            verdict(real_time >= GOALS[2], "500"),
        )?;
    }
    Ok(Findings { table, raw })
}

/// Cells for the time of a period outside of the tick, and for the multiple of real time that it alone would
/// allow; dashes where that time is lost in the noise of the tick's.
fn without_tick(period_us: f64, world_us: f64, tick_us: f64) -> String {
    if world_us < NOISE * tick_us {
        return "- | -".to_owned();
    }
    let real_time = period_us / world_us;
    format!("{world_us:.1} | {real_time:.0} ({})", verdict(real_time >= GOALS[2], "500"))
}

fn verdict(is_met: bool, goal: &str) -> String {
    format!("goal {goal} {}", if is_met { "met" } else { "**missed**" })
}

/// Whether the flight is over: it was running and is over.
fn is_over(was_flying: &mut bool, phase: Phase) -> bool {
    let is_flying = phase == Phase::Flying;
    let is_over = *was_flying && !is_flying;
    *was_flying |= is_flying;
    is_over
}

/// Input and output of each tick of a flight.
fn record(flight: &FlightTable, sim: &SimTable, seed: u64) -> Result<Vec<TickRecord>> {
    let mut virtual_flight = VirtualFlight::new(flight, sim, seed)?;
    let (mut records, mut was_flying) = (Vec::new(), false);
    for _ in 0..TICKS_MAX {
        let out = virtual_flight.tick()?.clone();
        let is_over = is_over(&mut was_flying, out.phase());
        let inbox = virtual_flight.inbox().clone();
        let timing = Timing { step: inbox.step, ..Timing::default() };
        records.push(TickRecord { inbox, out, timing });
        if is_over {
            break;
        }
    }
    Ok(records)
}

/// Times of the ticks of one flight. us
fn tick(flight: &FlightTable, records: &[TickRecord]) -> Result<Vec<f64>> {
    let mut cycle = cycle::build(flight)?;
    let mut out = cycle.new_outcome();
    let clock = Clock::start();
    let timed = records.iter().map(|record| {
        let start = clock.now();
        cycle.tick(&record.inbox, &mut Unwatched::default(), &mut out);
        clock.now().since(start).seconds() * 1e6
    });
    Ok(timed.collect())
}

/// Keeps the least time of each tick.
fn keep_least(least_us: &mut Vec<f64>, us: Vec<f64>) {
    if least_us.is_empty() {
        *least_us = us;
    } else {
        least_us.iter_mut().zip(us).for_each(|(least, us)| *least = least.min(us));
    }
}

/// Times of the first `ticks` ticks of the recorded flight, vehicle, links and bytes included. us
fn whole(flight: &FlightTable, sim: &SimTable, ticks: usize) -> Result<Vec<f64>> {
    let mut virtual_flight = VirtualFlight::new(flight, sim, SEED)?;
    let clock = Clock::start();
    let timed = (0..ticks).map(|_| {
        let start = clock.now();
        virtual_flight.tick()?;
        Ok(clock.now().since(start).seconds() * 1e6)
    });
    timed.collect()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Time per tick of writing the log, compression and file included. us
fn log(bench: &Bench, flight: &FlightTable, records: &[TickRecord]) -> Result<f64> {
    let path = bench.workshop.path("bench.mcap");
    if path.exists() {
        std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
    }
    let first = records.first().context("a flight without a tick")?;
    let clock = Clock::start();
    let mut log = flight_log::create(&path, flight, 0, &first.out)?;
    for record in records {
        flight_log::write_tick(&mut log, record)?;
    }
    log.finish()?;
    Ok(clock.now().seconds() * 1e6 / records.len() as f64)
}

/// Flights per second, and virtual over real time.
fn batch(flight: &FlightTable, sim: &SimTable) -> Result<(f64, f64)> {
    let clock = Clock::start();
    let mut ticks = 0_u32;
    for seed in SEED..SEED + FLIGHTS {
        let mut virtual_flight = VirtualFlight::new(flight, sim, seed)?.without_plan();
        let mut was_flying = false;
        for _ in 0..TICKS_MAX {
            ticks += 1;
            if is_over(&mut was_flying, virtual_flight.tick()?.phase()) {
                break;
            }
        }
    }
    let taken_s = clock.now().seconds();
    Ok((FLIGHTS as f64 / taken_s, f64::from(ticks) * flight.cycle.dt_s / taken_s))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_tick_has_its_least_time_of_all_passes() {
        let mut least_us = Vec::new();
        for pass_us in [[3.0, 1.0], [2.0, 4.0], [5.0, 0.5]] {
            keep_least(&mut least_us, pass_us.to_vec());
        }
        assert_eq!(least_us, [2.0, 0.5]);
    }

    #[test]
    fn a_time_that_is_lost_in_the_noise_is_not_printed() {
        assert_eq!(without_tick(20_000.0, NOISE * 50.0 - 1e-9, 50.0), "- | -");
        assert_eq!(without_tick(20_000.0, 10.0, 50.0), "10.0 | 2000 (goal 500 met)");
        assert_eq!(without_tick(20_000.0, 80.0, 50.0), "80.0 | 250 (goal 500 **missed**)");
    }

    #[test]
    fn a_flight_is_over_when_it_flew_and_flies_no_more() {
        let phases = [Phase::Idle, Phase::TakingOff, Phase::Flying, Phase::Flying, Phase::Landing];
        let mut was_flying = false;
        let over = phases.map(|phase| is_over(&mut was_flying, phase));
        assert_eq!(over, [false, false, false, false, true]);
    }
}
