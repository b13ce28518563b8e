//! From a table to a checked reference along a trajectory.

use std::f64::consts::TAU;

use horizon_model::rows::{Pose, pos_w, pose};
use horizon_model::setting::{SettingError, finite, in_range, not_negative};

use super::follower::Follower;
use super::table::{
    CircleTable, Direction, FollowTable, LIMIT_MIN, LimitTable, PointsTable, SplineTable,
    TIMED_COUNT, TrajectoryTable, WaypointTable, at_least, check_apart, check_waypoints, repeat,
};
use super::timed_path::{TimedPath, Waypoint, leave};
use crate::path::{self, Heading, Limits, Path};
use crate::trajectory::Trajectory;

/// Longest path. m
const LENGTH_MAX_M: f64 = 500.0;

/// Most turns: those of the smallest circle on the longest path. turns
const TURNS_MAX: f64 = 1600.0;

/// A larger angle loses its digits. rad
const BEGIN_MAX_RAD: f64 = 1000.0;

/// Longest trajectory. s
const DURATION_MAX_S: f64 = 3600.0;

/// Speed and yaw rate to the beginning of a trajectory that is slower, or stands still. m/s, rad/s
const SLOWEST: (f64, f64) = (0.3, 0.5);

/// Of the distance at which corners pass their waypoints: after a missed one. 1
const CAREFUL_CORNERS: f64 = 0.5;

/// A limit that does not limit. m/s, m/s^2, rad/s
const LIFTED: f64 = 1e3;

/// A limit by its key, with its value, and how long the path takes without it. s
struct LiftedLimit {
    key: &'static str,
    value: f64,
    duration_s: f64,
}

pub(super) fn waypoints(table: &WaypointTable, dt_s: f64) -> Result<Follower, SettingError> {
    let mut poses = check_waypoints(&table.waypoints, 2)?;
    repeat(&mut poses, table.laps)?;
    check_length(&poses)?;
    let corner_m = not_negative("corner_m", table.corner_m)?;
    if corner_m >= table.follow.reach {
        let rule = format!("below follow.reach = {}", table.follow.reach);
        return Err(SettingError::new("corner_m", corner_m, rule));
    }
    let limits = limits(&table.limits)?;
    let timed = |corner_m| -> Result<TimedPath, SettingError> {
        let path = path::rounded(&poses, corner_m);
        let trajectory = timed_path(&path, &poses, table.heading, &limits)?;
        let stops = poses.iter().zip(path.marks()).map(|(at, node)| {
            let passing = trajectory.nodes()[*node].pose;
            // On a rounded corner the path passes beside the waypoint, with the same heading.
            let at = Pose::new(at[pose::X], at[pose::Y], at[pose::Z], passing[pose::THETA]);
            let leave = leave(&trajectory, *node, &at, table.follow.reach);
            Waypoint { pose: at, node: *node, leave, counts_from_s: 0.0 }
        });
        let waypoints = stops.collect();
        Ok(TimedPath { trajectory, waypoints })
    };
    // Without careful corners if the path would take too long with them.
    let careful = if corner_m > 0.0 { timed(CAREFUL_CORNERS * corner_m).ok() } else { None };
    Follower::new(timed(corner_m)?, careful, &table.follow, limits, dt_s)
}

pub(super) fn spline(table: &SplineTable, dt_s: f64) -> Result<Follower, SettingError> {
    let mut poses = check_waypoints(&table.waypoints, 3)?;
    if table.closed && table.laps > 1 {
        // A periodic spline through points that are repeated repeats itself.
        poses.push(poses[0]);
        repeat(&mut poses, table.laps)?;
        poses.pop();
    } else {
        repeat(&mut poses, table.laps)?;
    }
    check_length(&poses)?;
    let path = path::spline(&poses, table.closed);
    if let Some(k) = path.first_unresolved() {
        let rule = "a curve that can be flown: it turns back on itself after this waypoint; move it, \
                    or let `waypoints` turn back there";
        return Err(SettingError::new(
            format!("waypoints[{}]", k % table.waypoints.len()),
            format!("{:?}", table.waypoints[k % table.waypoints.len()]),
            rule,
        ));
    }
    if table.closed {
        let last = poses.len() - 1;
        check_apart(last, &poses[last], &poses[0])?;
        poses.push(poses[0]);
    }
    let limits = limits(&table.limits)?;
    let trajectory = timed_path(&path, &poses, table.heading, &limits)?;
    curve(trajectory, &table.follow, limits, dt_s)
}

pub(super) fn circle(table: &CircleTable, dt_s: f64) -> Result<Follower, SettingError> {
    for (row, value) in table.centre_w.iter().enumerate() {
        finite(&format!("centre[{row}]"), *value)?;
    }
    let centre = Pose::from(table.centre_w);
    let radius_m = in_range("radius_m", table.radius_m, 0.05..=50.0)?;
    let turns = in_range("turns", table.turns, 0.01..=TURNS_MAX)?;
    if TAU * turns * radius_m > LENGTH_MAX_M {
        let rule = format!("at most {LENGTH_MAX_M} m in all");
        return Err(SettingError::new("turns", turns, rule));
    }
    let turns = match table.direction {
        Direction::CounterClockwise => turns,
        Direction::Clockwise => -turns,
    };
    let begin_rad = in_range("begin_rad", table.begin_rad, -BEGIN_MAX_RAD..=BEGIN_MAX_RAD)?;
    let limits = limits(&table.limits)?;
    let path = path::circle(pos_w(&centre), radius_m, begin_rad, turns);
    let trajectory = timed_path(&path, &[centre, centre], table.heading, &limits)?;
    curve(trajectory, &table.follow, limits, dt_s)
}

pub(super) fn timed(table: &TrajectoryTable, dt_s: f64) -> Result<Follower, SettingError> {
    let rows = match &table.points {
        PointsTable::Rows(rows) => rows,
        PointsTable::Csv(name) => {
            return Err(SettingError::new(
                "points.csv",
                name,
                "rows of `points`: a CSV file is read only from a mission file",
            ));
        }
    };
    if rows.len() < 2 {
        return Err(SettingError::new("points", rows.len(), "at least 2 rows"));
    }
    for (k, row) in rows.iter().enumerate() {
        for (column, value) in row.iter().enumerate() {
            finite(&format!("points[{k}][{column}]"), *value)?;
        }
    }
    let times_s: Vec<f64> = rows.iter().map(|[t_s, ..]| *t_s).collect();
    if let Some(error) = falling_times(rows).next() {
        return Err(error);
    }
    let duration_s = times_s[times_s.len() - 1] - times_s[0];
    if duration_s > DURATION_MAX_S {
        let rule = format!("at most {DURATION_MAX_S} s in all");
        return Err(SettingError::new("points", format!("{duration_s} s"), rule));
    }
    let accel_max_mps2 = at_least(LIMIT_MIN, "accel_max_mps2", table.accel_max_mps2)?;
    let poses: Vec<Pose> =
        rows.iter().map(|[_, x, y, z, theta]| Pose::new(*x, *y, *z, *theta)).collect();
    let trajectory = Trajectory::through(&times_s, &poses);
    let limits = own_limits(&trajectory, accel_max_mps2);
    curve(trajectory, &table.follow, limits, dt_s)
}

/// The times of `rows` that are not above all before, each as a refusal of `points[k][0]`.
pub fn falling_times(rows: &[[f64; TIMED_COUNT]]) -> impl Iterator<Item = SettingError> + '_ {
    let mut before_s = f64::NEG_INFINITY;
    rows.iter().enumerate().filter_map(move |(k, [t_s, ..])| {
        let refused = (*t_s <= before_s).then(|| {
            let rule = format!("above the time before, {before_s}");
            SettingError::new(format!("points[{k}][0]"), t_s, rule)
        });
        before_s = before_s.max(*t_s);
        refused
    })
}

/// Limits for the path to a timed trajectory: its own fastest speed and yaw rate, but not so slow that
/// the vehicle never arrives.
fn own_limits(trajectory: &Trajectory, accel_mps2: f64) -> Limits {
    let nodes = trajectory.nodes().iter();
    let (speed_mps, turn_radps) = nodes.fold(SLOWEST, |(speed_mps, turn_radps), node| {
        (speed_mps.max(node.vel_w().norm()), turn_radps.max(node.rate[pose::THETA].abs()))
    });
    Limits { speed_mps, accel_mps2, speed_up_mps2: accel_mps2, climb_mps: speed_mps, turn_radps }
}

/// A curve without waypoints of its own: its beginning and, once the reference is there, its end.
fn curve(
    trajectory: Trajectory,
    follow: &FollowTable,
    limits: Limits,
    dt_s: f64,
) -> Result<Follower, SettingError> {
    let last = trajectory.nodes().len() - 1;
    let waypoint = |node: usize| {
        let at = &trajectory.nodes()[node];
        Waypoint { pose: at.pose, node, leave: last, counts_from_s: at.at_s }
    };
    let waypoints = vec![waypoint(0), waypoint(last)];
    Follower::new(TimedPath { trajectory, waypoints }, None, follow, limits, dt_s)
}

/// The path as fast as `limits` allow.
///
/// # Errors
/// It takes too long; the key is that of the limit which costs most of the time.
fn timed_path(
    path: &Path,
    poses: &[Pose],
    heading: Heading,
    limits: &Limits,
) -> Result<Trajectory, SettingError> {
    let thetas: Vec<f64> = poses.iter().map(|at| at[pose::THETA]).collect();
    let headings = path.headings(heading, &thetas);
    let duration_s = path.duration_s(&headings, limits);
    if duration_s <= DURATION_MAX_S {
        return Ok(path.timed(&headings, limits));
    }
    let without = |key, value, lifted: Limits| LiftedLimit {
        key,
        value,
        duration_s: path.duration_s(&headings, &lifted),
    };
    let Limits { speed_mps, accel_mps2, climb_mps, turn_radps, .. } = *limits;
    let any_accel = Limits { accel_mps2: LIFTED, speed_up_mps2: LIFTED, ..*limits };
    let [first, others @ ..] = [
        without("speed_max_mps", speed_mps, Limits { speed_mps: LIFTED, ..*limits }),
        without("accel_max_mps2", accel_mps2, any_accel),
        without("climb_max_mps", climb_mps, Limits { climb_mps: LIFTED, ..*limits }),
        without("turn_max_radps", turn_radps, Limits { turn_radps: LIFTED, ..*limits }),
    ];
    let shorter = |least: LiftedLimit, other: LiftedLimit| {
        if other.duration_s < least.duration_s { other } else { least }
    };
    let LiftedLimit { key, value, .. } = others.into_iter().fold(first, shorter);
    let rule =
        format!("at most {DURATION_MAX_S} s for the path instead of {duration_s:.0} s: raise it");
    Err(SettingError::new(format!("limits.{key}"), value, rule))
}

fn limits(table: &LimitTable) -> Result<Limits, SettingError> {
    table.check().map_err(|error| error.under("limits"))
}

fn check_length(poses: &[Pose]) -> Result<(), SettingError> {
    let sides = poses.windows(2).map(|pair| (pair[1] - pair[0]).fixed_rows::<3>(pose::X).norm());
    let length_m: f64 = sides.sum();
    if length_m <= LENGTH_MAX_M {
        return Ok(());
    }
    let rule = format!("at most {LENGTH_MAX_M} m in all");
    Err(SettingError::new("waypoints", format!("{length_m:.2} m"), rule))
}

#[cfg(test)]
mod tests;
