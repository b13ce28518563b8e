use super::*;
use crate::firmware::PLAIN;
use crate::plant::{NOMINAL, PlantParams};
use crate::profile::Profile;

fn drone(phase: DronePhase, z: f64, battery_pct: f64) -> Drone {
    let params = PlantParams::try_from(NOMINAL);
    let at = Pose::new(0.0, 0.0, z, 0.0);
    let plant = Plant::new(params.unwrap(), at, Velocity::default(), 3).unwrap();
    let link = CommandLink::new(Profile::Clean, 3);
    Drone::new(plant, link, phase, battery_pct, PLAIN)
}

/// Advances until the phase changes, at most 40 s; the time it took. s
fn wait(drone: &mut Drone, mut each_step: impl FnMut(&mut Drone)) -> f64 {
    let phase = drone.phase;
    for k in 1..=2000 {
        each_step(drone);
        drone.advance();
        if drone.phase != phase {
            return f64::from(k) * DT_S;
        }
    }
    panic!("still {phase:?} after 40 s");
}

#[test]
fn take_off_ignores_the_sticks_and_ends_at_a_metre() {
    let mut drone = drone(DronePhase::Grounded, 0.0, 90.0);
    drone.steer(Sticks::new(1.0, 1.0, 1.0, 1.0));
    for _ in 0..100 {
        drone.advance();
    }
    assert_eq!(drone.truth().pose, Pose::new(0.0, 0.0, STANDING_M, 0.0));
    assert!(drone.take_off());
    let took_s = wait(&mut drone, Drone::reset_watchdog);
    assert_eq!(drone.phase, DronePhase::Flying);
    assert!((3.5..4.5).contains(&took_s), "{took_s} s");
    let truth = drone.truth();
    assert!(truth.pose[pose::X].hypot(truth.pose[pose::Y]) < 0.3, "{:?}", truth.pose);
    drone.steer(Sticks::zeros());
    for _ in 0..100 {
        drone.advance();
    }
    let height_m = drone.height_m();
    assert!((0.9..1.15).contains(&height_m), "hovers at {height_m} m");
}

#[test]
fn an_order_to_land_is_not_heard_early_in_a_take_off() {
    let mut drone = drone(DronePhase::Grounded, 0.0, 90.0);
    assert!(drone.take_off());
    let mut refused = 0;
    while !drone.land() {
        drone.advance();
        refused += 1;
    }
    assert_eq!(refused, 150);
    wait(&mut drone, |_| {});
    assert_eq!(drone.phase, DronePhase::Grounded);
}

#[test]
fn landing_takes_the_drone_down_and_stops_the_motors() {
    let mut drone = drone(DronePhase::Flying, 1.4, 90.0);
    drone.steer(Sticks::new(0.0, 1.0, 0.0, 1.0));
    assert!(drone.land());
    let took_s = wait(&mut drone, Drone::reset_watchdog);
    assert!((3.5..5.0).contains(&took_s), "{took_s} s");
    assert_eq!(drone.phase, DronePhase::Grounded);
    let (motor_s, battery_pct) = (drone.motor_s, drone.battery_pct);
    drone.advance();
    let truth = drone.truth();
    assert_eq!(truth.velocity, Velocity::default());
    assert!(truth.motor_s <= motor_s && truth.battery_pct >= battery_pct, "{truth:?}");
    assert!(truth.pose[pose::Z] <= STANDING_M);
}

#[test]
fn a_landing_can_be_called_off() {
    let mut drone = drone(DronePhase::Flying, 1.4, 90.0);
    assert!(!drone.cancel_landing());
    assert!(drone.land() && drone.cancel_landing());
    assert_eq!(drone.phase, DronePhase::Flying);
}

#[test]
fn silence_lands_and_the_next_packet_calls_it_off() {
    let mut drone = drone(DronePhase::Flying, 1.4, 90.0);
    let took_s = wait(&mut drone, |_| {});
    assert!((took_s - 15.0).abs() < 0.03, "{took_s} s");
    assert_eq!(drone.phase, DronePhase::Landing(Cause::Silence));
    drone.reset_watchdog();
    assert_eq!(drone.phase, DronePhase::Flying);
    wait(&mut drone, |_| {});
    wait(&mut drone, |_| {});
    assert_eq!(drone.phase, DronePhase::Grounded);
}

#[test]
fn an_empty_battery_lands_and_refuses_to_take_off() {
    let mut drone = drone(DronePhase::Flying, 1.4, 6.0);
    let took_s = wait(&mut drone, Drone::reset_watchdog);
    // 1 % at 0.125 %/s.
    assert!((took_s - 8.0).abs() < 0.05, "{took_s} s");
    assert_eq!(drone.phase, DronePhase::Landing(Cause::Battery));
    assert!(!drone.cancel_landing());
    wait(&mut drone, Drone::reset_watchdog);
    assert!(!drone.take_off());
}

#[test]
fn a_full_battery_has_a_tenth_left_after_12_minutes() {
    let mut drone = drone(DronePhase::Flying, 1.4, 100.0);
    for _ in 0..12 * 60 * 50 {
        drone.reset_watchdog();
        drone.advance();
    }
    assert!((drone.battery_pct - 10.0).abs() < 1e-6, "{} %", drone.battery_pct);
}

#[test]
fn sticks_stay_until_replaced_and_never_reach_the_floor() {
    let mut drone = drone(DronePhase::Flying, 1.4, 90.0);
    drone.steer(Sticks::new(0.0, 0.5, 0.0, -1.0));
    for _ in 0..500 {
        drone.reset_watchdog();
        drone.advance();
    }
    let truth = drone.truth();
    assert_eq!(truth.phase, DronePhase::Flying);
    assert!(truth.pose[pose::X] > 5.0, "{:?}", truth.pose);
    // From 0.28 m on it is braked with its lag: 0.25 s at 0.78 m/s. The disturbance adds some
    // centimetres.
    let height_m = truth.pose[pose::Z];
    assert!((0.01..0.2).contains(&height_m), "{height_m} m");
}

#[test]
fn a_stopped_drone_falls_like_a_stone_and_may_take_off_again() {
    let mut drone = drone(DronePhase::Flying, 1.3, 90.0);
    drone.stop_motors();
    assert_eq!(drone.phase, DronePhase::Falling);
    assert!(!drone.land() && !drone.take_off() && !drone.cancel_landing());
    let took_s = wait(&mut drone, Drone::reset_watchdog);
    // sqrt(2 * 1.25 m / g) = 0.505 s; it enters the fall from a hover.
    assert!((0.48..=0.54).contains(&took_s), "{took_s} s");
    assert_eq!(drone.phase, DronePhase::Grounded);
    assert!(drone.take_off());
}

#[test]
fn an_emergency_stop_ends_a_take_off_and_a_landing_and_leaves_a_standing_drone_alone() {
    let mut drone = drone(DronePhase::Grounded, 0.0, 90.0);
    drone.stop_motors();
    assert_eq!(drone.phase, DronePhase::Grounded);
    assert!(drone.take_off());
    drone.stop_motors();
    wait(&mut drone, |_| {});
    assert_eq!(drone.phase, DronePhase::Grounded);
}
