//! Refuses missions that no vehicle within the settings can fly between walls and obstacles, and notes what the
//! expected vehicle cannot. Also the clearance of a take-off.

use horizon_model::rows::{Pose, lag, pos_w, pose, stick};
use horizon_model::setting::SettingError;
use nalgebra::Vector3;

use super::walls::climb_beside_m;
use super::{CycleTable, ModelKind};
use crate::mission::Demand;
use crate::supervisor::CLIMB_MAX_M;
use crate::{
    CircleTable, Mission, MissionTable, Obstacle, PointsTable, Room, TrajectoryTable, obstacles,
};

/// A Tello does not hover lower above the floor. m
const HOVER_MIN_M: f64 = 0.3;

/// Two turns: larger angles are in degrees. rad
const ANGLE_MAX_RAD: f64 = 2.0 * std::f64::consts::TAU;

/// Why `mission` cannot be flown, which is that of `table`: it leaves the room, is too low, stops inside of an
/// obstacle, ends above one, or is faster than the failsafe or the upper bounds of the gains allow. Allocates.
///
/// Each pose of `table` outside of the room is named, the farthest position of the path if none of them is.
///
/// # Errors
/// A room or obstacles that break their rule.
pub fn misfits(
    table: &MissionTable,
    mission: &Mission,
    cycle: &CycleTable,
) -> Result<Vec<SettingError>, SettingError> {
    let mut found = room(cycle)?.map_or(Vec::new(), |room| outside(table, mission, &room));
    found.extend(in_degrees(table));
    found.extend(low(table, mission, cycle.filter.floor_m));
    found.extend(blocked(mission, cycle)?);
    found.extend(fast(mission, cycle));
    Ok(found)
}

/// Angles of the mission that none in radians is. Headings over time may add up to any number of turns, not all of them
/// between two rows.
fn in_degrees(table: &MissionTable) -> Vec<SettingError> {
    let list = table.poses().map(|(key, at)| (key, at[pose::THETA]));
    let mut angles: Vec<(String, f64)> = list.collect();
    match table {
        MissionTable::Circle(CircleTable { centre_w: [.., theta], begin_rad, .. }) => {
            angles.push(("circle.centre[3]".into(), *theta));
            angles.push(("circle.begin_rad".into(), *begin_rad));
        }
        MissionTable::Trajectory(TrajectoryTable { points: PointsTable::Rows(rows), .. }) => {
            let thetas = || rows.iter().map(|[.., theta]| *theta);
            let turns = thetas().skip(1).zip(thetas()).map(|(theta, before)| theta - before);
            let key = |k| format!("trajectory.points.rows[{k}][4]");
            angles.extend(thetas().take(1).chain(turns).enumerate().map(|(k, it)| (key(k), it)));
        }
        // Lists are `poses`; a CSV file has become rows.
        MissionTable::Targets(_)
        | MissionTable::Waypoints(_)
        | MissionTable::Spline(_)
        | MissionTable::Trajectory(TrajectoryTable { points: PointsTable::Csv(_), .. }) => {}
    }
    angles.retain(|(_, angle)| angle.abs() > ANGLE_MAX_RAD);
    let refused = angles.into_iter().map(|(key, angle)| {
        let rule = format!("an angle or a turn within +-{ANGLE_MAX_RAD:.1} rad: it is in radians");
        SettingError::new(format!("mission.{key}"), angle, rule)
    });
    refused.collect()
}

/// Obstacles that a stop of the mission lies in, and those at rest that the drone would land on.
fn blocked(mission: &Mission, cycle: &CycleTable) -> Result<Vec<SettingError>, SettingError> {
    let obstacles = obstacles(&cycle.obstacles).map_err(|error| error.under("cycle"))?;
    let stops = mission.stops();
    let misfit = |(k, obstacle): (usize, &Obstacle)| {
        let inside = |at: &Pose| (-obstacle.distance(&pos_w(at)).distance_m, pos_w(at));
        let deepest = stops.iter().map(inside).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((inside_m, at)) = deepest.filter(|(inside_m, _)| *inside_m > 0.0) {
            let rule = format!("outside of cycle.obstacles[{k}]: it is {inside_m:.2} m inside");
            return Some(SettingError::new("mission", position(at.into()), rule));
        }
        let end = stops.last().filter(|_| !obstacle.is_moving())?;
        let is_above = distance_above(obstacle, end, cycle.filter.floor_m) < 0.0;
        is_above.then(|| {
            let rule = format!("not above cycle.obstacles[{k}]: the drone lands there");
            SettingError::new("mission", position(pos_w(end).into()), rule)
        })
    };
    Ok(obstacles.iter().enumerate().filter_map(misfit).collect())
}

/// Speeds beyond the failsafe, else those beyond full sticks with the upper bounds of the gains.
fn fast(mission: &Mission, cycle: &CycleTable) -> Vec<SettingError> {
    let failsafe_mps = cycle.supervisor.failsafe.speed_mps;
    if let Some(demands) = mission.demands().filter(|it| it.speed.value > failsafe_mps) {
        let rule = format!("at most {failsafe_mps}, cycle.supervisor.failsafe.speed_mps");
        return vec![SettingError::new("mission", described(&demands.speed, "m/s"), rule)];
    }
    axes(mission, cycle, &cycle.mhe.p_ub)
        .filter(|(demand, _, best, _)| demand.value > *best)
        .map(|(demand, row, best, unit)| {
            let best = (100.0 * best).round() / 100.0;
            let rule = format!("at most {best}, full sticks with cycle.mhe.p_ub[{row}]");
            SettingError::new("mission", described(&demand, unit), rule)
        })
        .collect()
}

/// Least distance to `obstacle` on the vertical from `at` down to the floor, world frame; negative inside. m
fn distance_above(obstacle: &Obstacle, at: &Pose, floor_m: f64) -> f64 {
    let foot_w = Vector3::new(at[pose::X], at[pose::Y], floor_m.min(at[pose::Z]));
    obstacle.distance_in_climb(&foot_w, at[pose::Z] - foot_w.z, None).distance_m
}

/// Distance of a take-off at `at` (world frame, m and rad) to the nearest wall beside it or obstacle at rest, in m,
/// with its name; `None` without any. Allocates.
///
/// # Errors
/// A room or obstacles that break their rule.
pub fn take_off_clearance(
    at: &Pose,
    cycle: &CycleTable,
) -> Result<Option<(f64, String)>, SettingError> {
    let room = room(cycle)?;
    let beside = room.iter().flat_map(|room| {
        ["lower x", "upper x", "lower y", "upper y"].into_iter().enumerate().map(|(i, name)| {
            let distance_m = room.wall_distance(i, &pos_w(at)).distance_m;
            (distance_m, format!("the wall at the {name} of the room"))
        })
    });
    let obstacles = obstacles(&cycle.obstacles).map_err(|error| error.under("cycle"))?;
    let at_rest = obstacles.iter().enumerate().filter(|(_, obstacle)| !obstacle.is_moving());
    let near = at_rest.map(|(k, obstacle)| {
        let distance_m = obstacle.distance_in_climb(&pos_w(at), CLIMB_MAX_M, None).distance_m;
        (distance_m, format!("cycle.obstacles[{k}]"))
    });
    Ok(beside.chain(near).min_by(|a, b| a.0.total_cmp(&b.0)))
}

/// Distance of a take-off at `at` from the moving obstacle at `moving_at`, both in the world frame, m and rad, and the
/// least one at which the drone takes off, both in m; `None` without such an obstacle. Allocates.
///
/// # Errors
/// Obstacles that break their rule.
pub fn beside_moving_obstacle(
    at: &Pose,
    moving_at: &Pose,
    cycle: &CycleTable,
) -> Result<Option<(f64, f64)>, SettingError> {
    let obstacles = obstacles(&cycle.obstacles).map_err(|error| error.under("cycle"))?;
    let moving = obstacles.iter().find(|obstacle| obstacle.is_moving());
    let distance_m = moving
        .map(|obstacle| obstacle.distance_from(&pos_w(at), Some(&pos_w(moving_at))).distance_m);
    let margin_m = cycle.mpc.walls.as_ref().map(|walls| walls.margin_m);
    Ok(distance_m.zip(margin_m.map(climb_beside_m)))
}

fn room(cycle: &CycleTable) -> Result<Option<Room>, SettingError> {
    let room = cycle.supervisor.room.as_ref().map(Room::try_from).transpose();
    room.map_err(|error| error.under("cycle.supervisor.room"))
}

/// The positions of the mission outside of `room`, as [`misplaced`] names them.
fn outside(table: &MissionTable, mission: &Mission, room: &Room) -> Vec<SettingError> {
    let rule = |excess_m| format!("inside of cycle.supervisor.room: it is {excess_m:.2} m outside");
    misplaced(table, mission, |at| room.excess_m(at), rule)
}

/// The positions of the mission that are lower than a drone hovers, as [`misplaced`] names them.
fn low(table: &MissionTable, mission: &Mission, floor_m: f64) -> Vec<SettingError> {
    let least_m = floor_m + HOVER_MIN_M;
    let rule =
        |_| format!("at least {least_m:.2} m high: {HOVER_MIN_M} m above cycle.filter.floor_m");
    misplaced(table, mission, |at| least_m - at[pose::Z], rule)
}

/// The poses of `table` that miss a rule by more than zero, `missing_m`; if there is none, the position of its path
/// that misses it most. `rule` states by how much.
fn misplaced(
    table: &MissionTable,
    mission: &Mission,
    missing_m: impl Fn(&Pose) -> f64,
    rule: impl Fn(f64) -> String,
) -> Vec<SettingError> {
    // What is no number does not fit.
    let fits = |at: &Pose| missing_m(at) <= 0.0;
    let refusal = |key: String, at: &Pose| {
        SettingError::new(key, position(pos_w(at).into()), rule(missing_m(at)))
    };
    let named = table.poses().filter(|(_, at)| !fits(at));
    let named: Vec<_> = named.map(|(key, at)| refusal(format!("mission.{key}"), &at)).collect();
    if !named.is_empty() {
        return named;
    }
    let outline = mission.outline();
    let by_missing = |a: &&Pose, b: &&Pose| missing_m(a).total_cmp(&missing_m(b));
    let worst = outline.iter().filter(|at| !fits(at)).max_by(by_missing);
    worst.map(|at| refusal("mission".into(), at)).into_iter().collect()
}

/// What is allowed but should be looked at, a sentence each: where `mission` asks for more than the vehicle of the
/// prior parameters does, so that it is flown late there or beside the path; walls that it is too near to; obstacles
/// that no position of the room touches. Allocates.
pub fn notes(mission: &Mission, cycle: &CycleTable) -> Vec<String> {
    let prior = &cycle.mhe.p_prior;
    let late = |(demand, row, best, unit): (Demand, usize, f64, &str)| {
        let outcome = if row == lag::A_MAX { "leaves the path" } else { "is late" };
        let asked = described(&demand, unit);
        (demand.value > best)
            .then(|| format!("{asked}: the vehicle does {best:.2} {unit} and {outcome} there"))
    };
    let accel = match (cycle.model, mission.demands(), prior.get(lag::A_MAX)) {
        (ModelKind::Lagged, Some(demands), Some(best)) => {
            Some((demands.accel, lag::A_MAX, *best, "m/s^2"))
        }
        _ => None,
    };
    let late = axes(mission, cycle, prior).chain(accel).filter_map(late);
    late.chain(near(mission, cycle)).chain(obstacles_outside(cycle)).collect()
}

/// Walls nearer to the mission than plans go.
fn near(mission: &Mission, cycle: &CycleTable) -> Option<String> {
    let (room, walls) = (cycle.supervisor.room.as_ref()?, cycle.mpc.walls.as_ref()?);
    let distance_m = mission.survey().margin_m(room.walls_m());
    (distance_m < walls.margin_m).then(|| {
        format!(
            "it comes within {distance_m:.2} m of a wall, the plan keeps {} m away (cycle.mpc.walls.margin_m): a \
             target there may never be reached",
            walls.margin_m
        )
    })
}

/// Obstacles that lie outside of the room as a whole, as those do that are written in millimetres.
fn obstacles_outside(cycle: &CycleTable) -> impl Iterator<Item = String> {
    let room = cycle.supervisor.room.as_ref();
    let is_outside = move |extent_m: &[[f64; 2]; 3]| {
        room.is_some_and(|room| {
            let walls_m = room.walls_m();
            let mut axes = extent_m.iter().zip(&walls_m);
            axes.any(|([low, high], [wall_low, wall_high])| high < wall_low || low > wall_high)
        })
    };
    cycle.obstacles.iter().enumerate().filter_map(move |(k, obstacle)| {
        obstacle.extent_m().filter(is_outside).map(|_| {
            format!("cycle.obstacles[{k}] is outside of the room as a whole: is it in metres, in the world frame?")
        })
    })
}

/// What a path asks of each axis, the row of its gain, what full sticks do with the parameters `p`, and the unit.
fn axes(
    mission: &Mission,
    cycle: &CycleTable,
    p: &[f64],
) -> impl Iterator<Item = (Demand, usize, f64, &'static str)> {
    let full = |axis: usize| cycle.mpc.u_ub.get(axis).map_or(1.0, |u| u.min(cycle.gate.stick_max));
    let best = |row: usize, axis: usize| p.get(row).map_or(f64::INFINITY, |gain| gain * full(axis));
    let [h, v, a] = [
        (lag::LAMBDA_H, best(lag::LAMBDA_H, stick::PITCH), "m/s horizontally"),
        (lag::LAMBDA_V, best(lag::LAMBDA_V, stick::THROTTLE), "m/s vertically"),
        (lag::LAMBDA_A, best(lag::LAMBDA_A, stick::YAW), "rad/s"),
    ];
    mission.demands().into_iter().flat_map(move |demands| {
        [(demands.horizontal, h), (demands.vertical, v), (demands.turn, a)]
            .map(|(demand, (row, best, unit))| (demand, row, best, unit))
    })
}

fn described(demand: &Demand, unit: &str) -> String {
    let Demand { value, at_w, at_s } = demand;
    format!("{value:.2} {unit} at {} after {at_s:.1} s", position(*at_w))
}

fn position([x, y, z]: [f64; 3]) -> String {
    format!("({x:.2}, {y:.2}, {z:.2}) m")
}

#[cfg(test)]
mod tests;
