//! Solvers that fail or are late, in the whole loop: held, flown on, or landed.

use tello_flight::{Fault, Phase};
use tello_sim::failing_model::{self, FAILING_PART, FailingPart};
use tello_sim::virtual_time::VirtualFlight;

use super::story::{FAULT_AT_S, Moment, Story, fly, fly_with, settings};

/// A flight in which `broken` fails in `ticks` ticks from [`FAULT_AT_S`] on.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly_failing(broken: FailingPart, ticks: u32) -> Story {
    let settings = settings(&[]);
    let cycle = failing_model::cycle(&settings.0).unwrap();
    let until_s = FAULT_AT_S + (f64::from(ticks) - 0.5) * settings.0.cycle.dt_s;
    let story = fly_with(cycle, &settings, 60.0, |at_s, _| {
        let is_broken = (FAULT_AT_S - 1e-9..until_s).contains(&at_s);
        FAILING_PART.set(if is_broken { broken } else { FailingPart::Nothing });
    });
    FAILING_PART.set(FailingPart::Nothing);
    story.assert_sound();
    story
}

fn steers(moment: &Moment) -> bool {
    moment.stick.is_some_and(|stick| stick > 0.0)
}

/// Ticks in a row that a solver may fail without ending the flight.
fn failures_max() -> u32 {
    settings(&[]).0.cycle.supervisor.solver_failures_max
}

#[test]
fn an_estimator_that_fails_is_held_and_one_that_goes_on_failing_is_landed() {
    let max = failures_max();
    let story = fly_failing(FailingPart::Estimator, max);
    assert!(story.has(Fault::EstimatorFailed) && !story.has(Fault::SolverFailing));
    for moment in story.moments.iter().filter(|it| it.faults.contains(&Fault::EstimatorFailed)) {
        assert!(!steers(moment), "steered without an estimate: {moment:?}");
    }
    assert_eq!(story.last().phase, Phase::Landed, "the mission is flown to its end");
    assert!(story.last().at_s > FAULT_AT_S + 5.0, "{:?}", story.last());

    let story = fly_failing(FailingPart::Estimator, max + 1);
    let dt_s = settings(&[]).0.cycle.dt_s;
    let failing_s = f64::from(max) * dt_s;
    story.assert_landed_by(Fault::SolverFailing, [failing_s - 1e-6, failing_s + 2.5 * dt_s]);
}

#[test]
fn a_controller_that_fails_flies_on_its_plan_and_one_that_goes_on_failing_is_landed() {
    let max = failures_max();
    let story = fly_failing(FailingPart::Controller, max);
    assert!(story.has(Fault::ControllerFailed) && !story.has(Fault::SolverFailing));
    let failed = |it: &&Moment| it.faults.contains(&Fault::ControllerFailed);
    assert!(story.moments.iter().filter(failed).all(steers), "the plan before goes on");
    assert!(story.last().at_s > FAULT_AT_S + 5.0, "{:?}", story.last());

    let story = fly_failing(FailingPart::Controller, max + 1);
    let dt_s = settings(&[]).0.cycle.dt_s;
    let failing_s = f64::from(max) * dt_s;
    story.assert_landed_by(Fault::SolverFailing, [failing_s - 1e-6, failing_s + 2.5 * dt_s]);
}

#[test]
fn solvers_that_are_always_late_fly_on_to_the_end_of_the_plan_and_are_landed() {
    let late_from = |at_s: f64, flight: &mut VirtualFlight| {
        flight.set_late_at_poll((at_s >= FAULT_AT_S).then_some(0));
    };
    let story = fly(&settings(&[]), 60.0, late_from);
    // The sticks of a plan fade while it grows older, until it does not reach to now any more.
    let faded = |it: &&Moment| (FAULT_AT_S + 0.7..FAULT_AT_S + 0.9).contains(&it.at_s);
    for moment in story.moments.iter().filter(faded) {
        assert!(moment.stick.is_some_and(|stick| stick < 0.1), "{moment:?}");
    }
    assert!(story.has(Fault::ControllerFailed));
    story.assert_landed_by(Fault::SolverFailing, [0.9, 1.5]);
}
