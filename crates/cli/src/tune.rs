//! `tello-ctl tune`: numbers of a configuration that fly better.
//!
//! Owns the command: what is tried, which progress is printed, what is written. The search is `tello_sim::tuning`.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::Args;
use serde::Serialize;
use tello_eval::Stopped;
use tello_flight::Start;
use tello_flight::cycle::FlightTable;
use tello_io::atomic_file::{self, write_json};
use tello_io::clock::Clock;
use tello_io::config;
use tello_sim::tuning::{
    Scale, Setup, Trial, Variable, VariableRange, WeightArgument, Weights, best, minimize,
};

use crate::interrupt::Interrupt;
use crate::sim::{WorldArguments, seeds_from};
use crate::{Verdict, stdio};

/// Search numbers in a configuration by flying batches.
///
/// Every try flies the same seeds in virtual time; its cost is the mean over flights of the time from
/// entering the first target to reaching the last, by the true pose, plus the penalties of --weigh. Writes
/// the best configuration, complete, and its mission beside it. Judge it on other seeds than it was
/// tuned on. Equal arguments write equal files.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl tune configs/fly.json --over-log cycle.mpc.C_u[0]+cycle.mpc.C_u[1]=0.1..10
  tello-ctl tune configs/fly.json --over cycle.mpc.C_u[3]=1..10 --profile outages
  tello-ctl sim --batch 200 --seed 1001 --config configs/fly.tuned.json --against configs/fly.json

Exit codes: 0 tuned, 1 nothing better was found or Ctrl-C came first, 2 could not run.")]
pub(crate) struct Arguments {
    /// Settings of the flight to start from.
    config: PathBuf,
    #[command(flatten)]
    world: WorldArguments,
    /// Targets, in place of those of the settings.
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
    /// A number to search, and where. KEY is a path as messages write it, e.g. `cycle.mpc.C_u[0]`, or
    /// begins with `mission` for what is flown; several joined with + get one value. Repeatable.
    #[arg(long, value_name = "KEY=LO..HI")]
    over: Vec<VariableRange>,
    /// The same, searched by its logarithm: for weights.
    #[arg(long, value_name = "KEY=LO..HI")]
    over_log: Vec<VariableRange>,
    /// Penalties of a flight beside its time: `distance` (s per m of its median horizontal distance
    /// to the outline), `distance_p95` (of its 95 % quantile), `overshoot` (s per m of its mean overshoot),
    /// `outside` (s if it was further than 0.3 m off), `unfinished` (s in place of the time, and the
    /// most for it). Beyond 0.5 m nothing costs more; a flight that never begins or ends with a fault
    /// costs the most that a flight can. Repeatable; [default: `distance=40`, `distance_p95=20`,
    /// `overshoot=20`, `outside=5`, `unfinished=60`].
    #[arg(long, value_name = "WHAT=NUMBER")]
    weigh: Vec<WeightArgument>,
    /// Flights of one try.
    #[arg(long, value_name = "N", default_value_t = 24)]
    #[arg(value_parser = clap::value_parser!(u64).range(1..=10_000))]
    flights: u64,
    /// Seed of the first flight of each try.
    #[arg(long, default_value_t = 500_001)]
    seed: u64,
    /// Most tries.
    #[arg(long, value_name = "N", default_value_t = 60)]
    #[arg(value_parser = clap::value_parser!(u16).range(2..))]
    tries: u16,
    /// First change of each number, as a fraction of its range.
    #[arg(long, value_name = "FRACTION", default_value_t = 0.2)]
    step: f64,
    /// Where to write the best configuration [default: beside CONFIG, as NAME.tuned.json].
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Replace a configuration and a mission that exist.
    #[arg(long)]
    force: bool,
    /// Threads; 0 for all cores.
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = crate::thread_count())]
    threads: usize,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// Result of the search.
#[derive(Debug, Serialize)]
struct Summary {
    /// The number of tries, and whether Ctrl-C ended them.
    tries: usize,
    is_interrupted: bool,
    /// Cost of the configuration as it was, and of the best. s
    cost_before: f64,
    /// s
    cost: f64,
    /// Weights of the cost.
    weights: Weights,
    /// Every number, before and after.
    numbers: Vec<Number>,
    /// The configuration and the mission that were written; empty if nothing was better.
    written: Vec<PathBuf>,
}

/// A number of the configuration, in the unit of its key.
#[derive(Debug, Serialize)]
struct Number {
    key: String,
    before: f64,
    after: f64,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    check_arguments(arguments)?;
    let (mut table, mission) = config::fly(Some(&arguments.config), arguments.mission.as_deref())?;
    let before = config::flight(&table, mission, Start::Airborne);
    let interrupt = Interrupt::listen()?;
    let setup = Setup {
        document: serde_json::to_value(&before)?,
        variables: variables(arguments)?,
        weights: Weights::new(&arguments.weigh),
        sim: arguments.world.table()?,
        seeds: seeds_from(arguments.seed, arguments.flights)?,
    };
    let start = setup.start()?;
    let out = output_path(arguments)?;
    let trials = search(arguments, &setup, &start, &interrupt)?;
    let [first, ..] = &trials[..] else {
        return Err(Stopped("the first try was over").into());
    };
    let best = best(&trials).unwrap_or(first);
    if trials.iter().all(|trial| trial.cost.to_bits() == first.cost.to_bits()) {
        let keys: Vec<&str> = setup.variables.iter().map(Variable::name).collect();
        stdio::note(format_args!(
            "note: every try costs the same: this mission does not depend on {}",
            keys.join(", ")
        ));
    }
    let mut summary = summary(&setup, &trials, first, best)?;
    summary.is_interrupted = interrupt.is_asked();
    if best.cost < first.cost {
        let flight = config::from_value(&setup.flight(&best.x)?)?;
        summary.written = save(&out, arguments.force, &mut table, flight)?;
    }
    print(&summary, arguments.json)?;
    let is_good = best.cost < first.cost && !summary.is_interrupted;
    Ok(if is_good { Verdict::Good } else { Verdict::Bad })
}

/// Refuses a step outside of its range, and an output that would replace the settings.
fn check_arguments(arguments: &Arguments) -> Result<()> {
    if !(arguments.step > 0.0 && arguments.step <= 0.5) {
        bail!("--step {}: expected above 0, at most 0.5", arguments.step);
    }
    let is_config = |out: &PathBuf| {
        let whole = |path: &PathBuf| path.canonicalize().unwrap_or_else(|_| path.clone());
        whole(out) == whole(&arguments.config)
    };
    if let Some(out) = arguments.out.as_ref().filter(|out| is_config(out)) {
        bail!("--out {} would replace the settings that it starts from", out.display());
    }
    Ok(())
}

/// Where the settings go, once it is sure that they and the mission beside them can be written.
fn output_path(arguments: &Arguments) -> Result<PathBuf> {
    let beside = || arguments.config.with_extension("tuned.json");
    let out = arguments.out.clone().unwrap_or_else(beside);
    for path in [&out, &mission_beside(&out)] {
        atomic_file::prepare(path, arguments.force)?;
    }
    Ok(out)
}

/// Every try from `start` on, with a line about each unless the summary is to be JSON.
fn search(
    arguments: &Arguments,
    setup: &Setup,
    start: &[f64],
    interrupt: &Interrupt,
) -> Result<Vec<Trial>> {
    let clock = Clock::start();
    let tries = usize::from(arguments.tries);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    pool.install(|| {
        minimize(start, arguments.step, tries, &mut |x, trials| {
            let cost = setup.cost(x, &|| interrupt.is_asked());
            match &cost {
                Ok(Some(cost)) if !arguments.json => {
                    print_try(&setup.variables, x, *cost, trials, tries, clock.now().seconds());
                }
                Err(reason) if !trials.is_empty() => {
                    stdio::note(format_args!("refused: {reason:#}"));
                }
                _ => {}
            }
            cost
        })
    })
}

fn variables(arguments: &Arguments) -> Result<Vec<Variable>> {
    let linear = arguments.over.iter().map(|range| Variable::new(range, Scale::Linear));
    let log = arguments.over_log.iter().map(|range| Variable::new(range, Scale::Logarithmic));
    let variables: Vec<Variable> = linear.chain(log).collect::<Result<_>>()?;
    if variables.is_empty() {
        bail!("nothing to search: name numbers with --over or --over-log");
    }
    let mut known = BTreeSet::new();
    if let Some(twice) = variables.iter().flat_map(Variable::places).find(|at| !known.insert(*at)) {
        bail!("{twice} is searched twice: give it one range");
    }
    Ok(variables)
}

/// The result of `trials`; nothing was written and nothing interrupted so far.
fn summary(setup: &Setup, trials: &[Trial], first: &Trial, best: &Trial) -> Result<Summary> {
    let after = setup.flight(&best.x)?;
    let number = |variable: &Variable| -> Result<Number> {
        let (before, after) = (variable.value(&setup.document)?, variable.value(&after)?);
        Ok(Number { key: variable.name().to_owned(), before, after })
    };
    Ok(Summary {
        tries: trials.len(),
        is_interrupted: false,
        cost_before: first.cost,
        cost: best.cost,
        weights: setup.weights,
        numbers: setup.variables.iter().map(number).collect::<Result<_>>()?,
        written: Vec::new(),
    })
}

/// A line about the try at `x`, which comes after `trials`.
fn print_try(
    variables: &[Variable],
    x: &[f64],
    cost: f64,
    trials: &[Trial],
    tries: usize,
    elapsed_s: f64,
) {
    let done = trials.len() + 1;
    let best = best(trials).map_or(cost, |best| best.cost.min(cost));
    let left_s = elapsed_s / done as f64 * (tries - done) as f64;
    let numbers: Vec<String> = variables
        .iter()
        .zip(x)
        .map(|(variable, fraction)| {
            format!("{} {:.4}", variable.name(), variable.value_at(*fraction))
        })
        .collect();
    stdio::note(format_args!(
        "{done:>4}/{tries}  cost {cost:.3} s, best {best:.3} s, at most {left_s:.0} s left: {}",
        numbers.join(", ")
    ));
}

/// Where the mission of the settings at `out` goes.
fn mission_beside(out: &Path) -> PathBuf {
    out.with_extension("mission.json")
}

/// Writes the settings to `out` and the mission beside it.
fn save(
    out: &Path,
    is_replaced: bool,
    table: &mut config::FlyTable,
    flight: FlightTable,
) -> Result<Vec<PathBuf>> {
    let mission = mission_beside(out);
    let name = mission.file_name().context("--out needs a file name")?;
    table.mission = PathBuf::from(name);
    table.cycle = flight.cycle;
    write_json(&mission, is_replaced, &flight.mission)?;
    write_json(out, is_replaced, table)?;
    Ok(vec![out.to_owned(), mission])
}

fn print(summary: &Summary, is_json: bool) -> Result<()> {
    if is_json {
        return stdio::line(serde_json::to_string(summary)?);
    }
    let Summary { tries, cost_before, cost, numbers, written, .. } = summary;
    stdio::line(format_args!("cost {cost_before:.3} s before, {cost:.3} s after {tries} tries"))?;
    for Number { key, before, after } in numbers {
        stdio::line(format_args!("{key:<40} {before:>10.4} -> {after:.4}"))?;
    }
    match &written[..] {
        [] => stdio::line("nothing better was found"),
        [config, ..] => stdio::line(format_args!("written to {}", config.display())),
    }
}

#[cfg(test)]
mod tests;
