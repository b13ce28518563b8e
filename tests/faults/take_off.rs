//! Conditions that keep a drone on the ground, and reactions to a drone that does not rise straight.

use tello_flight::{Fault, Phase, Pilot};
use tello_sim::{InjectedFault, ScriptedFault};

use super::story::{Moment, Story, fly_alone, settings};

/// A flight from the ground with `fault` in this time.
fn with(fault: InjectedFault, from_s: f64, for_s: f64, seconds: f64) -> Story {
    fly_alone(&settings(&[ScriptedFault { fault, from_s, for_s }]), seconds)
}

/// A drone that is kept on the ground by `fault` while `sim_fault` lasts, from the beginning on, and takes off within
/// `after_s` of its end.
fn assert_waits(sim_fault: InjectedFault, for_s: f64, fault: Fault, after_s: f64) {
    let story = with(sim_fault, 0.0, for_s, for_s + after_s);
    for moment in &story.moments {
        let is_idle = moment.phase == Phase::Idle && moment.take_offs == 0;
        assert!(moment.at_s >= for_s || is_idle, "{moment:?}");
    }
    let waits = |moment: &&Moment| moment.faults.contains(&fault);
    let waited = story.moments.iter().filter(waits).count();
    assert!(waited > story.moments.len() / 3, "{fault:?} in {waited} ticks");
    let take_off_s = story.first(0.0, |moment| moment.take_offs > 0);
    assert!(take_off_s.is_some(), "no take-off within {after_s} s: {:?}", story.last());
}

#[test]
fn a_drone_that_has_not_reported_does_not_take_off() {
    assert_waits(InjectedFault::DroneMute, 4.0, Fault::DroneUnheard, 1.0);
}

#[test]
fn noisy_poses_on_the_ground_keep_the_drone_there() {
    let noise = InjectedFault::MocapNoise { growth_mps: 0.05, growth_radps: 0.0 };
    assert_waits(noise, 6.0, Fault::MocapUnsettled, 2.0);
}

#[test]
fn a_take_off_that_drifts_is_steered_once_its_climb_has_ended() {
    let fly = |script: &[ScriptedFault]| {
        let (mut flight, sim) = settings(script);
        flight.cycle.supervisor.settle_s = 4.0;
        fly_alone(&(flight, sim), 40.0)
    };
    let steered_s =
        |story: &Story| story.first(0.0, |moment| moment.pilot == Some(Pilot::Controller)).unwrap();
    let straight_s = steered_s(&fly(&[]));
    // A draught in the climb.
    let push = InjectedFault::DronePushed { velocity_w_mps: [0.4, 0.0, 0.0] };
    let from_s = straight_s - 3.9;
    let carried = fly(&[ScriptedFault { fault: push, from_s, for_s: 1.5 }]);
    let early_s = straight_s - steered_s(&carried);
    assert!((1.2..2.5).contains(&early_s), "{early_s} s before {straight_s} s");
    carried.assert_sound();
    carried.assert_down();
    assert_eq!(carried.last().faults, [], "{:?}", carried.last());
}
