//! Before a real drone takes off: what the flight needs, each with its result and reason, then the question.
//!
//! Owns the list and the prompt. It opens both links for a moment and asks for nothing but a connection. What keeps
//! a drone on the ground is the supervisor's; refused here is only a flight that nobody starts, a real drone in
//! the built-in room or without one, and what does not go away by waiting.

mod battery;
mod inspection;
mod log;
mod probe;
mod question;
mod start;

use std::fmt::{self, Display, Formatter};
use std::io::{self, IsTerminal};
use std::path::PathBuf;

use anyhow::{Result, bail};
use horizon_model::rows::{Pose, pose};
use tello_flight::cycle::{self, CycleTable, FlightTable};
use tello_flight::{Mission, RoomTable};
use tello_io::config::{self, FlyTable};
use tello_io::link_diagnosis::{misnumbered, too_old, undated, wrong_rate};
use tello_io::manual::is_terminal_ours;
use tello_io::mocap::StreamReport;
use tello_io::tello::{DroneFacts, DroneStatus};
use tello_sim::NominalFlight;

use self::battery::battery_check;
use self::log::{log_check, log_dir};
pub(super) use self::probe::probe;
use self::question::confirm;
use self::start::start_check;
use super::Arguments;
use super::control_loop::Orders;
use super::loop_times::GROUND_WAIT;
use super::vehicle::is_on_this_machine;
use crate::stdio;

/// Fewest frames within the age at which a pose is stale: one of them may be missing. frames
const FRAMES_MIN: f64 = 2.0;

/// Findings of the inspection, without judgement.
#[derive(Debug, Clone)]
struct Found {
    /// Report of the mocap stream during the inspection.
    stream: StreamReport,
    /// Frame rate that it announces, or that is set. Hz
    announced_hz: Option<f64>,
    /// Message on the mocap stream if there is no pose.
    mocap_trouble: String,
    /// The newest pose.
    at: Option<Pose>,
    /// The newest pose of the obstacle that moves.
    moving_at: Option<Pose>,
    drone: Option<DroneStatus>,
    /// Message on the drone if it has no status.
    drone_trouble: String,
    facts: DroneFacts,
    /// Where the log goes.
    log_dir: PathBuf,
    /// Room for it; `None` if the system does not report it. bytes
    disk_free: Option<u64>,
    /// Refusals of the system to a thread that asks for real time.
    refusals: Vec<String>,
    has_keys: bool,
    device: Option<String>,
    /// Simulated flight of the mission, if it does not reach its end.
    unfinished: Option<NominalFlight>,
    /// Whether nobody is asked: with `--yes`.
    is_unasked: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Readiness {
    Good,
    /// The flight goes on, with less.
    Note,
    /// The drone stays on the ground until it is mended.
    Bad,
    /// The cause does not go away by waiting: the drone stays on the ground.
    Never,
}

/// One line of the list.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Check {
    what: &'static str,
    readiness: Readiness,
    reason: String,
}

impl Display for Check {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let readiness = match self.readiness {
            Readiness::Good => "ok",
            Readiness::Note => "note",
            Readiness::Bad | Readiness::Never => "FAIL",
        };
        write!(f, "  {readiness:<4}  {:<9}  {}", self.what, self.reason)
    }
}

/// The orders with which the flight begins. Shows what is ready and what is not and, unless it was answered on the
/// command line, asks whether to fly. A drone that reports that it flies already is no question: the flight lands it,
/// and orders no take-off should it stand after all.
///
/// # Errors
/// No person is there to ask, or the person declines; a port that is taken.
pub(super) fn arm(arguments: &Arguments, table: &FlyTable, flight: &FlightTable) -> Result<Orders> {
    if arguments.sim || arguments.dry_run {
        return Ok(Orders::to_fly());
    }
    if !(arguments.yes || io::stdin().is_terminal()) {
        bail!("a real drone takes off only when asked: press Enter on a terminal, or give --yes");
    }
    refuse_unmeasured_room(table)?;
    let has_keys = !arguments.no_keys && is_terminal_ours();
    // Before the inspection, whose findings must be new when the person reads them.
    let nominal = NominalFlight::fly(flight);
    let mut found = inspection::inspect(table, log_dir(arguments, table), has_keys)?;
    if found.drone.is_some_and(|status| status.is_flying) {
        stdio::note("the drone reports that it flies: it is landed, without a question");
        return Ok(Orders::to_wait());
    }
    found.unfinished = nominal.ok().filter(|flight| !flight.is_finished());
    found.is_unasked = arguments.yes;
    let checks = checks(&found, table, flight)?;
    show(&checks)?;
    ask(arguments, table, &checks)
}

/// Shows the list.
///
/// # Errors
/// A cause does not go away by waiting.
fn show(checks: &[Check]) -> Result<()> {
    stdio::note("pre-flight");
    for check in checks {
        stdio::note(check);
    }
    if let Some(check) = checks.iter().find(|check| check.readiness == Readiness::Never) {
        bail!("not started: {}", check.reason);
    }
    Ok(())
}

/// Asks whether to fly, unless that was answered on the command line.
///
/// # Errors
/// The person declines.
fn ask(arguments: &Arguments, table: &FlyTable, checks: &[Check]) -> Result<Orders> {
    if !arguments.yes {
        return confirm(&table.tello.address, checks).map(|()| Orders::to_fly());
    }
    let failed = checks.iter().filter(|check| check.readiness == Readiness::Bad).count();
    if failed > 0 {
        let wait_s = GROUND_WAIT.seconds();
        stdio::note(format_args!("takes off once all checks pass, within {wait_s} s at most"));
    }
    Ok(Orders::to_fly())
}

/// Refuses to fly a real drone without walls, or between walls that were not measured. A drone on this machine is a
/// simulated one.
fn refuse_unmeasured_room(table: &FlyTable) -> Result<()> {
    if is_on_this_machine(table) {
        return Ok(());
    }
    let (built_in, _) = config::fly(None, None)?;
    let walls_m = |table: &FlyTable| table.cycle.supervisor.room.as_ref().map(RoomTable::walls_m);
    let what = match walls_m(table) {
        None => "null: no wall would be kept away from",
        found_m if found_m == walls_m(&built_in) => "the built-in one, 10 x 10 m",
        Some(_) => return Ok(()),
    };
    bail!(
        "cycle.supervisor.room is {what}; measure your room and write its walls (x_m, y_m, z_m in the frame of the \
         motion capture, half a metre to spare) into the file of --config"
    )
}

/// The list, in the order in which things are put right.
///
/// # Errors
/// A room or a mission that breaks its rule.
fn checks(found: &Found, table: &FlyTable, flight: &FlightTable) -> Result<Vec<Check>> {
    let mission =
        Mission::new(&flight.mission, flight.cycle.dt_s).map_err(|error| error.under("mission"))?;
    let walls = flight.cycle.supervisor.room.as_ref();
    let supervisor = &flight.cycle.supervisor;
    let moving = table.moving_object.as_ref().map(|name| moving_check(name, found, &flight.cycle));
    let mocap = mocap_check(found, table, flight.cycle.dt_s, supervisor.stale_s);
    let links = [mission_check(&mission, walls, found), mocap];
    let others = [
        start_check(found.at.as_ref(), &flight.cycle, &mission.first_pose())?,
        drone_check(found, table),
        battery_check(
            found.drone.as_ref(),
            supervisor.battery_low_pct,
            supervisor.battery_critical_pct,
        ),
        log_check(found),
        real_time_check(&found.refusals),
        operator_check(found),
    ];
    Ok(links.into_iter().chain(moving.transpose()?).chain(others).collect())
}

fn check(what: &'static str, readiness: Readiness, reason: impl Into<String>) -> Check {
    Check { what, readiness, reason: reason.into() }
}

/// A mission that leaves the room does not get as far as this.
fn mission_check(mission: &Mission, walls: Option<&RoomTable>, found: &Found) -> Check {
    let count = mission.targets_count();
    if let Some(flight) = &found.unfinished {
        let reason = format!("{count} targets; simulated: {flight}");
        if !flight.is_blocked() {
            // Only a person may fly it all the same.
            let readiness = if found.is_unasked { Readiness::Never } else { Readiness::Note };
            return check("mission", readiness, reason);
        }
        let advice = "change the mission, the room or the obstacles; `tello-ctl check --figure NAME` draws them";
        return check("mission", Readiness::Never, format!("{reason}: {advice}"));
    }
    let Some(walls) = walls else {
        let reason = format!("{count} targets; no room is set, so that no wall is kept away from");
        return check("mission", Readiness::Note, reason);
    };
    let RoomTable { x_m, y_m, z_m, .. } = walls;
    let nearest_m = mission.survey().margin_m(walls.walls_m());
    let span = |[low_m, high_m]: &[f64; 2]| format!("{low_m:.1}..{high_m:.1}");
    let reason = format!(
        "{count} targets, {nearest_m:.2} m or more inside of the room x {}, y {}, z {} m",
        span(x_m),
        span(y_m),
        span(z_m)
    );
    check("mission", Readiness::Good, reason)
}

fn mocap_check(found: &Found, table: &FlyTable, dt_s: f64, stale_s: f64) -> Check {
    let StreamReport { frames, unseen, rate_hz, .. } = found.stream;
    let object = table.mocap.object();
    if let Some(rate_hz) = rate_hz.filter(|rate_hz| rate_hz * stale_s < FRAMES_MIN) {
        let reason = format!(
            "{rate_hz:.2} frames a second: poses are stale after {stale_s} s (cycle.supervisor.stale_s), so that {:.0} are \
             needed",
            FRAMES_MIN / stale_s
        );
        return check("mocap", Readiness::Never, reason);
    }
    if let Some(reason) = misnumbered(&found.stream, object) {
        return check("mocap", Readiness::Bad, reason);
    }
    if let Some(reason) = wrong_rate(&found.stream, found.announced_hz, &table.mocap) {
        return check("mocap", Readiness::Bad, reason);
    }
    let (Some(_), Some(rate_hz)) = (found.at, rate_hz) else {
        return check("mocap", Readiness::Bad, &*found.mocap_trouble);
    };
    if let Some(reason) = too_old(&found.stream) {
        return check("mocap", Readiness::Bad, reason);
    }
    if let Some(reason) = undated(&found.stream, object) {
        return check("mocap", Readiness::Bad, reason);
    }
    let mut reason =
        vec![format!("{} poses of {object:?}, {rate_hz:.0} frames a second", frames - unseen)];
    if unseen > 0 {
        reason.push(format!("{unseen} of {frames} frames do not see it"));
    }
    // Half a hertz for a rate that was measured in a second.
    if rate_hz + 0.5 < 1.0 / dt_s {
        reason.push(format!("the loop has {:.0} ticks a second", 1.0 / dt_s));
    }
    let readiness = if reason.len() == 1 { Readiness::Good } else { Readiness::Note };
    check("mocap", readiness, reason.join("; "))
}

fn moving_check(name: &str, found: &Found, cycle: &CycleTable) -> Result<Check> {
    let Some(moving_at) = found.moving_at else {
        let reason =
            format!("no pose of {name:?}, which the plan keeps away from: the drone stays down");
        return Ok(check("obstacle", Readiness::Bad, reason));
    };
    let place = format!("{name:?} at {:+.2} {:+.2} m", moving_at[pose::X], moving_at[pose::Y]);
    let beside_m = found.at.map(|at| cycle::beside_moving_obstacle(&at, &moving_at, cycle));
    Ok(match beside_m.transpose()?.flatten() {
        Some((beside_m, least_m)) if beside_m < least_m => {
            let reason = format!(
                "{place}, {beside_m:.2} m from the drone without its radius: nothing steers in the take-off; within \
                 {least_m:.2} m the drone stays down"
            );
            check("obstacle", Readiness::Bad, reason)
        }
        _ => check("obstacle", Readiness::Good, place),
    })
}

fn drone_check(found: &Found, table: &FlyTable) -> Check {
    let address = &table.tello.address;
    if found.drone.is_none() {
        return check("drone", Readiness::Bad, &*found.drone_trouble);
    }
    let reported = reported(&found.facts);
    check("drone", Readiness::Good, format!("{address} answers and stands{reported}"))
}

/// The answers of the drone, as the end of a sentence.
fn reported(facts: &DroneFacts) -> String {
    let DroneFacts { version, altitude_limit_m, battery_threshold_pct, tilt_limit_rad } = facts;
    [
        version.map(|version| format!("; firmware {version}")),
        altitude_limit_m.map(|limit_m| format!("; climbs to {limit_m} m")),
        tilt_limit_rad.map(|tilt_rad| format!("; tilts to {:.0} degrees", tilt_rad.to_degrees())),
        battery_threshold_pct.map(|pct| format!("; warns of its battery below {pct} %")),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn real_time_check(refusals: &[String]) -> Check {
    if refusals.is_empty() {
        return check("real time", Readiness::Good, "priority and memory are granted");
    }
    check("real time", Readiness::Note, refusals.join("; "))
}

fn operator_check(found: &Found) -> Check {
    let keys = "this terminal: Backspace stops the motors, R or Q lands";
    let (readiness, reason) = match (&found.device, found.has_keys) {
        (Some(device), true) => (Readiness::Good, format!("{device} and {keys}")),
        (Some(device), false) => (Readiness::Good, format!("{device} alone")),
        (None, true) => (Readiness::Good, keys.to_owned()),
        (None, false) => {
            let reason = "no keys and no device: nobody can steer; a signal to end lands, and so does the page of \
                          --view";
            (Readiness::Note, reason.to_owned())
        }
    };
    check("operator", readiness, reason)
}

#[cfg(test)]
mod tests;
