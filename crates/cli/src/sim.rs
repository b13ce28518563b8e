//! `tello-ctl sim`: the simulator alone, or batches of flights in virtual time.

mod part;
mod serve;
mod world;

use std::net::{SocketAddr, SocketAddrV4};
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use clap::{ArgGroup, Args};
use serde_json::{Value, json};
use tello_eval::figure::{self, FigureFiles, SeenFlights};
use tello_eval::part_file::{Kind, PartNumber, Seeded};
use tello_flight::cycle::{self, FlightTable};
use tello_flight::{SPEED_AS_WRITTEN, Start};
use tello_io::config;
use tello_sim::batch::{self, Batch, Comparison, Contender, Flown};
use tello_sim::campaign::{self, Campaign, Family};
use tello_sim::{SimTable, logged_flight};

use self::part::Target;
pub(crate) use self::world::{WorldArguments, resolve};
use crate::interrupt::Interrupt;
use crate::progress::Seeds;
use crate::{Verdict, interrupt, stdio};

/// Most flights in a figure: more are a blot.
const FIGURE_FLIGHTS_MAX: usize = 30;

/// A drone and a mocap system on sockets for any client; with --batch, seeded flights.
///
/// Without --batch the emulators run until Ctrl-C. With --batch N the controller flies N seeds in
/// virtual time on all cores. The table judges by the true pose: targets in order, each within reach
/// (norm over x, y, z and theta); the clock runs from the tick in which the controller reaches its first
/// target until the true pose reaches the last. Equal arguments print equal bytes.
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("flown").args(["batch", "log"])))]
#[command(after_help = "Examples:
  tello-ctl sim --batch 200 --seed 1001 --profile good_day           the table
  tello-ctl sim --batch 200 --seed 1001 --against configs/thesis/fly.json
                                                      two configurations, seed by seed
  tello-ctl sim --batch 200 --vary gain=0.7 --vary dead_time=+0.1    is it robust?
  tello-ctl sim --batch 200 --hover 30                               does it stand still?
  tello-ctl sim --batch 200 --campaign                               does it come down, whatever breaks?
  tello-ctl sim --batch 200 --campaign --family still                one kind of fault alone
  tello-ctl sim --seed 1007 --log seed-1007.mcap                     one flight of a batch, to be looked at
  tello-ctl sim --campaign --seed 2597 --log seed-2597.mcap          one flight of a campaign
  tello-ctl sim --batch 30 --figure tracks                           tracks.svg and tracks.png

Exit codes: 0 done, 1 Ctrl-C came first, a campaign found something, or the one flight of --log missed a target or
was cut short, 2 could not run.")]
pub(crate) struct Arguments {
    #[command(flatten)]
    world: WorldArguments,
    /// Seed of the flight, or of the first flight of a batch.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Fly this many seeds in virtual time.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=10_000_000))]
    batch: Option<u64>,
    /// Fly the seed once in virtual time, as a batch or a campaign does, and leave its log here, for `report`,
    /// `replay` and `ident`.
    // What needs --batch is named too: a conflict with it lifts that need.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["batch", "against", "hover", "earlier", "figure",
        "threads", "shard", "force", "part"])]
    log: Option<PathBuf>,
    /// Settings of the controller in a batch [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE", requires = "flown")]
    config: Option<PathBuf>,
    /// What to fly in a batch, in place of the mission of the settings.
    #[arg(long, value_name = "FILE", requires = "flown")]
    mission: Option<PathBuf>,
    /// How fast the mission is flown in a batch, 0.1 to 1: 0.5 as it is written, 1 at the limit of the vehicle.
    #[arg(long, value_name = "SPEED", default_value_t = SPEED_AS_WRITTEN, requires = "flown")]
    speed: f64,
    /// Settings of a second controller that flies the same seeds: both tables, and the differences
    /// within the seeds with their 95 % intervals (bootstrap over the seeds).
    #[arg(long, value_name = "FILE", requires = "batch")]
    against: Option<PathBuf>,
    /// Hover at the first target for so long, in place of the reference path; errors count from 2 s after the
    /// arrival on.
    #[arg(long, value_name = "SECONDS", requires = "batch", conflicts_with = "against")]
    hover: Option<f64>,
    /// Let each vehicle fly so often before, and begin with the vehicle file that these flights leave.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "batch")]
    #[arg(value_parser = clap::value_parser!(u32).range(..=100))]
    earlier: u32,
    /// Take off in each flight of a batch, and let one to three faults of random families and sizes
    /// happen in it, to a drone that may differ from what is assumed of it. The table counts how the
    /// flights ended, what was detected and after which time and way, and names the seeds that left the
    /// room further than it takes to stop while the drone executed its orders, were steered while landing, or had no
    /// end.
    #[arg(long, requires = "flown", conflicts_with_all = ["against", "hover", "figure", "earlier"])]
    campaign: bool,
    /// Draw the faults of a campaign from one family alone: one fault in each flight.
    #[arg(long, value_name = "NAME", requires = "campaign")]
    family: Option<Family>,
    /// Draw the true tracks of the first 30 flights from above, as NAME.svg and NAME.png.
    #[arg(long, value_name = "NAME", requires = "batch")]
    figure: Option<PathBuf>,
    /// Replace a figure that exists.
    #[arg(long, requires = "figure")]
    force: bool,
    /// Threads of a batch; 0 for all cores.
    #[arg(long, value_name = "N", default_value_t = 0, requires = "batch")]
    #[arg(value_parser = crate::thread_count())]
    threads: usize,
    /// Fly only part I of N of the batch's seeds, into the file of --part: `2/8`. `tello-ctl merge` prints what one
    /// process prints.
    #[arg(long, value_name = "I/N", requires_all = ["batch", "part"], conflicts_with = "figure")]
    shard: Option<PartNumber>,
    /// The file of --shard. It appears when all of its flights are done; if it exists already, with the same settings
    /// and revision, nothing is flown.
    #[arg(long, value_name = "FILE", requires = "shard")]
    part: Option<PathBuf>,
    /// Run this many drones, without --batch: drone K listens at the IP address of the first plus K, with the next seed
    /// and the name of the object plus the number (`tello`, `tello2`, ..); so do its mocap servers.
    #[arg(long, value_name = "N", default_value_t = 1, conflicts_with = "batch",
        value_parser = clap::value_parser!(u8).range(1..=32))]
    drones: u8,
    /// Where the drone listens (UDP), without --batch. It speaks what it hears first, the text SDK or the
    /// binary protocol, until it is started anew.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:8889")]
    drone_address: SocketAddr,
    /// Where the mocap relay listens (TCP), without --batch.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:51602")]
    relay_address: SocketAddr,
    /// Where the mocap's DataStream server listens (TCP), without --batch. Vicon's own port, 801, is
    /// reserved for root.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:8801")]
    datastream_address: SocketAddr,
    /// Where the mocap sends its UDP object stream to, without --batch; with --drones the next drone sends to the next
    /// address.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:51001")]
    udp_target: SocketAddr,
    /// Where the mocap's NatNet server (OptiTrack) listens for questions (UDP), without --batch. Frames go to
    /// the clients that asked.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:1510")]
    natnet_address: SocketAddr,
    /// Send the frames of the NatNet server to this multicast group, in place of the clients that asked.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    natnet_group: Option<SocketAddrV4>,
    /// Where the mocap's QTM server (Qualisys) listens (TCP, little-endian), without --batch.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:22223")]
    qtm_address: SocketAddr,
    /// Where the mocap's VRPN server listens (TCP), without --batch.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "flown")]
    #[arg(default_value = "127.0.0.1:3883")]
    vrpn_address: SocketAddr,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let sim = arguments.world.table()?;
    if let Some(path) = &arguments.log {
        return fly_one(arguments, &sim, path);
    }
    match arguments.batch {
        Some(count) if arguments.campaign => fly_campaign(arguments, &sim, count),
        Some(count) => fly_batch(arguments, &sim, count),
        None => serve::run(&sim, arguments),
    }
}

/// Flight by the settings in `config`, or the built-in ones: an error names all mistakes of the files.
fn flight(arguments: &Arguments, config: Option<&Path>, start: Start) -> Result<FlightTable> {
    let mission = arguments.mission.as_deref();
    let (fly, table) = config::fly(config, mission)?;
    let flight = config::flight(&fly, table, start).at_speed(arguments.speed)?;
    cycle::build(&flight).map_err(|error| config::explain(error.into(), config, mission))?;
    Ok(flight)
}

/// Flies one seed and leaves its log. A flight of a campaign is good however it ends: the campaign judges.
fn fly_one(arguments: &Arguments, sim: &SimTable, path: &Path) -> Result<Verdict> {
    let seed = arguments.seed;
    let (start, sim) = if arguments.campaign {
        (Start::Grounded, campaign::world(seed, sim, arguments.family))
    } else {
        note_ignored(sim)?;
        (Start::Airborne, sim.clone())
    };
    let flight = flight(arguments, arguments.config.as_deref(), start)?;
    interrupt::leave_no_unfinished_file()?;
    let logged = logged_flight::fly(&flight, &sim, seed, path)?;
    stdio::report(&logged, arguments.json)?;
    Ok(if arguments.campaign || logged.is_success() { Verdict::Good } else { Verdict::Bad })
}

/// Notes what of `sim` makes no difference to flights in virtual time that begin in the air.
fn note_ignored(sim: &SimTable) -> Result<()> {
    let ignored = batch::ignored(sim)?;
    if !ignored.is_empty() {
        stdio::note(format_args!("not used without sockets: {}", ignored.join(", ")));
    }
    Ok(())
}

/// Flies `count` seeds and prints their metrics.
fn fly_batch(arguments: &Arguments, sim: &SimTable, count: u64) -> Result<Verdict> {
    if let Some(hover_s) = arguments.hover
        && !(hover_s > 0.0 && hover_s <= 600.0)
    {
        bail!("--hover {hover_s}: expected above 0, at most 600 s");
    }
    let contender = |config: Option<&Path>| -> Result<Contender> {
        let flight = flight(arguments, config, Start::Airborne)?;
        Ok(Contender::new(flight, arguments.hover)?.after(arguments.earlier))
    };
    note_ignored(sim)?;
    let mut contenders = vec![contender(arguments.config.as_deref())?];
    if let Some(against) = &arguments.against {
        contenders.push(contender(Some(against))?);
    }
    let settings = json!({
        "sim": sim,
        "contenders": contenders.iter().map(Contender::settings).collect::<Vec<_>>(),
    });
    let place = arguments
        .figure
        .as_deref()
        .map(|name| FigureFiles::of(name, arguments.force))
        .transpose()?;
    let fly = |seeds, watch: &SeedHooks<'_>| {
        let mut rows = batch::fly(&contenders, sim, seeds, watch.0, watch.1)?;
        if place.is_none() {
            // Tracks are long, only the figure draws them, and part files do not have them.
            rows.iter_mut().flatten().for_each(|flown| flown.track_w.clear());
        }
        Ok(rows)
    };
    in_parts(arguments, Kind::Batch, settings, count, fly, |rows| {
        let flown = batch::by_contender(rows);
        if let Some(place) = &place {
            draw(place, &names(arguments), &contenders, &flown)?;
        }
        print_batches(&flown, names(arguments), arguments.seed, arguments.json)?;
        Ok(Verdict::Good)
    })
}

/// Flies `count` seeds with random faults and prints how they ended.
fn fly_campaign(arguments: &Arguments, sim: &SimTable, count: u64) -> Result<Verdict> {
    let flight = flight(arguments, arguments.config.as_deref(), Start::Grounded)?;
    let settings = json!({ "sim": sim, "flight": flight, "family": arguments.family });
    let fly = |seeds, watch: &SeedHooks<'_>| {
        campaign::fly(&flight, sim, seeds, arguments.family, watch.0, watch.1)
    };
    in_parts(arguments, Kind::Campaign, settings, count, fly, |rows| {
        print_campaign(&Campaign::of(rows), arguments.json)
    })
}

/// Whether Ctrl-C came, and what is called after each seed.
struct SeedHooks<'a>(&'a (dyn Fn() -> bool + Sync), &'a (dyn Fn() + Sync));

/// Flies `count` seeds, or those of the part that is asked for; writes the part, or shows the rows. Bad after Ctrl-C.
fn in_parts<T: Seeded + Send>(
    arguments: &Arguments,
    kind: Kind,
    settings: Value,
    count: u64,
    fly: impl FnOnce(Range<u64>, &SeedHooks<'_>) -> Result<Vec<T>> + Send,
    show: impl FnOnce(Vec<T>) -> Result<Verdict>,
) -> Result<Verdict> {
    let mut seeds = seeds_from(arguments.seed, count)?;
    let target = Target::of(arguments, kind, settings, count);
    if let Some(target) = &target {
        if target.check_existing::<T>()? {
            return Ok(Verdict::Good);
        }
        seeds = target.header.seeds();
    }
    let count = seeds.end - seeds.start;
    let interrupt = Interrupt::listen()?;
    let seen = Seeds::of(count, !arguments.json)?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(arguments.threads).build()?;
    let watch = SeedHooks(&|| interrupt.is_asked(), &|| seen.advance());
    let rows = pool.install(|| fly(seeds, &watch))?;
    seen.end();
    let done = rows.len();
    if interrupt.is_asked() && (target.is_some() || done == 0) {
        return Ok(stopped(done, count, ": nothing is written"));
    }
    if let Some(target) = target {
        return target.write(&rows);
    }
    let verdict = show(rows)?;
    Ok(if interrupt.is_asked() { stopped(done, count, "") } else { verdict })
}

/// `count` seeds from `first` on.
pub(crate) fn seeds_from(first: u64, count: u64) -> Result<Range<u64>> {
    let end = first.checked_add(count);
    let end =
        end.with_context(|| format!("--seed {first}: {count} seeds from it on exceed 64 bits"))?;
    Ok(first..end)
}

/// Ctrl-C came first.
fn stopped(done: usize, count: u64, rest: &str) -> Verdict {
    stdio::note(format_args!("stopped after {done} of {count} seeds{rest}"));
    Verdict::Bad
}

/// Prints a campaign; bad if it found something.
pub(crate) fn print_campaign(campaign: &Campaign, is_json: bool) -> Result<Verdict> {
    stdio::report(campaign, is_json)?;
    Ok(if campaign.is_clean() { Verdict::Good } else { Verdict::Bad })
}

/// Prints the batch of one contender, or of two and their differences.
pub(crate) fn print_batches(
    flown: &[Vec<Flown>],
    names: [String; 2],
    seed: u64,
    is_json: bool,
) -> Result<()> {
    let mut batches = flown.iter().map(|flown| Batch::of(flown));
    let (Some(config), against) = (batches.next(), batches.next()) else { return Ok(()) };
    match against {
        Some(against) => stdio::report(&Comparison::of(names, config, against, seed), is_json),
        None => stdio::report(&config, is_json),
    }
}

/// Names of the two controllers of a batch: their settings files.
fn names(arguments: &Arguments) -> [String; 2] {
    let name = |path: &PathBuf| path.display().to_string();
    [&arguments.config, &arguments.against]
        .map(|path| path.as_ref().map_or_else(|| "built-in".to_owned(), name))
}

/// Draws the first flights of each contender over the outline.
fn draw(
    place: &FigureFiles,
    names: &[String],
    contenders: &[Contender],
    flown: &[Vec<Flown>],
) -> Result<()> {
    let obstacles = contenders.first().map(Contender::obstacles).transpose()?.unwrap_or_default();
    let contenders = names.iter().zip(contenders).zip(flown);
    let seen = contenders.map(|((name, contender), flown)| {
        let tracks = flown.iter().take(FIGURE_FLIGHTS_MAX).map(|flown| flown.track_w.clone());
        SeenFlights { name, outline: contender.outline(), tracks: tracks.collect() }
    });
    let seen: Vec<_> = seen.collect();
    let title = format!(
        "{}: true tracks of {} flights from above",
        place.stem(),
        seen.iter().map(|seen| seen.tracks.len()).max().unwrap_or(0)
    );
    place.save(&figure::tracks_among(&title, &seen, &obstacles))?;
    Ok(())
}
