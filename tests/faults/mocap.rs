//! The motion capture is silent, or says what cannot be true.

use horizon_model::check::maximum;
use horizon_model::rows::pose;
use tello_flight::cycle::FlightTable;
use tello_flight::{Fault, Phase};
use tello_sim::{InjectedFault, ScriptedFault, SimStart, SimTable};

use super::story::{FAULT_AT_S, Moment, fly_alone, mission, scripted, settings};

/// Neutral sticks at the latest after this time without news: `stale_s`, and two ticks. s
const NEUTRAL_AFTER_S: f64 = 0.54;

#[test]
fn mocap_silence_of_a_tenth_of_a_second_to_one_second_does_not_end_the_flight() {
    for (silence_s, is_held) in
        [(0.1, false), (0.2, false), (0.4, false), (0.5, false), (0.6, true), (1.0, true)]
    {
        let until_s = FAULT_AT_S + silence_s + 1.5;
        let story = fly_alone(&settings(&scripted(InjectedFault::MocapSilent, silence_s)), until_s);
        assert_eq!(story.has(Fault::MocapStale), is_held, "{silence_s} s");
        assert_eq!(story.last().phase, Phase::Flying, "{silence_s} s: {:?}", story.last());
        assert!(story.last_stick_s() >= Some(until_s - 0.1), "{silence_s} s: does not go on");
        let neutral = |moment: &Moment| moment.stick.is_some_and(|u| u <= 0.0);
        let held_s = story.first(FAULT_AT_S, neutral).map(|at_s| at_s - FAULT_AT_S);
        if is_held {
            assert!(held_s.is_some_and(|held_s| held_s <= NEUTRAL_AFTER_S), "after {held_s:?} s");
        }
    }
}

#[test]
fn a_pose_that_is_repeated_while_the_object_is_hidden_does_not_end_the_flight() {
    // At full speed, in corners and between both.
    for (from_s, for_s) in
        [(11.0, 0.3), (11.6, 0.5), (12.0, 0.7), (12.7, 0.6), (13.3, 0.9), (14.0, 0.8)]
    {
        let hidden = ScriptedFault { fault: InjectedFault::MocapFrozen, from_s, for_s };
        let until_s = from_s + for_s + 1.5;
        let story = fly_alone(&settings(&[hidden]), until_s);
        assert_eq!(
            story.last().phase,
            Phase::Flying,
            "{for_s} s at {from_s} s: {:?}",
            story.last()
        );
        let last_s = story.last_stick_s();
        assert!(last_s >= Some(until_s - 0.1), "{for_s} s at {from_s} s: does not go on");
    }
}

/// A flight whose mocap is wrong for good: neutral sticks in time, a landing within these limits.
fn assert_ends(fault: InjectedFault, expected: Fault, landing_s: [f64; 2]) {
    let story = fly_alone(&settings(&scripted(fault, 1e3)), 60.0);
    story.assert_landed_by(expected, landing_s);
    let last_stick_s = story.last_stick_s().map(|at_s| at_s - FAULT_AT_S);
    // What is frozen is noticed at its third repetition, up to 0.1 s later than what is missing.
    assert!(
        last_stick_s.is_some_and(|s| s <= NEUTRAL_AFTER_S + 0.1),
        "steered for {last_stick_s:?} s"
    );
}

#[test]
fn mocap_silence_of_three_seconds_lands() {
    let story = fly_alone(&settings(&scripted(InjectedFault::MocapSilent, 3.0)), 60.0);
    story.assert_landed_by(Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn an_object_that_is_lost_lands() {
    assert_ends(InjectedFault::MocapLost, Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn a_frozen_pose_is_no_pose() {
    assert_ends(InjectedFault::MocapFrozen, Fault::MocapFrozen, [1.9, 2.2]);
}

#[test]
fn a_frozen_pose_that_changes_its_last_digit_now_and_then_is_no_pose() {
    for noise_m in [1e-5, 2e-5, 3e-5, 5e-5, 1e-4] {
        let fault = InjectedFault::MocapStill {
            offset_w_m: [0.0; 3],
            turn_rad: 0.0,
            noise_m,
            noise_rad: 1e-4,
        };
        let story = fly_alone(&settings(&scripted(fault, 1e3)), 60.0);
        // The drone's velocity may land it sooner.
        story.assert_landed_by(Fault::MocapFrozen, [0.5, 2.2]);
        let last_stick_s = story.last_stick_s().map(|at_s| at_s - FAULT_AT_S);
        // Before it is known to stand still it may have been no pose for a while.
        assert!(
            last_stick_s.is_some_and(|s| s < 0.9),
            "{noise_m} m: steered for {last_stick_s:?} s"
        );
    }
}

#[test]
fn a_pose_that_is_not_a_number_is_no_pose() {
    assert_ends(InjectedFault::MocapNan, Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn a_jump_of_ten_metres_is_refused_and_lands_when_it_is_insisted_on() {
    assert_ends(InjectedFault::MocapFar, Fault::MocapJumped, [1.5, 2.1]);
}

#[test]
fn a_jump_of_three_metres_lands_as_soon_as_it_is_accepted() {
    assert_ends(InjectedFault::MocapAside, Fault::MocapJumped, [0.4, 0.7]);
}

#[test]
fn another_object_that_stands_still_lands() {
    assert_ends(InjectedFault::MocapFixed, Fault::MocapJumped, [0.4, 2.1]);
}

/// Each jump alone is too small for `jump_m`, and the vehicle would be steered between the two.
#[test]
fn an_object_in_two_places_lands_before_it_is_flown_by() {
    for (offset_m, fraction) in [(0.15, 0.5), (0.2, 0.5), (0.25, 0.5)] {
        let fault = InjectedFault::MocapSplit { offset_w_m: [offset_m, 0.0, 0.0], fraction };
        let story = fly_alone(&settings(&scripted(fault, 1e3)), 60.0);
        story.assert_landed_by(Fault::MocapRough, [0.08, 0.6]);
    }
}

/// The settings of a hover above the place of the take-off, with `fault` in it: too little motion shows the drone's
/// axes.
fn hover(fault: InjectedFault) -> (FlightTable, SimTable) {
    let (mut flight, mut sim) = settings(&scripted(fault, 1e3));
    flight.mission = mission("hover.json");
    sim.start = SimStart::Ground { x: 0.0, y: 0.0, theta: 0.0 };
    (flight, sim)
}

#[test]
fn an_object_that_changes_slowly_between_two_places_lands_and_is_followed_until_then() {
    let offset_m = 0.3;
    let fault = InjectedFault::MocapShifted { offset_w_m: [offset_m, 0.0, 0.0] };
    let (flight, mut sim) = hover(fault);
    // A second in each of the two places.
    let windows = (0..10).map(|k| ScriptedFault {
        fault,
        from_s: FAULT_AT_S + 2.0 * f64::from(k),
        for_s: 1.0,
    });
    sim.faults = windows.collect();
    let story = fly_alone(&(flight, sim), 60.0);
    // The eighth change.
    story.assert_landed_by(Fault::MocapRough, [6.9, 7.2]);
    let steered = story.moments.iter().filter(|moment| moment.landings == 0);
    let off_m = steered.map(|moment| moment.pose[pose::X].hypot(moment.pose[pose::Y]));
    let most_m = off_m.fold(0.0, maximum);
    assert!((0.5 * offset_m..2.0 * offset_m).contains(&most_m), "{most_m} m off the hover");
}

#[test]
fn an_object_that_leaves_a_hover_lands() {
    // The sooner the drone's way differs from that of the object, the sooner that is seen. Before, the motion looks
    // like an old command, and small sticks brake it.
    for (speed_mps, neutral_s, landing_s) in [(0.15, 2.0, 9.0), (0.3, 1.5, 3.3), (1.0, 1.0, 1.7)] {
        let leaves = InjectedFault::MocapWalker {
            offset_w_m: [0.0; 3],
            radius_m: 20.0,
            speed_mps,
            noise_m: 5e-4,
            noise_rad: 3e-3,
        };
        let story = fly_alone(&hover(leaves), 60.0);
        let after_s = |is_it: fn(&Moment) -> bool| {
            story.first(FAULT_AT_S, is_it).map_or(f64::INFINITY, |at_s| at_s - FAULT_AT_S)
        };
        let held_s = after_s(|moment| moment.stick.is_some_and(|u| u <= 0.0));
        assert!(held_s <= neutral_s, "{speed_mps} m/s: steered for {held_s} s");
        let landed_s = after_s(|moment| moment.landings > 0);
        assert!(landed_s <= landing_s, "{speed_mps} m/s: LAND after {landed_s} s");
        story.assert_sound();
        story.assert_down();
        let at = story.last().pose;
        let way_m = at[pose::X].hypot(at[pose::Y]);
        assert!(way_m < 1.7, "{speed_mps} m/s: {way_m} m away from the hover");
    }
}

#[test]
fn a_heading_flip_that_stays_lands_before_it_is_steered_by() {
    assert_ends(InjectedFault::MocapFlipped, Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn millimetres_in_place_of_metres_land() {
    assert_ends(InjectedFault::MocapMillimetres, Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn lines_of_another_subject_alone_land() {
    assert_ends(InjectedFault::MocapOther, Fault::MocapLost, [1.9, 2.1]);
}

#[test]
fn a_start_in_millimetres_or_outside_of_the_room_stays_on_the_ground() {
    let from_the_start =
        [ScriptedFault { fault: InjectedFault::MocapMillimetres, from_s: 0.0, for_s: 1e3 }];
    let in_millimetres = settings(&from_the_start);
    let mut outside = settings(&[]);
    outside.1.start = SimStart::Ground { x: 5.5, y: 0.0, theta: 0.0 };
    for settings in [in_millimetres, outside] {
        let story = fly_alone(&settings, 8.0);
        assert!(story.has(Fault::StartMisplaced), "{:?}", story.last());
        assert_eq!(story.last().phase, Phase::Idle);
        assert!(story.moments.iter().all(|moment| moment.take_offs == 0));
        story.assert_down();
    }
}
