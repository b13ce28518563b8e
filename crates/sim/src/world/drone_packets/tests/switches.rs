//! Both positions of each switch of the drone, and the faults of the drone, by what it is sent.

use horizon_model::check::amax;
use horizon_model::rows::{Sticks, pose};
use nalgebra::Vector2;
use tello_flight::drone::Protocol;
use tello_flight::gate::{Gate, GateTable};
use tello_io::clock::TimeOfDay;

use super::super::*;
use crate::drone::{Cause, DronePhase, Truth};
use crate::fault::ScriptedFault;
use crate::firmware::{CancelledBy, DroneTable, OutageBehaviour, PLAIN};
use crate::plant::RIGID_BODY;
use crate::world::tests::table;
use crate::{DT_S, Profile, SimStart, SimTable};

const LAND: HostPacket = HostPacket::Action { action: Action::Land, sequence: 8 };
const FORWARD: Sticks = Sticks::new(0.0, 0.5, 0.0, 0.0);

fn sticks(u: Sticks) -> HostPacket {
    HostPacket::Sticks { u, is_fast: false, time: TimeOfDay::default() }
}

/// A world without chance, in the air.
fn world(change: impl FnOnce(&mut DroneTable), faults: Vec<ScriptedFault>) -> World {
    let mut drone = PLAIN;
    change(&mut drone);
    World::new(&SimTable { faults, ..air(drone) }, 1).unwrap()
}

fn air(drone: DroneTable) -> SimTable {
    let start = SimStart::Air { x: 0.0, y: 0.0, z: 1.3, theta: 0.06 };
    let mut table = SimTable { start, drone, ..table() };
    (table.profile, table.has_spread) = (Profile::Clean, false);
    (table.plant.disturbance_h_mps, table.plant.disturbance_v_mps) = (0.0, 0.0);
    table
}

fn wait(world: &mut World, time_s: f64) {
    for _ in 0..steps(time_s) {
        world.advance();
    }
}

/// Sends sticks in every step.
fn steer(world: &mut World, u: Sticks, time_s: f64) {
    for _ in 0..steps(time_s) {
        world.receive(&sticks(u));
        world.advance();
    }
}

fn steps(time_s: f64) -> u32 {
    let count = (0..10_000_u32).take_while(|k| f64::from(*k) * DT_S < time_s - 1e-9).count();
    count.try_into().unwrap()
}

fn speed_mps(world: &World) -> f64 {
    let velocity = world.truth().velocity;
    velocity.x_mps.hypot(velocity.y_mps)
}

fn fault(fault: InjectedFault, from_s: f64, for_s: f64) -> Vec<ScriptedFault> {
    vec![ScriptedFault { fault, from_s, for_s }]
}

#[test]
fn an_emergency_is_obeyed_or_not() {
    for is_obeyed in [true, false] {
        let mut world = world(|drone| drone.emergency.binary = is_obeyed, Vec::new());
        world.receive(&HostPacket::EmergencyStop);
        let phase = if is_obeyed { DronePhase::Falling } else { DronePhase::Flying };
        assert_eq!((world.truth().phase, world.truth().received.emergency_stops), (phase, 1));
    }
}

#[test]
fn a_gesture_of_the_sticks_stops_the_motors_or_not_and_never_through_the_gate() {
    let corner = Sticks::new(1.0, -1.0, -1.0, -1.0);
    let gate = Gate::new(&GateTable { stick_max: 1.0, stale_s: 0.3 }, Protocol::Binary).unwrap();
    let passed = gate.pass(&corner, Some(0.0)).sticks();
    for (stops, u, phase) in [
        (true, corner, DronePhase::Falling),
        (false, corner, DronePhase::Flying),
        (true, passed, DronePhase::Flying),
        (true, -corner, DronePhase::Flying),
    ] {
        let mut world = world(|drone| drone.stops_at_gesture = stops, Vec::new());
        steer(&mut world, u, 0.1);
        assert_eq!(world.truth().phase, phase, "{stops}, {u}");
    }
}

#[test]
fn a_landing_levels_or_goes_on_with_the_last_sticks() {
    for keeps_sticks in [false, true] {
        let mut world = world(|drone| drone.landing.keeps_sticks = keeps_sticks, Vec::new());
        steer(&mut world, FORWARD, 3.0);
        let before_mps = speed_mps(&world);
        world.receive(&LAND);
        let from_m = world.truth().pose[pose::X];
        wait(&mut world, 2.5);
        let way_m = world.truth().pose[pose::X] - from_m;
        assert_eq!(world.truth().phase, DronePhase::Landing(Cause::Order));
        if keeps_sticks {
            assert!((speed_mps(&world) - before_mps).abs() < 0.05 && way_m > 1.5, "{way_m} m");
        } else {
            assert!(speed_mps(&world) < 0.1 && way_m < 1.0, "{way_m} m");
        }
        wait(&mut world, 3.0);
        assert_eq!(world.truth().phase, DronePhase::Grounded);
    }
    let mut world = world(|drone| drone.landing.keeps_sticks = true, Vec::new());
    steer(&mut world, FORWARD, 3.0);
    world.receive(&sticks(Sticks::zeros()));
    world.receive(&LAND);
    wait(&mut world, 2.5);
    assert!(speed_mps(&world) < 0.1, "neutral sticks before the order level it");
}

#[test]
fn orders_to_land_are_not_heard_for_a_time_or_a_number() {
    let answers = |change: fn(&mut DroneTable)| -> Vec<bool> {
        let mut world = world(change, Vec::new());
        let mut answer = || {
            let is_accepted = world.receive(&LAND).is_some();
            wait(&mut world, 0.5);
            is_accepted
        };
        (0..5).map(|_| answer()).collect()
    };
    assert_eq!(answers(|_| ()), [true; 5]);
    assert_eq!(answers(|drone| drone.landing.deaf_count = 3), [false, false, false, true, true]);
    assert_eq!(answers(|drone| drone.landing.deaf_s = 0.9), [false, false, true, true, true]);
    assert_eq!(answers(|drone| drone.landing.is_refused = true), [false; 5]);
}

#[test]
fn sticks_call_a_landing_off_or_do_not() {
    let neutral = Sticks::zeros();
    for (cancelled_by, u, is_cancelled) in [
        (CancelledBy::Nothing, FORWARD, false),
        (CancelledBy::Deflection, neutral, false),
        (CancelledBy::Deflection, FORWARD, true),
        (CancelledBy::AnySticks, neutral, true),
    ] {
        let mut world = world(|drone| drone.landing.cancelled_by = cancelled_by, Vec::new());
        world.receive(&LAND);
        world.receive(&sticks(u));
        let phase =
            if is_cancelled { DronePhase::Flying } else { DronePhase::Landing(Cause::Order) };
        assert_eq!(world.truth().phase, phase, "{cancelled_by:?} {u}");
    }
}

#[test]
fn a_drone_that_hears_nothing_lands_or_keeps_on() {
    for lands in [true, false] {
        let mut world = world(|drone| drone.lands_on_silence = lands, Vec::new());
        world.receive(&sticks(FORWARD));
        wait(&mut world, 40.0);
        let phase = if lands { DronePhase::Grounded } else { DronePhase::Flying };
        assert_eq!(world.truth().phase, phase);
    }
}

#[test]
fn an_outage_levels_or_holds() {
    for (outage, is_held) in [(OutageBehaviour::Level, false), (OutageBehaviour::Held, true)] {
        let start = SimStart::Air { x: 0.0, y: 0.0, z: 1.3, theta: 0.0 };
        let drone = DroneTable { outage, ..PLAIN };
        let mut table = SimTable { profile: Profile::Outages, start, drone, ..table() };
        (table.has_spread, table.plant.disturbance_h_mps) = (false, 0.0);
        let mut world = World::new(&table, 8).unwrap();
        let (mut down_s, mut judged) = (0.0, 0);
        for _ in 0..3000 {
            // Ours turns while the link is down: that does not arrive.
            let u = if world.truth().link_is_up { FORWARD } else { -FORWARD };
            world.receive(&sticks(u));
            world.advance();
            down_s = if world.truth().link_is_up { 0.0 } else { down_s + DT_S };
            if down_s > 3.0 {
                let speed_mps = world.truth().velocity.x_mps;
                let is_right = if is_held { speed_mps > 0.7 } else { speed_mps.abs() < 0.1 };
                assert!(is_right, "{outage:?}: {speed_mps} m/s after {down_s} s");
                judged += 1;
            }
        }
        assert!(judged > 50, "{judged} steps in long outages");
    }
}

#[test]
fn stuck_sticks_leave_orders_alone_and_a_refused_landing_leaves_sticks_alone() {
    let mut world = world(|_| (), fault(InjectedFault::DroneSticksStuck, 2.0, 10.0));
    steer(&mut world, FORWARD, 2.0);
    steer(&mut world, Sticks::zeros(), 3.0);
    assert!(speed_mps(&world) > 0.7, "{} m/s", speed_mps(&world));
    assert!(world.receive(&LAND).is_some());

    let mut world = self::world(|_| (), fault(InjectedFault::DroneRefusesLand, 0.0, 5.0));
    steer(&mut world, FORWARD, 2.0);
    steer(&mut world, Sticks::zeros(), 3.02);
    assert!(speed_mps(&world) < 0.1, "{} m/s", speed_mps(&world));
    assert!(world.receive(&LAND).is_some(), "it obeys when the fault is over");
    let mut world = self::world(|_| (), fault(InjectedFault::DroneRefusesLand, 0.0, 5.0));
    assert_eq!(world.receive(&LAND), None);
    assert_eq!(world.truth().phase, DronePhase::Flying);
}

#[test]
fn a_drone_that_is_held_stays_where_it_is_and_starts_from_rest() {
    let mut world =
        world(|_| (), fault(InjectedFault::DroneHeld { sway_m: 0.0, lowered_m: 0.0 }, 2.0, 3.0));
    steer(&mut world, FORWARD, 2.02);
    let held = world.truth().pose;
    steer(&mut world, FORWARD, 2.98);
    assert_eq!((world.truth().pose, speed_mps(&world)), (held, 0.0));
    steer(&mut world, FORWARD, 0.04);
    let speed_mps = speed_mps(&world);
    assert!(speed_mps > 0.0 && speed_mps < 0.1, "{speed_mps} m/s");
}

#[test]
fn a_push_adds_its_velocity_to_that_of_the_sticks_and_ends_at_the_floor() {
    for is_rigid_body in [false, true] {
        let flown = |push: Option<[f64; 3]>| {
            let push = push.map(|velocity_w_mps| {
                fault(InjectedFault::DronePushed { velocity_w_mps }, 0.0, 9.0)
            });
            let mut table = SimTable { faults: push.unwrap_or_default(), ..air(PLAIN) };
            table.plant.rigid_body = is_rigid_body.then_some(RIGID_BODY);
            let mut world = World::new(&table, 1).unwrap();
            steer(&mut world, FORWARD, 4.0);
            world.truth()
        };
        let (free, pushed) = (flown(None), flown(Some([0.3, -0.5, -1.0])));
        let moved = pushed.pose - free.pose;
        assert!((moved[pose::X] - 1.2).abs() < 1e-9, "{moved}");
        assert!((moved[pose::Y] + 2.0).abs() < 1e-9, "{moved}");
        assert!(pushed.pose[pose::Z].abs() < 0.05, "{}", pushed.pose);
        let velocity = |truth: Truth| Vector2::new(truth.velocity.x_mps, truth.velocity.y_mps);
        let push_mps = velocity(pushed) - velocity(free);
        assert!(amax(&(push_mps - Vector2::new(0.3, -0.5))) < 1e-9, "{push_mps}");
    }
}

#[test]
fn a_second_controller_acts_as_often_as_it_sends_last() {
    let speed = |rate_hz| {
        let sticks = FORWARD.into();
        let second = InjectedFault::SecondController { sticks, rate_hz };
        let mut world = world(|_| (), fault(second, 1.0, 4.0));
        steer(&mut world, Sticks::zeros(), 1.0);
        assert!(speed_mps(&world) < 1e-9);
        steer(&mut world, Sticks::zeros(), 4.0);
        let speed_mps = speed_mps(&world);
        steer(&mut world, Sticks::zeros(), 4.0);
        assert!(self::speed_mps(&world) < 0.02, "ours act again");
        speed_mps
    };
    // 1.9 times the stick excess over its dead zone of 0.07.
    let full_mps = 1.9 * 0.43;
    for (rate_hz, expected_mps) in [(50.0, full_mps), (25.0, 0.5 * full_mps), (5.0, 0.1 * full_mps)]
    {
        let got_mps = speed(rate_hz);
        assert!((got_mps - expected_mps).abs() < 0.05, "{rate_hz} Hz: {got_mps} m/s");
    }
}

#[test]
fn a_drone_that_starts_anew_forgets_its_host_and_levels_or_falls() {
    for falls in [false, true] {
        let reboot = InjectedFault::DroneReboot { falls };
        let mut world = world(|_| (), fault(reboot, 2.02, 5.0));
        steer(&mut world, FORWARD, 2.0);
        assert!(world.flight_status().is_some());
        steer(&mut world, FORWARD, 1.0);
        assert_eq!(world.flight_status(), None);
        assert_eq!(world.truth().received.sticks, 101, "those before it");
        if falls {
            assert_eq!(world.truth().phase, DronePhase::Grounded);
        } else {
            steer(&mut world, FORWARD, 3.9);
            assert!(world.truth().phase == DronePhase::Flying && speed_mps(&world) < 0.1);
            let request = HostPacket::ConnReq { video_port: 6038 };
            assert_eq!(world.receive(&request), None, "not before it is up");
            steer(&mut world, FORWARD, 2.0);
            assert_eq!(world.flight_status(), None, "it knows no host");
            assert!(speed_mps(&world) < 0.1, "and obeys none");
            assert!(world.receive(&request).is_some() && world.flight_status().is_some());
            steer(&mut world, FORWARD, 2.0);
            assert!(speed_mps(&world) > 0.5);
        }
    }
}

#[test]
fn a_drone_may_fly_at_the_start() {
    let world = world(|_| (), Vec::new());
    assert!(world.flight_status().unwrap().is_flying());
}

#[test]
fn the_status_is_what_the_switches_make_of_it() {
    let status = |change: fn(&mut DroneTable)| {
        let mut world = world(change, Vec::new());
        steer(&mut world, FORWARD, 4.0);
        world.flight_status().unwrap()
    };
    let plain = status(|_| ());
    assert!(plain.is_flying() && plain.vel_north_dm_s == 8 && plain.height_dm == 13, "{plain:?}");
    let wrong = status(|drone| drone.status.flying = crate::FlyingFlag::Standing);
    assert!(wrong.is_on_ground() && !wrong.is_flying(), "{wrong:?}");
    let blind = status(|drone| {
        (drone.status.velocity.is_present, drone.status.has_height) = (false, false);
    });
    assert_eq!((blind.vel_north_dm_s, blind.height_dm), (0, 0));
    let turned = status(|drone| drone.status.velocity.turn_rad = std::f64::consts::FRAC_PI_2);
    assert_eq!((turned.vel_north_dm_s, turned.vel_east_dm_s), (0, -8));
}

#[test]
fn a_switch_with_a_value_outside_of_its_range_is_refused() {
    let refusal = |change: fn(&mut DroneTable)| {
        let mut drone = PLAIN;
        change(&mut drone);
        World::new(&SimTable { drone, ..table() }, 0).unwrap_err().to_string()
    };
    for (text, key) in [
        (refusal(|drone| drone.landing.deaf_s = -1.0), "drone.landing.deaf_s"),
        (refusal(|drone| drone.status.flying_late_s = f64::NAN), "drone.status.flying_late_s"),
        (refusal(|drone| drone.status.velocity.late_s = 61.0), "drone.status.velocity.late_s"),
        (refusal(|drone| drone.status.velocity.turn_rad = 11.0), "drone.status.velocity.turn_rad"),
        (refusal(|drone| drone.status.height_drift_mps = 2.0), "drone.status.height_drift_mps"),
    ] {
        assert!(text.starts_with(&format!("{key} = ")), "{text}");
    }
}
