//! `tello-ctl sim`: the simulator alone, or batches of flights in virtual time.

use std::net::SocketAddr;
use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use serde_json::json;
use tello_control::Start;
use tello_sim::{Emulator, Profile, SimTable, World};

use crate::{Verdict, batch, config, parameter_file};

/// A drone on UDP and a mocap relay on TCP for any client; with --batch, seeded flights.
///
/// Without --batch the emulators run until Ctrl-C. With --batch N the controller flies N seeds in
/// virtual time on all cores and prints finish times, distances and the share within 0.3 m; equal
/// arguments print equal bytes.
#[derive(Debug, Args)]
pub(crate) struct Arguments {
    /// Settings of the simulator [default: the built-in configs/sim.json].
    #[arg(long, value_name = "FILE")]
    sim_config: Option<PathBuf>,
    /// Identified parameters (model lagged): the vehicle to simulate, in place of the settings' one. Its
    /// disturbance, and its spread over seeds, stay those of the settings.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// Measurement and link faults, in place of the settings' profile: `clean`, `good_day`,
    /// `typical`, `bad_day`, `mild_outages` or `outages`.
    #[arg(long)]
    profile: Option<Profile>,
    /// Seed of the flight, or of the first flight of a batch.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Fly this many seeds in virtual time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    batch: Option<u64>,
    /// Settings of the controller in a batch [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE", requires = "batch")]
    config: Option<PathBuf>,
    /// Targets in a batch, in place of those of the settings.
    #[arg(long, value_name = "FILE", requires = "batch")]
    targets: Option<PathBuf>,
    /// Where the drone listens (UDP), without --batch.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8889")]
    drone_address: SocketAddr,
    /// Where the mocap relay listens (TCP), without --batch.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:51602")]
    relay_address: SocketAddr,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The simulator's settings with the profile of the command line.
pub(crate) fn resolve(file: Option<&PathBuf>, profile: Option<Profile>) -> Result<SimTable> {
    let mut table = config::sim(file.map(PathBuf::as_path))?;
    table.profile = profile.unwrap_or(table.profile);
    Ok(table)
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let mut sim = resolve(arguments.sim_config.as_ref(), arguments.profile)?;
    parameter_file::apply(arguments.params.as_deref(), &mut sim.plant)?;
    let Some(count) = arguments.batch else {
        return serve(&sim, arguments);
    };
    let (fly, targets) = config::fly(arguments.config.as_deref(), arguments.targets.as_deref())?;
    let flight = config::flight(&fly, targets, Start::Airborne);
    let result = batch::fly_batch(&flight, &sim, arguments.seed, count, !arguments.json)?;
    if arguments.json {
        println!("{}", serde_json::to_string(&result)?);
    } else {
        print!("{result}");
    }
    Ok(Verdict::Good)
}

/// Runs the emulators until Ctrl-C.
fn serve(sim: &SimTable, arguments: &Arguments) -> Result<Verdict> {
    let world = World::new(sim, arguments.seed)?;
    let emulator = Emulator::start(world, arguments.drone_address, arguments.relay_address)?;
    let addresses = json!({
        "drone": emulator.drone_address(),
        "relay": emulator.relay_address(),
        "object": sim.object,
    });
    if arguments.json {
        println!("{addresses}");
    } else {
        println!("drone on UDP {}", emulator.drone_address());
        println!("relay on TCP {}, object {:?}", emulator.relay_address(), sim.object);
        println!("Ctrl-C stops");
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(tokio::signal::ctrl_c())?;
    emulator.stop()?;
    Ok(Verdict::Good)
}
