//! The drone ignores orders, is silent, tired or unwilling, and the operator wants it down.

use tello_flight::cycle::Operator;
use tello_flight::{Fault, Phase};
use tello_sim::{Cause, InjectedFault, SimTable};

use super::story::{FAULT_AT_S, asks, fly, fly_alone, scripted, settings};

/// A flight in the simulator that `change` makes, with these limits of the program's own, ends by a critical battery.
fn assert_landed_by_charge([low_pct, critical_pct]: [u8; 2], change: impl FnOnce(&mut SimTable)) {
    let mut settings = settings(&[]);
    settings.0.cycle.supervisor.battery_low_pct = low_pct;
    settings.0.cycle.supervisor.battery_critical_pct = critical_pct;
    change(&mut settings.1);
    let story = fly_alone(&settings, 60.0);
    story.assert_sound();
    assert!(story.has(Fault::BatteryCritical), "{:?}", story.last());
    story.assert_down();
}

#[test]
fn the_operator_lands_the_drone() {
    let story = fly(&settings(&[]), 60.0, asks(Operator::Land, FAULT_AT_S));
    story.assert_landed_by(Fault::OperatorStop, [-0.01, 0.03]);
}

#[test]
fn a_cut_downlink_lands_the_drone() {
    let story = fly_alone(&settings(&scripted(InjectedFault::DroneMute, 1e3)), 60.0);
    // Silent for 2 s, then brought to rest in at most 1.5 s.
    story.assert_landed_by(Fault::DroneSilent, [1.9, 3.55]);
}

#[test]
fn behind_a_cut_uplink_the_drone_lands_by_itself_and_is_not_steered_on() {
    // It drifts with its last sticks, whatever is ordered, until its own watchdog brings it down after
    // 15 s: without walls, so that the lost reference is what ends the flight for control.
    let mut settings = settings(&scripted(InjectedFault::DroneDeaf, 1e3));
    settings.0.cycle.supervisor.room = None;
    let story = fly_alone(&settings, 60.0);
    story.assert_sound();
    assert!(story.has(Fault::TrackingLost), "{:?}", story.last());
    let by_itself = tello_sim::DronePhase::Landing(Cause::Silence);
    let fell_s = story.first(0.0, |moment| moment.drone == by_itself).map(|s| s - FAULT_AT_S);
    assert!(
        fell_s.is_some_and(|s| (14.9..15.1).contains(&s)),
        "its own landing after {fell_s:?} s"
    );
    story.assert_down();
}

#[test]
fn a_battery_of_thirty_per_cent_flies_one_of_seven_stays_down() {
    for (battery_pct, flies) in [(30.0, true), (15.0, true), (14.0, false), (7.0, false)] {
        let mut settings = settings(&[]);
        settings.1.battery_pct = battery_pct;
        let story = fly_alone(&settings, 9.5);
        let has_flown = story.moments.iter().any(|moment| moment.phase == Phase::Flying);
        assert_eq!(has_flown, flies, "{battery_pct} %");
        assert_eq!(story.has(Fault::BatteryLow), battery_pct < 16.0, "{battery_pct} %");
        assert_eq!(story.has(Fault::BatteryCritical), battery_pct < 8.0, "{battery_pct} %");
    }
}

#[test]
fn a_battery_that_the_drone_calls_low_or_critical_stays_down_or_lands() {
    // Charges as the drone shows them, 90 % at first, are far above the program's own limits.
    for (warns_below_pct, flies) in [(91, false), (89, true)] {
        let mut settings = settings(&[]);
        settings.1.drone.warns_below_pct = warns_below_pct;
        let story = fly_alone(&settings, 9.5);
        let has_flown = story.moments.iter().any(|moment| moment.phase == Phase::Flying);
        assert_eq!((has_flown, story.has(Fault::BatteryLow)), (flies, !flies));
        assert!(!story.has(Fault::BatteryCritical));
    }
    assert_landed_by_charge([10, 5], |sim| {
        sim.battery_pct = 60.0;
        sim.drone.drain_pct_per_s = 3.0;
        // Low at once, critical 10 s after the start of the motors.
        sim.drone.warns_below_pct = 60;
    });
}

#[test]
fn a_battery_that_runs_out_in_flight_lands_the_drone() {
    // Enough to take off; the first seconds of flight take it below the limit.
    assert_landed_by_charge([19, 19], |sim| sim.battery_pct = 20.0);
}

#[test]
fn a_take_off_that_the_drone_refuses_ends_on_the_ground_without_a_stick() {
    let mut settings = settings(&[]);
    // The drone refuses below a tenth of its charge, and does not say why.
    settings.1.battery_pct = 9.0;
    settings.1.drone.warns_below_pct = 0;
    settings.0.cycle.supervisor.battery_low_pct = 5;
    settings.0.cycle.supervisor.battery_critical_pct = 5;
    let story = fly_alone(&settings, 30.0);
    assert!(story.has(Fault::TakeOffTimeout), "{:?}", story.last());
    assert_eq!(story.last().phase, Phase::Landed);
    assert!(story.moments.iter().all(|moment| moment.stick.is_none_or(|stick| stick <= 0.0)));
    story.assert_down();
}

#[test]
fn a_drone_whose_motors_stop_in_the_air_is_not_steered_on() {
    let story =
        fly_alone(&settings(&scripted(InjectedFault::DroneReboot { falls: true }, 1.0)), 60.0);
    story.assert_landed_by(Fault::TrackingLost, [0.3, 1.0]);
}

#[test]
fn a_drone_that_lands_by_itself_and_says_that_it_stands_is_not_steered_on() {
    let mut settings = settings(&[]);
    // From low down it does not sink far enough to be off its reference.
    let hover = include_str!("../../configs/missions/hover.json").replace("1.3", "0.4");
    settings.0.mission = serde_json::from_str(&hover).unwrap();
    settings.0.cycle.supervisor.battery_low_pct = 0;
    settings.0.cycle.supervisor.battery_critical_pct = 0;
    // It lands by its own battery protection some seconds after the take-off.
    (settings.1.battery_pct, settings.1.drone.drain_pct_per_s) = (14.0, 0.5);
    settings.1.drone.warns_below_pct = 0;
    let story = fly_alone(&settings, 60.0);
    story.assert_sound();
    let is_down = |moment: &super::story::Moment| moment.drone == tello_sim::DronePhase::Grounded;
    let down_s = story.first(FAULT_AT_S, is_down).unwrap();
    let landing_s = story.first(0.0, |moment| moment.landings > 0).unwrap();
    assert!((0.9..1.6).contains(&(landing_s - down_s)), "down {down_s} s, LAND {landing_s} s");
    assert!(story.has(Fault::NotFlying), "{:?}", story.last());
    story.assert_down();
}
