//! A vehicle that something from outside holds or carries on: it looks like a command outage.

use horizon_model::check::{amax, maximum};
use horizon_model::rows::{Sticks, pose};
use tello_flight::{Fault, Phase, Start};
use tello_io::config;

use super::super::VirtualFlight;
use crate::plant::RIGID_BODY;
use crate::{InjectedFault, ScriptedFault};

/// Height of the square. m
const HEIGHT_M: f64 = 1.3;

/// Record of one tick.
struct Flown {
    height_m: f64,
    u_sent: Sticks,
    is_outage: bool,
}

/// Time of a tick. s
const DT_S: f64 = 0.02;

/// When the fault begins. s
const HELD_FROM_S: f64 = 4.0;

/// The ticks of the square from the air, with `fault` from its fifth second on, until the program ends the flight, and
/// the faults by which it does.
fn flown(fault: InjectedFault, seed: u64, is_rigid_body: bool) -> (Vec<Flown>, Vec<Fault>) {
    let (fly, mission) = config::fly(None, None).unwrap();
    let flight = config::flight(&fly, mission, Start::Airborne);
    let mut sim = crate::settings(None).unwrap();
    sim.plant.rigid_body = is_rigid_body.then_some(RIGID_BODY);
    sim.faults = vec![ScriptedFault { fault, from_s: HELD_FROM_S, for_s: 60.0 }];
    let mut flight = VirtualFlight::new(&flight, &sim, seed).unwrap();
    let mut ticks = Vec::new();
    for _ in 0..2500 {
        let height_m = flight.true_pose()[pose::Z];
        let out = flight.tick().unwrap();
        if out.phase() != Phase::Flying {
            return (ticks, out.decision.unwrap().faults.iter().collect());
        }
        let is_outage = out.link.is_some_and(|link| link.state.is_down());
        ticks.push(Flown { height_m, u_sent: out.u_sent, is_outage });
    }
    panic!("seed {seed} flies on");
}

#[test]
fn a_push_leaves_the_height_as_it_is() {
    let push = InjectedFault::DronePushed { velocity_w_mps: [0.56, 0.56, 0.0] };
    for (seed, is_rigid_body) in [(1, false), (2, false), (3, false), (3, true)] {
        let (ticks, _) = flown(push, seed, is_rigid_body);
        let off_m = |tick: &Flown| (tick.height_m - HEIGHT_M).abs();
        // From 2 s on the climb of the start is over.
        let off_m = ticks.iter().skip(100).map(off_m).fold(0.0, maximum);
        assert!(off_m < 0.08, "seed {seed}, rigid body {is_rigid_body}: {off_m} m");
    }
}

#[test]
fn a_drone_that_is_held_is_pressed_by_small_sticks_only() {
    for seed in 1..=3 {
        let (ticks, faults) =
            flown(InjectedFault::DroneHeld { sway_m: 0.0, lowered_m: 0.0 }, seed, false);
        assert_eq!(faults, [Fault::MocapLost, Fault::MocapFrozen], "seed {seed}");
        let in_outage: Vec<f64> =
            ticks.iter().filter(|tick| tick.is_outage).map(|tick| amax(&tick.u_sent)).collect();
        assert!(in_outage.len() > 100, "seed {seed}: {} ticks", in_outage.len());
        let largest = in_outage.iter().copied().fold(0.0, maximum);
        assert!(largest > 0.1 && largest < 0.401, "seed {seed}: {largest}");
    }
}

#[test]
fn a_drone_in_a_hand_that_sways_is_landed() {
    // A hand that hardly sways looks like a pose that is not the vehicle's, then like an outage (20 s, small sticks),
    // another one like outages that end: immobile.
    for (sway_m, expected, latest_s) in [
        (0.003, &[Fault::MocapLost, Fault::MocapFrozen][..], 22.0),
        (0.01, &[Fault::OutageLong], 22.0),
        (0.03, &[Fault::Immobile], 16.0),
        (0.05, &[Fault::Immobile], 16.0),
    ] {
        for (seed, is_rigid_body) in [(1, false), (2, true), (3, false)] {
            let (ticks, faults) =
                flown(InjectedFault::DroneHeld { sway_m, lowered_m: 0.0 }, seed, is_rigid_body);
            let held_s = ticks.len() as f64 * DT_S - HELD_FROM_S;
            let large = ticks.iter().filter(|tick| amax(&tick.u_sent) > 0.41);
            let large_s = large.count() as f64 * DT_S;
            let case =
                format!("sway {sway_m} m, seed {seed}: {held_s} s, {large_s} s of large sticks");
            assert_eq!(faults, expected, "{case}");
            assert!(held_s < latest_s && large_s < 9.0, "{case}");
        }
    }
}
