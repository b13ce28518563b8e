//! `tello-ctl sim`: the simulator alone, or batches of flights in virtual time.

use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, Result, bail};
use clap::{Args, ValueEnum};
use serde_json::json;
use tello_eval::figure::{self, SeenFlights};
use tello_eval::parameter_file;
use tello_flight::Start;
use tello_io::config;
use tello_sim::batch::{self, Batch, Comparison, Contender, Flown};
use tello_sim::campaign::{Campaign, Family};
use tello_sim::plant::{PlantTable, RIGID_BODY};
use tello_sim::{Emulator, MocapAddresses, Profile, SimTable, World};

use crate::interrupt::Interrupt;
use crate::{Verdict, progress, stdio};

/// Most flights in a figure: more are a blot.
const FIGURE_FLIGHTS_MAX: usize = 30;

/// A drone and a mocap system on sockets for any client; with --batch, seeded flights.
///
/// Without --batch the emulators run until Ctrl-C. With --batch N the controller flies N seeds in
/// virtual time on all cores. The table judges by the true pose: targets in order, each within reach
/// (norm over x, y, z and theta); the clock runs from the tick in which the controller reaches its first
/// target until the true pose reaches the last. Equal arguments print equal bytes.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl sim --batch 200 --seed 1001 --profile good_day           the table
  tello-ctl sim --batch 200 --seed 1001 --against configs/thesis/fly.json
                                                      two configurations, seed by seed
  tello-ctl sim --batch 200 --vary gain=0.7 --vary dead_time=+0.1    is it robust?
  tello-ctl sim --batch 200 --hover 30                               does it stand still?
  tello-ctl sim --batch 200 --campaign                               does it come down, whatever breaks?
  tello-ctl sim --batch 200 --campaign --family ghost                one kind of fault alone
  tello-ctl sim --batch 30 --figure tracks                           tracks.svg and tracks.png

Exit codes: 0 done, 1 Ctrl-C came first or a campaign found something, 2 could not run.")]
pub(crate) struct Arguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Seed of the flight, or of the first flight of a batch.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Fly this many seeds in virtual time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=100_000))]
    batch: Option<u64>,
    /// Settings of the controller in a batch [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE", requires = "batch")]
    config: Option<PathBuf>,
    /// What to fly in a batch, in place of the mission of the settings.
    #[arg(long, value_name = "FILE", requires = "batch")]
    mission: Option<PathBuf>,
    /// Settings of a second controller that flies the same seeds: both tables, and the differences
    /// within the seeds with their 95 % intervals (bootstrap over the seeds).
    #[arg(long, value_name = "FILE", requires = "batch")]
    against: Option<PathBuf>,
    /// Hover at the first target for so long, in place of the reference; errors count from 2 s after the
    /// arrival on.
    #[arg(long, value_name = "SECONDS", requires = "batch", conflicts_with = "against")]
    hover: Option<f64>,
    /// Let each vehicle fly so often before, and begin with the vehicle file that these flights leave.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "batch")]
    earlier: u32,
    /// Take off in each flight of a batch, and let one to three faults of random families and sizes
    /// happen in it, to a drone that may differ from what is assumed of it. The table counts how the
    /// flights ended, what was detected and after which time and way, and names the seeds that left the
    /// room further than it takes to stop while the drone obeyed, were steered while landing, or had no
    /// end.
    #[arg(long, requires = "batch", conflicts_with_all = ["against", "hover", "figure", "earlier"])]
    campaign: bool,
    /// Draw the faults of a campaign from one family alone: one fault in each flight.
    #[arg(long, value_name = "NAME", requires = "campaign")]
    family: Option<Family>,
    /// Draw the true tracks of the first 30 flights from above, as NAME.svg and NAME.png.
    #[arg(long, value_name = "NAME", requires = "batch")]
    figure: Option<PathBuf>,
    /// Threads of a batch; 0 for all cores.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "batch")]
    threads: usize,
    /// Where the drone listens (UDP), without --batch. It speaks what it hears first, the text SDK or the
    /// binary protocol, until it is started anew.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8889")]
    drone_address: SocketAddr,
    /// Where the mocap relay listens (TCP), without --batch.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:51602")]
    relay_address: SocketAddr,
    /// Where the mocap's DataStream server listens (TCP), without --batch. Vicon's own port, 801, is
    /// reserved for root.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8801")]
    datastream_address: SocketAddr,
    /// Where the mocap sends its UDP object stream to, without --batch.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:51001")]
    udp_target: SocketAddr,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

/// The world that is flown in.
#[derive(Debug, Args)]
pub(crate) struct WorldArguments {
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
    /// Change the vehicle of every seed after its draw, beside the settings' variation: `gain=0.7`
    /// (factor of the horizontal gain), `dead_time=+0.1` (added to every dead time, which stays at 0 or
    /// above; s), `lag=1.4` (factor of the horizontal time constant), `theta_0=-0.3` (added; rad).
    /// Repeatable. With a rigid body also `wind=0.5` (added to the mean speed of the wind, whose direction each seed
    /// draws; m/s) and `flow=0.1` (added to the deviation of the optical flow's error; m/s).
    #[arg(long, value_name = "WHAT=NUMBER")]
    vary: Vec<Vary>,
    /// Structure of the vehicle: `fitted` (first-order lags, as fitted to real flights) or `rigid_body`
    /// (attitude and velocity loops, drag, gusts, drifting optical flow, weakening motors) [default: that
    /// of the settings].
    #[arg(long)]
    plant: Option<PlantKind>,
}

/// Structure of the simulated vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
#[value(rename_all = "snake_case")]
pub(crate) enum PlantKind {
    /// First-order lags.
    Fitted,
    /// A rigid body with attitude and velocity loops.
    RigidBody,
}

impl PlantKind {
    /// Gives `plant` this structure. A rigid body of the settings stays as it is set.
    pub(crate) fn apply(self, plant: &mut PlantTable) {
        plant.rigid_body = match self {
            Self::Fitted => None,
            Self::RigidBody => Some(plant.rigid_body.unwrap_or(RIGID_BODY)),
        };
    }
}

/// One change of the command line to the vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Vary {
    Gain(f64),
    DeadTime(f64),
    Lag(f64),
    Theta0(f64),
    Wind(f64),
    Flow(f64),
}

impl FromStr for Vary {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let (what, number) = text.split_once('=').context("no `=`: WHAT=NUMBER")?;
        let number = number.parse().with_context(|| format!("{number:?} is no number"))?;
        Ok(match what {
            "gain" => Self::Gain(number),
            "dead_time" => Self::DeadTime(number),
            "lag" => Self::Lag(number),
            "theta_0" => Self::Theta0(number),
            "wind" => Self::Wind(number),
            "flow" => Self::Flow(number),
            _ => bail!("{what:?} cannot be varied: gain, dead_time, lag, theta_0, wind or flow"),
        })
    }
}

impl Vary {
    /// # Errors
    /// Wind or optical flow, where the vehicle is no rigid body.
    fn apply(self, table: &mut SimTable) -> Result<()> {
        let SimTable { variation, plant, .. } = table;
        let body = plant.rigid_body.as_mut();
        let no_body = "--vary wind=.. and flow=.. need --plant rigid_body";
        match self {
            Self::Gain(factor) => variation.gain *= factor,
            Self::DeadTime(more_s) => variation.dead_time_s += more_s,
            Self::Lag(factor) => variation.lag *= factor,
            Self::Theta0(more_rad) => variation.theta_0 += more_rad,
            Self::Wind(more_mps) => body.context(no_body)?.wind_mps += more_mps,
            Self::Flow(more_mps) => body.context(no_body)?.flow_drift_mps += more_mps,
        }
        Ok(())
    }
}

impl WorldArguments {
    /// The simulator's settings with what the command line replaces.
    ///
    /// # Errors
    /// A file that cannot be read or does not fit. Values are checked when a world is built.
    pub(crate) fn table(&self) -> Result<SimTable> {
        let mut table = resolve(self.sim_config.as_ref(), self.profile)?;
        parameter_file::apply(self.params.as_deref(), &mut table.plant)?;
        if let Some(kind) = self.plant {
            kind.apply(&mut table.plant);
        }
        for vary in &self.vary {
            vary.apply(&mut table)?;
        }
        Ok(table)
    }
}

/// The simulator's settings with the profile of the command line.
pub(crate) fn resolve(file: Option<&PathBuf>, profile: Option<Profile>) -> Result<SimTable> {
    let mut table = tello_sim::settings(file.map(PathBuf::as_path))?;
    table.profile = profile.unwrap_or(table.profile);
    Ok(table)
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let sim = arguments.world.table()?;
    match arguments.batch {
        Some(count) if arguments.campaign => fly_campaign(arguments, &sim, count),
        Some(count) => fly_batch(arguments, &sim, count),
        None => serve(&sim, arguments),
    }
}

/// Flies `count` seeds and prints what they were worth.
fn fly_batch(arguments: &Arguments, sim: &SimTable, count: u64) -> Result<Verdict> {
    if let Some(hover_s) = arguments.hover
        && !(hover_s > 0.0 && hover_s <= 600.0)
    {
        bail!("--hover {hover_s} violates 0..=600 s");
    }
    let contender = |config: Option<&Path>| -> Result<Contender> {
        let (fly, mission) = config::fly(config, arguments.mission.as_deref())?;
        let flight = config::flight(&fly, mission, Start::Airborne);
        Ok(Contender::new(flight, arguments.hover)?.after(arguments.earlier))
    };
    let mut contenders = vec![contender(arguments.config.as_deref())?];
    if let Some(against) = &arguments.against {
        contenders.push(contender(Some(against))?);
    }
    let seeds = arguments.seed..arguments.seed.saturating_add(count);
    let interrupt = Interrupt::listen()?;
    let bar = progress::of_seeds(count, !arguments.json)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let flown = pool.install(|| {
        batch::fly(&contenders, sim, seeds, &|| interrupt.is_asked(), &|| bar.inc(1))
    })?;
    bar.finish_and_clear();
    let done = flown.first().map_or(0, Vec::len);
    if done == 0 {
        bail!("stopped before the first flight was over");
    }
    if let Some(name) = &arguments.figure {
        draw(name, &contenders, &flown)?;
    }
    let batches: Vec<Batch> = flown.iter().map(|flown| Batch::of(flown)).collect();
    print(batches, arguments)?;
    if interrupt.is_asked() {
        stdio::note(format_args!("stopped after {done} of {count} seeds"));
        return Ok(Verdict::Bad);
    }
    Ok(Verdict::Good)
}

/// Flies `count` seeds with random faults and prints how they ended.
fn fly_campaign(arguments: &Arguments, sim: &SimTable, count: u64) -> Result<Verdict> {
    let (fly, mission) = config::fly(arguments.config.as_deref(), arguments.mission.as_deref())?;
    let flight = config::flight(&fly, mission, Start::Grounded);
    let seeds = arguments.seed..arguments.seed.saturating_add(count);
    let bar = progress::of_seeds(count, !arguments.json)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let campaign =
        pool.install(|| Campaign::fly(&flight, sim, seeds, arguments.family, &|| bar.inc(1)))?;
    bar.finish_and_clear();
    stdio::report(&campaign, arguments.json)?;
    Ok(if campaign.is_clean() { Verdict::Good } else { Verdict::Bad })
}

/// Prints one batch, or two and their differences.
fn print(batches: Vec<Batch>, arguments: &Arguments) -> Result<()> {
    let mut batches = batches.into_iter();
    let (Some(config), against) = (batches.next(), batches.next()) else { return Ok(()) };
    match against {
        Some(against) => {
            stdio::report(&Comparison::of(config, against, arguments.seed), arguments.json)
        }
        None => stdio::report(&config, arguments.json),
    }
}

/// Draws the first flights of each contender over the outline.
fn draw(name: &Path, contenders: &[Contender], flown: &[Vec<Flown>]) -> Result<()> {
    let stem = name.file_stem().context("--figure needs a name")?.to_string_lossy();
    let outlines: Vec<Vec<(f64, f64)>> = contenders.iter().map(Contender::outline).collect();
    let shown = flown.iter().map(|flown| flown.iter().take(FIGURE_FLIGHTS_MAX));
    let tracks: Vec<Vec<&[(f64, f64)]>> =
        shown.map(|shown| shown.map(|flown| &*flown.track_w).collect()).collect();
    let seen: Vec<SeenFlights<'_>> = ["config", "against"]
        .into_iter()
        .zip(&outlines)
        .zip(&tracks)
        .map(|((name, outline), tracks)| SeenFlights { name, outline, tracks })
        .collect();
    let title = format!(
        "{stem}: true tracks of {} flights from above",
        tracks.iter().map(Vec::len).max().unwrap_or(0)
    );
    figure::save(name.parent().unwrap_or(Path::new("")), &stem, &figure::tracks(&title, &seen))?;
    Ok(())
}

/// Runs the emulators until Ctrl-C.
fn serve(sim: &SimTable, arguments: &Arguments) -> Result<Verdict> {
    let world = World::new(sim, arguments.seed)?;
    let mocap = MocapAddresses {
        relay: Some(arguments.relay_address),
        datastream: Some(arguments.datastream_address),
        udp_target: Some(arguments.udp_target),
    };
    let emulator = Emulator::start(world, arguments.drone_address, mocap)?;
    let MocapAddresses { relay, datastream, udp_target } = emulator.mocap();
    let addresses = json!({
        "drone": emulator.drone_address(),
        "relay": relay,
        "datastream": datastream,
        "udp_target": udp_target,
        "object": sim.object,
    });
    if arguments.json {
        stdio::line(addresses)?;
    } else {
        stdio::line(format_args!("drone on UDP {}", emulator.drone_address()))?;
        stdio::line(format_args!("object {:?} at {} Hz by", sim.object, 1.0 / tello_sim::DT_S))?;
        for (what, address) in [
            ("relay on TCP", relay),
            ("DataStream on TCP", datastream),
            ("object stream to UDP", udp_target),
        ] {
            if let Some(address) = address {
                stdio::line(format_args!("  {what} {address}"))?;
            }
        }
        stdio::line("Ctrl-C stops")?;
    }
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
    runtime.block_on(tokio::signal::ctrl_c())?;
    emulator.stop()?;
    Ok(Verdict::Good)
}

#[cfg(test)]
mod tests {
    use tello_sim::plant::VariationTable;

    use super::*;

    #[test]
    fn variations_move_what_they_say_and_add_up() {
        let mut table = tello_sim::settings(None).unwrap();
        for text in ["gain=0.7", "gain=2", "dead_time=+0.1", "lag=1.4", "theta_0=-0.3"] {
            text.parse::<Vary>().unwrap().apply(&mut table).unwrap();
        }
        let expected = VariationTable { gain: 1.4, dead_time_s: 0.1, lag: 1.4, theta_0: -0.3 };
        assert_eq!(table.variation, expected);
    }

    #[test]
    fn wind_and_optical_flow_need_a_rigid_body() {
        let mut table = tello_sim::settings(None).unwrap();
        let [wind, flow]: [Vary; 2] = ["wind=0.5", "flow=0.1"].map(|text| text.parse().unwrap());
        assert!(wind.apply(&mut table).is_err());
        PlantKind::RigidBody.apply(&mut table.plant);
        wind.apply(&mut table).unwrap();
        flow.apply(&mut table).unwrap();
        let body = table.plant.rigid_body.unwrap();
        assert_eq!(body.wind_mps, RIGID_BODY.wind_mps + 0.5);
        assert_eq!(body.flow_drift_mps, RIGID_BODY.flow_drift_mps + 0.1);
        PlantKind::Fitted.apply(&mut table.plant);
        assert_eq!(table.plant.rigid_body, None);
    }

    #[test]
    fn what_cannot_be_varied_is_refused() {
        for (text, reason) in
            [("gain", "no `=`"), ("gain=much", "is no number"), ("mass=2", "cannot be varied")]
        {
            let error = format!("{:#}", text.parse::<Vary>().unwrap_err());
            assert!(error.contains(reason), "{text}: {error}");
        }
    }
}
