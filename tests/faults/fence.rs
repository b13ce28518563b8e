//! The walls of the room.

use horizon_model::check::maximum;
use horizon_model::rows::{Sticks, pose};
use tello_flight::{Fault, Phase, Pilot, Room, RoomTable, cycle};
use tello_sim::Truth;
use tello_sim::virtual_time::VirtualFlight;

use super::story::{FAULT_AT_S, Moment, fly, settings};

/// Smaller than the one built in: the mission reaches to 2.5 m.
const ROOM: RoomTable =
    RoomTable { x_m: [-3.5, 3.5], y_m: [-3.5, 3.5], z_m: [-0.2, 3.0], stop_s: 1.3 };

#[test]
fn a_mission_that_leaves_the_room_is_refused_before_anything_moves() {
    let (mut flight, _) = settings(&[]);
    flight.cycle.supervisor.room = Some(RoomTable { y_m: [-2.4, 3.0], ..ROOM });
    let error = cycle::build(&flight).err().map(|error| error.to_string()).unwrap_or_default();
    assert!(error.starts_with("mission.waypoints.waypoints[3] = "), "{error}");
    assert!(error.contains("cycle.supervisor.room") && error.contains("0.10 m outside"), "{error}");
}

/// A person who flies towards the wall at x = 3.5 m and hands back as soon as `is_enough`.
fn runs_at_the_wall(is_enough: impl Fn(&Truth) -> bool) -> impl FnMut(f64, &mut VirtualFlight) {
    let mut has_handed_back = false;
    move |at_s, flight| {
        has_handed_back |= at_s > FAULT_AT_S && is_enough(&flight.truth());
        let is_by_hand = at_s >= FAULT_AT_S && !has_handed_back;
        flight.set_manual(is_by_hand.then(|| Sticks::new(0.0, 0.8, 0.0, 0.0)));
    }
}

/// By a plan that knows the walls, or else by neutral sticks.
#[test]
fn a_vehicle_that_rushes_at_the_wall_is_braked_and_comes_to_rest_inside() {
    for plan_knows_walls in [true, false] {
        let mut settings = settings(&[]);
        settings.0.cycle.supervisor.room = Some(ROOM);
        if !plan_knows_walls {
            settings.0.cycle.mpc.walls = None;
        }
        // It can just stop inside, by the measure of the room.
        let can_just_stop =
            |truth: &Truth| truth.pose[pose::X] + ROOM.stop_s * truth.velocity.x_mps > 3.48;
        let story = fly(&settings, 26.0, runs_at_the_wall(can_just_stop));
        let last_by_hand =
            story.moments.iter().rfind(|moment| moment.pilot == Some(Pilot::Person)).unwrap();
        let handed_back_s = last_by_hand.at_s;
        let fenced = |moment: &Moment| moment.faults.contains(&Fault::FenceNear);
        let held_s = story.first(handed_back_s, |moment| fenced(moment) && moment.pilot.is_none());
        let is_held = held_s.is_some_and(|s| s < handed_back_s + 0.2);
        assert_ne!(
            is_held, plan_knows_walls,
            "handed back at {handed_back_s} s, held at {held_s:?} s"
        );
        let room = Room::try_from(&ROOM).unwrap();
        let excess_m =
            story.moments.iter().map(|moment| room.excess_m(&moment.pose)).fold(0.0, maximum);
        assert!(excess_m <= 0.0, "{excess_m} m outside");
        assert_eq!(story.last().phase, Phase::Flying, "control goes on: {:?}", story.last());
        assert!(story.last_stick_s() > Some(25.0), "control does not go on");
    }
}

#[test]
fn a_vehicle_that_is_handed_back_outside_lands() {
    let mut settings = settings(&[]);
    settings.0.cycle.supervisor.room = Some(ROOM);
    let story = fly(&settings, 40.0, runs_at_the_wall(|truth| truth.pose[pose::X] > 3.6));
    story.assert_sound();
    assert!(story.has(Fault::FenceLeft), "{:?}", story.last());
    let by_hand_outside = |moment: &Moment| {
        moment.pilot == Some(Pilot::Person) && moment.faults.contains(&Fault::FenceLeft)
    };
    assert!(story.moments.iter().any(by_hand_outside), "a person was stopped by the wall");
    story.assert_down();
}
