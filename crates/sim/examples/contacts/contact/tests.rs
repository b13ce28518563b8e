use tello_flight::{ObstacleTable, RoomTable, Start};
use tello_io::config;
use tello_sim::{Profile, SimStart};

use super::*;

const DEAD_STEPS: u64 = 16;

/// The square beside a wall at `x_m`, with a vehicle like the nominal one that starts at rest.
fn beside(x_m: f64) -> (FlightTable, SimTable) {
    let (fly, mission) = config::fly(None, None).unwrap();
    let mut flight = config::flight(&fly, mission, Start::Airborne);
    let (y_m, z_m) = ([-5.0, 5.0], [-0.2, 3.0]);
    flight.cycle.supervisor.room = Some(RoomTable { x_m: [-5.0, x_m], y_m, z_m, stop_s: 1.3 });
    let start = SimStart::Air { x: -2.0, y: -3.0, z: 1.2, theta: 0.06 };
    let sim = tello_sim::settings(None).unwrap();
    (flight, SimTable { profile: Profile::Clean, has_spread: false, start, ..sim })
}

/// A vehicle that flies along x with full deflection from -2 m on, after `count` steps.
fn flown(sim: &SimTable, count: u64) -> World {
    let mut world = World::new(sim, 1).unwrap();
    let u = world.drone().plant().sticks_towards(0.06, [1.0, 0.0]);
    (0..count).for_each(|_| steer(&mut world, u));
    world
}

#[test]
fn braking_helps_as_long_as_the_way_of_the_dead_time_and_of_the_braking_is_left() {
    let (flight, sim) = beside(0.0);
    let around = Surroundings::of(&flight.cycle).unwrap();
    let scene = Scene { around, passer: None, seed: 1 };
    // The bound by hand: the way up to the first braking stick, and v^2 / (2 a) behind it.
    let left_m = |count: u64| {
        let then = flown(&sim, count + DEAD_STEPS).truth();
        let speed_mps = then.velocity.x_mps;
        -then.pose[pose::X] - speed_mps * speed_mps / (2.0 * 1.1)
    };
    let helps = |count| scene.is_clear_by_braking(&flown(&sim, count), count + 200);
    let turning = (1..120).find(|count| left_m(*count) < 0.0).unwrap();
    assert!(helps(turning - 8), "0.16 s earlier than the bound of {turning} steps");
    assert!(!helps(turning + 8), "0.16 s later than the bound of {turning} steps");
}

#[test]
fn a_contact_is_avoidable_unless_the_last_fault_comes_too_late_or_the_pose_is_false() {
    let (flight, sim) = beside(0.0);
    // Straight into the wall, as a controller would that does not know it.
    let judged = |onset: Option<u64>, error_m: f64| {
        let around = Surroundings::of(&flight.cycle).unwrap();
        let mut watch = Watch::new(Scene { around, passer: None, seed: 1 }, &sim);
        watch.onsets.extend(onset);
        let mut world = World::new(&sim, 1).unwrap();
        let u = world.drone().plant().sticks_towards(0.06, [1.0, 0.0]);
        loop {
            watch.remember(&world);
            if error_m > FALSE_M {
                watch.newest = Some((world.step(), false));
                watch.moments.back_mut().unwrap().knowledge = Knowledge::False;
            }
            steer(&mut world, u);
            if let Some(contact) = watch.contact(&world) {
                return contact;
            }
        }
    };
    let free = judged(None, 0.0);
    assert_eq!((free.touched, free.avoidability), (Touched::Wall, Avoidability::Avoidable));
    let ahead_s = free.ahead_s.unwrap();
    assert!((0.6..2.0).contains(&ahead_s), "{free:?}");
    let at = steps(free.at_s);
    assert_eq!(judged(Some(at - 5), 0.0).avoidability, Avoidability::TooLate);
    assert_eq!(judged(Some(at - steps(ahead_s) - 20), 0.0).avoidability, Avoidability::Avoidable);
    assert_eq!(judged(None, 1.0).avoidability, Avoidability::FalsePose);
}

#[test]
fn a_standing_vehicle_is_run_over_and_no_braking_avoids_it() {
    let (mut flight, mut sim) = beside(5.0);
    flight.cycle.obstacles.push(ObstacleTable::Moving { radius_m: 0.2 });
    sim.passer = Some(PasserTable {
        from_w_m: [-4.0, -3.0, 1.0],
        to_w_m: [0.0, -3.0, 1.0],
        speed_mps: 1.0,
        hidden_s: None,
    });
    let around = Surroundings::of(&flight.cycle).unwrap();
    let mut watch = Watch::new(Scene { around, passer: sim.passer, seed: 0 }, &sim);
    let mut world = World::new(&sim, 0).unwrap();
    let contact = loop {
        watch.remember(&world);
        steer(&mut world, Sticks::zeros());
        if let Some(contact) = watch.contact(&world) {
            break contact;
        }
    };
    assert_eq!(contact.touched, Touched::Obstacle);
    assert_eq!(contact.avoidability, Avoidability::Unavoidable);
    assert!((1.5..2.1).contains(&contact.at_s), "{contact:?}");
}
