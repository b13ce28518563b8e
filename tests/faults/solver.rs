//! Solvers that fail or are late, in the whole loop: held, flown on, or landed.

use std::cell::Cell;

use horizon_model::rows::{Pose, Sticks, lag, motion, pose, stick};
use horizon_model::{Lagged, Model, Row};
use nalgebra::SVector;
use tello_flight::cycle;
use tello_flight::{Fault, Phase};
use tello_sim::virtual_time::VirtualFlight;

use super::story::{FAULT_AT_S, Moment, Story, fly, fly_with, settings};

type State = SVector<f64, { motion::COUNT }>;
type Parameter = SVector<f64, { lag::COUNT }>;

/// Which model gives NaN now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Broken {
    Nothing,
    /// The model of the controller: it plans on [`Model::core`].
    Controller,
    /// That of the estimator.
    Estimator,
}

thread_local! {
    static BROKEN: Cell<Broken> = const { Cell::new(Broken::Nothing) };
}

/// [`Lagged`], whose steps are NaN while it is broken.
#[derive(Debug, Clone, Copy)]
struct Breaking {
    model: Lagged,
    breaks_with: Broken,
}

impl Model<{ motion::COUNT }, { stick::COUNT }, { pose::COUNT }, { lag::COUNT }> for Breaking {
    const STATE: [Row; motion::COUNT] = Lagged::STATE;
    const INPUT: [Row; stick::COUNT] = Lagged::INPUT;
    const OBSERVATION: [Row; pose::COUNT] = Lagged::OBSERVATION;
    const PARAMETER: [Row; lag::COUNT] = Lagged::PARAMETER;
    const CONTROLLABLE: usize = Lagged::CONTROLLABLE;

    fn step(&self, s: &State, u: &Sticks, p: &Parameter, dt_s: f64) -> State {
        let is_broken = BROKEN.get() == self.breaks_with;
        if is_broken { State::repeat(f64::NAN) } else { self.model.step(s, u, p, dt_s) }
    }

    fn observe(&self, s: &State) -> Pose {
        self.model.observe(s)
    }

    fn at_rest(&self, o: &Pose) -> State {
        self.model.at_rest(o)
    }

    fn moving(&self, o: &Pose, rate: &Pose, s: &State) -> State {
        self.model.moving(o, rate, s)
    }

    fn coasting(&self, s: &State, p: &Parameter) -> Pose {
        self.model.coasting(s, p)
    }

    fn core(&self) -> Self {
        Self { model: self.model.core(), breaks_with: Broken::Controller }
    }

    fn effect(&self, u: &Sticks, p: &Parameter) -> Sticks {
        self.model.effect(u, p)
    }

    fn input_for(&self, effect: &Sticks, p: &Parameter) -> Sticks {
        self.model.input_for(effect, p)
    }
}

/// A flight in which `broken` fails in `ticks` ticks from [`FAULT_AT_S`] on.
#[expect(clippy::unwrap_used, reason = "a test may panic")]
fn fly_breaking(broken: Broken, ticks: u32) -> Story {
    let settings = settings(&[]);
    let model = Breaking { model: Lagged::default(), breaks_with: Broken::Estimator };
    let cycle = cycle::build_with::<_, _, _, { motion::CONTROLLABLE }>(model, &settings.0);
    let until_s = FAULT_AT_S + (f64::from(ticks) - 0.5) * settings.0.cycle.dt_s;
    let story = fly_with(cycle.unwrap(), &settings, 60.0, |at_s, _| {
        let is_broken = (FAULT_AT_S - 1e-9..until_s).contains(&at_s);
        BROKEN.set(if is_broken { broken } else { Broken::Nothing });
    });
    BROKEN.set(Broken::Nothing);
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
    let story = fly_breaking(Broken::Estimator, max);
    assert!(story.has(Fault::EstimatorFailed) && !story.has(Fault::SolverFailing));
    for moment in story.moments.iter().filter(|it| it.faults.contains(&Fault::EstimatorFailed)) {
        assert!(!steers(moment), "steered without an estimate: {moment:?}");
    }
    assert_eq!(story.last().phase, Phase::Landed, "the mission is flown to its end");
    assert!(story.last().at_s > FAULT_AT_S + 5.0, "{:?}", story.last());

    let story = fly_breaking(Broken::Estimator, max + 1);
    let dt_s = settings(&[]).0.cycle.dt_s;
    let failing_s = f64::from(max) * dt_s;
    story.assert_landed_by(Fault::SolverFailing, [failing_s - 1e-6, failing_s + 2.5 * dt_s]);
}

#[test]
fn a_controller_that_fails_flies_on_its_plan_and_one_that_goes_on_failing_is_landed() {
    let max = failures_max();
    let story = fly_breaking(Broken::Controller, max);
    assert!(story.has(Fault::ControllerFailed) && !story.has(Fault::SolverFailing));
    let failed = |it: &&Moment| it.faults.contains(&Fault::ControllerFailed);
    assert!(story.moments.iter().filter(failed).all(steers), "the plan before goes on");
    assert!(story.last().at_s > FAULT_AT_S + 5.0, "{:?}", story.last());

    let story = fly_breaking(Broken::Controller, max + 1);
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
