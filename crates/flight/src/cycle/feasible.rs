//! Whether a mission fits the room, the obstacles and the vehicle: what nothing that the settings describe can fly is
//! refused, what is more than the expected vehicle does is noted.

use horizon_model::rows::{Pose, lag, pos_w, stick};
use horizon_model::setting::SettingError;

use super::{CycleTable, ModelKind};
use crate::mission::Demand;
use crate::{Mission, MissionTable, Room, RoomTable, obstacles};

/// Why `mission`, which is that of `table`, cannot be flown: it leaves the room, stops inside of an obstacle, is faster
/// than the failsafe lets a vehicle be or than the upper bounds of the gains. Each pose of `table` outside of the room is
/// named, the farthest place of the path if none of them is. Allocates.
///
/// # Errors
/// A room or obstacles that break their rule.
pub fn misfits(
    table: &MissionTable,
    mission: &Mission,
    cycle: &CycleTable,
) -> Result<Vec<SettingError>, SettingError> {
    let mut found = match &cycle.supervisor.room {
        Some(room) => outside(table, mission, room)?,
        None => Vec::new(),
    };
    let mut refuse = |value: String, rule: String| {
        found.push(SettingError::new("mission", value, rule));
    };
    let obstacles = obstacles(&cycle.obstacles).map_err(|error| error.under("cycle"))?;
    for (k, obstacle) in obstacles.iter().enumerate() {
        let inside = |at: &Pose| (-obstacle.distance(&pos_w(at)).distance_m, pos_w(at));
        let deepest = mission.stops().iter().map(inside).max_by(|a, b| a.0.total_cmp(&b.0));
        if let Some((inside_m, at)) = deepest.filter(|(inside_m, _)| *inside_m > 0.0) {
            let rule = format!("outside of cycle.obstacles[{k}]: it is {inside_m:.2} m inside");
            refuse(place(at.into()), rule);
        }
    }
    let failsafe_mps = cycle.supervisor.failsafe.speed_mps;
    if let Some(demands) = mission.demands().filter(|it| it.speed.value > failsafe_mps) {
        let rule = format!("at most {failsafe_mps}, cycle.supervisor.failsafe.speed_mps");
        refuse(described(&demands.speed, "m/s"), rule);
    } else {
        for (demand, row, best, unit) in axes(mission, cycle, &cycle.mhe.p_ub) {
            if demand.value > best {
                let rule = format!("at most {best}, full sticks with cycle.mhe.p_ub[{row}]");
                refuse(described(&demand, unit), rule);
            }
        }
    }
    Ok(found)
}

/// The poses of `table` that are outside of `room`; if there is none, the farthest place of its path.
fn outside(
    table: &MissionTable,
    mission: &Mission,
    room: &RoomTable,
) -> Result<Vec<SettingError>, SettingError> {
    let room = Room::try_from(room).map_err(|error| error.under("cycle.supervisor.room"))?;
    let refusal = |key: String, at: &Pose| {
        let excess_m = room.excess_m(at);
        let rule = format!("inside of cycle.supervisor.room: it is {excess_m:.2} m outside");
        SettingError::new(key, place(pos_w(at).into()), rule)
    };
    let named = table.poses().filter(|(_, at)| !room.contains(at));
    let named: Vec<_> = named.map(|(key, at)| refusal(format!("mission.{key}"), &at)).collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let outline = mission.outline();
    let outside = outline.iter().filter(|at| !room.contains(at));
    let by_excess = |a: &&Pose, b: &&Pose| room.excess_m(a).total_cmp(&room.excess_m(b));
    Ok(outside.max_by(by_excess).map(|at| refusal("mission".into(), at)).into_iter().collect())
}

/// Where `mission` asks for more than the vehicle of the prior parameters does, a sentence each: it is flown late there,
/// or beside the path.
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
    axes(mission, cycle, prior).chain(accel).filter_map(late).collect()
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
    let Demand { value, at_m, at_s } = demand;
    format!("{value:.2} {unit} at {} after {at_s:.1} s", place(*at_m))
}

fn place([x, y, z]: [f64; 3]) -> String {
    format!("({x:.2}, {y:.2}, {z:.2}) m")
}
