//! `tello-ctl excite`: a mission for identification, made for a room.

use std::ops::RangeInclusive;
use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;
use horizon_model::rows::{Pose, pose};
use horizon_model::setting::SettingError;
use tello_eval::Excitation;
use tello_flight::{MissionTable, PointsTable, RoomTable, Start, TrajectoryTable};
use tello_io::{atomic_file, config};

use crate::check::CheckedMission;
use crate::{Verdict, stdio};

/// Design a flight for identification.
///
/// Writes a mission that moves all four axes at once, with sums of sines that have no frequency in common, in the
/// middle of the room of --config and as large as that allows. Fly it as any mission, then identify its log. What one
/// minute of it shows beside five minutes by hand: docs/identification.md.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  tello-ctl excite --config lab/fly.json               excite.json, for the room of the settings
  tello-ctl sim --log excite.mcap --mission excite.json && tello-ctl ident excite.mcap
  tello-ctl fly --config lab/fly.json --mission excite.json
  tello-ctl ident --self-test --automatic --mission excite.json --runs 20   what it shows, in simulation

Exit codes: 0 written, 2 does not fit into the room, or could not write.")]
pub(crate) struct Arguments {
    /// The mission to write.
    #[arg(value_name = "FILE", default_value = "excite.json")]
    mission: PathBuf,
    /// Settings of the flight, for its room and its limits [default: the built-in configs/fly.json].
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Duration, without take-off and landing, 20 to 600. s
    #[arg(long, value_name = "S", default_value_t = 60.0)]
    seconds: f64,
    /// Largest distance from the centre along x and y, 0.3 to 4 [default: what the room allows, at most 1.5]. m
    #[arg(long, value_name = "M")]
    half_width: Option<f64>,
    /// Largest distance from the centre upwards and downwards, 0.1 to 1. m
    #[arg(long, value_name = "M", default_value_t = 0.36)]
    half_height: f64,
    /// Centre [default: the middle of the room, 1.4 m high or as low as its ceiling needs, heading 0]: x, y, z in m,
    /// heading in rad.
    #[arg(long, value_name = "X,Y,Z,THETA", allow_hyphen_values = true, value_delimiter = ',')]
    centre: Vec<f64>,
    /// Replace a file that exists.
    #[arg(long)]
    force: bool,
}

/// Height of the centre where none is given, if the ceiling permits. m
const HEIGHT_M: f64 = 1.4;

/// Lower heights that are tried then, from the largest on. dm
const LOWER_DM: RangeInclusive<u32> = 7..=13;

/// The floor disturbs a vehicle that is lower. m
const OFF_GROUND_M: f64 = 0.3;

/// Half widths that are tried where none is given, from the largest on. dm
const HALF_WIDTHS_DM: RangeInclusive<u32> = 5..=15;

/// How far the vehicle may be from the reference: it cannot do all that is asked for. m
const BESIDE_M: f64 = 0.3;

pub(crate) fn run(arguments: &Arguments) -> Result<Verdict> {
    let (table, mission) = config::fly(arguments.config.as_deref(), None)?;
    let mut flight = config::flight(&table, mission, Start::Grounded);
    let room = flight.cycle.supervisor.room.as_ref();
    let design = Excitation {
        centre: centre(&arguments.centre, room)?,
        half_width_m: arguments.half_width.unwrap_or_default(),
        half_height_m: arguments.half_height,
        duration_s: arguments.seconds,
    };
    let mut heights_m = vec![design.centre[pose::Z]];
    if arguments.centre.is_empty() {
        heights_m.extend(LOWER_DM.rev().map(|dm| f64::from(dm) / 10.0));
    }
    let (half_width_m, trajectory) = match arguments.half_width {
        None => largest(&design, &heights_m, room)?,
        Some(half_width_m) => {
            let Some(trajectory) = highest(&design, &heights_m, room)? else {
                let (most_m, _) = largest(&design, &heights_m, room)?;
                bail!(
                    "--half-width {half_width_m} with --half-height {} comes within the stopping distance of a wall, \
                     the floor or the ceiling: at most {most_m} to each side around this centre",
                    arguments.half_height
                );
            };
            (half_width_m, trajectory)
        }
    };
    flight.mission = MissionTable::Trajectory(trajectory);
    let CheckedMission { look, .. } = CheckedMission::at(&flight)?;
    if look.obstacle_margin_m.is_some_and(|margin_m| margin_m < 2.0 * BESIDE_M) {
        bail!("the pattern comes within {} m of an obstacle: choose --centre", 2.0 * BESIDE_M);
    }
    let text = serde_json::to_string(&flight.mission)? + "\n";
    atomic_file::write_contents(&arguments.mission, arguments.force, text)?;
    let name = arguments.mission.display();
    let config = arguments.config.as_ref();
    let config = config.map_or_else(String::new, |file| format!("--config {} ", file.display()));
    stdio::line(format_args!("{name}: {half_width_m} m to each side of the centre\n{look}"))?;
    stdio::line(format_args!(
        "next: tello-ctl fly {config}--mission {name}, then tello-ctl ident LOG"
    ))?;
    Ok(Verdict::Good)
}

/// A refusal of a pattern with the name of the option in place of the key.
fn of_option(error: SettingError) -> SettingError {
    let key = match &*error.key {
        "half_width_m" => "--half-width",
        "half_height_m" => "--half-height",
        "duration_s" => "--seconds",
        _ => return error,
    };
    SettingError { key: key.to_owned(), ..error }
}

/// The pattern of `design` at the first of the heights at which it fits. m
fn highest(
    design: &Excitation,
    heights_m: &[f64],
    room: Option<&RoomTable>,
) -> Result<Option<TrajectoryTable>> {
    for z_m in heights_m {
        let mut centre = design.centre;
        centre[pose::Z] = *z_m;
        let trajectory = Excitation { centre, ..*design }.trajectory().map_err(of_option)?;
        if fits(&trajectory, room) {
            return Ok(Some(trajectory));
        }
    }
    Ok(None)
}

/// The largest pattern like `design` that fits at one of the heights, and its half width. m
fn largest(
    design: &Excitation,
    heights_m: &[f64],
    room: Option<&RoomTable>,
) -> Result<(f64, TrajectoryTable)> {
    for width_dm in HALF_WIDTHS_DM.rev() {
        let half_width_m = f64::from(width_dm) / 10.0;
        if let Some(found) = highest(&Excitation { half_width_m, ..*design }, heights_m, room)? {
            return Ok((half_width_m, found));
        }
    }
    let [x, y] = [pose::X, pose::Y].map(|row| design.centre[row]);
    let [low_m, high_m] = [heights_m.last(), heights_m.first()].map(|z_m| z_m.unwrap_or(&f64::NAN));
    bail!(
        "around x = {x}, y = {y} m, at {low_m} to {high_m} m, the room has no place for the smallest pattern, 0.5 m to \
         each side: with the stopping distance it needs about 1.3 m to each wall, and floor and ceiling --half-height \
         and about 0.7 m away; choose --centre or a smaller --half-height"
    )
}

/// The centre that was given, or that of the room.
fn centre(given: &[f64], room: Option<&RoomTable>) -> Result<Pose> {
    let middle = |[low, high]: [f64; 2]| f64::midpoint(low, high);
    match (given, room) {
        ([.., theta], _) if theta.abs() > std::f64::consts::TAU => {
            bail!("--centre: theta = {theta}: expected at most one turn, 6.28 rad, to either side")
        }
        ([x, y, z, theta], _) => Ok(Pose::new(*x, *y, *z, *theta)),
        ([], Some(room)) => Ok(Pose::new(middle(room.x_m), middle(room.y_m), HEIGHT_M, 0.0)),
        ([], None) => bail!("the settings have no room: give --centre"),
        _ => bail!("--centre needs four numbers, x,y,z,theta, instead of {}", given.len()),
    }
}

/// Whether the vehicle could stop inside of the room at every moment, and stays off the ground.
fn fits(trajectory: &TrajectoryTable, room: Option<&RoomTable>) -> bool {
    let PointsTable::Rows(rows) = &trajectory.points else { return false };
    if rows.iter().any(|[_, _, _, z, _]| *z < OFF_GROUND_M + BESIDE_M) {
        return false;
    }
    let Some(room) = room else { return true };
    rows.windows(2).all(|pair| {
        let [[from_s, from @ ..], [to_s, to @ ..]] = pair else { return false };
        let length_s = to_s - from_s;
        let walls_m = room.walls_m();
        walls_m.iter().zip(from.iter().zip(to)).all(|([low_m, high_m], (from, to))| {
            let stopped_m = to + (to - from) / length_s * room.stop_s;
            [*to, stopped_m].iter().all(|at| at - BESIDE_M > *low_m && at + BESIDE_M < *high_m)
        })
    })
}

#[cfg(test)]
mod tests;
