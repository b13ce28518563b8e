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

#[cfg(test)]
mod tests {
    use tello_io::config;

    use super::*;

    /// First target of these tests. m, rad
    const FIRST: [f64; 4] = [3.0, -3.0, 1.2, 0.0];

    /// The check of a drone that stands at `at`, with the built-in settings after a change.
    fn start_at(at: [f64; 4], change: impl FnOnce(&mut CycleTable)) -> Check {
        let (mut table, _) = config::fly(None, None).unwrap();
        change(&mut table.cycle);
        start_check(Some(&Pose::from(at)), &table.cycle, &Pose::from(FIRST)).unwrap()
    }

    #[test]
    fn without_a_pose_the_start_is_unknown() {
        let (table, _) = config::fly(None, None).unwrap();
        let check = start_check(None, &table.cycle, &Pose::from(FIRST)).unwrap();
        assert_eq!(check.readiness, Readiness::Bad);
        assert_eq!(check.reason, "unknown without a pose");
    }

    #[test]
    fn a_near_wall_and_a_turned_heading_are_joined_in_one_note() {
        let check = start_at([4.41, -3.0, 0.05, 3.1], |_| ());
        assert_eq!(check.readiness, Readiness::Note);
        let (near, turned) = check.reason.split_once("; turned by ").unwrap();
        assert!(near.contains("0.59 m from the wall at the upper x of the room"), "{check}");
        assert!(turned.starts_with("+178 degrees from the heading of the first"), "{check}");
        assert!(turned.contains("the nose of the object is wrong"), "{check}");
    }

    #[test]
    fn a_near_wall_or_a_turned_heading_is_noted_alone() {
        let near = start_at([4.41, -3.0, 0.05, 0.0], |_| ());
        assert_eq!(near.readiness, Readiness::Note);
        assert!(near.reason.contains("leave 0.6 m") && !near.reason.contains("turned"), "{near}");
        let turned = start_at([2.0, -3.0, 0.05, -0.61], |_| ());
        assert_eq!(turned.readiness, Readiness::Note);
        assert!(
            turned.reason.contains("turned by -35") && !turned.reason.contains("wall"),
            "{turned}"
        );
    }

    #[test]
    fn headings_are_compared_across_the_half_turn() {
        let (table, _) = config::fly(None, None).unwrap();
        let (at, first) = ([2.0, -3.0, 0.05, 3.1], [3.0, -3.0, 1.2, -3.1]);
        let check = start_check(Some(&at.into()), &table.cycle, &first.into()).unwrap();
        assert_eq!(check.readiness, Readiness::Good, "{check}");
    }

    #[test]
    fn a_pose_below_the_floor_of_the_filter_is_refused_with_its_key() {
        let check = start_at([2.0, -3.0, 0.05, 0.0], |cycle| cycle.filter.floor_m = 0.1);
        assert_eq!(check.readiness, Readiness::Bad);
        assert!(check.reason.contains("lower poses than 0.1 m (cycle.filter.floor_m)"), "{check}");
    }

    #[test]
    fn a_place_outside_of_the_room_is_refused_with_the_axis() {
        let check = start_at([2.0, -5.1, 0.05, 0.0], |_| ());
        assert_eq!(check.readiness, Readiness::Bad);
        assert!(check.reason.contains("outside of the room, whose y is -5.00..5.00 m"), "{check}");
    }

    #[test]
    fn a_first_target_that_is_too_far_stays_refused() {
        let check = start_at([-48.0, -3.0, 0.05, 0.0], |cycle| cycle.supervisor.room = None);
        assert_eq!(check.readiness, Readiness::Never);
        assert!(check.reason.contains("more than 50 m: are mission, room"), "{check}");
    }
}
