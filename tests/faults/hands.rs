//! A person at the controls.

use horizon_model::check::maximum;
use horizon_model::rows::{Sticks, pose, stick};
use tello_flight::cycle::Operator;
use tello_flight::{Fault, Phase, Pilot, Start};
use tello_sim::plant::RIGID_BODY;
use tello_sim::{InjectedFault, ScriptedFault};

use super::story::{FAULT_AT_S, Moment, Story, asks, fly, fly_alone, scripted, settings};

/// A flight in which a person steers for 3 s.
fn by_hand_for_three_seconds(u_hand: Sticks) -> Story {
    fly(&settings(&[]), FAULT_AT_S + 7.0, |at_s, flight| {
        let is_by_hand = (FAULT_AT_S..FAULT_AT_S + 3.0).contains(&at_s);
        flight.set_manual(is_by_hand.then_some(u_hand));
    })
}

#[test]
fn a_person_takes_over_and_hands_back_without_a_jump_of_the_sticks() {
    let story = by_hand_for_three_seconds(Sticks::new(-0.6, 0.3, 0.0, 0.2));
    let by_hand = |moment: &Moment| moment.pilot == Some(Pilot::Person);
    let from_s = story.first(0.0, by_hand).unwrap_or(f64::NAN);
    assert!((from_s - FAULT_AT_S).abs() < 0.03, "took over at {from_s} s");
    // A tenth of the way between two pilots is 0.16 at most; the rest is what the controller itself moves
    // in a tick when it flies alone, mostly from one side of the dead zone to the other.
    let own = story.jump(FAULT_AT_S - 6.0, FAULT_AT_S - 0.1);
    assert!(own < 0.4, "the controller alone moves a stick by {own} in a tick");
    for (what, at_s) in [("take-over", FAULT_AT_S), ("hand-back", FAULT_AT_S + 3.0)] {
        let jump = story.jump(at_s - 0.1, at_s + 0.3);
        assert!(jump < 0.16 + own, "the sticks jumped by {jump} at the {what}, own {own}");
    }
    let in_full =
        story.moments.iter().filter(|moment| (moment.u_sent[stick::ROLL] + 0.6).abs() < 0.01);
    assert!(in_full.count() > 130, "the person's sticks did not count in full");
    let last = story.last();
    assert_eq!((last.phase, last.pilot), (Phase::Flying, Some(Pilot::Controller)), "{last:?}");
}

#[test]
fn a_person_flies_on_without_mocap() {
    let settings = settings(&scripted(InjectedFault::MocapSilent, 4.0));
    let story = fly(&settings, FAULT_AT_S + 7.0, |at_s, flight| {
        let is_by_hand = (FAULT_AT_S + 0.3..FAULT_AT_S + 5.0).contains(&at_s);
        flight.set_manual(is_by_hand.then(|| Sticks::new(0.0, 0.0, 0.3, 0.0)));
    });
    assert!(story.has(Fault::MocapLost), "{:?}", story.last());
    assert!(story.moments.iter().all(|moment| moment.landings == 0), "the person was landed");
    let last = story.last();
    assert_eq!((last.phase, last.pilot), (Phase::Flying, Some(Pilot::Controller)), "{last:?}");
}

#[test]
fn a_person_who_is_gone_is_landed() {
    let mut flight = settings(&[]);
    flight.0.cycle.supervisor.failsafe.person_gone_s = Some(10.0);
    let gone_at_s = FAULT_AT_S + 2.0;
    let story = fly(&flight, FAULT_AT_S + 25.0, |at_s, flight| {
        // A released key: towards level with the time constant of `manual.smoothing_s`.
        let decay = (-(at_s - gone_at_s).max(0.0) / 0.2).exp();
        let is_by_hand = at_s >= FAULT_AT_S;
        flight.set_manual(is_by_hand.then(|| Sticks::new(0.0, 0.4, 0.0, 0.0) * decay));
    });
    // From 0.4 to 0.02 it takes 0.6 s.
    story.assert_landed_by(Fault::PersonGone, [12.55, 12.75]);
}

#[test]
fn a_person_takes_off_and_lands_without_mocap() {
    let blind = [ScriptedFault { fault: InjectedFault::MocapSilent, from_s: 0.0, for_s: 1e3 }];
    let story = fly(&settings(&blind), 40.0, |at_s, flight| {
        flight.set_manual(Some(Sticks::new(0.0, 0.4, 0.0, 0.0)));
        let land = at_s >= FAULT_AT_S;
        flight.set_operator(if land { Operator::Land } else { Operator::FlyByHand });
    });
    story.assert_landed_by(Fault::OperatorStop, [-0.01, 0.03]);
    let moved_m = story.last().pose[pose::X] - story.moments[0].pose[pose::X];
    assert!(moved_m > 1.0, "the person's sticks moved it by {moved_m} m");
}

#[test]
fn the_emergency_stop_is_sent_at_once_and_nothing_else_follows() {
    let story = fly(&settings(&[]), 30.0, asks(Operator::EmergencyStop, FAULT_AT_S));
    let stop_s = story.first(0.0, |moment| moment.emergency_stops > 0).unwrap_or(f64::NAN);
    assert!((stop_s - FAULT_AT_S).abs() < 0.03, "stopped at {stop_s} s");
    let first = story
        .moments
        .iter()
        .find(|moment| moment.emergency_stops > 0)
        .map(|moment| moment.emergency_stops);
    assert!(first >= Some(3), "{first:?} copies");
    story.assert_sound();
    assert!(
        story.moments.iter().all(|moment| moment.landings == 0),
        "a landing after the emergency stop"
    );
    assert_eq!(story.last().phase, Phase::MotorsStopped);
    story.assert_down();
    let fell_s = story.last().at_s - stop_s;
    assert!(fell_s < 1.0, "a fall from 1.3 m takes half a second, this took {fell_s} s");
}

#[test]
fn a_drone_that_a_person_puts_down_is_landed_before_it_is_let_go() {
    for lowered_m in [0.6, 1.2] {
        let held = InjectedFault::DroneHeld { sway_m: 0.005, lowered_m };
        let story = fly_alone(&settings(&scripted(held, 6.0)), 40.0);
        story.assert_landed_by(Fault::TrackingLost, [0.9, 1.6]);
        let let_go_s = FAULT_AT_S + 6.0;
        let after = story.moments.iter().filter(|moment| moment.at_s > let_go_s);
        let highest_m = after.map(|moment| moment.pose[pose::Z]).fold(0.0, maximum);
        assert!(highest_m < 1.3 - lowered_m + 0.1, "it rises again to {highest_m} m");
    }
}

#[test]
fn a_drone_that_is_caught_at_full_speed_is_landed_at_once() {
    for is_rigid_body in [false, true] {
        for sway_m in [0.003, 0.02] {
            let held = InjectedFault::DroneHeld { sway_m, lowered_m: 0.0 };
            let mut settings = settings(&scripted(held, 60.0));
            settings.0.start = Start::Airborne;
            settings.0 = settings.0.at_speed(1.0).unwrap();
            settings.1.plant.rigid_body = is_rigid_body.then_some(RIGID_BODY);
            // On the first side, as fast as it becomes.
            settings.1.faults[0].from_s = 3.0;
            let story = fly_alone(&settings, 12.0);
            let landing_s = story.first(0.0, |moment| moment.landings > 0).unwrap();
            let case = format!("rigid body {is_rigid_body}, sway {sway_m} m: {landing_s} s");
            assert!(story.has(Fault::Immobile) && (3.1..3.7).contains(&landing_s), "{case}");
        }
    }
}
