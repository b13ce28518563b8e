//! The pose of the drone before the take-off.

use anyhow::Result;
use horizon_model::angle::wrap;
use horizon_model::rows::{Pose, pose};
use tello_flight::cycle::{self, CycleTable};
use tello_flight::{CLIMB_MAX_M, GROUND_MAX_M, Room, RoomTable};

use super::{Check, Readiness, check};

/// A first target that is further away is one in another unit or another room: the vehicle would set off for it. m
const TO_FIRST_MAX_M: f64 = 50.0;

/// Least distance of a take-off from walls and obstacles without a note. m
const BESIDE_MIN_M: f64 = 0.6;

/// A heading offset up to this is estimated in flight; a vehicle that stands turned by more from its first target may
/// have a nose that was defined wrongly. rad
const TURNED_MAX_RAD: f64 = 0.6;

/// # Errors
/// A room that breaks its rule.
pub(super) fn start_check(at: Option<&Pose>, cycle: &CycleTable, first: &Pose) -> Result<Check> {
    let Some(at) = at else { return Ok(check("start", Readiness::Bad, "unknown without a pose")) };
    let floor_m = cycle.filter.floor_m;
    let room = cycle.supervisor.room.as_ref().map(Room::try_from).transpose()?;
    let near = cycle::take_off_clearance(at, cycle)?.filter(|(near_m, _)| *near_m < BESIDE_MIN_M);
    let to_first_m = (first - at).fixed_rows::<3>(pose::X).norm();
    let turned_rad = wrap(at[pose::THETA] - first[pose::THETA]);
    let place = format!(
        "at {:+.2} {:+.2} {:+.2} m, heading {:+.0} degrees",
        at[pose::X],
        at[pose::Y],
        at[pose::Z],
        at[pose::THETA].to_degrees()
    );
    Ok(if at[pose::Z] < floor_m {
        let reason = format!(
            "{place}: lower poses than {floor_m} m (cycle.filter.floor_m) count as wrong; are poses in metres, with z \
             upwards (tello-ctl mocap watch shows it)? If they are, lower that key, or the origin of the motion capture"
        );
        check("start", Readiness::Bad, reason)
    } else if room.is_some_and(|room| !room.may_start_at(at)) {
        let why =
            cycle.supervisor.room.as_ref().map_or_else(String::new, |room| misplaced(at, room));
        let reason = format!("{place}: {why}; is it the drone, in metres, with z upwards?");
        check("start", Readiness::Bad, reason)
    } else if to_first_m > TO_FIRST_MAX_M {
        let reason = format!(
            "{place}, {to_first_m:.1} m from the first target, more than {TO_FIRST_MAX_M} m: are mission, room and \
             motion capture in metres?"
        );
        check("start", Readiness::Never, reason)
    } else {
        let notes: Vec<String> = near
            .map(|(near_m, name)| {
                format!(
                    "{near_m:.2} m from {name}: nothing steers in the take-off, and a draught carries the drone; leave \
                     {BESIDE_MIN_M} m"
                )
            })
            .into_iter()
            .chain((turned_rad.abs() > TURNED_MAX_RAD).then(|| turned(turned_rad)))
            .collect();
        match notes.as_slice() {
            [] => check(
                "start",
                Readiness::Good,
                format!("{place}, {to_first_m:.1} m from the first target"),
            ),
            notes => check("start", Readiness::Note, format!("{place}, {}", notes.join("; "))),
        }
    })
}

/// What a heading so far from that of the first target may mean.
fn turned(turned_rad: f64) -> String {
    format!(
        "turned by {:+.0} degrees from the heading of the first target: if its nose points there, the nose of the \
         object is wrong (tello-ctl mocap watch shows it)",
        turned_rad.to_degrees()
    )
}

/// Why no take-off begins at `at`, for a place that the room refuses.
fn misplaced(at: &Pose, room: &RoomTable) -> String {
    let RoomTable { x_m, y_m, z_m, .. } = room;
    let [floor_m, ceiling_m] = z_m;
    let rows = [("x", pose::X, x_m), ("y", pose::Y, y_m), ("z", pose::Z, z_m)];
    let outside =
        rows.into_iter().find(|(_, row, [low_m, high_m])| !(*low_m..=*high_m).contains(&at[*row]));
    match outside {
        Some((name, _, [low_m, high_m])) => {
            format!("outside of the room, whose {name} is {low_m:.2}..{high_m:.2} m")
        }
        None if at[pose::Z] > floor_m + GROUND_MAX_M => {
            format!("more than {GROUND_MAX_M} m above the floor of the room, z = {floor_m:.2} m")
        }
        None => format!(
            "less than {CLIMB_MAX_M} m, which a take-off needs, below the ceiling of the room, z = {ceiling_m:.2} m"
        ),
    }
}
