//! `tello-ctl fly`: mocap bytes in, stick bytes out, fifty times a second.
//!
//! Owns the threads: the tokio runtime on this one (Tello writer), the mocap reader's, the control thread, the
//! logger's, the status line's, those of the signals, of the terminal, of the live views, of input devices and of the
//! end; and the guardian's process.

mod connection_limit;
mod control_loop;
mod drill;
mod ending;
#[cfg(feature = "live")]
mod foxglove_server;
mod guardian;
mod links;
mod live;
mod lock;
mod log_thread;
mod loop_times;
mod preflight;
#[cfg(feature = "ros2")]
mod ros2_publisher;
pub(crate) mod signals;
mod simulator;
mod sources;
mod status;
mod take_off_refusal;
mod threads;
mod tui;
mod vehicle;
mod view;

use std::io;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};

use anyhow::{Result, bail};
use clap::Args;
use parking_lot::Mutex;
use rtrb::{Consumer, RingBuffer};
use tello_eval::flight_summary::{LoopEnd, Summary, Tally};
use tello_eval::parameter_file;
use tello_flight::cycle::{self, FlightTable};
use tello_flight::{Mission, Phase, SPEED_AS_WRITTEN, Start};
use tello_io::clock::{Clock, Role, request_priority};
use tello_io::config::{self, FlyTable};
use tello_io::manual::{self, Inputs, KEYS_HELP, ManualControls};
use tello_sim::Profile;

use self::control_loop::{ControlLoop, Orders};
use self::drill::InjectedFailure;
use self::ending::{Display, close_log, conclude};
use self::links::{Counters, Links};
use self::live::Live;
use self::log_thread::Notes;
use self::loop_times::{GROUND_WAIT, LoopTimes};
use self::simulator::start_simulator;
use self::status::{Status, show_statuses};
use self::take_off_refusal::{note_unseen, take_off_refusal};
use self::threads::Threads;
use self::tui::{Picture, Screen};
pub(crate) use self::view::Playback;
use self::view::View;
use crate::{Verdict, interrupt, stdio};

pub(crate) use self::guardian::{Arguments as GuardianArguments, Guardian, run as guard};
pub(crate) use self::lock::Lock;

/// Take off, fly the targets, land; every tick is logged.
///
/// Poses come from the mocap source of the settings, sticks go to the Tello (UDP, binary protocol or text SDK).
/// Ctrl-C lands the drone and keeps the log. Without hardware: --sim starts a drone and a room on loopback sockets.
/// On real hardware the flight starts when you press Enter, or at once with --yes.
///
/// On a terminal you can steer: Backspace EMERGENCY STOP in every phase, R or Q land, T take off, E by hand, C
/// automatic again, W/S A/D forward, back, left, right, I/K up, down, J/L turn. Any steering key takes over.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit codes: 0 all targets reached and landed, 1 landed early or the log is incomplete, \
2 could not fly."
)]
#[expect(clippy::struct_excessive_bools, reason = "flags of the command line")]
pub(crate) struct Arguments {
    /// Settings of the flight [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Identified parameters, in place of the settings' prior and dead times.
    #[arg(long, value_name = "FILE")]
    params: Option<PathBuf>,
    /// The vehicle: parameters of earlier flights, in place of the settings' prior and dead times. After a
    /// flight that reached all targets the file takes over the estimate; the first flight makes it.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["params", "dry_run"])]
    vehicle: Option<PathBuf>,
    /// What to fly (targets, a path, a trajectory), in place of the settings' mission.
    #[arg(long, value_name = "FILE")]
    mission: Option<PathBuf>,
    /// How fast the mission is flown, 0.1 to 1: 0.5 as it is written, 1 at the limit of the vehicle.
    #[arg(long, value_name = "SPEED", default_value_t = SPEED_AS_WRITTEN)]
    speed: f64,
    /// Fly the built-in simulator over loopback sockets.
    #[arg(long)]
    sim: bool,
    /// Plan as if in flight but send nothing: no sticks, no take-off, no landing. Carry the drone
    /// through the room and look at the log. It ends with the targets or with Ctrl-C.
    #[arg(long)]
    dry_run: bool,
    /// Settings of the simulator [default: the built-in configs/sim.json].
    #[arg(long, value_name = "FILE", requires = "sim")]
    sim_config: Option<PathBuf>,
    /// Measurement and link faults of the simulator, in place of its settings' profile: `clean`,
    /// `good_day`, `typical`, `bad_day`, `mild_outages` or `outages`.
    #[arg(long, requires = "sim")]
    profile: Option<Profile>,
    /// Seed of the simulator.
    #[arg(long, default_value_t = 1, requires = "sim")]
    seed: u64,
    /// Write the log here [default: logs/DATE-TIME.mcap].
    #[arg(long, value_name = "FILE")]
    log: Option<PathBuf>,
    /// Draw the flight on the terminal, in place of the status line: works over ssh. Not with --view.
    #[arg(long, conflicts_with = "no_keys")]
    tui: bool,
    /// Show the flight live in Foxglove or Lichtblick, by a WebSocket at this address [default:
    /// 127.0.0.1:8765]. Any client that reaches it can watch; none can steer.
    #[cfg(feature = "live")]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = "127.0.0.1:8765")]
    foxglove: Option<SocketAddr>,
    /// Publish the flight in ROS 2: pose, velocity, reference, target, plan, phase, faults, battery. Nobody can steer.
    #[cfg(feature = "ros2")]
    #[arg(long)]
    ros2: bool,
    #[cfg(feature = "ros2")]
    #[command(flatten)]
    network: crate::ros2::Network,
    /// Keyboard or gamepad to steer with, in place of the settings' `manual.device`: a file such as
    /// `/dev/input/event5`, or `gamepad` for the first one that is found.
    #[arg(long, value_name = "DEVICE")]
    input: Option<String>,
    /// Leave the terminal's keys alone.
    #[arg(long)]
    no_keys: bool,
    /// Show the flight in a browser, at a page that is served here. The address that is printed lets you
    /// land, hold and stop the motors from there; without the part after `#` a page can only look.
    /// Without ADDRESS: 127.0.0.1:8080, or a free port if that is taken. Not with --tui.
    #[arg(long, value_name = "ADDRESS", conflicts_with = "tui")]
    #[expect(clippy::option_option, reason = "an option whose value is optional")]
    view: Option<Option<SocketAddr>>,
    /// Do not ask before the take-off of a real drone.
    #[arg(long)]
    yes: bool,
    /// Print the summary as one JSON object.
    #[arg(long)]
    json: bool,
    /// Let a part of this program fail, against a simulator on this machine: `control-stalls`,
    /// `control-panics`, `link-stalls`, `link-dies` or `main-panics`, so many seconds after the start.
    #[arg(long, value_name = "WHAT@SECONDS", hide = true)]
    drill: Option<InjectedFailure>,
}

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    manual::discard_typed();
    let (mut table, mission) =
        config::fly(arguments.config.as_deref(), arguments.mission.as_deref())?;
    vehicle::take_parameters(arguments, &mut table)?;
    // A dry run may be carried through the room by hand: it plans from the first pose on.
    let start = if arguments.dry_run { Start::Carried } else { Start::Grounded };
    let flight = config::flight(&table, mission, start).at_speed(arguments.speed)?;
    let (config, mission) = (arguments.config.as_deref(), arguments.mission.as_deref());
    let parameters = arguments.params.as_deref().or(arguments.vehicle.as_deref());
    let cycle = cycle::build(&flight).map_err(|error| match parameters {
        Some(path) => anyhow::Error::from(error).context(parameter_file::of(path)),
        None => config::explain(error.into(), config, mission),
    })?;
    let planned = Mission::new(&flight.mission, flight.cycle.dt_s)?;
    for note in cycle::notes(&planned, &flight.cycle) {
        stdio::note(format_args!("note: {note}"));
    }
    config::moving_object(&table)
        .map_err(|error| config::explain(error.into(), config, mission))?;
    table.manual.device = arguments.input.clone().or(table.manual.device);
    let emulator = if arguments.sim {
        // Before its threads, which would be ended by a signal that they do not block.
        signals::block()?;
        Some(start_simulator(arguments, &mut table)?)
    } else {
        None
    };
    let _drone = Lock::drone(&table.tello)?;
    // A dry run may watch the object of a flight.
    let _object = (!arguments.dry_run).then(|| Lock::object(&table.mocap)).transpose()?;
    preflight::probe(arguments, &table)?;
    let orders = preflight::arm(arguments, &table, &flight)?;
    signals::block()?;
    stdio::never_wait();
    if arguments.drill.is_some() {
        InjectedFailure::check(&table.tello.address)?;
    }
    let runtime = interrupt::runtime()?;
    let summary = runtime.block_on(fly(arguments, &table, &flight, cycle, orders))?;
    drop(emulator);
    // Flight and log are what is judged, not whether the summary can be written.
    stdio::report(&summary, arguments.json)
        .unwrap_or_else(|error| stdio::note(stdio::chain(&error)));
    Ok(if summary.is_complete() { Verdict::Good } else { Verdict::Bad })
}

async fn fly(
    arguments: &Arguments,
    table: &FlyTable,
    flight: &FlightTable,
    cycle: Box<dyn cycle::Tick>,
    orders: Orders,
) -> Result<Summary> {
    let clock = Clock::start();
    // Before anything moves: from here on every way to end the program lands the drone first.
    let asks_to_land = land_on_signals()?;
    let mut links = Links::open(arguments, table, clock)?;
    // The terminal is as it was when these go, the keys before the screen, whatever ends the flight.
    let screen = arguments.tui.then(Screen::enter).transpose()?;
    let (mut controls, inputs) = open_inputs(arguments, table, clock)?;
    links.tello.obey(controls.emergency());

    let counters = links.counters();
    let tally = Arc::new(Mutex::new(Tally::new(flight)?));
    let (live, picture, view) = watch(arguments, screen.as_ref(), flight, &mut controls, clock)?;
    let (mocap, drone) = (Arc::clone(&counters.mocap), Arc::clone(&counters.drone));
    let notes = Notes { tally: Arc::clone(&tally), live, mocap, drone };
    let recorder = log_thread::start(arguments, table, flight, clock, &*cycle, notes)?;
    let (status, statuses) = RingBuffer::new(16);
    let Links { guardian, drone, tello, moving_feed, feed, sources } = links;
    let control = ControlLoop {
        clock,
        cycle,
        times: LoopTimes::of(table, flight)?,
        is_dry_run: arguments.dry_run,
        feed,
        moving_feed,
        drone,
        recorder,
        status,
        asks_to_land: Arc::clone(&asks_to_land),
        controls,
        orders,
        drill: arguments.drill,
    };

    note_unseen(arguments, table, &counters.mocap);
    let display = Display { status_line: show(picture, statuses)?, view, inputs, screen };
    let threads = Threads::start(sources, tello, control, guardian, table.real_time.core)?;
    // After all threads, which would inherit it. The control thread reports a refusal.
    request_priority(Role::Sender).ok();
    let (end, recorder, links) = threads.run_to_end(arguments.drill).await?;
    let summary = close_log(recorder, &tally);
    let left = display.close();
    let has_waited_in_vain = end.phase == Phase::Idle || (arguments.dry_run && !end.has_frames);
    if has_waited_in_vain && !asks_to_land.load(Ordering::Relaxed) {
        links.and(left)?;
        let Counters { mocap, drone } = &counters;
        bail!(take_off_refusal(table, GROUND_WAIT, end.faults_last, mocap, drone.packets.get()));
    }
    let summary = complete_summary(summary, &end, arguments, table, &counters);
    vehicle::save_vehicle_parameters(arguments, flight, &summary, &end, clock);
    conclude(summary, links, left)
}

/// A flag that each signal sets which ends programs: the control thread lands the drone then.
fn land_on_signals() -> Result<Arc<AtomicBool>> {
    let asks_to_land = Arc::new(AtomicBool::new(false));
    let to_land = Arc::clone(&asks_to_land);
    signals::listen(move |_| to_land.store(true, Ordering::Relaxed))?;
    Ok(asks_to_land)
}

/// The summary with the end of the control loop and the counts of the links.
fn complete_summary(
    summary: Summary,
    end: &LoopEnd,
    arguments: &Arguments,
    table: &FlyTable,
    Counters { mocap, drone }: &Counters,
) -> Summary {
    let summary = summary.with_end(end, mocap, table.mocap.object(), drone);
    Summary { is_dry_run: arguments.dry_run, ..summary }
}

/// Starts the thread that shows the flight.
fn show(picture: Option<Picture>, statuses: Consumer<Status>) -> io::Result<JoinHandle<()>> {
    thread::Builder::new().name("tello-status".into()).spawn(move || match picture {
        Some(picture) => picture.show(statuses),
        None => show_statuses(statuses),
    })
}

/// What a person can steer with: the terminal's keys, unless they shall be left alone, and a device.
fn open_inputs(
    arguments: &Arguments,
    table: &FlyTable,
    clock: Clock,
) -> Result<(ManualControls, Inputs)> {
    let (controls, inputs) = Inputs::open(&config::manual(table)?, !arguments.no_keys, clock)?;
    if inputs.has_keys() && !arguments.tui {
        // In parts, since terminals of 80 columns would break the whole.
        KEYS_HELP.split("; ").for_each(stdio::note);
    }
    Ok((controls, inputs))
}

/// Telemetry for viewers, if there are any, what draws them on `screen`, and the live page.
fn watch(
    arguments: &Arguments,
    screen: Option<&Screen>,
    flight: &FlightTable,
    controls: &mut ManualControls,
    clock: Clock,
) -> Result<(Option<Live>, Option<Picture>, Option<View>)> {
    if screen.is_none() && arguments.view.is_none() {
        return Ok((None, None, None));
    }
    let (live, briefing, watched) = Live::new(flight)?;
    let picture = screen.map(|screen| screen.picture(briefing.clone(), watched.clone()));
    let open = |address| View::open(address, briefing, watched, controls.remote(clock), clock);
    Ok((Some(live), picture, arguments.view.map(open).transpose()?))
}
