//! Sticks of a person, of a plan and of nobody, and what the gate lets through.

use horizon_model::check::{amax, maximum};
use horizon_model::rows::{pose, stick};

use super::*;
use crate::Sighting;
use crate::cycle::sense::tests::{DT_NS, sighting, table};
use crate::cycle::tests::{LaggedCycle, cycle, status};
use crate::cycle::{Tick, Unwatched};
use crate::time::TimeNs;

const U_HAND: [f64; stick::COUNT] = [0.3, -0.2, 0.1, 0.0];

/// What the pilot proposes, and what the gate lets through.
fn steer(cycle: &mut LaggedCycle, pilot: Option<Pilot>, inbox: &Inbox) -> (Sticks, Approved) {
    let u_proposed = cycle.proposed_sticks(pilot, inbox);
    (u_proposed, cycle.pass_gate(pilot, &u_proposed, inbox))
}

#[test]
fn without_a_pilot_or_without_the_sticks_of_a_person_the_sticks_are_neutral() {
    for pilot in [None, Some(Pilot::Person)] {
        let mut cycle = cycle();
        cycle.fifo.push(&Sticks::repeat(0.5));
        let steered = steer(&mut cycle, pilot, &Inbox::new());
        assert_eq!(steered, (Sticks::zeros(), Approved::neutral()), "{pilot:?}");
    }
}

#[test]
fn a_person_needs_no_pose_and_takes_over_from_the_newest_sticks() {
    let mut cycle = cycle();
    cycle.fifo.push(&Sticks::repeat(0.5));
    let inbox = Inbox { manual: Some(U_HAND), ..Inbox::new() };
    let (first, _) = steer(&mut cycle, Some(Pilot::Person), &inbox);
    assert!(first.iter().all(|u| (0.4..0.5).contains(u)), "{first}");
    let (last, approved) =
        (0..20).map(|_| steer(&mut cycle, Some(Pilot::Person), &inbox)).last().unwrap();
    assert_eq!(last, Sticks::from(U_HAND));
    assert!(amax(&(approved.sticks() - last)) <= 0.5 / 660.0, "a step of the wire");
    // Beyond full deflection the gate refuses.
    let inbox = Inbox { manual: Some([1.1, 0.0, 0.0, 0.0]), ..inbox };
    assert_eq!(steer(&mut cycle, Some(Pilot::Person), &inbox).1, Approved::neutral());
}

#[test]
fn a_person_who_takes_over_after_ticks_without_a_pilot_begins_at_the_newest_sticks_again() {
    let mut cycle = cycle();
    let inbox = Inbox { manual: Some(U_HAND), ..Inbox::new() };
    for _ in 0..20 {
        steer(&mut cycle, Some(Pilot::Person), &inbox);
    }
    steer(&mut cycle, None, &inbox);
    cycle.fifo.push(&Sticks::repeat(-0.5));
    let (first, _) = steer(&mut cycle, Some(Pilot::Person), &inbox);
    assert!(first.iter().all(|u| (-0.5..-0.4).contains(u)), "{first}");
}

#[test]
fn in_an_outage_the_sticks_of_the_controller_are_limited_and_those_of_a_person_are_not() {
    let mut cycle = cycle();
    let (mut inbox, mut out) = (Inbox::new(), cycle.new_outcome());
    let (mut largest_up, mut largest_down) = (0.0_f64, 0.0_f64);
    // A vehicle that stays where it is, in a hand that sways by 0.01 m.
    for step in 0..400 {
        let now = TimeNs(step * DT_NS);
        inbox.open(step.unsigned_abs(), now);
        inbox.drone = Some(status(now));
        let mut at = sighting(TimeNs(0), 0).pose.unwrap();
        at[pose::X] += 0.01 * (0.1 * step as f64).sin();
        inbox.sightings.push(Sighting { pose: Some(at), ..sighting(now, 0) });
        cycle.tick(&inbox, &mut Unwatched::default(), &mut out);
        if !out.decision.unwrap().may_steer() {
            break;
        }
        let largest = if cycle.link_is_up() { &mut largest_up } else { &mut largest_down };
        *largest = maximum(*largest, amax(&out.u_sent));
    }
    let limit = table().cycle.link.unwrap().outage_stick_max.unwrap();
    assert!(largest_up > limit + 0.1, "{largest_up}");
    assert!((0.5 * limit..limit + 1e-3).contains(&largest_down), "{largest_down}");
    assert!(!cycle.link_is_up());
    let inbox = Inbox { manual: Some([0.9; stick::COUNT]), ..inbox };
    let proposed = (0..20).map(|_| steer(&mut cycle, Some(Pilot::Person), &inbox).0).last();
    assert_eq!(proposed, Some(Sticks::repeat(0.9)));
}

#[test]
fn the_sticks_of_the_controller_pass_on_a_fresh_pose_only() {
    let mut cycle = cycle();
    cycle.hand_over.blend(Pilot::Person, &Sticks::zeros(), &Sticks::repeat(0.5), 1.0);
    cycle.fifo.push(&Sticks::repeat(0.5));
    // Blend of the person's sticks, 0.5, and the neutral sticks of a missing plan, not finished.
    for (pose_age_ns, passes) in
        [(None, false), (Some(20_000_000), true), (Some(i64::MAX / 4), false)]
    {
        let now = TimeNs(i64::MAX / 2);
        cycle.memory.position_at = pose_age_ns.map(|age_ns| TimeNs(now.0 - age_ns));
        cycle.memory.heading_at = cycle.memory.position_at;
        let mut inbox = Inbox::new();
        inbox.open(0, now);
        let (u_proposed, approved) = steer(&mut cycle, Some(Pilot::Controller), &inbox);
        assert!(amax(&u_proposed) > 0.1, "{u_proposed}");
        assert_eq!(approved != Approved::neutral(), passes, "{pose_age_ns:?}");
    }
}
